"""Observations of lanes with different mechanisms, compiled: from rows with the same number of links, in their units.

A number of a row becomes (number - shift) * factor, within its bounds; entries that the row does not have are constant:
the description of the design, and 0 for links that are not there.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from rj_gym.tracking.arrays import TaskArrays
from rj_gym.tracking.kernels import step
from rollingjoint.compiled import Floats, Integers, Singles, kernel, part, singles_at, unpin

CONSTANT, SHIFT, FACTOR, UNIT_ROWS = range(4)
"""Rows of units."""
LOW, HIGH, BOUND_ROWS = range(3)
"""Rows of bounds."""
THERE, HERE, COUNT, RUN_COLUMNS = range(4)
"""Columns of runs of entries: where one begins among all entries; among those of a row, or ABSENT; how many it has."""
ABSENT = -2  # not one before 0
TASK, ROWS, ROOM, N_ROWS, AT_ONCE, SIZE_COLUMNS = range(6)
"""Columns of sizes: addresses of the pins of TaskArrays and of RowArrays, and of room for observations; how many rows;
1 where they are stepped on the thread of their caller."""


class LaneArrays(NamedTuple):
    """Arrays of all lanes: units and bounds of observations and of the privileged state, and readings."""

    units: Annotated[Singles, "B", 3, "entries"]  # UNIT_ROWS
    bounds: Annotated[Singles, 2, "entries"]  # BOUND_ROWS
    truth_units: Annotated[Floats, "B", 3, "truths"]
    truth_bounds: Annotated[Floats, 2, "truths"]
    readings: Annotated[Floats, "B", "columns"]


class RowArrays(NamedTuple):
    """Rows with the same number of links: their lanes, where their entries go, and their readings."""

    all: LaneArrays
    lanes: Annotated[Integers, "B"]
    runs: Annotated[Integers, "runs", 3]  # RUN_COLUMNS
    truth_runs: Annotated[Integers, "runs of the privileged state", 3]
    readings: Annotated[Floats, "B", "columns of rows"]
    entries: int  # of a row
    plain: int  # columns of readings before the privileged state


class SizeArrays(NamedTuple):
    """The numbers of links that lanes have, and the actions of all lanes."""

    sizes: Annotated[Integers, "sizes", 5]  # SIZE_COLUMNS
    actions: Annotated[Floats, "B", "m"]


@kernel(nogil=True, short_loops=True, title="the environments")
def step_sizes(pins, observations, first):
    """One step of the lanes with each number of links, from row `first` of sizes on: see `spread` for observations.

    Returns the row that it leaves: before its step, where threads share it, or after it with lanes that the solver has
    left; the number of rows if none.
    """
    sizes, actions = unpin(pins, SizeArrays)
    for size in range(first, sizes.shape[0]):
        task, rows, room, count = sizes[size, TASK], sizes[size, ROWS], sizes[size, ROOM], sizes[size, N_ROWS]
        if sizes[size, AT_ONCE] == 0:
            return size
        own, lanes = unpin(task, TaskArrays).inputs.actions, unpin(rows, RowArrays).lanes
        for row in range(count):
            for j in range(actions.shape[1]):
                own[row, j] = actions[lanes[row], j]
        if step(task, room, 0, count) != 0:
            return size
        _spread(rows, room, observations, 0, count)
    return sizes.shape[0]


@kernel(title="the environments")
def spread(pins, vectors, observations, first, last):
    """Put rows first to last - 1 where their lanes are: their readings, and observations from one address to another.

    vectors: address of the observations of these rows, (rows, entries of a row). observations: of all lanes, (B,
    entries).
    """
    _spread(pins, vectors, observations, first, last)


@part(inline=True)
def _spread(pins, vectors, observations, first, last):
    every, lanes, runs, truth_runs, readings, entries, plain = unpin(pins, RowArrays)
    own = singles_at(vectors, (last - first, entries))
    into = singles_at(observations, (lanes.size, every.units.shape[2]))
    for row in range(first, last):
        lane = lanes[row]
        units, seen = every.units[lane], every.readings[lane]
        _in_units(units, every.bounds, runs, own[row - first], 0, into[lane], 0)
        for column in range(plain):
            seen[column] = readings[row, column]
        if truth_runs.shape[0] > 0:
            _in_units(every.truth_units[lane], every.truth_bounds, truth_runs, readings[row], plain, seen, plain)


@part(inline=True)
def _in_units(units, bounds, runs, own, own_first, into, first):
    """The entries of a lane, from column `first` on, from the numbers of its row, from `own_first` on."""
    constants, shifts, factors = units[CONSTANT], units[SHIFT], units[FACTOR]
    low, high = bounds[LOW], bounds[HIGH]
    for run in range(runs.shape[0]):
        there, here, count = runs[run, THERE], runs[run, HERE], runs[run, COUNT]
        if here == ABSENT:
            for entry in range(there, there + count):
                into[first + entry] = constants[entry]
        else:
            offset = own_first + here - there
            for entry in range(there, there + count):
                value = (own[offset + entry] - shifts[entry]) * factors[entry]
                into[first + entry] = min(max(value, low[entry]), high[entry])
