"""How an arm answers its tendons: by the implicit function theorem what differences of the solver give."""

import gymnasium
import numpy as np
import pytest

from rj_gym.tracking import tangent

LANES = 6
TAUT = {"start_tension": 15.0, "tension_range": (0.5, 60.0)}  # far from the limits


def arm(steps, last=None, **settings):
    """The instrument after some steps, of which the last is given: its lanes, and info."""
    env = gymnasium.make_vec("rj_gym/ArmInstrument-v0", LANES, "vector_entry_point", **settings).unwrapped
    rng, (_, info) = np.random.default_rng(0), env.reset(seed=5)
    for step in range(steps):
        action = rng.uniform(-0.5, 0.5, (LANES, 8))
        info = env.step(action if last is None or step < steps - 1 else last)[-1]
    return env, info


def forward_differences(env, monkeypatch):
    """The tangent as it is where no linear system gives it."""
    with monkeypatch.context() as patched:
        patched.setattr(tangent, "_implicit_rates", lambda *lanes: None)
        return env.tangent()


@pytest.mark.parametrize("settings", [{}, TAUT])
def test_without_friction_rates_are_those_of_forward_differences(settings, monkeypatch):
    env, _ = arm(5, friction=None, **settings)
    found = env.tangent()
    expected = forward_differences(env, monkeypatch)
    np.testing.assert_allclose(found.tip_rates, expected.tip_rates, atol=1e-3)
    np.testing.assert_allclose(found.tension_rates, expected.tension_rates, atol=1e-3)
    np.testing.assert_allclose(found.length_rates, expected.length_rates, atol=1e-4)
    assert found.held.any() == (settings == {})


def test_a_lane_at_the_edge_of_buckling_leaves_all_lanes_to_forward_differences(monkeypatch):
    env, _ = arm(2, friction=None, **TAUT)
    expected = forward_differences(env, monkeypatch)

    def singular(*solved):
        H, torques = stiffnesses(*solved)
        H[2] = 0.0
        return H, torques

    stiffnesses = tangent.stiffnesses
    monkeypatch.setattr(tangent, "stiffnesses", singular)
    found = env.tangent()
    for name in ("tip_rates", "tension_rates", "length_rates"):
        assert np.array_equal(getattr(found, name), getattr(expected, name))
    assert (np.abs(expected.tension_rates).max(axis=(1, 2)) > 0).all()


def test_with_friction_rates_are_those_of_the_step_that_was_taken():
    """Against central differences of the last action, where neither play nor a tension limit is in its way."""
    settings = {"actuation": {"play_mm": 0.0, "sheath_friction": 0.0}, "friction": {"mu": 0.1}} | TAUT
    last, h = np.random.default_rng(1).uniform(-0.5, 0.5, (LANES, 8)), 1e-3
    env, _ = arm(4, last, **settings)
    found = env.tangent()
    assert not found.held.any()
    for j in range(8):
        (_, more), (_, less) = (arm(4, last + way * h * np.eye(8)[j], **settings) for way in (1, -1))
        for name, rates in (("tip", found.tip_rates), ("tensions", found.tension_rates)):
            expected = -(more[name] - less[name]) / (2 * h)  # an action of 1 shortens the command by 1 mm
            np.testing.assert_allclose(rates[:, :, j], expected, atol=0.05 * np.abs(expected).max(), err_msg=name)
