"""The protocol of controllers: episodes that begin apart, classes of users, functions, and the true state."""

from functools import partial

import numpy as np
import pytest

from agents.controllers import Controller, DoNothing, FunctionController, OpenLoop, Reading
from agents.controllers.controller import as_controller
from agents.controllers.open_loop import FrictionOpenLoop
from agents.controllers.privileged_feedback import PrivilegedFeedback
from agents.controllers.residual import BaseController, ResidualPolicy, controllers_in
from agents.evaluation.rollout import run_episodes
from agents.policies.loading import load_policy
from agents.runs.environment import EnvConfig, make_vector_env
from rollingjoint.errors import InvalidInput

STEPS, POLICY = 8, load_policy("instrument", version=0)
RUBBING = {"friction": {"mu": (0.05, 0.2)}}
ALL = [
    *(("rj_gym/RollingJoint-v0", name, {}) for name in controllers_in("rj_gym/RollingJoint-v0")),
    ("rj_gym/FlexibleArm-v0", "load estimate", {}),
    ("rj_gym/Instrument-v0", "predictive bank", {}),
    ("rj_gym/LatePose-v0", "smith predictor", {}),
    ("rj_gym/SlowCamera-v0", "smith predictor", {}),
    ("rj_gym/Instrument-v0", "probing bank", {}),
    ("rj_gym/Instrument-v0", "bank of filters", {}),
    ("rj_gym/Instrument-v0", "smoother", {}),
    ("rj_gym/RollingJoint-v0", FrictionOpenLoop, RUBBING),
    ("rj_gym/Instrument-v0", partial(load_policy, "instrument", version=0), POLICY.environment.settings),
    ("rj_gym/Instrument-v0", lambda: ResidualPolicy(BaseController(OpenLoop()), DoNothing()), {}),
]


def made(env_id, name):
    return controllers_in(env_id)[name] if isinstance(name, str) else name()


@pytest.mark.parametrize(("env_id", "name", "settings"), ALL)
def test_an_episode_that_begins_later_is_driven_as_one_that_begins_at_once(env_id, name, settings):
    """Two lanes; the second begins again after some steps: from there its actions are those of a lane of its own."""
    env = EnvConfig(env_id, settings=settings)
    envs, alone = make_vector_env(env, 2), make_vector_env(env, 2)
    controller, other = made(env_id, name), made(env_id, name)
    observation, _ = envs.reset(seed=[5, 6])
    kept, _ = alone.reset(seed=[5, 7])
    controller.begin(envs.task, 2)
    other.begin(alone.task, 2)
    for _ in range(STEPS):
        observation, *_ = envs.step(controller.act(observation))
    mask = np.array([False, True])
    observation, _ = envs.reset(seed=[5, 7], options={"reset_mask": mask})
    controller.reset(mask)
    for _ in range(STEPS):
        actions, expected = controller.act(observation), other.act(kept)
        np.testing.assert_allclose(actions[1], expected[1], atol=1e-6)
        observation, *_ = envs.step(actions)
        kept, *_ = alone.step(expected)


class Halved(OpenLoop):
    """As classes of users were written for the protocol of 0.1.0."""

    def begin(self, task, episodes):
        super().begin(task, episodes)
        self.episodes = episodes

    def act(self, seen):
        assert seen.tip.shape == (self.episodes, 2)
        return 0.5 * super().act(seen)


class Apart:
    """The same without a base class."""

    def begin(self, task, episodes):
        self.inner = OpenLoop()
        self.inner.begin(task, episodes)

    def act(self, seen):
        assert np.isfinite(seen.error).all()
        return 0.5 * self.inner.act(seen)


class Slow(OpenLoop):
    def act(self, observations):
        return 0.5 * super().act(observations)


def test_classes_with_begin_and_act_of_readings_drive_as_before():
    env, seeds = EnvConfig(settings={"episode_steps": 6}), [1, 2, 3]
    expected = run_episodes(env, Slow(), seeds).errors
    for controller in (Halved(), Apart()):
        np.testing.assert_array_equal(run_episodes(env, controller, seeds).errors, expected)


def test_functions_are_controllers_and_numbers_are_not():
    def zeros(observations):
        return np.zeros((len(observations), 2))

    env, seeds = EnvConfig(settings={"episode_steps": 6}), [1, 2]
    expected = run_episodes(env, DoNothing(), seeds).errors
    np.testing.assert_array_equal(run_episodes(env, zeros, seeds).errors, expected)
    assert isinstance(as_controller(zeros), FunctionController)
    with pytest.raises(InvalidInput, match="a function from observations"):
        as_controller(7)


def test_some_episodes_of_an_earlier_class_cannot_begin_apart():
    with pytest.raises(InvalidInput, match="no reset"):
        as_controller(Apart()).reset(np.array([True, False]))


def test_a_privileged_controller_is_given_the_state():
    env, seeds = EnvConfig("rj_gym/Instrument-v0", settings={"episode_steps": 6}), [1, 2]
    assert PrivilegedFeedback.privileged and not OpenLoop.privileged
    assert np.isfinite(run_episodes(env, PrivilegedFeedback(), seeds).errors).all()


def test_readings_of_a_controller_are_of_its_task():
    class Noting(Controller):
        def act(self, observations):
            self.reading = self.read(observations)
            return np.zeros((len(observations), 2))

    noting = Noting()
    run_episodes(EnvConfig(settings={"episode_steps": 1}), noting, [1])
    assert isinstance(noting.reading, Reading) and noting.reading.tip.shape == (1, 2)
