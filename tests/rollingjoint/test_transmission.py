"""Play, sheath and limits of a motor: what the room promises, from kernels and on arrays."""

import inspect
import math
from itertools import pairwise

import numpy as np
import pytest

from rollingjoint import transmission
from rollingjoint.compiled import motor_yield, standalone, unstretched_length
from rollingjoint.transmission import (
    at_limit,
    elastic_tension,
    kernels,
    limited_tension,
    play_contact,
    play_inverse,
    play_place,
    play_step,
    pull_end,
    pull_limit,
    sheath_direction,
    sheath_ratio,
)
from rollingjoint.transmission import unstretched_length as unstretched

EVERY = [getattr(transmission, name) for name in transmission.__all__]
SPECIAL = np.array([0.0, -0.0, 1.0, -1.0, 1e-300, -1e300, np.inf, -np.inf, np.nan])
every_formula = pytest.mark.parametrize("formula", EVERY, ids=lambda formula: formula.__name__)


def way(rng, steps=200, shape=()):
    """Positions of motors that go to and fro, (steps, *shape) [mm]."""
    return 90.0 + np.cumsum(rng.uniform(-1.0, 1.0, (steps, *shape)), axis=0)


def follow(tendon, motors, half_width):
    """Where a tendon is after each of these positions of its motor [mm]."""
    found = []
    for motor in motors:
        tendon = play_step(tendon, motor, half_width)
        found.append(tendon)
    return np.array(found)


def values(formula, rng, shape):
    """Numbers for every argument of a formula; half widths and the like may be negative, too."""
    return [rng.uniform(-2.0, 2.0, shape) for _ in inspect.signature(formula).parameters]


@every_formula
def test_kernels_and_arrays_give_the_same_numbers_to_the_last_bit(formula):
    in_kernels, rng = standalone(getattr(kernels, formula.__name__)), np.random.default_rng(0)
    count = len(inspect.signature(formula).parameters)
    special = (
        [axis.ravel() for axis in np.meshgrid(*[SPECIAL] * count)] if count < 6 else rng.choice(SPECIAL, (count, 20000))
    )
    for arrays in (values(formula, rng, 2000), special):
        one_by_one = np.array([in_kernels(*map(float, row)) for row in zip(*arrays, strict=True)])
        assert np.array_equal(formula(*arrays).astype(float), one_by_one.astype(float), equal_nan=True)
        if one_by_one.dtype == float:
            numbers = ~np.isnan(one_by_one)  # the sign of a NaN is not specified
            assert np.array_equal(np.signbit(formula(*arrays))[numbers], np.signbit(one_by_one)[numbers])


@every_formula
def test_arrays_of_any_shape_broadcast_and_numbers_stay_numbers(formula):
    rng = np.random.default_rng(1)
    batch = values(formula, rng, (3, 4, 2))
    together = formula(*batch)
    assert together.shape == (3, 4, 2)
    assert formula(*(array[1, 2, 0] for array in batch)) == together[1, 2, 0]
    assert np.ndim(formula(*(array[1, 2, 0] for array in batch))) == 0
    assert np.array_equal(formula(*(array.T for array in batch)), together.T)
    first, *others = batch
    spread = formula(first, *(array[0, 0] for array in others))
    assert np.array_equal(spread, formula(first, *(np.tile(array[0, 0], (3, 4, 1)) for array in others)))
    assert formula(*(array[:0] for array in batch)).shape == (0, 4, 2)


@every_formula
def test_nan_and_infinite_numbers_raise_nothing(formula):
    count = len(inspect.signature(formula).parameters)
    with np.errstate(all="raise"):
        formula(*np.meshgrid(*[SPECIAL] * count))


def test_a_motor_without_a_number_moves_nothing_and_a_tendon_without_one_stays_so():
    assert play_step(90.0, np.nan, 0.5) == 90.0
    assert np.isnan(play_step(np.nan, 90.0, 0.5))
    assert np.isnan([sheath_direction(90.0, np.nan, 0.5), limited_tension(np.nan, 0.5, 15.0)]).all()


def test_the_tendon_stays_within_the_play_of_its_motor():
    rng = np.random.default_rng(2)
    motors = way(rng, shape=(50,))
    half = rng.uniform(0.0, 3.0, 50)
    tendons = follow(motors[0], motors, half)
    assert np.all(np.abs(tendons - motors) <= half * (1 + 1e-12))
    assert np.array_equal(follow(motors[0], motors, 0.0), motors)  # no play: the tendon is where the motor is


