"""Controllers on an instrument of rolling joints in space: those of the arm, levers about contact points."""

from dataclasses import replace
from functools import cache

import gymnasium
import numpy as np
import pytest

import rj_gym  # noqa: F401  (registers its ids)
from agents.controllers import JacobianFeedback, LoadEstimate, OpenLoop
from agents.controllers.controller import Reading, env_for
from agents.controllers.measured import MeasuredArm, MeasuredTube, measured_by
from agents.controllers.privileged_feedback import PrivilegedFeedback
from agents.evaluation.floor import episode_floor
from agents.evaluation.rollout import run_episodes
from agents.learners.true_state import TrueState, TrueStateFeedback
from agents.runs.environment import EnvConfig
from rj_gym.registry import task_of
from rj_gym.tracking.config import PitchYawConfig
from rollingjoint import pitch_yaw_two_segment, solve_tensions_batch
from tests.agents.learners.checks import lanes_of

ID = "rj_gym/PitchYaw-v0"
SEEDS = range(9000, 9030)
LOADED = {"target": {"loaded": True}}


def final_errors(controller, seeds=SEEDS, **settings):
    return run_episodes(EnvConfig(ID, settings=settings), controller, seeds).final_errors


@cache
def floors():
    return episode_floor(EnvConfig(ID), SEEDS).errors


def stepped(controller, steps, lanes=20, **settings):
    """The reading after some steps of a controller, and the info of that moment."""
    env = EnvConfig(ID, settings=settings)
    env = replace(env_for(env, controller), n_envs=lanes)
    envs = gymnasium.make_vec(ID, lanes, "vector_entry_point", **env.arguments())
    observation, _ = envs.reset(seed=9000)
    controller.begin(envs.unwrapped.task, lanes)
    for _ in range(steps):
        observation, *_, info = envs.step(controller.act(observation))
    return Reading(observation, envs.unwrapped.task), info


@pytest.mark.slow
def test_every_target_is_reachable_under_the_payload():
    assert floors().max() < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("controller", [JacobianFeedback, LoadEstimate, PrivilegedFeedback])
def test_feedback_ends_at_the_floor_but_where_tensions_are_at_both_limits(controller):
    errors = final_errors(controller())
    assert np.median(errors) < 0.001 and np.mean(errors > 0.1) < 0.1


def test_open_loop_misses_most_targets_by_the_payload_alone():
    assert np.median(final_errors(OpenLoop(), load={"magnitude": [0.0, 0.0]})) < 0.02
    assert 0.3 < np.median(final_errors(OpenLoop())) < 3.0


@pytest.mark.parametrize("settings", [{}, {"mechanism": "pitch_yaw"} | LOADED], ids=["two segments", "one"])
def test_the_load_estimate_is_the_force_at_the_tip(settings):
    controller = LoadEstimate()
    reading, info = stepped(controller, 15, **settings)
    _, loads = controller.measured.loaded(reading)
    difference = np.linalg.norm(loads[:, -1, 4:7] - info["load"]["force"], axis=1)
    assert np.median(difference) < 0.01


def test_chains_with_weights_hang_as_arms_and_others_have_a_force_at_the_tip():
    assert type(measured_by(task_of(PitchYawConfig()))) is MeasuredTube
    heavy = PitchYawConfig(mechanism=pitch_yaw_two_segment(weight=0.02))
    task = task_of(heavy)
    model = measured_by(task)
    assert type(model) is MeasuredArm and model.stiffens
    draws = task.sample([np.random.default_rng(seed) for seed in range(5)])
    angle = np.arccos(draws.gravity[:, 2])
    turns = draws.gravity[:, :2] * (angle / np.sin(angle))[:, None]
    tables = model.tables(np.column_stack([turns, draws.payloads[:, 0]])), task.load_tables(draws, 0)
    tensions = np.random.default_rng(0).uniform(2.0, 8.0, (5, 8))
    first, second = (solve_tensions_batch(task.mechanism, tensions, table) for table in tables)
    np.testing.assert_allclose(first.tip, second.tip, atol=1e-8)


def test_true_state_feedback_has_the_rates_of_the_true_state():
    """Its model, at the true angles, loads and tensions, is the environment's own tip."""
    from agents.controllers.privileged_feedback import Truth, true_arm

    controller = PrivilegedFeedback()
    reading, info = stepped(controller, 12, actuation={"play_mm": [0.1, 0.5]}, sensing={"pose": "none"})
    model = true_arm(reading, Truth.of(reading))
    np.testing.assert_allclose(model.tip, info["tip"], atol=1e-3)


@pytest.mark.parametrize(("env_id", "raises"), [(ID, True), ("rj_gym/FlexibleArm-v0", False)])
def test_a_teacher_raises_tensions_where_they_hold_joints_together(env_id, raises):
    env = lanes_of(env_id, 8)
    _, info = env.reset(seed=0)
    teacher = TrueStateFeedback(env.task)
    teacher.reset(np.ones(8, bool))
    for _ in range(50):
        *_, info = env.step(teacher.act(TrueState(env.tangent(), info["target"])).astype(np.float32))
    assert np.median(info["error_mm"]) < 0.1
    highest = np.median(info["tensions"].max(axis=1))
    assert (highest > 0.9 * env.config.tension_range[1]) == raises
