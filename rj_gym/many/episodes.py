"""Running episodes with different mechanisms, those with the same number of links side by side in one buffer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import check_whole, checked_array, checked_parts
from rj_gym.core.episodes import NO_ROWS, EpisodeBuffer, Observation, Rows
from rj_gym.core.generators import Generators, Random
from rj_gym.many.designs import DrawnDesign
from rj_gym.many.kernels import (
    ABSENT,
    RUN_COLUMNS,
    SIZE_COLUMNS,
    UNIT_ROWS,
    LaneArrays,
    RowArrays,
    SizeArrays,
    spread,
    step_sizes,
)
from rj_gym.many.task import Chosen, ManyMechanismsTask, ManyOptions, by_links
from rj_gym.tracking.episodes import TrackingEpisodeBuffer
from rj_gym.tracking.options import TrackingOptions
from rj_gym.tracking.tangent import Tangent
from rollingjoint.compiled import Pinned, machine_code, runs_at_once
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]


_BOUND = {"_pinned", "_pins", "_spread", "_room", "_room_at"}  # attributes of a size that are made anew from the others
_ARRANGED = {"_running", "_pinned", "_step"}  # the same of a buffer
NO_RUNS = np.zeros((0, RUN_COLUMNS), np.int64)

MOST_KNOWN = 512
"""Mechanisms of one number of links that a buffer keeps, so that episodes that draw them again begin faster."""


class _Known:
    """Mechanisms with the same number of links that have been drawn, in one tuple that only grows while it can."""

    def __init__(self) -> None:
        self.mechanisms: tuple[Any, ...] = ()
        self._places: dict[Any, int] = {}

    def chosen(self, designs: Sequence[DrawnDesign], options: TrackingOptions) -> Chosen:
        """Episodes with these designs."""
        drawn = dict.fromkeys(design.mechanism for design in designs)
        new = [mechanism for mechanism in drawn if mechanism not in self._places]
        if len(self._places) + len(new) > max(MOST_KNOWN, len(drawn)):
            self._places, new = {}, list(drawn)
        if new:
            self._places |= {mechanism: place for place, mechanism in enumerate(new, len(self._places))}
            self.mechanisms = tuple(self._places)
        rows = [self._places[design.mechanism] for design in designs]
        return Chosen(self.mechanisms, np.array(rows, np.int64), options)


class _Size:
    """The lanes with one number of links: in the first rows of an episode buffer of their task.

    Args:
        task: with all numbers of links. n_links: of these. every: the arrays of all lanes.
    Attributes:
        designs: of the rows.
    """

    def __init__(self, task: ManyMechanismsTask, n_links: int, every: LaneArrays) -> None:
        self._task, self.own, self.n_links, capacity = task, task.sizes[n_links], n_links, len(every.readings)
        self.buffer = TrackingEpisodeBuffer(self.own, capacity)
        self._spare: TrackingEpisodeBuffer | None = None
        self._known = _Known()
        self.designs: list[DrawnDesign] = []
        self._arrays = RowArrays(
            every,
            lanes=np.zeros(capacity, np.int64),
            runs=runs_of(task.places[n_links], len(task.entries())),
            truth_runs=runs_of(task.truth_places[n_links], len(task.privileged_entries()))
            if task.tells_truth
            else NO_RUNS,
            readings=self.buffer.readings,
            entries=len(task.places[n_links]),
            plain=task.plain_columns,
        )
        self._bind()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in _BOUND}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._bind()

    @property
    def lanes(self) -> Rows:
        """The lanes of the rows, (count,): a view."""
        return self._arrays.lanes[: len(self.designs)]

    def place(self, designs: Sequence[DrawnDesign], lanes: Rows) -> None:
        """Have the first rows be these lanes, with these designs."""
        self.designs = list(designs)
        self.lanes[:] = lanes

    def leave(self, stays: NDArray[np.bool_]) -> None:
        """Keep the rows of the mask (count,), and move them together."""
        if not stays.all():
            rows = np.flatnonzero(stays)
            self.buffer.keep(rows)
            self.place([self.designs[row] for row in rows], self.lanes[rows])

    def join(
        self, lanes: Rows, designs: Sequence[DrawnDesign], rngs: Random, options: TrackingOptions, into: Observation
    ) -> dict[str, Any]:
        """New episodes in these lanes, in the next rows; fills their observations, and gives their info["sampled"]."""
        count, begins = len(self.designs), self.buffer
        if count > 0:
            if self._spare is None or self._spare.capacity < len(lanes):
                self._spare = TrackingEpisodeBuffer(self.own, len(lanes))
            begins = self._spare
        draws, vectors = begins.begin(rngs, self._known.chosen(designs, options))
        if count > 0:
            self.buffer.take(np.arange(count, count + len(lanes)), begins)
        self.place([*self.designs, *designs], np.concatenate([self.lanes, lanes]))
        self._spread(self._pins, vectors.ctypes.data, into.ctypes.data, count, len(self.designs))
        return begins.sampled_info(draws)

    def columns(self) -> list[int]:
        """The row of SizeArrays.sizes."""
        self._at_once = runs_at_once(self.own.mechanism.n_joints, len(self.designs))
        return [self.buffer.pins, self._pins, self._room_at, len(self.designs), int(self._at_once)]

    def step_apart(self, actions: Array, into: int) -> None:
        """The step that `step_sizes` has left, with the actions of all lanes, (B, m); observations as there."""
        count = len(self.designs)
        if self._at_once:
            self.buffer.complete(self._room_at, 0, count)
        else:
            self.buffer.accept_first(actions[self.lanes])
            self.buffer.step_into(self._room_at, count)
        self._spread(self._pins, self._room_at, into, 0, count)

    def observe(self, into: Observation) -> None:
        """Fill the current observations of these lanes among all, (B, entries), and their readings."""
        vectors = self.buffer.observe()  # lives as long as its address is read
        self._spread(self._pins, vectors.ctypes.data, into.ctypes.data, 0, len(self.designs))

    def _bind(self) -> None:
        self._room = np.empty((self.buffer.capacity, self._arrays.entries), np.float32)
        self._room_at = int(self._room.ctypes.data)
        self._pinned = Pinned(self._arrays)
        self._pins = self._pinned.address_for(RowArrays)
        self._spread = machine_code(spread, int, int, int, int, int)

    def tangent(self) -> Tangent:
        """The Tangent of the rows, its poses those of the most links, in units of the length of these."""
        tangent, places = self.buffer.tangent(len(self.designs)), self._task.pictured_places[self.n_links]
        is_place = np.array([not name.endswith("angle") for name in self.own.pictured], bool)
        lengths = np.array([design.mechanism.length for design in self.designs])
        scales = np.where(is_place, self._task.length / lengths[:, None], 1.0)
        count, m = tangent.commands.shape
        poses, rates = np.zeros((count, len(self._task.pictured))), np.zeros((count, len(self._task.pictured), m))
        poses[:, places] = tangent.poses * scales
        rates[:, places] = tangent.pose_rates * scales[..., None]
        return tangent._replace(poses=poses, pose_rates=rates)


class ManyEpisodeBuffer(EpisodeBuffer):
    """Room for B episodes with different mechanisms.

    Attributes:
        designs: of the lanes, once they have begun.
    """

    task: ManyMechanismsTask

    def __init__(self, task: ManyMechanismsTask, capacity: int, goal: bool = False) -> None:
        super().__init__(task, capacity, goal)
        self.readings = np.zeros((capacity, task.columns))
        self.designs: list[DrawnDesign | None] = [None] * capacity
        self._sizes: dict[int, _Size] = {}
        bounds, truth_bounds = (np.array(pair) for pair in (task.observation_bounds(), task.privileged_bounds()))
        self._every = LaneArrays(
            np.zeros((capacity, UNIT_ROWS, bounds.shape[1]), np.float32),
            bounds.astype(np.float32),
            np.zeros((capacity, UNIT_ROWS, truth_bounds.shape[1])),
            truth_bounds,
            self.readings,
        )
        self._arrange()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in _ARRANGED}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._arrange()

    def advance(self, ended: Rows = NO_ROWS) -> Observation:
        """One step of all lanes with the accepted actions; fresh observations, (B, entries)."""
        observations = self._room()
        address, place = observations.ctypes.data, -1
        while (place := self._step(address, place + 1)) < len(self._running):
            self._running[place].step_apart(self._actions, address)
        return observations

    def observe(self) -> Observation:
        """The current observations of all lanes, (B, entries)."""
        observations = self._room()
        for size in self._running:
            size.observe(observations)
        return observations

    def restart(self, rows: Rows, rngs: Random, fixed: ManyOptions | None = None) -> tuple[dict[str, Any], Observation]:
        """New episodes in these lanes, each with a design of its own: info["sampled"], and their observations."""
        designs, observations = self.task.choose(rngs, fixed), self._room()
        try:
            sampled = self._begin(rows, designs, rngs, fixed, observations)
        finally:  # not even Ctrl-C leaves addresses of arrays that are gone
            self._arrange()
        sampled["design"] = np.array([design.number for design in designs], np.int64)
        sampled["n_links"] = np.array([design.n_links for design in designs], np.int64)
        self._actions[rows] = 0.0
        return sampled, observations[rows]

    def _begin(
        self, rows: Rows, designs: Sequence[DrawnDesign], rngs: Random, fixed: ManyOptions | None, into: Observation
    ) -> dict[str, Any]:
        """New episodes in these lanes with these designs; fills their observations, and gives their info["sampled"]."""
        begins = np.zeros(self.capacity, bool)
        begins[rows] = True
        for size in self._sizes.values():
            size.leave(~begins[size.lanes])
        self._describe(rows, designs)
        sampled: dict[str, Any] = {}
        for n, places in by_links(designs).items():
            those = rngs.of(places) if isinstance(rngs, Generators) else [rngs[place] for place in places]
            chosen, options = [designs[place] for place in places], self.task.options_for(n, fixed)
            part = self._size(n).join(rows[places], chosen, those, options, into)
            for name, values in part.items():
                room = sampled.setdefault(name, np.empty((len(rows), *values.shape[1:]), values.dtype))
                room[places] = values
        return sampled

    def tangent(self) -> Tangent:
        """The state of all lanes and how it answers the tendons' commands."""
        whole: list[Any] = []
        for size in self._running:
            for place, values in enumerate(size.tangent()):
                if place == len(whole):
                    whole.append(np.zeros((self.capacity, *values.shape[1:]), values.dtype))
                whole[place][size.lanes] = values
        return Tangent(*whole)

    def get_state(self) -> dict[str, Any]:
        """Everything that later steps depend on, copied: plain values and arrays."""
        return {
            "designs": np.array([-1 if design is None else design.number for design in self.designs], np.int64),
            "lanes": {str(size.n_links): size.lanes.copy() for size in self._running},
            "episodes": {str(size.n_links): size.buffer.get_state() for size in self._running},
        }

    def set_state(self, state: Any) -> None:
        """Continue from a state of `get_state`; raises InvalidInput, and keeps its state, if it does not fit."""
        parts = checked_parts(state, ("designs", "lanes", "episodes"))
        numbers = checked_array("designs", parts["designs"], np.empty(self.capacity, np.int64))
        check_whole("designs", numbers, -1, 2**31)
        sizes = tuple(parts["episodes"]) if isinstance(parts["episodes"], Mapping) else ()
        lanes = checked_parts(parts["lanes"], sizes, "state: lanes")
        together = np.concatenate([NO_ROWS, *(_checked_lanes(n, rows) for n, rows in lanes.items())])
        if not set(lanes) <= set(map(str, self.task.sizes)) or sorted(together.tolist()) != list(range(self.capacity)):
            raise InvalidInput("state: lanes", lanes, f"each of {self.capacity} lanes once, by number of links")
        before = self.get_state() if self.designs[0] is not None else None
        try:
            self._set(numbers, lanes, parts["episodes"])
        except InvalidInput:
            if before is not None:
                self._set(*before.values())
            raise

    def scene(self, trail: Array, lane: int = 0) -> Any:
        """The scene of one lane's picture; trail (steps, d) [mm] is where its tip has been."""
        size = next(size for size in self._sizes.values() if lane in size.lanes)
        return size.buffer.scene(trail, int(np.flatnonzero(size.lanes == lane)[0]))

    def renderer(self) -> Any:
        """A renderer of the scenes."""
        return self.task.renderer()

    def _set(self, numbers: NDArray[np.int64], lanes: Any, episodes: Any) -> None:
        try:
            for size in self._sizes.values():
                size.leave(np.zeros(len(size.lanes), bool))
            for n, state in episodes.items():
                size = self._size(int(n))
                size.buffer.set_state(state)
                mechanisms, rows = size.buffer.solver.mechanisms, size.buffer.solver.designs[: len(lanes[n])]
                chosen = zip(numbers[lanes[n]].tolist(), rows, strict=True)
                size.place([DrawnDesign(number, mechanisms[row]) for number, row in chosen], lanes[n])
                self._describe(size.lanes, size.designs)
        finally:
            self._arrange()
        self.observe()

    def _arrange(self) -> None:
        """Note the numbers of links that lanes have, and where they are, for steps."""
        self._running = [size for size in self._sizes.values() if size.designs]
        sizes = np.array([size.columns() for size in self._running], np.int64).reshape(-1, SIZE_COLUMNS)
        self._pinned = Pinned(SizeArrays(sizes, self._actions))
        self._step = partial(machine_code(step_sizes, int, int, int), self._pinned.address_for(SizeArrays))

    def _room(self) -> Observation:
        """Room for the observations of all lanes."""
        return np.empty((self.capacity, self._every.units.shape[2]), np.float32)

    def _size(self, n_links: int) -> _Size:
        if n_links not in self._sizes:
            self._sizes[n_links] = _Size(self.task, n_links, self._every)
        return self._sizes[n_links]

    def _describe(self, lanes: Rows, designs: Sequence[DrawnDesign]) -> None:
        """Note the designs of lanes, and their units."""
        own, every = [self.task.own_units(design) for design in designs], self._every
        every.units[lanes] = [units.entries for units in own]
        if self.task.tells_truth:
            every.truth_units[lanes] = [units.truths for units in own]
        for lane, design in zip(lanes.tolist(), designs, strict=True):
            self.designs[lane] = design

    def _allowed(self, shape: tuple[int, ...]) -> str:
        if len(shape) == 1:
            return f"{shape[0]} finite numbers in [-1, 1], one per tendon"
        return f"finite numbers in [-1, 1] of shape {shape}"


def _checked_lanes(n_links: str, rows: object) -> Rows:
    """The lanes with this number of links, in a state; InvalidInput unless they are whole numbers in a row."""
    count = rows.size if isinstance(rows, np.ndarray) else 0
    return checked_array(f"lanes with {n_links} links", rows, np.empty(count, np.int64))


def runs_of(places: NDArray[np.intp], entries: int) -> NDArray[np.int64]:
    """Where ascending places, and the others, are among a number of entries, in runs (runs, RUN_COLUMNS)."""
    here = np.full(entries, ABSENT)
    here[places] = np.arange(len(places))
    first = np.flatnonzero(np.diff(here, prepend=2 * ABSENT) != (here != ABSENT))
    return np.stack([first, here[first], np.diff(first, append=entries)], axis=1)