def test_play_remembers_on_which_side_the_motor_was():
    half = 0.5
    assert play_step(90.0, 90.3, half) == 90.0  # within the play nothing moves
    pulled, paid_out = follow(90.0, [85.0, 88.0], half)[-1], follow(90.0, [91.0, 88.0], half)[-1]
    assert (pulled, paid_out) == (87.5, 88.5)


def test_play_is_rate_independent():
    rng = np.random.default_rng(3)
    turns = way(rng, 40)
    shares = np.linspace(0.0, 1.0, 8)[1:]
    slowly = [a + share * (b - a) for a, b in pairwise(turns) for share in shares]
    at_turns = follow(turns[0], slowly, 0.7)[len(shares) - 1 :: len(shares)]
    assert follow(turns[0], turns[1:], 0.7) == pytest.approx(at_turns)


def test_a_larger_swing_wipes_out_what_smaller_ones_left():
    rng = np.random.default_rng(4)
    half, inner = 0.7, way(rng, 60)
    low, high = min(*inner, 90.0) - 2 * half, max(*inner, 90.0) + 2 * half
    for end in ([high], [low], [high, low]):
        with_memory, without = follow(90.0, [*inner, *end], half), follow(90.0, end, half)
        assert with_memory[-1] == without[-1]
    swings = follow(90.0, [*inner, *[91.0, 88.0] * 3], half)[-6:]
    assert np.array_equal(swings[2:4], swings[4:])  # a loop closes once it has been passed


def test_play_never_stretches_differences_and_keeps_order():
    rng = np.random.default_rng(5)
    motors, half = way(rng), 0.7
    shifts = rng.uniform(0.0, 0.3, motors.size)
    here, above = follow(motors[0], motors, half), follow(motors[0] + 0.3, motors + shifts, half)
    assert np.all(above >= here) and np.all(above - here <= 0.3 + 1e-12)


def test_contact_is_where_the_tendon_moves_with_its_motor():
    rng = np.random.default_rng(6)
    tendon, motor, half = 90.0 + rng.uniform(-2, 2, 1000), 90.0 + rng.uniform(-2, 2, 1000), rng.uniform(0, 2, 1000)
    reach, side = 1e-6, play_contact(tendon, motor, half)
    sure = np.abs(np.abs(tendon - motor) - half) > 2 * reach
    by_motor, by_half = (
        (play_step(tendon, motor + a, half + b) - play_step(tendon, motor - a, half - b)) / (2 * reach)
        for a, b in ((reach, 0.0), (0.0, reach))
    )
    assert np.allclose(by_motor[sure], np.abs(side[sure]), atol=1e-8)
    assert np.allclose(by_half[sure], side[sure], atol=1e-8)
    assert set(side) == {-1.0, 0.0, 1.0}
    assert play_contact(90.0, 80.0, 0.5) == 1.0 and play_contact(90.0, 100.0, 0.5) == -1.0  # pulled in, paid out
    assert play_contact(90.5, 90.0, 0.5) == 1.0  # at the very end, where the last step left it


def test_the_inverse_of_play_moves_a_tendon_by_what_was_wanted():
    rng = np.random.default_rng(7)
    tendon, move, half = 90.0 + rng.uniform(-2, 2, 1000), rng.uniform(-1, 1, 1000), rng.uniform(0, 2, 1000)
    before = tendon + rng.uniform(-1, 1, 1000) * half
    motor = play_inverse(tendon, move, half)
    assert play_step(tendon, motor, half) == pytest.approx(tendon + move, abs=1e-12)
    assert play_step(play_step(tendon, before, half), motor, half) == pytest.approx(tendon + move, abs=1e-12)


def test_place_is_the_share_of_the_half_width_and_direction_is_cut_to_its_ends():
    motors = [90.5, 90.0, 91.0, 89.5, 92.0]
    assert play_place(90.5, motors, 0.5) == pytest.approx([0.0, 1.0, -1.0, 2.0, -3.0])
    assert sheath_direction(90.5, motors, 0.5) == pytest.approx([0.0, 1.0, -1.0, 1.0, -1.0])
    assert play_place(90.5, 90.0, 0.0) == sheath_direction(90.5, 90.0, 0.0) == 0.0


def test_a_sheath_without_friction_loses_nothing():
    direction = np.linspace(-1.0, 1.0, 11)
    assert np.all(sheath_ratio(0.0, direction) == 1.0)
    assert np.all(sheath_ratio(np.linspace(0.0, 1.0, 11), 0.0) == 1.0)


