"""Running episodes of the design task."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import checked_array, checked_parts
from rj_gym.core.columns import ERROR, STEP
from rj_gym.core.episodes import NO_ROWS, EpisodeBuffer, Observation, Rows
from rj_gym.core.generators import Random
from rj_gym.design.observation import observation_values
from rj_gym.design.render import DesignCanvas, DesignScene
from rj_gym.design.sampling import DesignDraws, blank_draws
from rj_gym.design.task import TERMS, DesignTask, Judged, reward_terms
from rj_gym.rendering import Screen
from rollingjoint.chain.status import Status

Array = NDArray[np.float64]


class DrawnEpisodeBuffer(EpisodeBuffer):
    """Room for B episodes that go on from what was drawn for them and from their readings.

    Attributes:
        draws: a named tuple of arrays (B, ...).
    """

    draws: Any

    def get_state(self) -> dict[str, Any]:
        """Everything that later steps depend on, copied: arrays."""
        return {name: array.copy() for name, array in self._arrays().items()}

    def set_state(self, state: Any) -> None:
        """Continue from a state of `get_state`; raises InvalidInput, and keeps its state, if it does not fit."""
        arrays = self._arrays()
        values = checked_parts(state, tuple(arrays))
        for name, array in arrays.items():
            checked_array(name, values[name], array)
        for name, array in arrays.items():
            array[:] = values[name]

    def _arrays(self) -> dict[str, Array]:
        return {**self.draws._asdict(), "readings": self.readings}

    def _drawn(self, rows: Rows) -> Any:
        """What was drawn for these lanes."""
        return type(self.draws)(*(array[rows] for array in self.draws))

    def _draw(self, rows: Rows, draws: Any) -> None:
        """Begin these lanes with what has been drawn for them."""
        for array, drawn in zip(self.draws, draws, strict=True):
            array[rows] = drawn


class DesignEpisodeBuffer(DrawnEpisodeBuffer):
    """Room for B episodes of the design task."""

    task: DesignTask
    draws: DesignDraws

    def __init__(self, task: DesignTask, capacity: int, goal: bool = False) -> None:
        super().__init__(task, capacity, goal)
        self.draws = blank_draws(task.config, capacity)
        self.readings = np.zeros((capacity, task.columns["cases"].stop))
        self._bounds = task.observation_bounds()

    @property
    def designs(self) -> Array:
        """The present designs, (B, d)."""
        return self.task.part(self.readings, "design")

    def advance(self, ended: Rows = NO_ROWS) -> Observation:
        """One step of the lanes that have not ended; fresh observations of all, (B, entries)."""
        rows, config = np.delete(np.arange(self.capacity), ended), self.task.config
        before, actions = self.readings[rows], np.clip(self._actions[rows], -1.0, 1.0)
        designs = np.clip(self.designs[rows] + config.action_scale * actions, -1.0, 1.0)
        judged = self.task.judge(designs, self._drawn(rows))
        terms = reward_terms(config.reward, before[:, ERROR], judged)
        self._enter(rows, before[:, STEP] + 1, designs, judged, terms)
        return self.observe()

    def restart(self, rows: Rows, rngs: Random, fixed: Any = None) -> tuple[dict[str, Any], Observation]:
        """New episodes in these lanes, one per generator. Where it raises, these episodes are unchanged."""
        draws = self.task.sample(rngs, fixed)
        self._draw(rows, draws)
        judged = self.task.judge(draws.start_design, draws)
        self._enter(rows, np.zeros(len(rows)), draws.start_design, judged, np.zeros((len(rows), len(TERMS))))
        return draws._asdict(), self.observe()[rows]

    def observe(self) -> Observation:
        """The current observations of all lanes, (B, entries)."""
        read = partial(self.task.part, self.readings)
        values = observation_values(self.task.config, self.task.length, read, self.draws)
        return np.clip(values, *self._bounds).astype(np.float32)

    def scene(self, trail: Array, lane: int = 0) -> DesignScene:
        """The scene of one lane; it has no trail."""
        task, draws, row = self.task, self.draws, self.readings[lane : lane + 1]
        valid = bool((task.part(row, "margins") >= 0).all())
        design = self.designs[lane] if valid else task.space.reference()
        mechanism, poses = task.drawn(design, draws.tensions[lane], draws.forces[lane])
        return DesignScene(
            mechanism=mechanism,
            poses=poses,
            ok=task.part(row, "cases")[0] <= Status.AT_LIMIT,
            targets=draws.targets[lane],
            tensions=draws.tensions[lane],
            forces=draws.forces[lane],
            case_errors=task.part(row, "case_errors")[0],
            error=float(row[0, ERROR]),
            valid=valid,
            step=int(row[0, STEP]),
            steps=task.config.episode_steps,
        )

    def renderer(self) -> Screen[DesignScene]:
        """A renderer of the scenes."""
        return Screen(DesignCanvas(self.task.length))

    def _enter(self, rows: Rows, steps: Array, designs: Array, judged: Judged, terms: Array) -> None:
        """Update the readings of these lanes, in the order of the task's columns."""
        worst, total = judged.status.max(-1), terms.sum(-1)
        columns = terms, judged.case_errors, judged.margins, designs, judged.positions, judged.status
        parts = (np.reshape(part, (len(rows), -1)) for part in (steps, worst, judged.error, total, *columns))
        self.readings[rows] = np.concatenate(list(parts), axis=1)

    def _allowed(self, shape: tuple[int, ...]) -> str:
        return f"finite numbers in [-1, 1] of shape {shape}, one per dimension of the design"
