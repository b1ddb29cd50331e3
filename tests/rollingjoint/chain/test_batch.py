"""Lanes of a batch do not see each other, and the solver of eight lanes finds what the general solver finds."""

import dataclasses
import sys
from pathlib import Path

import numpy as np
import pytest

from rollingjoint import (
    Equilibrium,
    InvalidInput,
    RollingChain,
    Spring,
    Status,
    Tendon,
    WorldForce,
    five_link,
    sensitivity,
    set_threads,
    small_arm,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    solve_tensions_batch,
    uniform,
)
from rollingjoint.chain.random_chain import random_chain, random_lengths, random_loads, random_tensions
from rollingjoint.chain.stacks import designs_of
from rollingjoint.compiled import BatchArrays, PinnedRange, TendonLaw
from rollingjoint.kernels.batch import solve_lanes
from rollingjoint.kernels.lanes import PENDING
from rollingjoint.kernels.rolling import Chain as ChainArrays
from rollingjoint.kernels.rolling import new_results
from rollingjoint.load import LOAD_COLUMNS, load_table

NOT_NUMBERS = ("mechanism", "loads", "friction", "walls")
FIELDS = [field.name for field in dataclasses.fields(Equilibrium) if field.name not in NOT_NUMBERS]
DERIVED = ["arc_lengths", "free_joints", "stiffness", "smallest_eigenvalue"]
MOMENT = LOAD_COLUMNS.index("moment")
LANES = 8  # per random mechanism
PROBLEMS = range(40)


def problem(seed):
    """(mechanism, lengths (LANES, m), loads, starts): some lanes slack, one without numbers; some loads followers."""
    rng = np.random.default_rng(seed)
    chain = random_chain(rng)
    loads = random_loads(rng, chain.n_links, follower=seed % 3 == 0) if seed % 5 else []
    lengths = np.stack([random_lengths(rng, chain) for _ in range(LANES)])
    lengths[seed % LANES, 0] = np.nan
    lengths[(seed + 3) % LANES] += 0.2 * chain.length  # nothing is taut
    low, high = chain.joint_limits.T
    return chain, lengths, loads, chain.joint_angles(rng.uniform(0.9 * low, 0.9 * high, (LANES, chain.n_joints)))


def assert_same(lane, single, names=FIELDS):
    for name in names:
        assert np.array_equal(lane[name], getattr(single, name)), name


def lane_of(batch, lane, names=FIELDS):
    return {name: getattr(batch, name)[lane] for name in names}


@pytest.fixture
def threads():
    """set_threads, undone at the end."""
    from rollingjoint import threads as thread_settings

    before = thread_settings._threads
    yield set_threads
    set_threads(before)


@pytest.mark.parametrize("seed", PROBLEMS)
def test_a_lane_is_the_single_solve_to_the_last_bit(seed):
    chain, lengths, loads, starts = problem(seed)
    batch = solve_lengths_batch(chain, lengths, loads, starts, tension_limits=(0.0, 30.0))
    for lane in range(LANES):
        single = solve_lengths(chain, lengths[lane], loads, starts[lane], tension_limits=(0.0, 30.0))
        assert_same(lane_of(batch, lane), single)
    assert batch.status[seed % LANES] == Status.INVALID_INPUT


@pytest.mark.slow
def test_these_problems_end_in_every_way_and_in_both_solvers():
    batches = [solve_lengths_batch(*problem(seed)) for seed in PROBLEMS]
    statuses = np.concatenate([batch.status for batch in batches])
    assert set(statuses) >= {Status.CONVERGED, Status.AT_LIMIT, Status.INDETERMINATE, Status.INVALID_INPUT}
    assert np.count_nonzero(statuses == Status.CONVERGED) > len(statuses) / 3