def test_friction_of_the_sheath_acts_against_the_motion():
    half, phi = 0.5, 0.3
    for target, compare in ((80.0, np.greater), (100.0, np.less)):  # pulled in: the motor needs more than arrives
        tendon = play_step(90.0, target, half)
        ratio = sheath_ratio(phi, sheath_direction(tendon, target, half))
        assert compare(ratio, 1.0) and abs(math.log(ratio)) == pytest.approx(phi)
    there, back = sheath_ratio(phi, [1.0, -1.0])
    assert there * back == pytest.approx(1.0)


def test_two_sheaths_in_a_row_are_one_with_the_sum_of_their_frictions():
    first, second = np.random.default_rng(8).uniform(0.0, 1.0, (2, 100))
    assert sheath_ratio(first, 1.0) * sheath_ratio(second, 1.0) == pytest.approx(sheath_ratio(first + second, 1.0))


def test_tensions_are_held_at_their_limits_and_elastic_between():
    pull = np.array([-3.0, 0.5, 0.6, 7.0, 14.9, 15.0, 80.0])
    tension = limited_tension(pull, 0.5, 15.0)
    assert tension.tolist() == [0.5, 0.5, 0.6, 7.0, 14.9, 15.0, 15.0]
    assert at_limit(pull, 0.5, 15.0).tolist() == at_limit(tension, 0.5, 15.0).tolist()
    assert at_limit(tension, 0.5, 15.0).tolist() == [True, True, False, False, False, True, True]
    assert limited_tension(pull, 4.0, 4.0).tolist() == [4.0] * 7  # prescribed


def test_an_elastic_tendon_is_held_by_its_unstretched_length():
    length, stiffness = np.array([92.0, 95.0]), np.array([20.0, 7.0])
    command = unstretched(length, np.array([3.0, 5.0]), stiffness)
    assert elastic_tension(length, command, stiffness, 0.5, 15.0) == pytest.approx([3.0, 5.0])
    assert elastic_tension(length, command - 90.0, stiffness, 0.5, 15.0).tolist() == [15.0, 15.0]


def test_a_tendon_at_a_limit_is_left_with_the_length_that_carries_its_tension():
    length, stiffness, left = 92.0, 20.0, standalone(unstretched_length)
    for tendon in (90.0, 91.5, 93.0):  # beyond the upper limit, elastic, slack
        tension = limited_tension(stiffness * (length - tendon), 0.5, 15.0)
        kept = left(length, float(tension), stiffness)
        assert stiffness * (length - kept) == pytest.approx(tension)
        assert (kept == pytest.approx(tendon)) == (not at_limit(tension, 0.5, 15.0))


def test_a_motor_that_gives_way_moves_with_its_tendon_and_stays_there():
    give_way = standalone(motor_yield)
    assert give_way(90.0, 89.0, 0.25) == (90.25, 90.25)
    assert give_way(90.0, 89.0, -0.25) == (89.75, 89.75)
    assert give_way(90.0, 89.0, 0.0) == (90.0, 89.0)
    assert give_way(90.0, 89.0, 1e-10) == (90.0 + 1e-10, 89.0 + 1e-10)  # the rounding of a solve: no limit


def test_a_motor_that_pulls_with_its_tendon_stops_at_its_limit_over_the_sheath_s_ratio():
    assert pull_limit(20.0, 0.5, 1.0) == pytest.approx(20.0 / math.exp(0.5), rel=1e-15)
    assert pull_limit(20.0, 0.5, 0.0) == 20.0  # without play there is no friction


def test_a_pull_in_the_play_ends_where_the_motor_s_tension_is_its_limit():
    p, h, phi, tension = 100.0, 1.0, 0.5, 12.0
    end = pull_end(p, 101.0, 98.5, tension, 15.0, phi, h)  # from the slack end of the play, past its other end
    assert end == pytest.approx(p - math.log(15.0 / 12.0) / phi, abs=1e-12)
    assert tension * sheath_ratio(phi, sheath_direction(p, end, h)) == pytest.approx(15.0, rel=1e-12)
    assert pull_end(p, 101.0, 100.7, tension, 15.0, phi, h) == 100.7  # its goal comes first
    assert pull_end(p, 100.2, 98.5, tension, 10.0, phi, h) == 100.2  # beyond the limit it stays where it is
    assert pull_end(p, 101.0, 98.5, 5.0, 15.0, phi, h) == p - h  # the tendon is taken along before the limit


def test_without_a_sheath_s_friction_a_pull_within_the_play_goes_on_or_does_not_begin():
    assert pull_end(100.0, 101.0, 99.5, 14.9, 15.0, 0.0, 1.0) == 99.5
    assert pull_end(100.0, 101.0, 99.5, 15.0, 15.0, 0.0, 1.0) == 101.0
    assert pull_end(100.0, 100.0, 99.5, 15.0, 15.0, 0.0, 0.0) == 100.0
