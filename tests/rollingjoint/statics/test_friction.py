"""Histories of steps with friction: single solves and batches, statuses, and inputs that make no sense."""

import dataclasses
import importlib.util
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rollingjoint import (
    CapstanFriction,
    FrictionState,
    InvalidInput,
    MechanismError,
    Status,
    WorldForce,
    five_link,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    solve_tensions_batch,
    trace,
    uniform,
)
from rollingjoint.load import load_table

spec = importlib.util.spec_from_file_location(
    "friction_benchmark", Path(__file__).resolve().parents[3] / "benchmarks" / "friction.py"
)
benchmark = importlib.util.module_from_spec(spec)
spec.loader.exec_module(benchmark)

LIMITS = (0.5, 15.0)
FIELDS = ("joint_angles", "poses", "tensions", "lengths", "contact_forces", "residual", "iterations", "status")
OF_FRICTION = ("gap_tensions", "friction_states", "slip", "dissipated_work", "sticking")


@pytest.fixture(scope="module")
def chain():
    return five_link().replace(friction=CapstanFriction(0.1))


@pytest.fixture(scope="module")
def begin(chain):
    return solve_tensions(chain, (3.0, 3.0))


@pytest.fixture(scope="module")
def command(begin):
    return begin.lengths - begin.tensions / 5.0


def alike(one, other, names=FIELDS + OF_FRICTION):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def test_without_a_history_the_pose_is_that_without_friction(chain, begin):
    free = solve_tensions(five_link(), (3.0, 3.0))
    assert alike(begin, free)
    assert np.all(begin.friction_states == 0.0) and begin.dissipated_work == 0.0
    assert np.all(begin.gap_tensions == 3.0)


@pytest.mark.parametrize("friction", [None, CapstanFriction(0.0), CapstanFriction(0.0, 0.5, 0.1, compliance=0.2)])
def test_no_friction_is_todays_result_to_the_last_bit(friction, begin, command):
    chain, loads = five_link().replace(friction=friction), [WorldForce(-1, (0.2, 0.1))]
    stepped = solve_lengths(chain, command - (1.0, 0.0), loads, history=begin)
    assert alike(stepped, solve_lengths(five_link(), command - (1.0, 0.0), loads, start=begin))
    batch = solve_lengths_batch(chain, [command - (1.0, 0.0)] * 9, loads, history=begin.friction_state)
    plain = solve_lengths_batch(five_link(), [command - (1.0, 0.0)] * 9, loads, starts=begin.joint_angles)
    assert alike(batch, plain)


def random_rows(begin, command, rows, seed):
    """Commands, load tables and a batch that is the history of the next."""
    rng = np.random.default_rng(seed)
    commands = command + rng.uniform(-3.0, 3.0, (2, rows, 2))
    forces = rng.normal(0.0, 0.3, (2, rows, 2))
    tables = [[load_table([WorldForce(int(rng.integers(1, 5)), force)], 5) for force in each] for each in forces]
    return commands, np.array(tables)


def loads_of(table):
    return [WorldForce(int(table[0, 0]), table[0, 3:5])]


def test_rows_of_a_batch_are_single_solves_to_the_last_bit(begin, command):
    """Each with its own coefficients and its own history."""
    rng = np.random.default_rng(0)
    laws = [
        CapstanFriction(*pair) for pair in zip(rng.uniform(0.01, 0.25, 20), rng.uniform(0.01, 0.05, 20), strict=True)
    ]
    laws[3], laws[8] = CapstanFriction(0.1, constant=0.02, extra_turn=0.1), CapstanFriction(0.1, compliance=0.05)
    laws[13] = CapstanFriction(0.1, rolling=0.1)
    chains = [five_link().replace(friction=law) for law in laws]
    commands, tables = random_rows(begin, command, len(chains), 1)
    first = solve_lengths_batch(chains, commands[0], tables[0], tension_limits=LIMITS, history=begin.friction_state)
    second = solve_lengths_batch(chains, commands[1], tables[1], tension_limits=LIMITS, history=first)
    for row, each in enumerate(chains):
        one = solve_lengths(
            each, commands[0, row], loads_of(tables[0, row]), tension_limits=LIMITS, history=begin.friction_state
        )
        two = solve_lengths(each, commands[1, row], loads_of(tables[1, row]), tension_limits=LIMITS, history=one)
        for single, batch in ((one, first), (two, second)):
            for name in FIELDS + OF_FRICTION:
                assert np.array_equal(getattr(single, name), getattr(batch, name)[row]), name
            for single_array, batch_array in zip(single.friction_state, batch.friction_state, strict=True):
                assert np.array_equal(single_array, batch_array[row])
        assert two.stiffness == pytest.approx(second.stiffness[row], abs=1e-10)


