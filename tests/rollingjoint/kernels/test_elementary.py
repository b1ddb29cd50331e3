"""Elementary functions, and the law of a hole that slips, against their definitions."""

import numpy as np
import pytest

from rollingjoint._numba.jit import standalone
from rollingjoint.kernels import elementary, friction

decay, angle_and_inverse = standalone(elementary.decay), standalone(elementary.angle_and_inverse)
slide, work_per_grip = standalone(friction.slide), standalone(friction.work_per_grip)


@pytest.mark.parametrize("length", [1e-6, 1.0, 3e4])
def test_angles_of_vectors_and_inverses_in_every_octant(length):
    for angle in np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False):
        found, inverse = angle_and_inverse(length * np.sin(angle), length * np.cos(angle), 3.0 + angle)
        assert found == pytest.approx(angle, abs=2e-15)
        assert inverse == pytest.approx(1.0 / (3.0 + angle), rel=1e-15)


@pytest.mark.parametrize(("largest", "accuracy"), [(1.0, 1e-15), (3.0, 1e-11)])
def test_the_decay_and_its_mean(largest, accuracy):
    for x in np.linspace(-largest, largest, 201):
        exponential, mean = decay(x)
        assert exponential == pytest.approx(np.exp(-x), rel=3 * accuracy, abs=3 * accuracy)
        assert mean == pytest.approx(-np.expm1(-x) / x if x else 1.0, rel=3 * accuracy, abs=3 * accuracy)


@pytest.mark.parametrize("way", [-0.9, -0.03, 0.0, 0.02, 0.05, 0.4])
@pytest.mark.parametrize("before", [-1.0, -0.3, 0.0, 0.8, 1.0])
def test_the_work_of_a_hole_is_the_integral_of_its_state_along_the_slip(before, way):
    presliding = 0.05
    slips = np.linspace(0.0, way, 20_001)
    states = np.clip(before - slips / presliding, -1.0, 1.0)
    after = slide(before, way, presliding)
    assert after == pytest.approx(states[-1], abs=1e-14)
    taken = -np.trapezoid(states, slips)
    assert work_per_grip(before, after, way, presliding) == pytest.approx(taken, abs=1e-8)
