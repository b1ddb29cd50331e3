"""Every sensitivity against central differences of the solver."""

import numpy as np
import pytest

from rollingjoint import SolverError, WorldForce, five_link, solve_lengths, solve_tensions, two_segment
from rollingjoint.statics import sensitivity

LOADS = [WorldForce(2, (0.3, -0.4), point=(1.0, 2.0))]
STEP = 1e-5


def central(function, x):
    """d function / d x by central differences, the new axis last."""
    columns = [(function(x + STEP * e) - function(x - STEP * e)) / (2 * STEP) for e in np.eye(len(x))]
    return np.stack(columns, axis=-1)


CASES = {
    "five_link": (five_link, (6.0, 3.0), LOADS),
    "two_segment": (two_segment, (4.0, 2.0, 1.5, 3.0), LOADS),
    "near a singular pose": (five_link, (1.0, 1.0), [WorldForce(-1, (0.0, -0.05))]),
    "at a surface limit": (five_link, (0.4, 0.5), [WorldForce(-1, (-1.0, -0.1))]),
}


@pytest.mark.parametrize("build, tensions, loads", CASES.values(), ids=CASES)
def test_tension_sensitivities(build, tensions, loads):
    chain, tau = build(), np.array(tensions)
    result = solve_tensions(chain, tau, loads)
    jacobian = sensitivity.dlengths_dtensions(result)
    numeric = central(lambda t: solve_tensions(chain, t, loads, start=result).lengths, tau)
    assert jacobian == pytest.approx(numeric, rel=1e-5, abs=1e-5)
    assert jacobian == pytest.approx(jacobian.T, abs=1e-9)
    assert np.linalg.eigvalsh(jacobian).max() < 1e-9
    numeric = central(lambda t: solve_tensions(chain, t, loads, start=result).poses, tau)
    assert sensitivity.dposes_dtensions(result) == pytest.approx(numeric, rel=1e-5, abs=2e-5)
    assert sensitivity.dtip_dtensions(result) == pytest.approx(sensitivity.dposes_dtensions(result)[-1, :2], abs=1e-12)


def test_scaling_all_tensions_moves_nothing_when_nothing_else_acts():
    result = solve_tensions(five_link(), (3, 1))
    assert sensitivity.dlengths_dtensions(result) @ result.tensions == pytest.approx([0, 0], abs=1e-10)


@pytest.mark.parametrize("build, tensions, loads", CASES.values(), ids=CASES)
def test_length_sensitivities(build, tensions, loads):
    chain = build()
    by_tension = solve_tensions(chain, tensions, loads)
    command = by_tension.lengths - by_tension.tensions / chain.stiffnesses
    result = solve_lengths(chain, command, loads, start=by_tension)
    numeric = central(lambda c: solve_lengths(chain, c, loads, start=result).poses, command)
    assert sensitivity.dposes_dlengths(result) == pytest.approx(numeric, rel=1e-5, abs=1e-6)
    numeric = central(lambda c: solve_lengths(chain, c, loads, start=result).tensions, command)
    assert sensitivity.dtensions_dlengths(result) == pytest.approx(numeric, rel=1e-5, abs=1e-6)
    tip, rates = sensitivity.tip_and_tensions_dlengths(result)
    assert tip == pytest.approx(sensitivity.dposes_dlengths(result)[-1, :2], abs=1e-12)
    assert np.array_equal(rates, sensitivity.dtensions_dlengths(result))
    jacobian = sensitivity.dposes_dtensions(result)  # tensions held, although lengths were given
    assert jacobian == pytest.approx(sensitivity.dposes_dtensions(by_tension), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("link, point", [(-1, (0.0, 0.0)), (2, (3.0, -1.0)), (0, (0.0, 0.0))])
def test_load_sensitivities(link, point):
    chain = five_link()
    command = chain.neutral_lengths - (2.0, 1.5)

    def poses(load):
        extra = WorldForce(link, load[:2], moment=load[2], point=point)
        return solve_lengths(chain, command, [*LOADS, extra]).poses

    result = solve_lengths(chain, command, LOADS)
    numeric = central(poses, np.zeros(3))
    assert sensitivity.dposes_dload(result, link, point) == pytest.approx(numeric, rel=1e-5, abs=1e-6)


def test_a_slack_tendon_has_no_influence():
    chain = five_link()
    result = solve_lengths(chain, chain.neutral_lengths - (6.0, -30.0), [WorldForce(-1, (0.2, 0.1))])
    assert np.all(sensitivity.dposes_dlengths(result)[..., 1] == 0)
    assert np.any(sensitivity.dposes_dlengths(result)[..., 0] != 0)


def test_an_indeterminate_pose_has_no_sensitivities():
    with pytest.raises(SolverError, match="INDETERMINATE"):
        sensitivity.dposes_dtensions(solve_tensions(five_link(), (0, 0)))


def test_sensitivities_of_a_batch_equal_those_of_its_lanes():
    from rollingjoint import solve_lengths_batch

    chain = five_link()
    commands = chain.neutral_lengths - np.array([[2.0, 1.5], [1.0, 3.0]])
    batch = sensitivity.dposes_dlengths(solve_lengths_batch(chain, commands, LOADS))
    for lane, command in enumerate(commands):
        single = sensitivity.dposes_dlengths(solve_lengths(chain, command, LOADS))
        assert batch[lane] == pytest.approx(single, abs=1e-12)