@pytest.mark.parametrize("seed", [1, 4, 7, 12])
def test_a_lane_does_not_depend_on_batch_size_place_or_threads(seed, threads):
    chain, lengths, loads, starts = problem(seed)
    alone = solve_lengths_batch(chain, lengths, loads, starts)
    order = np.random.default_rng(seed).integers(0, LANES, 2000)
    for count in (1, 3):
        threads(count)
        many = solve_lengths_batch(chain, lengths[order], loads, starts[order])
        for name in FIELDS:
            assert np.array_equal(getattr(many, name), getattr(alone, name)[order]), name
    for size in (1, 2, 7):
        few = solve_lengths_batch(chain, lengths[:size], loads, starts[:size])
        assert all(np.array_equal(getattr(few, name), getattr(alone, name)[:size]) for name in FIELDS)


def family(seed, count):
    """Mechanisms of one topology with different surfaces, stiffnesses and sizes of table."""
    rng, found = np.random.default_rng(seed), {}
    while True:
        chain = random_chain(rng, max_links=4)
        alike = found.setdefault((chain.n_joints, chain.n_tendons, *chain.arrays.tendon_joints), [])
        alike.append(chain)
        if len(alike) == count and chain.n_joints > 1:
            return alike


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_every_lane_may_have_a_mechanism_of_its_own(seed):
    chains = family(seed, 6)
    assert len({len(chain.arrays.cells) for chain in chains}) > 1
    rng = np.random.default_rng(seed)
    mine = [chains[i] for i in rng.integers(0, len(chains), 30)]
    lengths = np.stack([random_lengths(rng, chain) for chain in mine])
    loads = random_loads(rng, chains[0].n_links)
    batch = solve_lengths_batch(mine, lengths, loads)
    again = solve_lengths_batch(mine, lengths, loads, starts=batch)
    tensions = np.stack([random_tensions(rng, chain.n_tendons) for chain in mine])
    pulled = solve_tensions_batch(mine, tensions, loads)
    assert batch.mechanism == tuple(mine) and "several mechanisms" in repr(batch)
    for lane, chain in enumerate(mine):
        single = solve_lengths(chain, lengths[lane], loads)
        assert_same(lane_of(batch, lane, FIELDS + DERIVED), single, FIELDS + DERIVED)
        assert_same(lane_of(again, lane), solve_lengths(chain, lengths[lane], loads, start=single))
        assert_same(lane_of(pulled, lane), solve_tensions(chain, tensions[lane], loads))


def test_sensitivities_follow_the_mechanism_of_a_lane():
    chains = [uniform(4), uniform(4, height=30.0)] * 2
    batch = solve_tensions_batch(chains, [(3, 2), (3, 2), (1, 2), (2, 4)])
    for lane, chain in enumerate(chains):
        single = solve_tensions(chain, batch.tensions[lane])
        for function in (sensitivity.dposes_dtensions, sensitivity.dlengths_dtensions):
            assert function(batch)[lane] == pytest.approx(function(single), rel=1e-9, abs=1e-12)
        assert sensitivity.dposes_dload(batch, -1)[lane] == pytest.approx(sensitivity.dposes_dload(single, -1))


@pytest.mark.parametrize(
    "mechanisms, message",
    [
        ([five_link()], "one per row"),
        ([five_link(), five_link(), five_link()], "one per row"),
        ([five_link(), uniform(4)], "as many links"),
        ([], "at least one"),
        ([five_link(), "five_link"], "a list"),
        (None, "a RollingChain"),
        (
            [five_link(), five_link().replace(tendons=[Tendon.on_surfaces(-5.0), Tendon.on_surfaces(5.0, end=2)])],
            "cross",
        ),
    ],
)
def test_mechanisms_that_cannot_be_a_batch_raise(mechanisms, message):
    with pytest.raises(InvalidInput, match=message):
        solve_lengths_batch(mechanisms, [(90.0, 100.0)] * 2)


def test_an_equilibrium_of_several_mechanisms_has_no_single_one():
    batch = solve_tensions_batch([five_link(), five_link()], [(3, 2), (2, 3)])
    with pytest.raises(InvalidInput, match="one mechanism"):
        _ = batch.chain
    assert isinstance(solve_tensions(five_link(), (3, 2)).chain, RollingChain)


