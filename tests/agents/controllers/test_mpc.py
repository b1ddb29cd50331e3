"""Predictive control over a receding horizon: exact expansions, plans that are minima, and what it is good for."""

import pickle

import numpy as np
import pytest
from scipy.optimize import minimize

from agents.controllers.controller import Controller
from agents.controllers.horizon import Goals
from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.mpc import (
    FilterMpc,
    FilterMpcSettings,
    Mpc,
    MpcFeedbackSettings,
    MpcSettings,
    Planner,
    PlanStart,
    PrivilegedMpc,
)
from agents.controllers.privileged_feedback import PrivilegedFeedback
from agents.controllers.steps import FeedbackSettings
from agents.controllers.tuned import _mpc_in, tuned_controllers
from agents.evaluation.rollout import run_episodes
from agents.runs.environment import EnvConfig
from rj_gym.registry import registered_settings, task_of
from rollingjoint import WorldForce, solve_tensions_batch
from rollingjoint.errors import ConfigError

SEEDS = range(5_000_000, 5_000_016)
MOVING = {"episode_steps": 100, "target": {"process": "path"}, "load": {"magnitude": [0.0, 1.0]}}
LIMITS = 1.225, 14.275  # N


def planner(horizon: int = 4, solves: int = 40, mechanism: str = "five_link", **weights: float) -> Planner:
    task = task_of(registered_settings("rj_gym/RollingJoint-v0", {"mechanism": mechanism}))
    return Planner(task, MpcSettings(horizon=horizon, solves=solves), FeedbackSettings(gain=1.0, **weights))


def belief(plans: Planner, load: float = 0.3, count: int = 1) -> PlanStart:
    """Of a chain pulled by 4 N, a side force at its tip unknown to the measured tip."""
    chain = plans.task.mechanism
    tensions = np.full((count, chain.n_tendons), 4.0)
    there = solve_tensions_batch(chain, tensions, [WorldForce(-1, (load, 0.1))])
    commands = there.lengths - tensions / chain.stiffnesses
    stiff = np.broadcast_to(chain.stiffnesses, tensions.shape)
    return PlanStart(commands, stiff, there.loads, there.joint_angles, there.tip + 0.4, tensions)


def cost_of(plans: Planner, start: PlanStart, target: np.ndarray, moves: np.ndarray) -> tuple[float, np.ndarray]:
    """The cost of moves (N, m) from a belief, and its derivatives by the commands of all stages."""
    plans.reset(np.ones(1, bool))
    plans._moves[:] = moves
    rows = plans._rows_of(start)
    low, high = (np.full_like(start.tensions, limit) for limit in LIMITS)
    motion = np.zeros((1, 2))
    goals = Goals(plans._targets(start.tip, target, motion), start.tip, start.tensions, low, high, np.full(1, np.nan))
    plans._improve(rows.solved(), goals, rows.plans, plans._weights, True, True)
    return float(rows.plans.cost[0]), 2.0 * rows.plans.slopes[0]


@pytest.mark.parametrize("mechanism", ["five_link", "two_segment"])
def test_stages_are_expanded_exactly(mechanism: str) -> None:
    plans = planner(mechanism=mechanism, stiffen=0.1, damping=0.2)
    start, rng = belief(plans), np.random.default_rng(0)
    target, moves = start.tip + 9.0, 0.4 * rng.standard_normal((4, plans.task.mechanism.n_tendons))
    _, slopes = cost_of(plans, start, target, moves)
    # a move changes the commands of all later stages
    by_moves = np.cumsum(slopes[::-1], axis=0)[::-1] + 2.0 * 0.2**2 * moves
    for s in range(4):
        for j in range(moves.shape[1]):
            step = np.zeros_like(moves)
            step[s, j] = 1e-5
            more, less = (cost_of(plans, start, target, moves + way * step)[0] for way in (1.0, -1.0))
            assert (more - less) / 2e-5 == pytest.approx(by_moves[s, j], rel=1e-5, abs=1e-5)


@pytest.mark.parametrize(("reach", "share"), [(2.0, 1e-5), (30.0, 0.01)])
def test_a_plan_is_the_minimum_of_its_cost(reach: float, share: float) -> None:
    """Far away tendons meet their lowest tension, where the cost has kinks."""
    plans = planner(stiffen=0.1, damping=0.3)
    start = belief(plans)
    target, size = start.tip + np.array([[reach, -0.3 * reach]]), plans.task.config.action_scale_mm
    plans.reset(np.ones(1, bool))
    plans.moves(start, target, np.zeros((1, 2)), LIMITS, np.full(1, np.nan))
    ours = next(iter(plans._rows.values())).plans
    planned, cost = ours.moves[0].copy(), float(ours.cost[0])

    def value(flat: np.ndarray) -> tuple[float, np.ndarray]:
        moves = flat.reshape(planned.shape)
        total, slopes = cost_of(plans, start, target, moves)
        return total, (np.cumsum(slopes[::-1], axis=0)[::-1] + 2.0 * 0.3**2 * moves).ravel()

    bounds = [(-size, size)] * planned.size
    best = minimize(value, np.zeros(planned.size), jac=True, bounds=bounds, method="L-BFGS-B", tol=1e-14)
    assert cost <= best.fun * (1.0 + share)
    assert np.abs(planned).max() <= size


