"""Running episodes of the tasks among walls."""

from __future__ import annotations

from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import HINT, LARGEST, check_whole, checked_array, checked_parts
from rj_gym.core.columns import ERROR, STATUS, STEP
from rj_gym.core.episodes import NO_ROWS, EpisodeBuffer, Observation, Rows
from rj_gym.core.generators import Random
from rj_gym.rendering import Screen
from rj_gym.surroundings.observation import observation_values
from rj_gym.surroundings.render import WallsCanvas, WallsScene
from rj_gym.surroundings.scenes import INDICES, Scenes
from rj_gym.surroundings.task import Response, SurroundingsTask
from rollingjoint.chain.solution import Solution, stacked
from rollingjoint.chain.status import Status
from rollingjoint.errors import InvalidInput
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]

_STATIC = ("mechanism", "friction", "walls")  # fields of a solution that are no arrays of its own
_WALLS = ("base", "gaps", "normals", "states", "forces", "work", "jumped", "parts")


class SurroundingsEpisodeBuffer(EpisodeBuffer):
    """Room for B episodes of a task among walls."""

    task: SurroundingsTask
    scenes: Scenes
    solution: Any  # the equilibria of all lanes; None before the first reset

    def __init__(self, task: SurroundingsTask, capacity: int, goal: bool = False) -> None:
        super().__init__(task, capacity, goal)
        self.readings = np.zeros((capacity, task.columns["poses"].stop))
        self.solution = None
        self._bounds = task.observation_bounds()

    def advance(self, ended: Rows = NO_ROWS) -> Observation:
        """One step of all lanes with the accepted actions; fresh observations, (B, entries)."""
        task, config, before = self.task, self.task.config, self.readings.copy()
        actions = np.clip(self._actions, -1.0, 1.0)
        commands = task.part(before, "commands") - config.action_scale_mm * actions[:, : task.m]
        feed = task.part(before, "feed")
        if config.FEEDS:
            feed = np.clip(feed + config.feed_scale_mm * actions[:, -1], *config.feed_range)
        solution = task.solve(self.scenes.walls, commands, feed, self.solution)
        good = np.asarray(solution.ok)
        self._enter(solution, good, actions, before)
        self.solution = solution if good.all() else self._merged(self.solution, np.flatnonzero(good), solution, good)
        return self.observe()

    def restart(self, rows: Rows, rngs: Random, fixed: Any = None) -> tuple[dict[str, Any], Observation]:
        """New episodes in these lanes, one per generator. Where it raises, these episodes are unchanged."""
        task, every = self.task, len(rows) == self.capacity
        scenes, sampled = task.sample(rngs, fixed)
        solution = task.at_rest(scenes.walls, np.repeat(task.rest[None], len(rows), axis=0))
        if not np.all(solution.ok):
            raise InvalidInput("options", fixed, "surroundings with room for the instrument at the start")
        tips = solution.tip
        scenes = scenes._replace(first_way=task.way(tips, scenes))
        self.scenes = scenes if every else self.scenes.put(rows, scenes)
        others = np.delete(np.arange(self.capacity), rows)
        kept = self.readings[others]
        self.readings[rows] = 0.0
        before, fresh = self.readings.copy(), np.ones(self.capacity, bool)
        whole = solution if every else self._merged(self.solution, rows, solution, slice(None))
        self.solution = whole
        task.part(before, "way")[rows] = scenes.first_way
        self._enter(whole, fresh, np.zeros_like(self._actions), before)
        self.readings[rows, STEP] = 0.0
        for name in ("terms", "failure", "reward"):
            task.part(self.readings, name)[rows] = 0.0
        self.readings[others] = kept
        return sampled, self.observe()[rows]

    def observe(self) -> Observation:
        """The current observations of all lanes, (B, entries)."""
        read = partial(self.task.part, self.readings)
        values = observation_values(self.task.config, self.task.mechanism, read, self.scenes)
        return np.clip(values, *self._bounds).astype(np.float32)

    def tangent(self) -> Response:
        """The Response of all lanes."""
        feed = self.task.part(self.readings, "feed")
        return self.task.response(self.solution, feed, self.scenes)

    def get_state(self) -> dict[str, Any]:
        """Everything that later steps depend on, copied: plain values and arrays."""
        return {name: np.array(array) for name, array in self._kept().items()}

    def set_state(self, state: Any) -> None:
        """Continue from a state of `get_state`; raises InvalidInput, and keeps its state, if it does not fit."""
        if self.solution is None:
            self._begin_blank()
        held = self._kept()
        arrays = checked_parts(state, tuple(held))
        for name, like in held.items():
            array = checked_array(name, arrays[name], np.asarray(like))
            if array.dtype.kind == "f" and not np.all(np.abs(array) <= LARGEST):
                raise InvalidInput(f"state: {name}", "not finite, or huge", f"numbers up to {LARGEST:g}", HINT)
        for table, columns in INDICES.items():
            name = f"walls.{table}"
            if table != "pieces" and not np.array_equal(arrays[name], held[name]):
                raise InvalidInput(f"state: {name}", "another outline", "that of these settings", HINT)
            if np.any(arrays[name][..., columns] != held[name][..., columns]):
                raise InvalidInput(f"state: {name}", "other numbers", "those of these settings", HINT)
        check_whole("steps", arrays["readings"][:, STEP], 0, self.task.config.episode_steps)
        check_whole("status", arrays["readings"][:, STATUS], 0, max(Status))
        check_whole("status", arrays["solution.status"], 0, max(Status))
        copied = {name: array.copy() for name, array in arrays.items()}
        self.readings[:] = copied["readings"]
        walls = type(self.scenes.walls)(*(copied[f"walls.{name}"] for name in self.scenes.walls._fields))
        self.scenes = Scenes(walls, *(copied[name] for name in Scenes._fields[1:]))
        self.solution = self._restored(copied)

    def scene(self, trail: Array, lane: int = 0) -> WallsScene:
        """The scene of one lane."""
        task, row = self.task, self.readings[lane : lane + 1]
        around = self.solution.walls.row(lane)
        return WallsScene(
            mechanism=task.mechanism,
            poses=task.part(row, "poses")[0],
            tensions=task.part(row, "tensions")[0],
            tension_range=task.config.tension_range,
            target=self.scenes.target[lane],
            tip=task.part(row, "tip")[0, :2],
            trail=trail,
            step=int(row[0, STEP]),
            steps=task.config.episode_steps,
            sleeve=task.config.sleeve,
            planes=self.scenes.walls.planes[lane],
            discs=self.scenes.walls.discs[lane],
            pieces=self.scenes.walls.pieces[lane],
            forces=around.forces[:, :2],
            wall_force=float(task.part(row, "wall_force")[0]),
            peak=float(task.part(row, "peak_wall_force")[0]),
        )

    def renderer(self) -> Screen[WallsScene]:
        """A renderer of the scenes."""
        return Screen(WallsCanvas(self.task.length, float(getattr(self.task.config, "feed_range", (0.0, 0.0))[1])))

    def _enter(self, solution: Any, good: NDArray[np.bool_], actions: Array, before: Array) -> None:
        """Update the readings after a step: where it was not good, the pose is the one before and the episode ends."""
        task, weights, now = self.task, self.task.config.reward, self.readings
        read = partial(task.part, now)
        feed, tips = solution.walls.base[:, 1], solution.tip
        poses = solution.poses.copy()
        poses[..., 1] += feed[:, None]
        new = {
            "poses": poses,
            "tip": np.stack([tips[:, 0], tips[:, 1] + feed, 0.0 * feed], -1),
            "tensions": solution.tensions,
            "commands": unstretched_length(solution.lengths, solution.tensions, task.mechanism.stiffnesses),
            "feed": feed,
            "insertion_force": solution.insertion_force,
            "wall_force": task.forces(solution),
        }
        for name, values in new.items():
            read(name)[good] = values[good]
        read("target")[:, :2] = self.scenes.target
        tip = read("tip")[:, :2]
        read("peak_wall_force")[:] = np.maximum(read("peak_wall_force"), read("wall_force"))
        way, way_before = task.way(tip, self.scenes), task.part(before, "way")
        read("way")[:], now[:, ERROR] = way, np.hypot(*(self.scenes.target - tip).T)
        read("path_ratio")[:] = np.clip(1.0 - way / np.maximum(self.scenes.first_way, 1e-9), 0.0, 1.0)
        now[:, STEP] = before[:, STEP] + 1
        now[:, STATUS] = solution.status
        ended = now[:, STATUS] > task.last_status
        succeeds = task.succeeds(now[:, ERROR], read("wall_force"), read("peak_wall_force"))
        read("success")[:] = succeeds & ~ended
        change = np.square(actions - task.part(before, "action")).mean(axis=1)
        read("action")[:] = actions
        terms = read("terms")
        terms[:, 0] = -way / weights.error_scale_mm
        terms[:, 1] = weights.progress * (way_before - way)
        terms[:, 2] = -weights.force * task.excess(read("wall_force"))
        terms[:, 3] = -weights.smoothness * change
        read("failure")[:] = -weights.failure_penalty * ended
        read("reward")[:] = terms.sum(axis=1) + read("failure")

    def _merged(self, every: Any, rows: Rows, fresh: Any, part: Any) -> Any:
        """Equilibria of all lanes with those of some lanes replaced; part: which rows of the fresh ones."""
        each = [every.row(lane) for lane in range(self.capacity)]
        chosen = np.arange(len(fresh.status))[part]
        for row, place in zip(rows, chosen, strict=True):
            each[row] = fresh.row(int(place))
        return self._around(stacked(each))

    def _around(self, solution: Any) -> Any:
        """The solution with the walls of all lanes."""
        walls = replace(solution.walls, walls=self.scenes.walls, which=np.arange(self.capacity))
        return replace(solution, walls=walls)

    def _begin_blank(self) -> None:
        """Any episodes, for a state to take the place of."""
        self.restart(np.arange(self.capacity), [np.random.default_rng(0)] * self.capacity)

    def _kept(self) -> dict[str, Array]:
        """The arrays (B, ...) that steps go on from, by name."""
        solution, walls = self.solution, self.solution.walls
        names = [entry.name for entry in fields(solution) if entry.name not in _STATIC]
        kept = {f"solution.{name}": getattr(solution, name) for name in names}
        kept |= {f"contact.{name}": getattr(walls, name) for name in _WALLS}
        if walls.memory is not None:
            kept |= {f"memory.{name}": array for name, array in walls.memory._asdict().items()}
        return kept | self.scenes.arrays() | {"readings": self.readings}

    def _restored(self, arrays: dict[str, Array]) -> Solution:
        """The solution whose arrays `_kept` has named."""
        solution, walls = self.solution, self.solution.walls
        memory = walls.memory
        if memory is not None:
            memory = type(memory)(*(arrays[f"memory.{name}"] for name in memory._fields))
        contact = replace(walls, memory=memory, **{name: arrays[f"contact.{name}"] for name in _WALLS})
        names = [entry.name for entry in fields(solution) if entry.name not in _STATIC]
        values = {name: arrays[f"solution.{name}"] for name in names}
        restored: Solution = self._around(replace(solution, walls=contact, **values))
        return restored

    def _allowed(self, shape: tuple[int, ...]) -> str:
        feeds = ", the last one moves the base on" if self.task.config.FEEDS else ""
        return f"finite numbers in [-1, 1] of shape {shape}, one per tendon{feeds}"
