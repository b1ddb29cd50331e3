"""How a chain answers its tendons: what pictures show, and its derivatives by the commands."""

import gymnasium
import numpy as np
import pytest

import rj_gym  # noqa: F401  (registers its ids)

LANES, ACTION = 6, np.random.default_rng(1).uniform(-0.5, 0.5, (6, 2))


def lanes(pose, action=ACTION):
    """Lanes after one step: what they answer, and their observations by name, (B,) each."""
    env = gymnasium.make_vec("rj_gym/RollingJoint-v0", LANES, "vector_entry_point", sensing={"pose": pose}).unwrapped
    env.reset(seed=5)
    observation = env.step(action)[0]
    names = [entry.name for entry in env.task.entries()]
    return env, env.tangent(), dict(zip(names, observation.T, strict=True))


@pytest.mark.parametrize(("pose", "links"), [("all", 4), ("tip", 1), ("none", 0)])
def test_poses_are_what_the_observation_shows_of_the_links(pose, links):
    env, found, seen = lanes(pose)
    assert found.poses.shape == (LANES, 4 * links) and len(env.task.pictured) == 4 * links
    for name, column in zip(env.task.pictured, found.poses.T, strict=True):
        unit = 1.0 if "angle" in name else env.task.length
        np.testing.assert_allclose(seen[name], column / unit, atol=1e-6, err_msg=name)


def test_rates_are_those_of_the_step_that_was_taken():
    (_, found, _), h = lanes("all"), 1e-4
    assert not found.held.any()
    for j in range(2):
        more, less = (lanes("all", ACTION + way * h * np.eye(2)[j])[1] for way in (1, -1))
        for name, rates in (("poses", found.pose_rates), ("tips", found.tip_rates), ("tensions", found.tension_rates)):
            expected = -(getattr(more, name) - getattr(less, name)) / (2 * h)  # an action of 1 pulls by 1 mm
            np.testing.assert_allclose(rates[:, :, j], expected, atol=2e-3 * np.abs(expected).max(), err_msg=name)
