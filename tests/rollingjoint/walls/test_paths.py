"""Prepared problems, paths and loops among walls: the same numbers as step by step; and the work of friction."""

import copy
import pickle

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.statics.loop import base_work
from tests.rollingjoint.walls.scenes import CHAIN, LIMITS, REST, RUBBING, cycle, s_bend, way_in

FIELDS = ("joint_angles", "tensions", "lengths", "poses", "wall_forces", "dissipated_work", "residual")


def assert_same(first, second):
    for name in FIELDS:
        assert np.array_equal(getattr(first, name), getattr(second, name)), name
    for name in ("gaps", "normals", "states", "base", "jumped"):
        assert np.array_equal(getattr(first.walls, name), getattr(second.walls, name)), name


@pytest.mark.parametrize("mechanism, mu", [(CHAIN, 0.0), (CHAIN, 0.2), (RUBBING, 0.2)], ids=["none", "walls", "both"])
def test_paths_and_prepared_problems_are_steps_to_the_last_bit(mechanism, mu):
    around, (commands, bases) = s_bend(mu), way_in(count=12)
    problem = rj.prepare(mechanism, tension_limits=LIMITS, surroundings=around)
    restored = pickle.loads(pickle.dumps(problem))
    path = rj.trace(mechanism, commands, tension_limits=LIMITS, surroundings=around, base=bases)
    step = None
    for k, (command, base) in enumerate(zip(commands, bases, strict=True)):
        settings = {"base": base, "history": step}
        prepared, again = (each.solve(command, **settings) for each in (problem, restored))
        step = rj.solve_lengths(mechanism, command, tension_limits=LIMITS, surroundings=around, **settings).require()
        for other in (prepared, again, path.row(k)):
            assert_same(other, step)
    assert len(step.wall_contacts) >= 2 and len(path.wall_contacts[-1]) == len(step.wall_contacts)
    assert "Problem" in repr(copy.copy(problem))


def test_prepared_tensions_among_walls():
    around, base = s_bend(), (0.0, 20.0, 0.0)
    problem = rj.prepare(CHAIN, given="tensions", surroundings=around)
    tensions = np.array([3.0, 1.0, 1.5, 2.0])
    assert_same(problem.solve(tensions, base=base), rj.solve_tensions(CHAIN, tensions, surroundings=around, base=base))


def test_a_loop_moves_commands_and_base():
    swing = [0.8, -0.8, -0.8, 0.8]
    loop = rj.trace_loop(
        CHAIN,
        swing,
        middle=REST,
        tension_limits=LIMITS,
        cycles=2,
        steps=80,
        surroundings=s_bend(0.2),
        base=(0.0, 25.0, 0.0),
        base_swing=(0.0, 5.0, 0.0),
    )
    assert loop.ok
    np.testing.assert_array_equal(loop.path.walls.base[:, 1], 25.0 + 5.0 * loop.shares)
    assert loop.dissipated_work > 0.5 and loop.width > 0.05
    assert loop.motor_work + loop.base_work == pytest.approx(loop.dissipated_work, rel=3e-3)


def test_wrong_bases_of_paths_are_named():
    with pytest.raises(rj.InvalidInput, match="base"):
        rj.trace(CHAIN, [REST, REST], surroundings=s_bend(), base=np.zeros((3, 3)))
    with pytest.raises(rj.InvalidInput, match="base_swing"):
        rj.trace_loop(CHAIN, np.zeros(4), surroundings=s_bend(), base_swing=(0.0, np.nan, 0.0))


@pytest.mark.parametrize("mechanism, mu", [(CHAIN, 0.1), (CHAIN, 0.3), (RUBBING, 0.0), (RUBBING, 0.2)])
def test_friction_takes_the_work_of_motors_and_feed(mechanism, mu):
    """Over the second of two closed cycles of 160 steps."""
    around, steps = s_bend(mu), 160
    into = rj.trace(mechanism, *way_in()[:1], tension_limits=LIMITS, surroundings=around, base=way_in()[1])
    commands, bases = cycle(steps)
    path = rj.trace(
        mechanism, commands, tension_limits=LIMITS, surroundings=around, base=bases, history=into.row(-1)
    ).require()
    second = slice(steps, 2 * steps + 1)
    motors = -np.sum(0.5 * (path.tensions[1:] + path.tensions[:-1])[steps:] * np.diff(path.lengths[second], axis=0))
    given, lost = motors + base_work(path, second), np.sum(path.dissipated_work[second][1:])
    assert lost > 1.0 and max(map(len, path.wall_contacts)) >= 3
    assert given == pytest.approx(lost, rel=1e-3)