def test_rows_without_friction_stand_beside_rows_with_it():
    chains = [five_link().replace(friction=CapstanFriction(mu)) for mu in (0.0, 0.1, 0.0, 0.2)]
    starts = solve_tensions_batch(chains, np.full((4, 2), 3.0))
    steps = solve_tensions_batch(chains, np.full((4, 2), (5.0, 3.0)), history=starts)
    assert steps.mechanism == tuple(chains)
    for row, chain in enumerate(chains):
        one = solve_tensions(chain, (5.0, 3.0), history=solve_tensions(chain, (3.0, 3.0)))
        for name in FIELDS + OF_FRICTION:
            assert np.array_equal(getattr(one, name), getattr(steps, name)[row]), name


def test_a_long_batch_and_its_rows_agree_whatever_stands_beside_them(chain, begin, command):
    commands, tables = random_rows(begin, command, 64, 2)
    history = begin.friction_state
    together = solve_lengths_batch(chain, commands[0], tables[0], tension_limits=LIMITS, history=history)
    backward = solve_lengths_batch(chain, commands[0][::-1], tables[0][::-1], tension_limits=LIMITS, history=history)
    for name in FIELDS + OF_FRICTION:
        assert np.array_equal(getattr(together, name), getattr(backward, name)[::-1]), name


def test_batches_under_given_tensions(chain, begin):
    tensions = np.array([[6.0, 3.0], [2.0, 4.0], [3.0, 3.0]])
    batch = solve_tensions_batch(chain, tensions, history=begin.friction_state)
    for row, values in enumerate(tensions):
        single = solve_tensions(chain, values, history=begin)
        assert all(np.array_equal(getattr(single, name), getattr(batch, name)[row]) for name in FIELDS + OF_FRICTION)


def test_a_path_is_its_steps(chain, begin, command):
    inputs = command - np.array([[1.0, -1.0], [2.0, -1.0], [0.0, 0.0]])
    loads = [[], [WorldForce(-1, (0.2, 0.0))], [WorldForce(2, (0.0, 0.3)), WorldForce(3, (0.1, 0.0))]]
    path, history = trace(chain, inputs, loads, tension_limits=LIMITS, history=begin), begin
    for step, (values, acting) in enumerate(zip(inputs, loads, strict=True)):
        history = solve_lengths(chain, values, acting, tension_limits=LIMITS, history=history)
        assert all(np.array_equal(getattr(history, n), getattr(path, n)[step]) for n in FIELDS + OF_FRICTION)
    virgin = trace(chain, inputs, tension_limits=LIMITS)
    assert np.all(virgin.friction_states[0] == 0.0) and np.any(virgin.friction_states[1] != 0.0)
    by_tension = trace(chain, [[3.0, 3.0], [6.0, 3.0]], given="tensions")
    assert by_tension.tip[1] == pytest.approx(solve_tensions(chain, (6.0, 3.0), history=begin).tip, abs=1e-9)


def test_a_path_goes_on_after_a_step_that_makes_no_sense(chain, begin, command):
    inputs = np.array([command - (1.0, -1.0), [np.nan, 1.0], command])
    path = trace(chain, inputs, tension_limits=LIMITS, history=begin)
    assert list(path.status) == [Status.CONVERGED, Status.INVALID_INPUT, Status.CONVERGED]
    whole = trace(chain, inputs[[0, 2]], tension_limits=LIMITS, history=begin)
    assert np.array_equal(path.poses[2], whole.poses[1])


def spoiled(history, name, value):
    arrays = {field: array.copy() for field, array in history._asdict().items()}
    arrays[name].flat[0] = value
    return FrictionState(**arrays)


SPOILED = [
    *[(name, np.nan) for name in FrictionState._fields],
    *[(name, 1e13) for name in FrictionState._fields],
    ("states", 1.5),
    ("states", -np.inf),
    ("rolling", -2.0),
]


@pytest.mark.parametrize("name, value", SPOILED)
def test_a_history_that_makes_no_sense_is_a_status(chain, begin, command, name, value):
    history = spoiled(begin.friction_state, name, value)
    step = solve_lengths(chain, command - (1.0, 0.0), start=begin, history=history)
    assert step.status is Status.INVALID_INPUT
    assert np.all(np.isfinite(step.poses)) and np.all(np.isfinite(step.gap_tensions))
    rows = FrictionState(*[np.repeat(array[None], 3, axis=0) for array in begin.friction_state])
    getattr(rows, name)[1].flat[0] = value
    batch = solve_lengths_batch(chain, [command - (1.0, 0.0)] * 3, starts=begin, history=rows)
    assert list(batch.status) == [Status.CONVERGED, Status.INVALID_INPUT, Status.CONVERGED]


