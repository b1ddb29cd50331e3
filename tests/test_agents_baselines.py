import gymnasium
import numpy as np
import pytest

import rj_gym  # noqa: F401  (registers its ids)
from agents.baselines import DoNothing, OpenLoop, nearest_tensions
from agents.rollout import error_table, run_episode, run_episodes
from rollingjoint.presets import preset
from rollingjoint.solve import solve_tensions

ENV = "rj_gym/RollingJoint-v0"


@pytest.fixture
def unloaded():
    env = gymnasium.make(ENV, load={"magnitude": (0.0, 0.0)})
    yield env
    env.close()


def test_open_loop_reaches_the_target_where_there_is_no_load(unloaded):
    final = error_table(run_episodes(unloaded, OpenLoop(), range(10)))[:, -1]
    assert final.max() < 0.5


def test_doing_nothing_misses_the_target(unloaded):
    errors = error_table(run_episodes(unloaded, DoNothing(), range(10)))
    assert np.median(errors[:, -1]) > 5
    assert np.allclose(errors, errors[:, :1], atol=1e-6)


def test_open_loop_follows_a_moving_target(unloaded):
    env = gymnasium.make(ENV, load={"magnitude": (0.0, 0.0)}, target={"process": "path"}, episode_steps=200)
    errors = error_table(run_episodes(env, OpenLoop(), range(3)))
    assert np.median(errors[:, -50:]) < 1.0


def test_open_loop_does_not_look_at_the_load():
    env = gymnasium.make(ENV)
    lengths = []
    for force in ((0.0, 0.0), (0.5, -0.5)):
        controller = OpenLoop()
        observation, _ = env.reset(seed=3, options={"target": (-40.0, 65.0), "load": {"link": 4, "force": force}})
        controller.reset(env)
        controller.act(observation, env)
        lengths.append(controller.lengths)
    np.testing.assert_array_equal(lengths[0], lengths[1])


@pytest.mark.parametrize("name", ["five_link", "two_segment"])
def test_the_model_command_puts_the_unloaded_tip_on_a_reachable_target(name):
    mechanism = preset(name)
    rng = np.random.default_rng(0)
    start = np.full(mechanism.n_tendons, 3.0)
    for _ in range(5):
        wanted = rng.uniform(1.5, 5.0, mechanism.n_tendons)
        target = solve_tensions(mechanism, wanted).tip
        tensions = nearest_tensions(mechanism, target, (0.5, 15.0), start)
        assert np.all((tensions >= 0.5) & (tensions <= 15.0))
        assert np.linalg.norm(solve_tensions(mechanism, tensions).tip - target) < 0.1


def test_the_same_seed_gives_every_controller_the_same_episode():
    env = gymnasium.make(ENV)
    first = [run_episode(env, controller, seed=42).errors[0] for controller in (DoNothing(), OpenLoop(), DoNothing())]
    assert first[0] == first[1] == first[2]
