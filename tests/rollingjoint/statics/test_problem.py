"""Prepared problems: the same numbers as the solvers, whoever uses them how often."""

import copy
import dataclasses
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from rollingjoint import (
    CapstanFriction,
    InvalidInput,
    RollingChain,
    Status,
    WorldForce,
    five_link,
    prepare,
    small_arm,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    uniform,
)

LIMITS = (0.5, 15.0)


def force_at_tip(mechanism):
    return [WorldForce(-1, (0.3, -0.1) if isinstance(mechanism, RollingChain) else (0.3, -0.1, 0.0))]


MECHANISMS = {"planar": five_link(), "arm": small_arm()}


def commands(mechanism, count=12, seed=0):
    rng = np.random.default_rng(seed)
    return mechanism.neutral_lengths - 1.0 + rng.uniform(-1.5, 1.5, (count, mechanism.n_tendons))


def assert_equal(first, second):
    for field in dataclasses.fields(first):
        one, other = getattr(first, field.name), getattr(second, field.name)
        if isinstance(one, np.ndarray):
            assert one.shape == other.shape and one.dtype == other.dtype
            assert one.tobytes() == other.tobytes(), field.name
            assert not one.flags.writeable and not other.flags.writeable
        elif field.name not in ("mechanism", "friction", "walls"):
            assert type(one) is type(other) and (one == other or one != one), field.name


@pytest.mark.parametrize("mechanism", MECHANISMS.values(), ids=MECHANISMS)
@pytest.mark.parametrize("loaded", [False, True])
def test_prepared_lengths_equal_the_solvers(mechanism, loaded):
    loads = force_at_tip(mechanism) if loaded else ()
    problem, before = prepare(mechanism, loads, tension_limits=LIMITS), None
    for command in commands(mechanism):
        found = problem.solve(command, start=before)
        assert_equal(found, solve_lengths(mechanism, command, loads, start=before, tension_limits=LIMITS))
        starts = None if before is None else before.joint_angles
        many = solve_lengths_batch(mechanism, command[None], loads, starts, tension_limits=LIMITS)
        assert_equal(found, many.row(0))
        before = found


@pytest.mark.parametrize("mechanism", MECHANISMS.values(), ids=MECHANISMS)
def test_prepared_tensions_equal_the_solver(mechanism):
    problem = prepare(mechanism, force_at_tip(mechanism), "tensions")
    for tensions in np.random.default_rng(1).uniform(0.0, 8.0, (6, mechanism.n_tendons)):
        assert_equal(problem.solve(tensions), solve_tensions(mechanism, tensions, force_at_tip(mechanism)))


def test_a_long_chain_equals_the_solver():
    chain = uniform(70)
    problem = prepare(chain)
    assert_equal(problem.solve(chain.neutral_lengths - 0.1), solve_lengths(chain, chain.neutral_lengths - 0.1))


@pytest.mark.parametrize("mechanism", MECHANISMS.values(), ids=MECHANISMS)
def test_steps_with_friction_equal_the_solver(mechanism):
    rubbed = mechanism.replace(friction=CapstanFriction(0.1))
    problem = prepare(rubbed, tension_limits=LIMITS)
    before = problem.solve(commands(rubbed)[0])
    for command in commands(rubbed)[1:4]:
        found = problem.solve(command, history=before)
        other = solve_lengths(rubbed, command, tension_limits=LIMITS, history=before)
        assert_equal(found, other)
        assert found.friction is not None
        assert found.friction.slip.tobytes() == other.friction.slip.tobytes()
        before = found


def test_a_result_stays_as_it_is_when_the_problem_goes_on():
    chain = five_link()
    problem = prepare(chain)
    first = problem.solve(commands(chain)[0])
    problem.solve(commands(chain)[1])
    solve_lengths(chain, commands(chain)[2])
    assert_equal(first, prepare(chain).solve(commands(chain)[0]))


@pytest.mark.parametrize("values", [(np.nan, 100.0), (np.inf, 1.0), (1e13, 0.0)])
def test_invalid_numbers_are_a_status(values):
    chain = five_link()
    found = prepare(chain).solve(values)
    assert found.status is Status.INVALID_INPUT
    assert_equal(found, solve_lengths(chain, values))


def test_a_refused_call_changes_nothing():
    chain = five_link()
    problem = prepare(chain)
    for values, more in (([1.0], {}), ("ab", {}), (chain.neutral_lengths, {"start": [0.0]})):
        with pytest.raises(InvalidInput) as error:
            problem.solve(values, **more)
        assert "\n" not in str(error.value)
    assert_equal(problem.solve(commands(chain)[0]), solve_lengths(chain, commands(chain)[0]))


def test_what_cannot_be_prepared_is_refused():
    with pytest.raises(InvalidInput, match="mechanism"):
        prepare("five_link")
    with pytest.raises(InvalidInput, match="link"):
        prepare(five_link(), [WorldForce(9, (1.0, 0.0))])
    with pytest.raises(InvalidInput, match="given"):
        prepare(five_link(), given="length")
    with pytest.raises(InvalidInput, match="tension_limits"):
        prepare(five_link(), given="tensions", tension_limits=LIMITS)
    with pytest.raises(InvalidInput, match="tension_limits"):
        prepare(five_link(), tension_limits=(1.0, 2.0, 3.0))


