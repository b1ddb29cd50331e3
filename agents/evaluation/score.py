"""The score of one controller over episodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents.controllers.controller import Array
from agents.evaluation.rollout import LAST_STEPS, Episodes

CLOSE_MM = 1.0
HELD_STEPS = LAST_STEPS
FLOOR = "floor"


@dataclass(frozen=True)
class Score:
    """How one controller did: tip error at the end of the episodes [mm], shares from 0 to 1.

    `last_10_mm` is the mean tip error over the last 10 steps: the measure of benchmarks, since an error at one
    moment may be small by chance where loads, targets or sensors move. `within_1_mm` is the share of episodes that end
    within 1 mm of the target, `held_1_mm` the share that are within 1 mm during all of the last 10 steps, `ended_early`
    the number of episodes that the environment ended. `regret_mm` is the mean of final error minus floor of the same
    episode, None where there are no floors.
    """

    mean_mm: float
    median_mm: float
    p95_mm: float
    last_10_mm: float
    within_1_mm: float
    held_1_mm: float
    mean_reward: float
    ended_early: int
    regret_mm: float | None = None

    @classmethod
    def of(cls, episodes: Episodes, floors: Array | None = None) -> Score:
        """The score of one controller's episodes; floors (E,) [mm], one that is not finite does not count."""
        final = episodes.final_errors
        return cls(
            mean_mm=float(final.mean()),
            median_mm=float(np.median(final)),
            p95_mm=float(np.percentile(final, 95)),
            last_10_mm=float(episodes.last_errors.mean()),
            within_1_mm=float(np.mean(final <= CLOSE_MM)),
            held_1_mm=float(np.mean(np.all(episodes.last_errors <= CLOSE_MM, axis=1))),
            mean_reward=float(episodes.rewards.mean()),
            ended_early=int(episodes.terminated.sum()),
            regret_mm=None if floors is None else _mean_of_finite(final - floors),
        )


def _mean_of_finite(values: Array) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else None