def both_solvers(seed, count=10):
    """(results side by side, results of the general solver) for random lengths or tensions under dead loads."""
    rng = np.random.default_rng(seed)
    chain = random_chain(rng)
    dead = [load for load in random_loads(rng, chain.n_links) if not isinstance(load, Spring)]
    loads = load_table(dead, chain.n_links)
    tables = np.repeat(loads[None], count, axis=0)
    if seed % 2:
        values = np.stack([random_lengths(rng, chain) for _ in range(count)])
        zero = np.zeros_like(values)
        laws = TendonLaw(values, zero + chain.stiffnesses, zero, zero + 30.0)
    else:
        values = np.stack([random_tensions(rng, chain.n_tendons) for _ in range(count)])
        laws = TendonLaw(np.zeros_like(values), np.ones_like(values), values, values)
    return solved_by_both(chain, laws, tables, np.repeat(chain.neutral_angles[None], count, axis=0))


def solved_by_both(chain, laws, tables, starts):
    """(results side by side, results of the general solver)."""
    count = len(starts)
    arrays, designs = designs_of(chain, count)
    shape = count, chain.n_joints, chain.n_tendons
    fast, every = new_results(*shape), new_results(*shape)
    side_by_side = PinnedRange(RollingChain.kernels, BatchArrays(arrays, designs, laws, tables, starts, fast))
    side_by_side._solve(0, count)
    solve_lanes(arrays, designs, laws, tables, starts, every, np.arange(count))
    return fast, every


def test_both_solvers_find_the_same_equilibrium_or_both_a_stable_one():
    solved, others = 0, []
    for seed in range(32):
        fast, every = both_solvers(seed)
        for lane in np.flatnonzero(fast.status != PENDING):
            assert fast.status[lane] in (Status.CONVERGED, Status.AT_LIMIT)
            assert fast.residual[lane] <= 1e-8
            assert every.status[lane] in (Status.CONVERGED, Status.AT_LIMIT), "the general solver misses it"
            solved += 1
            away = np.abs(fast.joint_angles[lane] - every.joint_angles[lane]).max()
            if away > 1e-9:
                others.append((seed, lane, away))
    assert solved > 250  # of 320: the rest is slack, or crosses poses where the energy is not convex
    assert len(others) <= 0.01 * solved, others


@pytest.mark.parametrize(
    ("seed", "lengths", "start"),
    [
        (5, [47.71790383035549, 33.73992866009506], [13.09]),
        (11, [31.06236420788894, 34.93927743409316, 40.09078330746837], [7.51]),
        (10, [44.586844101963436, 58.633032012797344, 51.379590963795515], [-1.9941775855472255, 2.6723974423126347]),
    ],
)
def test_both_solvers_refuse_a_step_that_brings_too_little(seed, lengths, start):
    """From a start far away, where a step brings 1e-4 of the fall that its slope promises, or less."""
    chain, unstretched = random_chain(np.random.default_rng(seed), len(start) + 1), np.array([lengths])
    laws = TendonLaw(unstretched, np.array(chain.stiffnesses[None]), np.zeros_like(unstretched), unstretched + np.inf)
    fast, every = solved_by_both(chain, laws, load_table((), chain.n_links)[None], np.array([start]))
    assert fast.status == every.status == Status.CONVERGED
    assert fast.iterations == every.iterations > 5


