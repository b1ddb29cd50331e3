"""Joint angles between the limits of their joints."""

from typing import NamedTuple

import numpy as np
import pytest

from rollingjoint._numba.jit import standalone
from rollingjoint.kernels import bounds

begin, move, moved = standalone(bounds.begin), standalone(bounds.move), standalone(bounds.moved)
mark_free, release_step = standalone(bounds.mark_free), standalone(bounds.release_step)


class Chain(NamedTuple):
    joints: np.ndarray


class State(NamedTuple):
    angle: np.ndarray
    residual: np.ndarray


CHAIN = Chain(np.array([[-0.5, 0.4], [-1.0, 1.0], [-0.2, 0.7]]))
LOW, HIGH = CHAIN.joints.T


def test_starts_and_steps_end_at_the_limits():
    angle = np.full(3, np.nan)
    begin(CHAIN, np.array([-0.6, 0.3, 0.9]), angle)
    np.testing.assert_array_equal(angle, [-0.5, 0.3, 0.7])
    move(CHAIN, np.array([0.0, 0.1, 0.2]), np.array([-2.0, 1.0, 0.4]), 0.5, angle)
    np.testing.assert_array_equal(angle, [-0.5, 0.6, 0.4])
    assert not moved(angle, angle.copy()) and moved(angle, angle + np.array([0.0, 0.0, 1e-9]))


@pytest.mark.parametrize(("limits", "outwards"), [(LOW, 1.0), (HIGH, -1.0)])
def test_a_joint_is_held_where_its_residual_presses_it_against_its_limit(limits, outwards):
    free, anchor = np.empty(3, bool), np.zeros(3)
    state = State(limits.copy(), outwards * np.array([5.0, 2.0, 3.0]))
    assert mark_free(CHAIN, state, 0.0, anchor, free) == 0.0 and not free.any()
    state.angle[0] -= 1e-3 * np.sign(limits[0])  # off its limit
    assert mark_free(CHAIN, state, 0.0, anchor, free) == 5.0 and free.tolist() == [True, False, False]
    inwards = State(limits.copy(), -state.residual)
    assert mark_free(CHAIN, inwards, 0.0, anchor, free) == 5.0 and free.all()
    at = State(limits.copy(), np.zeros(3))
    assert mark_free(CHAIN, at, 10.0, limits - outwards, free) == 0.0 and not free.any()  # by the proximal term
    assert mark_free(CHAIN, at, 10.0, limits + outwards, free) == pytest.approx(10.0) and free.all()


@pytest.mark.parametrize(("limits", "outwards"), [(LOW, -1.0), (HIGH, 1.0)])
def test_a_step_that_leaves_a_limit_outwards_is_held(limits, outwards):
    free = np.array([True, True, False])
    angle = limits.copy()
    angle[1] *= 0.9
    state = State(angle, np.zeros(3))
    assert not release_step(CHAIN, state, free, -outwards * np.ones(3)) and free.tolist() == [True, True, False]
    assert not release_step(CHAIN, state, free, np.zeros(3))
    assert release_step(CHAIN, state, free, outwards * np.ones(3)) and free.tolist() == [False, True, False]
    assert not release_step(CHAIN, state, free, outwards * np.ones(3))