@pytest.mark.parametrize("inputs", [(np.nan, 1.0), (1e13, 1.0), (np.inf, 1.0), (-1.0, 1.0)])
def test_inputs_that_make_no_sense_leave_the_history_as_it_was(chain, begin, inputs):
    before = solve_tensions(chain, (6.0, 3.0), history=begin)
    step = solve_tensions(chain, inputs, history=before)
    assert step.status is Status.INVALID_INPUT and np.all(np.isfinite(step.poses))
    for kept, old in zip(step.friction_state, before.friction_state, strict=True):
        assert np.array_equal(kept, old)
    assert step.dissipated_work == 0.0 and np.all(step.slip == 0.0)
    again, direct = (solve_tensions(chain, (4.0, 3.0), history=each) for each in (step, before))
    assert np.array_equal(again.poses, direct.poses)
    dead = solve_tensions(chain, (6.0, 3.0), [WorldForce(-1, (0.1, 0.0), moment=1e13)], history=before)
    assert dead.status is Status.INVALID_INPUT


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_no_numbers_raise_or_give_nan(data):
    chain = five_link().replace(friction=CapstanFriction(0.1))
    numbers = st.floats(allow_nan=True, allow_infinity=True)
    begin = solve_tensions(chain, (3.0, 3.0))
    arrays = [array.copy() for array in begin.friction_state]
    for _ in range(data.draw(st.integers(0, 3))):
        array = arrays[data.draw(st.integers(0, 4))]
        array.flat[data.draw(st.integers(0, array.size - 1))] = data.draw(numbers)
    inputs = [data.draw(st.one_of(numbers, st.floats(0.0, 20.0))) for _ in range(2)]
    loads = [WorldForce(-1, (data.draw(st.floats(-2.0, 2.0)), 0.0))]
    step = solve_tensions(chain, inputs, loads, start=begin, history=FrictionState(*arrays))
    assert step.status in Status and np.all(np.isfinite(step.poses)) and np.all(np.isfinite(step.gap_tensions))
    assert np.isfinite(step.dissipated_work)


WRONG = {
    "not a history": lambda begin: begin.friction_state.states,
    "rows for one": lambda begin: FrictionState(*[array[None] for array in begin.friction_state]),
    "another chain": lambda begin: solve_tensions(uniform(4), (3.0, 3.0)).friction_state,
    "an equilibrium of another chain": lambda begin: solve_tensions(uniform(4), (3.0, 3.0)),
    "text": lambda begin: "yesterday",
}


@pytest.mark.parametrize("wrong", WRONG.values(), ids=WRONG)
def test_what_is_no_history_is_refused_in_one_line(chain, begin, command, wrong):
    with pytest.raises(InvalidInput) as refusal:
        solve_lengths(chain, command, start=begin, history=wrong(begin))
    assert "\n" not in str(refusal.value) and "history" in str(refusal.value)


def test_histories_of_another_number_of_rows_are_refused(chain, begin, command):
    two = solve_lengths_batch(chain, [command] * 2, history=begin.friction_state)
    with pytest.raises(InvalidInput, match="history"):
        solve_lengths_batch(chain, [command] * 3, starts=begin.joint_angles, history=two)
    with pytest.raises(InvalidInput, match="least_squares"):
        solve_lengths(chain, command, method="least_squares", history=begin)


@pytest.mark.parametrize(
    "name, value", [("mu", 0.3), ("mu", -0.1), ("mu", np.nan), ("presliding", 0.0), ("rolling", -1.0), ("mu", "much")]
)
def test_coefficients_out_of_their_range_are_refused_in_one_line(name, value):
    with pytest.raises(MechanismError) as refusal:
        CapstanFriction(**({"mu": 0.1} | {name: value}))
    assert name in str(refusal.value) and "\n" not in str(refusal.value)
    with pytest.raises(dataclasses.FrozenInstanceError):
        CapstanFriction(0.1).mu = 0.2


def test_random_walks_never_fail():
    study = list(benchmark.walks(rows=60, seed=1))
    assert sum(int(np.sum(walk.status >= Status.UNSTABLE)) for *_, walk in study) == 0
    assert max(float(walk.residual.max()) for *_, walk in study) < 1e-8
    text = benchmark.table(iter(study[:2]))
    assert "2400 steps, 0 failures" in text and "| five_link | 0.02 | 0.05 |" in text


@pytest.mark.slow
def test_a_million_steps_never_fail():
    for *_, walk in benchmark.walks(rows=2000, seed=0):
        assert np.all(walk.status < Status.UNSTABLE) and walk.residual.max() < 1e-8