def test_the_loads_of_the_caller_are_not_the_problems():
    problem = prepare(five_link(), force_at_tip(five_link()))
    with pytest.raises(ValueError, match="read-only"):
        problem.loads[0, 0] = 3.0


@pytest.mark.parametrize("mechanism", MECHANISMS.values(), ids=MECHANISMS)
@pytest.mark.parametrize("copied", [lambda value: pickle.loads(pickle.dumps(value)), copy.copy, copy.deepcopy])
def test_copies_of_problems_mechanisms_and_results_work(mechanism, copied):
    problem, command = prepare(mechanism, force_at_tip(mechanism), tension_limits=LIMITS), commands(mechanism)[3]
    found = problem.solve(command)
    assert_equal(copied(problem).solve(command), found)
    assert_equal(copied(problem.solve(command)), found)
    solve_lengths(mechanism, command)
    assert_equal(solve_lengths(copied(mechanism), command), solve_lengths(mechanism, command))
    assert_equal(dataclasses.replace(problem.solve(command)), found)


def test_a_mechanism_made_of_another_one_is_solved_with_its_own_numbers():
    arm = small_arm()
    command = commands(arm)[0]
    solve_lengths(arm, command)
    other = copy.copy(arm)
    vars(other)["arrays"] = arm.arrays._replace(springs=2.0 * arm.arrays.springs)
    assert_equal(solve_lengths(other, command), solve_lengths_batch(other, command[None]).row(0))
    assert_equal(solve_lengths(arm, command), solve_lengths_batch(arm, command[None]).row(0))


def test_an_equilibrium_has_no_attributes_but_its_own():
    found = prepare(five_link()).solve(five_link().neutral_lengths)
    with pytest.raises(AttributeError, match="'Equilibrium' object has no attribute 'pose'"):
        _ = found.pose
    assert found.poses is found.poses


def test_threads_share_a_problem_and_a_mechanism():
    chain = five_link()
    problem, every = prepare(chain, tension_limits=LIMITS), commands(chain, 400)
    alone = [solve_lengths(chain, command, tension_limits=LIMITS) for command in every]
    with ThreadPoolExecutor(4) as threads:
        prepared = list(threads.map(problem.solve, every))
        public = list(threads.map(lambda command: solve_lengths(chain, command, tension_limits=LIMITS), every))
    for one, two, three in zip(alone, prepared, public, strict=True):
        assert_equal(one, two)
        assert_equal(one, three)


def strided(values):
    """The same numbers, not next to each other, and read-only."""
    apart = np.repeat(values, 3)[::3]
    apart.setflags(write=False)
    return apart


FORMS = {
    "list": lambda values: values.tolist(),
    "strided": strided,
    "big-endian": lambda values: values.astype(">f8"),
    "subclass": lambda values: np.ma.array(values),
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
@pytest.mark.parametrize("given", ["lengths", "tensions"])
@pytest.mark.parametrize("rubs", [False, True])
def test_inputs_of_any_form_give_the_same_numbers(form, given, rubs):
    chain = five_link().replace(friction=CapstanFriction(0.1) if rubs else None)
    solve = solve_lengths if given == "lengths" else solve_tensions
    values = commands(chain)[0] if given == "lengths" else np.array([3.0, 2.0])
    start, before = np.array([0.1, -0.05, 0.02, 0.0]), solve(chain, values * 0.999)
    expected = solve(chain, values, start=start, history=before)
    assert_equal(solve(chain, form(values), start=form(start), history=before), expected)
    assert_equal(prepare(chain, given=given).solve(form(values), start=form(start), history=before), expected)


def test_least_squares_takes_strided_lengths():
    chain = five_link()
    lengths = commands(chain)[0]
    expected = solve_lengths(chain, lengths, method="least_squares")
    assert_equal(solve_lengths(chain, strided(lengths), method="least_squares"), expected)


def test_limits_may_be_floats_integers_or_arrays():
    chain, command = five_link(), commands(five_link())[5]
    expected = solve_lengths(chain, command, tension_limits=(1.0, 15.0))
    for limits in ((1, 15), (np.float64(1.0), 15.0), [1.0, 15.0], ([1.0, 1.0], 15.0), np.array([1.0, 15.0])):
        assert_equal(solve_lengths(chain, command, tension_limits=limits), expected)
        assert_equal(prepare(chain, tension_limits=limits).solve(command), expected)
    for wrong in ((1.0,), (1.0, 2.0, 3.0), (1.0, "a"), (1.0, [1.0] * 3), 1.0):
        with pytest.raises(InvalidInput, match="tension_limits"):
            solve_lengths(chain, command, tension_limits=wrong)


def test_a_result_does_not_follow_the_arrays_of_its_caller():
    chain, command, start = five_link(), commands(five_link())[0], np.zeros(4)
    found, expected = solve_lengths(chain, command, start=start), solve_lengths(chain, command, start=np.zeros(4))
    command[:], start[:] = 0.0, 1.0
    assert_equal(found, expected)
