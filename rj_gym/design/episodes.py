"""Episodes of the design task side by side: the one place where they begin and go on. A scalar one has one lane."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.design.config import DesignRewardConfig
from rj_gym.design.observation import observe
from rj_gym.design.task import DesignTask, Episodes, Fixed, Judged
from rollingjoint.checks import as_floats
from rollingjoint.errors import InvalidInput
from rollingjoint.solution import Status

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

TERMS = ("improvement", "violation", "failure")
_STATUS_NAMES = np.array([status.name for status in Status], dtype=object)


class Lanes:
    """B episodes of a task. Arrays have the lane first; who hands out parts of them takes copies.

    Args:
        task: the task.
        count: B.
    """

    def __init__(self, task: DesignTask, count: int) -> None:
        self.task, self.count = task, count
        d, cases, moving = task.space.dimensions, task.config.cases, task.moving
        pairs, places = np.zeros((count, cases, 2)), np.zeros((count, cases, moving, 2))
        margins = task.margins(np.zeros((count, d)))
        self.designs = np.zeros((count, d))
        self.episodes = Episodes(self.designs.copy(), self.designs.copy(), pairs, pairs.copy(), places)
        status = np.zeros((count, cases), np.int64)
        self.judged = Judged(margins, places.copy(), status, np.zeros((count, cases)), np.zeros(count))
        self.steps = np.zeros(count, np.int64)
        self.terms = np.zeros((count, len(TERMS)))

    def checked(self, what: str, actions: ArrayLike, shape: tuple[int, ...]) -> Array:
        """Actions as numbers within [-1, 1].

        Raises:
            InvalidInput: actions that are not finite numbers of that shape.
        """
        allowed = f"finite numbers in [-1, 1] of shape {shape}, one per dimension of the design"
        values = as_floats(what, actions, allowed)
        if values.shape != shape or not np.isfinite(values).all():
            raise InvalidInput(what, actions, allowed)
        return np.clip(values, -1.0, 1.0)

    def begin(self, rows: Rows, rngs: Sequence[np.random.Generator], fixed: Fixed) -> Episodes:
        """New episodes in these lanes, one per generator; what was drawn. Where it raises, nothing has changed here."""
        episodes = self.task.sample(rngs, fixed)
        _put(self.episodes, rows, episodes)
        self.designs[rows] = episodes.start_design
        _put(self.judged, rows, self.task.judge(episodes.start_design, episodes))
        self.steps[rows] = 0
        self.terms[rows] = 0.0
        return episodes

    def advance(self, rows: Rows, actions: Array) -> None:
        """One step of these lanes with checked actions, (len(rows), d)."""
        config = self.task.config
        before = self.judged.error[rows]
        self.designs[rows] = np.clip(self.designs[rows] + config.action_scale * actions, -1.0, 1.0)
        judged = self.task.judge(self.designs[rows], Episodes(*(part[rows] for part in self.episodes)))
        _put(self.judged, rows, judged)
        self.terms[rows] = reward_terms(config.reward, before, judged)
        self.steps[rows] += 1

    def observe(self) -> NDArray[np.float32]:
        """Fresh observations of all lanes, (B, entries)."""
        return observe(self.task, self.designs, self.episodes, self.judged)

    @property
    def rewards(self) -> Array:
        """Sum of the terms of every lane's last step, (B,): fresh."""
        return self.terms.sum(-1)

    def state_info(self) -> dict[str, Any]:
        """What info says in every step: fresh arrays (B, ...)."""
        judged = self.judged
        return {
            "error_mm": judged.error.copy(),
            "case_errors_mm": judged.case_errors.copy(),
            "valid": (judged.margins >= 0).all(-1),
            "status": _STATUS_NAMES[judged.status.max(-1)],
            "margins": judged.margins.copy(),
            "design": self.designs.copy(),
            "positions": judged.positions.copy(),
        }

    def reward_info(self) -> dict[str, Array]:
        """The terms of every lane's last step: fresh arrays (B,)."""
        return {name: self.terms[:, k].copy() for k, name in enumerate(TERMS)}


def reward_terms(reward: DesignRewardConfig, before: Array, judged: Judged) -> Array:
    """TERMS of designs that had these errors (B,) [mm] a step before, (B, 3)."""
    if reward.improvement == "log":
        improvement = np.log((before + reward.offset_mm) / (judged.error + reward.offset_mm))
    else:
        improvement = (before - judged.error) / reward.error_scale_mm
    violation = judged.violation
    failed = (violation == 0) & (judged.status > Status.AT_LIMIT).any(-1)
    return np.stack([improvement, -reward.violation * violation, -reward.failure * failed], -1) + 0.0


def sampled_info(episodes: Episodes) -> dict[str, Any]:
    """What was drawn for episodes: fresh arrays (B, ...)."""
    return {name: part.copy() for name, part in episodes._asdict().items()}


def _put(arrays: Episodes | Judged, rows: Rows, others: Episodes | Judged) -> None:
    for mine, theirs in zip(arrays, others, strict=True):
        mine[rows] = theirs