def test_slack_invalid_and_limited_lanes_leave_good_lanes_as_they_are():
    chain = uniform(3)
    good, slack, nothing = chain.neutral_lengths - (0.5, 0.4), chain.neutral_lengths + 5.0, np.full(2, np.nan)
    lengths = np.stack([good, slack, good, nothing, good, good, *[good] * 6])
    tables = np.repeat(load_table([WorldForce(-1, (0.1, 0.0))], 3)[None], len(lengths), axis=0)
    tables[1, 0, 3], tables[4, 0, MOMENT] = 0.0, -1000.0
    expected = solve_lengths(chain, good, [WorldForce(-1, (0.1, 0.0))], tension_limits=(0.0, 3.0))
    batch = solve_lengths_batch(chain, lengths, tables, tension_limits=(0.0, 3.0))
    assert expected.status is Status.CONVERGED
    kinds = [Status.CONVERGED] * len(lengths)
    kinds[1], kinds[3], kinds[4] = Status.INDETERMINATE, Status.INVALID_INPUT, Status.AT_LIMIT
    assert batch.status.tolist() == kinds
    for lane in np.flatnonzero(batch.status == Status.CONVERGED):
        assert_same(lane_of(batch, lane), expected)
    assert all(np.isfinite(getattr(batch, name)).all() for name in FIELDS if name != "residual")


def test_a_part_of_the_lanes_leaves_the_results_of_the_others_alone():
    chain = five_link()
    command = chain.neutral_lengths - np.random.default_rng(0).uniform(0.5, 2.0, (20, 2))
    laws = TendonLaw(command, np.full((20, 2), 5.0), np.zeros((20, 2)), np.full((20, 2), np.inf))
    tables, starts = np.zeros((20, 0, len(LOAD_COLUMNS))), np.repeat(chain.neutral_angles[None], 20, axis=0)
    results = new_results(20, 4, 2)
    for array in results:
        array.fill(77)
    PinnedRange(RollingChain.kernels, BatchArrays(*designs_of(chain, 20), laws, tables, starts, results))(5, 12)
    outside = np.r_[0:5, 12:20]
    assert all(np.all(array[outside] == 77) for array in results if len(array))
    assert np.all(results.status[5:12] == Status.CONVERGED)


@pytest.mark.parametrize("count", [1, 11])
def test_responses_are_how_angles_answer_commands(count):
    chain, h = five_link(), 1e-4
    command = chain.neutral_lengths - np.random.default_rng(0).uniform(0.5, 2.0, (count, 2))
    laws = TendonLaw(command, np.full((count, 2), 5.0), np.zeros((count, 2)), np.full((count, 2), np.inf))
    tables, starts = np.zeros((count, 0, len(LOAD_COLUMNS))), np.repeat(chain.neutral_angles[None], count, axis=0)
    results = new_results(count, 4, 2, responses=True)
    solve = PinnedRange(chain.kernels, BatchArrays(*designs_of(chain, count), laws, tables, starts, results))
    solve(0, count)
    responses = results.responses.copy()
    for j in range(2):
        angles = []
        for step in (h, -2.0 * h, h):
            command[:, j] += step
            solve(0, count)
            angles.append(results.joint_angles.copy())
        np.testing.assert_allclose(responses[..., j], (angles[0] - angles[1]) / (2.0 * h), rtol=0, atol=1e-6)
    assert np.abs(responses).min() > 1e-3


def test_no_lanes_give_no_equilibria():
    none = solve_lengths_batch(five_link(), np.empty((0, 2)))
    assert repr(none) == "<Equilibrium of 'five_link', 0 rows: none>"
    assert none.stiffness.shape == (0, 4, 4) and none.arc_lengths.shape == none.free_joints.shape == (0, 4)
    assert none.smallest_eigenvalue.shape == (0,)


@pytest.mark.parametrize("spoil", [lambda a: np.repeat(a, 2, axis=-1)[..., ::2], np.asfortranarray, np.float32, list])
def test_arrays_of_any_layout_are_solved_by_the_same_machine_code(spoil):
    chain, rng = five_link(), np.random.default_rng(5)
    lengths = chain.neutral_lengths - rng.uniform(0.5, 2.0, (9, 2)).astype(np.float32)
    starts = chain.neutral_angles + rng.uniform(-0.1, 0.1, (9, 4)).astype(np.float32)
    lengths, starts = (np.float32(values).astype(float) for values in (lengths, starts))
    tables = np.repeat(load_table([WorldForce(-1, (0.25, 0.5))], 5)[None], 9, axis=0)
    spoiled = spoil(tables) if spoil is not list else tables
    expected = solve_lengths_batch(chain, lengths, tables, starts)
    found = solve_lengths_batch(chain, spoil(lengths), spoiled, spoil(starts))
    first = solve_lengths(chain, spoil(lengths[0]), [WorldForce(-1, (0.25, 0.5))], spoil(starts[0]))
    assert all(np.array_equal(getattr(found, name), getattr(expected, name)) for name in FIELDS)
    assert_same(lane_of(expected, 0), first)


