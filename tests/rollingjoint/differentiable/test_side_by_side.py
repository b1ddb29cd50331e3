"""Tabulated chains on a device: the numbers of the compiled solver, difficulties left to it, nothing read back."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import InvalidInput, Status
from rollingjoint.chain.random_chain import random_chain
from rollingjoint.chain.stacks import stack
from rollingjoint.chain.variations import ChainVariations
from rollingjoint.load import LOAD_COLUMNS, load_table

torch = pytest.importorskip("torch")

from rollingjoint.differentiable import SideBySide, as_on_a_device  # noqa: E402 - needs torch
from tests.host_reads import no_host_reads  # noqa: E402

pytestmark = pytest.mark.usefixtures("one_torch_thread")

LIMITS = (0.5, 15.0)


def solved(chains, commands, loads, starts, passes=40):
    """Settled rows with their mechanisms in turn, and the compiled equilibria."""
    designs = np.arange(len(commands)) % len(chains)
    solver = SideBySide(stack(chains), designs, passes=passes)
    stiffnesses = np.array([chains[design].stiffnesses for design in designs])
    return settled(solver, stiffnesses, tables_of(loads), starts, commands), [
        rj.solve_lengths(chains[design], command, row, start=start, tension_limits=LIMITS)
        for design, command, row, start in zip(designs, commands, loads, starts, strict=True)
    ]


def settled(solver, stiffnesses, tables, starts, commands):
    """What a solver finds of arrays."""
    commands, stiffnesses, tables, starts = map(torch.tensor, (commands, stiffnesses, tables, starts))
    limits = [torch.tensor(limit).double() for limit in LIMITS]
    with as_on_a_device():  # else the last rows would be left
        return solver.solve(commands, stiffnesses, limits, tables, starts)


def tables_of(loads):
    return np.array([load_table(row, 1 + max(each.link for each in row)) for row in loads])


def rows(chain, count, rng, force=0.5):
    """Commands, loads and starts near rest."""
    commands = chain.neutral_lengths - 1.0 + rng.uniform(-2.0, 1.0, (count, chain.n_tendons))
    links = rng.integers(1, chain.n_links, count)
    loads = [[rj.WorldForce(int(link), rng.uniform(-force, force, 2), point=(1.0, -2.0))] for link in links]
    return commands, loads, np.tile(chain.neutral_angles, (count, 1))


def assert_same(found, expected):
    for row, equilibrium in enumerate(expected):
        assert bool(found.held[row]) == (equilibrium.status == Status.AT_LIMIT)
        for name in ("joint_angles", "poses", "tensions", "lengths"):
            ours, theirs = getattr(found, name)[row].numpy(), getattr(equilibrium, name)
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9, err_msg=f"{name} of row {row}")
        np.testing.assert_allclose(found.contacts[row].numpy(), equilibrium.contact_points, rtol=0, atol=1e-9)


@pytest.mark.parametrize("build", [rj.five_link, rj.two_segment])
def test_equilibria_are_those_of_the_compiled_solver(build):
    found, expected = solved([build()], *rows(build(), 12, np.random.default_rng(0)))
    assert bool(found.arrived.all())
    assert_same(found, expected)


def test_rows_have_mechanisms_of_their_own():
    chain = rj.five_link()
    longer = chain.replace(links=chain.links[:1] + chain.links[:1] + chain.links[2:])
    found, expected = solved([chain, longer], *rows(chain, 6, np.random.default_rng(1)))
    assert bool(found.arrived.all())
    assert_same(found, expected)


def test_contacts_stop_at_the_ends_of_their_surfaces():
    found, expected = solved([rj.five_link()], *rows(rj.five_link(), 24, np.random.default_rng(2), force=12.0))
    arrived = found.arrived.tolist()
    assert any(held and came for held, came in zip(found.held.tolist(), arrived, strict=True))
    kept = [row for row, came in enumerate(arrived) if came]
    assert_same(found._replace(**{n: getattr(found, n)[kept] for n in found._fields}), [expected[row] for row in kept])


@pytest.mark.slow
def test_random_chains_settle_where_the_compiled_solver_does():
    came = 0
    for seed in range(25):
        rng = np.random.default_rng(seed)
        chain = random_chain(rng)
        if chain.springs or chain.n_joints > SideBySide.most_joints:
            continue
        found, expected = solved([chain], *rows(chain, 4, rng))
        for row in np.flatnonzero(found.arrived.numpy()):
            came += 1
            one = found._replace(**{name: getattr(found, name)[row : row + 1] for name in found._fields})
            assert_same(one, expected[row : row + 1])
    assert came > 40


def test_responses_are_how_angles_answer_commands():
    commands, loads, starts = rows(rj.five_link(), 3, np.random.default_rng(3))
    reach = 1e-5
    found, _ = solved([rj.five_link()], commands, loads, starts)
    for tendon in range(2):
        step = reach * np.eye(2)[tendon]
        (ahead, _), (behind, _) = (solved([rj.five_link()], commands + way * step, loads, starts) for way in (1, -1))
        rates = (ahead.joint_angles - behind.joint_angles) / (2 * reach)
        np.testing.assert_allclose(found.responses[..., tendon].numpy(), rates.numpy(), rtol=0, atol=1e-6)


@pytest.mark.parametrize("column", ["bx", "k", "torsion"])
def test_rows_with_other_loads_are_left(column):
    commands, loads, starts = rows(rj.five_link(), 3, np.random.default_rng(4))
    tables = tables_of(loads)
    tables[1, 0, LOAD_COLUMNS.index(column)] = 0.01
    assert settled(*alike(3), tables, starts, commands).arrived.tolist() == [True, False, True]


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e13])
def test_numbers_that_cannot_be_resolved_leave_their_row_alone(bad):
    commands, loads, starts = rows(rj.five_link(), 3, np.random.default_rng(5))
    expected, _ = solved([rj.five_link()], commands, loads, starts)
    starts[0, 1] = commands[2, 1] = bad
    found = settled(*alike(3), tables_of(loads), starts, commands)
    assert found.arrived.tolist() == [False, True, False]
    np.testing.assert_allclose(found.poses[1].numpy(), expected.poses[1].numpy(), rtol=0, atol=1e-9)


def test_too_few_passes_leave_rows():
    found, _ = solved([rj.five_link()], *rows(rj.five_link(), 3, np.random.default_rng(6)), passes=2)
    assert not found.arrived.any()


def test_mechanisms_of_some_rows_can_be_replaced():
    chain, rng = rj.five_link(), np.random.default_rng(7)
    commands, loads, starts = rows(chain, 3, rng)
    stacks = [ChainVariations(chain, rng.uniform(-0.1, 0.1, (3, 5, 2, 3)), np.ones((3, 2))) for _ in range(2)]
    solver = SideBySide(stacks[0].arrays, np.arange(3), passes=40)
    solver.put(np.array([1]), stacks[1].arrays)
    found = settled(solver, np.tile(chain.stiffnesses, (3, 1)), tables_of(loads), starts, commands)
    chains = stacks[0][0], stacks[1][1], stacks[0][2]
    each = zip(chains, commands, loads, starts, strict=True)
    assert_same(found, [rj.solve_lengths(c, x, row, start=s, tension_limits=LIMITS) for c, x, row, s in each])


def test_a_solve_reads_nothing_back():
    commands, loads, starts = rows(rj.five_link(), 3, np.random.default_rng(8))
    solver, stiffnesses = alike(3)
    inputs = [torch.tensor(each) for each in (commands, stiffnesses, tables_of(loads), starts)]
    limits = [torch.tensor(limit).double() for limit in LIMITS]
    with as_on_a_device(), no_host_reads():
        solver.solve(*inputs[:2], limits, *inputs[2:])


def alike(count):
    """A solver of rows with the same mechanism, and their stiffnesses."""
    chain = rj.five_link()
    return SideBySide(chain.arrays, np.zeros(count, np.int64), passes=20), np.tile(chain.stiffnesses, (count, 1))


def test_chains_that_the_tables_do_not_cover_are_refused():
    chain = rj.five_link()
    springy = chain.replace(springs=(rj.Spring(1, 0.02, (30.0, 50.0)),))
    with pytest.raises(InvalidInput, match=r"number of springs of the mechanism = 1: expected 0"):
        SideBySide(springy.arrays, np.zeros(1, np.int64))
    long = rj.RollingChain(chain.links[:1] * 17, [rj.Tendon.on_surfaces(-10.0), rj.Tendon.on_surfaces(10.0)], "long")
    with pytest.raises(InvalidInput, match=r"number of joints = 16: expected 15 at most"):
        SideBySide(long.arrays, np.zeros(1, np.int64))
