"""Running episodes with different mechanisms, those with the same number of links side by side in one buffer."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import check_whole, checked_array, checked_parts
from rj_gym.core.episodes import NO_ROWS, EpisodeBuffer, Observation, Rows
from rj_gym.core.generators import Generators, Random
from rj_gym.many.designs import DrawnDesign, description_entries
from rj_gym.many.task import Chosen, ManyMechanismsTask, ManyOptions, by_links
from rj_gym.tracking.episodes import TrackingEpisodeBuffer
from rj_gym.tracking.options import TrackingOptions
from rj_gym.tracking.tangent import Tangent
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]


MOST_KNOWN = 128
"""Mechanisms of one number of links that a buffer keeps, so that episodes that draw them again begin faster."""


class _Known:
    """Mechanisms with the same number of links that have been drawn, in one tuple that only grows while it can."""

    def __init__(self) -> None:
        self.mechanisms: tuple[RollingChain, ...] = ()
        self._places: dict[RollingChain, int] = {}

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
        task: with all numbers of links. n_links: of these. capacity: lanes at most.
    Attributes:
        lanes: of the rows, (count,). designs: of the rows.
    """

    def __init__(self, task: ManyMechanismsTask, n_links: int, capacity: int) -> None:
        self._task, self.own, self.n_links = task, task.sizes[n_links], n_links
        self.buffer = TrackingEpisodeBuffer(self.own, capacity)
        self._spare: TrackingEpisodeBuffer | None = None
        self._known = _Known()
        self._parts = _slices(task.places[n_links])
        self._truth_parts = _slices(task.truth_places[n_links]) if task.tells_truth else []
        self.place([], NO_ROWS)

    def place(self, designs: Sequence[DrawnDesign], lanes: Rows) -> None:
        """Have the first rows be these lanes, with these designs."""
        self.designs, self.lanes = list(designs), np.asarray(lanes, np.int64)

    def leave(self, stays: NDArray[np.bool_]) -> None:
        """Keep the rows of the mask (count,), and move them together."""
        if not stays.all():
            rows = np.flatnonzero(stays)
            self.buffer.keep(rows)
            self.place([self.designs[row] for row in rows], self.lanes[rows])

    def join(
        self, lanes: Rows, designs: Sequence[DrawnDesign], rngs: Random, options: TrackingOptions
    ) -> tuple[dict[str, Any], Observation]:
        """New episodes in these lanes, in the next rows; their info["sampled"], and observations in plain units."""
        count, begins = len(self.lanes), self.buffer
        if count > 0:
            if self._spare is None or self._spare.capacity < len(lanes):
                self._spare = TrackingEpisodeBuffer(self.own, len(lanes))
            begins = self._spare
        draws, vectors = begins.begin(rngs, self._known.chosen(designs, options))
        if count > 0:
            self.buffer.take(np.arange(count, count + len(lanes)), begins)
        self.place([*self.designs, *designs], np.concatenate([self.lanes, lanes]))
        return begins.sampled_info(draws), vectors

    def step(self, actions: Array, into: Observation) -> None:
        """One step with the actions of all lanes, (B, m); fills the observations of the rows, (count, all entries)."""
        self.buffer.accept_first(actions[self.lanes])
        self.spread(self.buffer.advance_first(len(self.lanes)), into)

    def observe(self, into: Observation) -> None:
        """Fill the current observations of the rows, (count, all entries)."""
        self.spread(self.buffer.observe(), into)

    def readings(self, into: Array) -> None:
        """Fill the readings of the rows, (count, all columns)."""
        values, plain = self.buffer.readings[: len(into)], self._task.plain_columns
        into[:, :plain] = values[:, :plain]
        for theirs, own in self._truth_parts:
            into[:, plain:][:, theirs] = values[:, plain:][:, own]

    def spread(self, vectors: Observation, into: Observation) -> None:
        """Put observations of rows into (count, all entries)."""
        for theirs, own in self._parts:
            into[:, theirs] = vectors[: len(into), own]

    def tangent(self) -> Tangent:
        """The Tangent of the rows, its poses those of the most links, in units of the length of these."""
        tangent, places = self.buffer.tangent(len(self.lanes)), self._task.pictured_places[self.n_links]
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
        entries, truths = len(task.entries()), len(task.privileged_entries())
        self._rows, self._row_readings = np.zeros((capacity, entries), np.float32), np.zeros(self.readings.shape)
        self._units = np.zeros((3, capacity, entries), np.float32)
        self._truth_units = np.zeros((3, capacity, truths))
        self._lengths_differ = False  # from those of the plain chains
        self._clipped = entries - len(description_entries(task.mechanism.n_links, task.action_size))
        self._bounds = [bound[: self._clipped].astype(np.float32) for bound in task.observation_bounds()]
        self._arrange()

    def advance(self, ended: Rows = NO_ROWS) -> Observation:
        """One step of all lanes with the accepted actions; fresh observations, (B, entries)."""
        for size, rows in self._running:
            size.step(self._actions, self._rows[rows])
        return self._together()

    def observe(self) -> Observation:
        """The current observations of all lanes, (B, entries)."""
        for size, rows in self._running:
            size.observe(self._rows[rows])
        return self._together()

    def restart(self, rows: Rows, rngs: Random, fixed: ManyOptions | None = None) -> tuple[dict[str, Any], Observation]:
        """New episodes in these lanes, each with a design of its own: info["sampled"], and their observations."""
        designs = self.task.choose(rngs, fixed)
        begins = np.zeros(self.capacity, bool)
        begins[rows] = True
        for size in self._sizes.values():
            size.leave(~begins[size.lanes])
        sampled: dict[str, Any] = {}
        begun: list[tuple[_Size, Observation]] = []
        for n, places in by_links(designs).items():
            those = rngs.of(places) if isinstance(rngs, Generators) else [rngs[place] for place in places]
            chosen = [designs[place] for place in places]
            size = self._size(n)
            part, vectors = size.join(rows[places], chosen, those, self.task.options_for(n, fixed))
            begun.append((size, vectors))
            for name, values in part.items():
                room = sampled.setdefault(name, np.empty((len(rows), *values.shape[1:]), values.dtype))
                room[places] = values
        self._describe(rows, designs)
        sampled["design"] = np.array([design.number for design in designs], np.int64)
        sampled["n_links"] = np.array([design.n_links for design in designs], np.int64)
        self._actions[rows] = 0.0
        self._arrange()
        last = {id(size): among.stop for size, among in self._running}
        for size, vectors in begun:
            stop = last[id(size)]
            size.spread(vectors, self._rows[stop - len(vectors) : stop])
        return sampled, self._together()[rows]

    def tangent(self) -> Tangent:
        """The state of all lanes and how it answers the tendons' commands."""
        whole: list[Any] = []
        for size, _ in self._running:
            for place, values in enumerate(size.tangent()):
                if place == len(whole):
                    whole.append(np.zeros((self.capacity, *values.shape[1:]), values.dtype))
                whole[place][size.lanes] = values
        return Tangent(*whole)

    def get_state(self) -> dict[str, Any]:
        """Everything that later steps depend on, copied: plain values and arrays."""
        return {
            "designs": np.array([-1 if design is None else design.number for design in self.designs], np.int64),
            "lanes": {str(size.n_links): size.lanes.copy() for size, _ in self._running},
            "episodes": {str(size.n_links): size.buffer.get_state() for size, _ in self._running},
        }

    def set_state(self, state: Any) -> None:
        """Continue from a state of `get_state`; raises InvalidInput, and keeps its state, if it does not fit."""
        parts = checked_parts(state, ("designs", "lanes", "episodes"))
        numbers = checked_array("designs", parts["designs"], np.empty(self.capacity, np.int64))
        check_whole("designs", numbers, -1, 2**31)
        lanes = checked_parts(parts["lanes"], tuple(parts["episodes"]), "state: lanes")
        together = np.concatenate([np.asarray(value) for value in lanes.values()] or [NO_ROWS])
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
        for size in self._sizes.values():
            size.leave(np.zeros(len(size.lanes), bool))
        for n, state in episodes.items():
            size = self._size(int(n))
            size.buffer.set_state(state)
            mechanisms = size.buffer.solver.mechanisms
            rows = size.buffer.solver.designs[: len(lanes[n])]
            own = [DrawnDesign(int(numbers[lane]), mechanisms[row]) for lane, row in zip(lanes[n], rows, strict=True)]
            size.place(own, lanes[n])
            self._describe(size.lanes, own)
        self._arrange()
        self.observe()

    def _arrange(self) -> None:
        """Note which sizes have lanes, their rows among all rows, and where the row of each lane is."""
        self._running: list[tuple[_Size, slice]] = []
        self._row_of, first = np.zeros(self.capacity, np.int64), 0
        for size in self._sizes.values():
            if count := len(size.lanes):
                self._running.append((size, slice(first, first + count)))
                self._row_of[size.lanes] = np.arange(first, first + count)
                first += count
        self._rows[self._row_of] = self._units[0]
        self._lengths_differ = bool((self._units[2] != 1.0).any())

    def _size(self, n_links: int) -> _Size:
        if n_links not in self._sizes:
            self._sizes[n_links] = _Size(self.task, n_links, self.capacity)
        return self._sizes[n_links]

    def _describe(self, lanes: Rows, designs: Sequence[DrawnDesign]) -> None:
        """Note the designs of lanes, and their units."""
        own = [self.task.own_units(design) for design in designs]
        self._units[:, lanes] = np.stack([units.entries for units in own], axis=1)
        if self.task.tells_truth:
            self._truth_units[:, lanes] = np.stack([units.truths for units in own], axis=1)
        for lane, design in zip(lanes.tolist(), designs, strict=True):
            self.designs[lane] = design

    def _together(self) -> Observation:
        """Observations of all lanes, (B, entries), from those by number of links; fills the readings, too."""
        observations, (_, shifts, factors) = self._rows.take(self._row_of, axis=0), self._units
        if self._lengths_differ:
            observations -= shifts
            observations *= factors
        else:
            observations[:, self.task.commands] -= shifts[:, self.task.commands]
        clipped, (low, high) = observations[:, : self._clipped], self._bounds
        np.maximum(clipped, low, out=clipped)
        np.minimum(clipped, high, out=clipped)
        for size, rows in self._running:
            size.readings(self._row_readings[rows])
        np.take(self._row_readings, self._row_of, axis=0, out=self.readings)
        if self.task.tells_truth:
            truths, (_, shift, factor) = self.readings[:, self.task.plain_columns :], self._truth_units
            truths[:] = ((truths - shift) * factor).clip(*self.task.privileged_bounds())
        return observations

    def _allowed(self, shape: tuple[int, ...]) -> str:
        if len(shape) == 1:
            return f"{shape[0]} finite numbers in [-1, 1], one per tendon"
        return f"finite numbers in [-1, 1] of shape {shape}"


def _slices(places: NDArray[np.intp]) -> list[tuple[slice, slice]]:
    """Ascending places as pairs of slices: where numbers go, and which of them."""
    cuts = [0, *(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
    return [
        (slice(int(places[first]), int(places[last - 1]) + 1), slice(first, last))
        for first, last in itertools.pairwise(cuts)
        if last > first
    ]