def test_far_targets_take_the_largest_moves_and_near_ones_none_beyond_limits() -> None:
    plans = planner(horizon=10, solves=4)
    start = belief(plans)
    plans.reset(np.ones(1, bool))
    moves = plans.moves(start, start.tip + 40.0, np.zeros((1, 2)), LIMITS, np.full(1, np.nan))
    assert np.abs(moves).max() == plans.task.config.action_scale_mm


def test_a_model_without_equilibria_gives_finite_moves() -> None:
    plans = planner()
    start = belief(plans)
    loads = start.loads.copy()
    loads[..., 1:3] = 1e9
    plans.reset(np.ones(1, bool))
    moves = plans.moves(start._replace(loads=loads), start.tip, np.zeros((1, 2)), LIMITS, np.full(1, np.nan))
    assert np.isfinite(moves).all()


def mean_error(controller: Controller, settings: dict, env_id: str = "rj_gym/RollingJoint-v0") -> float:
    env = EnvConfig(env_id, settings=settings)
    return float(run_episodes(env, controller, SEEDS).last_errors.mean())


def test_it_follows_moving_targets_more_closely_than_feedback() -> None:
    assert mean_error(Mpc(), MOVING) < 0.8 * mean_error(JacobianFeedback(), MOVING)


@pytest.mark.parametrize("settings", [{}, {"mechanism": "two_segment"}], ids=str)
def test_it_ends_where_feedback_ends(settings: dict) -> None:
    assert mean_error(Mpc(), settings) < 1.02 * mean_error(JacobianFeedback(), settings) + 1e-3


def test_an_episode_does_not_depend_on_others() -> None:
    env = EnvConfig("rj_gym/RollingJoint-v0", settings=MOVING)
    alone, together = (run_episodes(env, Mpc(), SEEDS[:4], batch=batch).errors for batch in (1, 4))
    assert np.allclose(alone, together, rtol=0.0, atol=1e-6)


@pytest.mark.slow
def test_it_knows_the_true_state_where_it_may() -> None:
    settings = MOVING | {"randomization": {"position_noise_mm": 1.0}}
    seen, true = mean_error(Mpc(), settings), mean_error(PrivilegedMpc(), settings)
    assert PrivilegedMpc.privileged
    assert true < 0.5 * seen
    assert true < 0.8 * mean_error(PrivilegedFeedback(), settings)


def test_it_plans_on_filters_and_on_smoothers() -> None:
    few = {"filter": {"hypotheses": 4}, "probe": {"sweep_mm": 3.0}}
    assert mean_error(FilterMpc(FilterMpcSettings.from_dict(few)), {}, "rj_gym/Instrument-v0") < 2.0
    assert mean_error(_mpc_in("rj_gym/Instrument-v0", "smoother")({}), {}, "rj_gym/Instrument-v0") < 1.0


@pytest.mark.slow
def test_arms_are_planned_on_the_fit_of_their_smoother() -> None:
    arm, seeds = "rj_gym/ArmInstrument-v0", range(5_000_000, 5_000_016)
    plans = _mpc_in(arm, "smoother")({"mpc": {"solves": 8}, "feedback": {"gain": 0.8, "damping": 0.2, "stiffen": 0.1}})
    errors = [
        run_episodes(EnvConfig(arm), controller, seeds).last_errors.mean()
        for controller in (plans, tuned_controllers(arm)["smoother"])
    ]
    assert errors[0] < errors[1] < 2.5


@pytest.mark.slow
def test_rolling_joints_in_space_reach_their_targets() -> None:
    assert mean_error(Mpc(), {}, "rj_gym/PitchYaw-v0") < 0.05


def test_pickles_drive_on() -> None:
    task = task_of(registered_settings("rj_gym/RollingJoint-v0", {}))
    controller = Mpc()
    controller.begin(task, 2)
    restored = pickle.loads(pickle.dumps(controller))
    assert restored.planner.settings == controller.planner.settings


def test_settings_are_checked() -> None:
    with pytest.raises(ConfigError, match=r"mpc\.horizon = 0"):
        MpcFeedbackSettings.from_dict({"mpc": {"horizon": 0}})