def test_views_of_an_equilibrium_compile_nothing_anew():
    from rollingjoint.kernels.batch import stiffness_of
    from rollingjoint.kernels.rolling import arc_lengths_of

    chain = five_link()
    batch = solve_tensions_batch(chain, [(3, 2), (2, 3)])
    wide = np.repeat(batch.joint_angles, 2, axis=1)
    wide.setflags(write=False)
    strided = dataclasses.replace(batch, joint_angles=wide[:, ::2], tensions=np.asfortranarray(batch.tensions))
    assert np.array_equal(strided.stiffness, batch.stiffness)
    assert np.array_equal(strided.arc_lengths, batch.arc_lengths)
    solve_tensions(chain, (0, 0), start=wide[0, ::2])
    solve_tensions_batch(chain, [(3, 2), (0, 0)], starts=strided)
    for kernel in (solve_lanes, stiffness_of, arc_lengths_of):
        classes = [signature[0].instance_class for signature in kernel.signatures]
        assert ChainArrays in classes and len(set(classes)) == len(classes), kernel


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_repeated_calls_keep_no_memory():
    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096

    chain = five_link()
    lengths = chain.neutral_lengths + np.random.default_rng(0).uniform(-4, 1, (16, 2))

    def work(times):
        for _ in range(times):
            batch = solve_lengths_batch(chain, lengths)
            assert batch.stiffness.shape == (16, 4, 4)
            solve_tensions(chain, (0, 0))

    work(100)
    before = resident()
    work(1000)
    assert resident() - before < 2**20  # a kept block of eight lanes would be 10 MB, kept results 25 MB


MANY_LOADS = """
import sys, numpy as np, rollingjoint as rj
from rollingjoint.load import LOAD_COLUMNS, SPATIAL_LOAD_COLUMNS
chain, columns = (rj.five_link(), LOAD_COLUMNS) if sys.argv[1] == "plane" else (rj.small_arm(), SPATIAL_LOAD_COLUMNS)
tables = np.zeros((8, 40_000, len(columns)))  # the memory of the lanes is given back to the system when it is freed
tables[:, -1, [0, columns.index("fx")]] = 4.0, 0.01
lengths = np.tile(chain.neutral_lengths - 0.1, (8, 1))
found, few = rj.solve_lengths_batch(chain, lengths, tables), rj.solve_lengths_batch(chain, lengths, tables[:, -1:])
print(np.array_equal(found.joint_angles, few.joint_angles))
"""


@pytest.mark.slow
@pytest.mark.parametrize("where", ["plane", "space"])
def test_lanes_keep_their_memory_while_they_work(where, run_python):
    assert run_python("-c", MANY_LOADS, where) == "True\n"


@pytest.mark.parametrize("chain", [five_link(), small_arm(3)], ids=["rolling", "hinges"])
def test_a_joint_at_its_end_leaves_it_under_a_small_moment(chain):
    pull = np.full(chain.n_tendons, 0.02)  # N: moments far below 1 N·mm
    expected = solve_tensions(chain, pull)
    for side in (0, 1):
        start = np.array(expected.joint_angles)
        start[0] = chain.arrays.joints[0, 0, side]
        for found in (
            solve_tensions(chain, pull, start=start),
            solve_tensions_batch(chain, [pull] * 9, starts=np.repeat(start[None], 9, axis=0)).row(0),
        ):
            assert found.status == Status.CONVERGED
            assert found.joint_angles == pytest.approx(expected.joint_angles, abs=1e-6)
