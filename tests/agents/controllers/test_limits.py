"""Controllers where limits of tension act at the motors: privileged ones know them, others plan below them."""

import numpy as np
import pytest

from agents.controllers.privileged_feedback import PrivilegedFeedback, Truth
from agents.controllers.tuned import tuned_controllers
from agents.evaluation.floor import episode_floor
from agents.evaluation.rollout import run_episodes
from agents.learners.true_state import TrueState, TrueStateFeedback
from agents.runs.environment import EnvConfig
from rollingjoint.transmission import pull_limit
from tests.agents.learners.checks import lanes_of

WORLDS = ["Instrument", "InstrumentShift", "SlowCamera", "LatePose", "ArmInstrument"]


def test_a_privileged_controller_knows_the_limit_of_every_motor_behind_its_sheath():
    env = lanes_of("rj_gym/Instrument-v1", 6, privileged="observation")
    observation, info = env.reset(seed=0)
    controller = PrivilegedFeedback()
    controller.begin(env.task, 6)
    controller.act(observation)
    sampled = info["sampled"]
    limits = pull_limit(sampled["tension_limits"], sampled["sheath_friction"], sampled["play_mm"] / 2)
    np.testing.assert_allclose(Truth.of(controller.read(observation)).limits, limits, rtol=1e-6)
    np.testing.assert_allclose(controller.tension_range[1], limits - 0.05 * (limits - 0.5), rtol=1e-6)


def test_feedback_on_the_true_state_reaches_targets_and_keeps_from_limits():
    env = lanes_of("rj_gym/Instrument-v1", 12)
    _, info = env.reset(seed=0)
    teacher = TrueStateFeedback(env.task)
    teacher.reset(np.ones(12, bool))
    stopped = 0
    for _ in range(50):
        actions = teacher.act(TrueState(env.tangent(), info["target"]))
        *_, info = env.step(actions.astype(np.float32))
        tangent = env.tangent()
        stopped += int((tangent.stays | tangent.in_play | tangent.held).sum())
    assert info["error_mm"].mean() < 0.3 and stopped < 0.05 * 50 * 24


@pytest.mark.slow
@pytest.mark.parametrize("stem", WORLDS)
def test_every_tuned_controller_of_a_world_drives_its_version_1(stem):
    env = EnvConfig(f"rj_gym/{stem}-v1", settings={"episode_steps": 4})
    for name, controller in tuned_controllers(env.id).items():
        assert np.all(np.isfinite(run_episodes(env, controller, range(2)).last_errors)), name


def test_the_floor_of_version_1_uses_tensions_up_to_the_largest_limit():
    first, second = (
        episode_floor(EnvConfig("rj_gym/Instrument-v1", settings={"actuation": {"tension_limit": limit}}), range(8))
        for limit in (4.0, 30.0)
    )
    assert first.tensions.max() < 4.0 + 1e-6 < second.tensions.max() < 30.0 + 1e-6
    assert np.all(second.errors <= first.errors + 1e-3)
