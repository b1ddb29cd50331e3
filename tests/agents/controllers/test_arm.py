"""Controllers on the arm: what each is for, and what the model of an arm makes of a tip, commands and tensions."""

from functools import cache

import gymnasium
import numpy as np
import pytest

import rj_gym  # noqa: F401  (registers its ids)
from agents.controllers import JacobianFeedback, LoadEstimate, OpenLoop, Predictive
from agents.controllers.controller import Reading
from agents.controllers.measured import measured_by
from agents.controllers.steps import nearest_tensions
from agents.evaluation.floor import episode_floor
from agents.evaluation.rollout import run_episodes
from agents.runs.environment import EnvConfig
from rj_gym.registry import task_of
from rj_gym.tracking.config import FlexibleArmConfig
from rollingjoint import flexible_arm, solve_tensions_batch

ARM = "rj_gym/FlexibleArm-v0"
SEEDS = range(9000, 9030)
UPRIGHT = {"gravity": {"tilt": [0.0, 0.0]}, "load": {"magnitude": [0.0, 0.0]}}
FEEDBACK = [JacobianFeedback, LoadEstimate, pytest.param(Predictive, marks=pytest.mark.slow)]


def final_errors(controller, seeds=SEEDS, env_id=ARM, **settings):
    return run_episodes(EnvConfig(env_id, settings=settings), controller, seeds).final_errors


@cache
def floors():
    return episode_floor(EnvConfig(ARM), SEEDS).errors


def stepped(controller, steps=4, lanes=20, **settings):
    """What is seen after some steps of a controller, and the info of that moment, with what was sampled."""
    env = gymnasium.make_vec(ARM, lanes, "vector_entry_point", **settings)
    observation, info = env.reset(seed=9000)
    sampled = info["sampled"]
    controller.begin(env.unwrapped.task, lanes)
    for _ in range(steps):
        observation, *_, info = env.step(controller.act(observation))
    return Reading(observation, env.unwrapped.task), info | {"sampled": sampled}


def test_open_loop_reaches_the_target_where_the_arm_hangs_upright_without_payload():
    assert final_errors(OpenLoop(), SEEDS[:10], **UPRIGHT).max() < 0.5
    assert np.median(final_errors(OpenLoop(), SEEDS[:10])) > 20


@pytest.mark.slow
@pytest.mark.parametrize("controller", FEEDBACK)
def test_feedback_ends_near_the_floor(controller):
    """Measured for these seeds: the largest regret is 0.007 mm; docs/results.md has 1,000 episodes."""
    regret = final_errors(controller()) - floors()
    assert regret.mean() < 0.01
    assert regret.max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("controller", FEEDBACK)
def test_feedback_works_on_the_goal_environment_with_orientations_and_without_observed_tensions(controller):
    settings = {"orientation": True, "observe_tensions": False}
    errors = final_errors(controller(), SEEDS[:10], "rj_gym/FlexibleArmGoal-v0", **settings)
    assert np.median(errors) < 0.1


@pytest.mark.parametrize("controller", FEEDBACK)
def test_feedback_works_on_another_arm_with_a_payload_that_changes(controller):
    load = {"magnitude": [0.0, 0.3], "process": "step"}
    assert np.median(final_errors(controller(), SEEDS[:20], mechanism="small_arm", load=load)) < 0.2


@pytest.mark.slow
@pytest.mark.parametrize("controller", FEEDBACK)
def test_feedback_survives_noise_and_an_arm_that_differs_from_its_model(controller):
    spreads = {"stiffness_spread": 0.2, "hinge_stiffness_spread": 0.1, "weight_spread": 0.1}
    randomization = spreads | {"position_noise_mm": 1.0, "actuator_offset_mm": 0.3}
    errors = final_errors(controller(), SEEDS[:20], randomization=randomization)
    assert np.median(errors) < 2.0
    assert errors.max() < 10.0


def test_tensions_stay_within_their_range_and_are_not_pulled_up():
    seen, _ = stepped(JacobianFeedback(), 40)
    low, high = seen.task.config.tension_range
    assert seen.tensions.min() > low + 0.01
    assert seen.tensions.max() < high - 0.01
    assert np.median(seen.tensions) < 8.0


def test_the_unloaded_model_is_the_arm_where_gravity_is_as_assumed():
    seen, _ = stepped(JacobianFeedback(), **UPRIGHT)
    model = measured_by(seen.task).unloaded(seen)
    np.testing.assert_allclose(model.tip, seen.tip, atol=1e-2)
    np.testing.assert_array_equal(model.tensions, seen.tensions)


@pytest.mark.parametrize("observe", [True, False])
def test_tip_and_tensions_tell_gravity_and_payload(observe):
    """Measured: 0.001 N and 0.0001 rad; without observed tensions the tip's numbers have to do, and it is a guess."""
    controller = LoadEstimate()
    seen, info = stepped(controller, 15, observe_tensions=observe)
    model, loads = controller.measured.loaded(seen)
    sampled = info["sampled"]
    payload = np.linalg.norm(loads[:, -1, 4:7], axis=1)
    weight = loads[:, 1, 4:7]
    direction = weight / np.linalg.norm(weight, axis=1, keepdims=True)
    tilt = np.linalg.norm(direction - sampled["gravity"], axis=1)
    assert np.median(np.linalg.norm(model.tip - seen.tip, axis=1)) < (0.1 if observe else 1.0)
    assert np.median(np.abs(payload - sampled["payloads"][:, -1])) < (0.02 if observe else 0.3)
    assert np.median(tilt) < (0.01 if observe else 0.3)


def test_the_estimate_s_load_tables_are_the_task_s():
    task = task_of(FlexibleArmConfig())
    episodes = task.sample([np.random.default_rng(seed) for seed in range(5)])
    angle = np.arccos(episodes.gravity[:, 2])
    turns = episodes.gravity[:, :2] * (angle / np.sin(angle))[:, None]
    tables = measured_by(task).tables(np.column_stack([turns, episodes.payloads[:, 0]]))
    tensions = np.random.default_rng(0).uniform(1.0, 5.0, (5, 8))
    both = (tables, task.load_tables(episodes, 0))
    ours, theirs = (solve_tensions_batch(task.mechanism, tensions, some) for some in both)
    np.testing.assert_allclose(ours.tip, theirs.tip, atol=1e-8)


def test_the_model_inverse_puts_the_hanging_tip_on_reachable_targets():
    arm, rng = flexible_arm(), np.random.default_rng(0)
    hanging = [arm.gravity((0, 0, 1))]
    targets = solve_tensions_batch(arm, rng.uniform(1.0, 5.0, (10, 8)), hanging).tip
    rest = np.full((10, 8), 3.0)
    tensions = nearest_tensions(arm, targets, (0.5, 15.0), rest, rest, hanging)
    assert np.linalg.norm(solve_tensions_batch(arm, tensions, hanging).tip - targets, axis=1).max() < 0.5


def test_unobserved_tensions_are_those_of_the_hanging_model():
    seen, info = stepped(JacobianFeedback(), observe_tensions=False, **UPRIGHT)
    np.testing.assert_allclose(seen.tensions, info["tensions"], atol=1e-2)
