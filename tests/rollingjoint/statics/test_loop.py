"""Loops: how wide friction makes them, what they cost, and what they are without friction."""

from __future__ import annotations

import numpy as np
import pytest

from rollingjoint.chain.presets import five_link, two_segment
from rollingjoint.chain.status import Status
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import CapstanFriction
from rollingjoint.load import WorldForce
from rollingjoint.statics.loop import Loop, trace_loop
from rollingjoint.statics.solve import solve_lengths


def rubbed(mu: float = 0.1, steps: int = 40, **options: object) -> Loop:
    chain = five_link().replace(friction=CapstanFriction(mu))
    return trace_loop(chain, (-5, 5), steps=steps, **options)  # type: ignore[arg-type]


def test_inputs_run_from_the_middle_to_one_end_and_back_and_forth() -> None:
    loop = rubbed(steps=4, middle=(90, 99))
    np.testing.assert_allclose(loop.shares, [0, 0.5, 1, *[0.5, 0, -0.5, -1, -0.5, 0, 0.5, 1] * 2])
    np.testing.assert_allclose(loop.inputs[:, 0], 90 - 5 * loop.shares)
    np.testing.assert_allclose(loop.inputs[:, 1], 99 + 5 * loop.shares)
    assert len(loop.path.status[loop.cycle]) == 9
    there, back = loop.branches
    np.testing.assert_array_equal(there, loop.path.tip[-9:-4])
    np.testing.assert_array_equal(back, loop.path.tip[-5:][::-1])


@pytest.mark.parametrize(("mu", "width"), [(0.05, 2.4), (0.1, 4.7), (0.2, 6.0)])
def test_width_grows_with_friction_as_in_an_independent_prototype(mu: float, width: float) -> None:
    """Its figures: differential ±5 mm of five_link, unloaded, two digits."""
    assert rubbed(mu).width == pytest.approx(width, abs=0.05)


def test_a_second_cycle_repeats_the_first() -> None:
    loop = rubbed(cycles=2)
    np.testing.assert_allclose(loop.path.tip[-81:], loop.path.tip[-161:-80], atol=2e-3)


def test_friction_takes_up_what_the_motors_put_in() -> None:
    """The trapezoidal rule leaves an error of second order in the steps."""
    for loop in (rubbed(steps=400), trace_loop(rubbed().path.mechanism, (1, -1), (2, 2), given="tensions", steps=400)):
        assert loop.dissipated_work > 5.0
        assert loop.motor_work == pytest.approx(loop.dissipated_work, rel=1e-4)


def test_without_friction_both_branches_are_one() -> None:
    loop = trace_loop(five_link(), (-5, 5), steps=10)
    assert loop.width < 1e-7
    assert (loop.dissipated_work, loop.sticking) == (0.0, 0.0)
    assert loop.motor_work == pytest.approx(0.0, abs=1e-9)
    assert loop.travel > 30.0


def test_the_middle_is_by_default_where_every_tendon_pulls_with_3_newtons() -> None:
    by_lengths, by_tensions = rubbed(steps=2), trace_loop(five_link(), (1, -1), given="tensions", steps=2)
    np.testing.assert_allclose(by_lengths.path.tensions[0], 3.0, atol=1e-6)
    np.testing.assert_array_equal(by_tensions.middle, [3.0, 3.0])
    np.testing.assert_allclose(by_lengths.path.tip[0], by_tensions.path.tip[0], atol=1e-6)


def test_loads_limits_and_every_tendon_reach_the_solver() -> None:
    chain = two_segment().replace(friction=CapstanFriction(0.1))
    loads, limits = [WorldForce(-1, (0.2, 0.0))], (2.0, 3.5)
    loop = trace_loop(chain, (-2, 2, -3, 3), loads=loads, tension_limits=limits, cycles=1, steps=6)
    first = solve_lengths(chain, loop.middle, loads, tension_limits=limits)
    np.testing.assert_array_equal(loop.path.poses[0], first.poses)
    second = solve_lengths(chain, loop.inputs[1], loads, tension_limits=limits, history=first)
    np.testing.assert_array_equal(loop.path.poses[1], second.poses)
    assert (loop.path.tensions.min(), loop.path.tensions.max()) == limits


def test_a_step_that_is_no_equilibrium_makes_the_loop_unusable() -> None:
    loop = trace_loop(rubbed(steps=2).path.mechanism, (3, -3), (1, 1), given="tensions", steps=4)
    assert not loop.ok
    assert Status.INVALID_INPUT in loop.path.status


def test_a_row_of_a_path_is_the_equilibrium_of_that_step() -> None:
    loop = rubbed(steps=6, loads=[WorldForce(-1, (0.2, 0.1))])
    row, path = loop.path.row(5), loop.path
    assert (row.status, row.mechanism) == (Status.CONVERGED, path.mechanism)
    assert type(row.residual) is float
    assert type(row.iterations) is int
    for name in ("tip", "joint_angles", "gap_tensions", "friction_states", "slip", "sticking", "stiffness", "loads"):
        np.testing.assert_array_equal(getattr(row, name), getattr(path, name)[5])
    assert row.dissipated_work == path.dissipated_work[5]
    again = solve_lengths(path.mechanism, loop.inputs[6], [WorldForce(-1, (0.2, 0.1))], history=row)
    np.testing.assert_array_equal(again.poses, path.poses[6])


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (((-5, 5, 0),), {}, "swing.*2 numbers, one per tendon"),
        (((-5, 5), (90,)), {}, "middle.*2 numbers"),
        (((-5, np.inf),), {}, "swing.*2 finite numbers"),
        (((-5, 5), (90, np.nan)), {}, "middle.*2 finite numbers"),
        (((-5, 5),), {"given": "length"}, "given = 'length'.*Did you mean 'lengths'"),
        (((-5, 5),), {"cycles": 0}, "cycles = 0: expected an integer from 1 to 125"),
        (((-5, 5),), {"steps": 2.5}, "steps = 2.5: expected an integer from 1 to 25000"),
    ],
)
def test_wrong_input_is_refused(arguments: tuple[object, ...], options: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        trace_loop(five_link(), *arguments, **options)  # type: ignore[arg-type]
