"""What filters believe before anything is measured, and how much of it a step leaves."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from agents.controllers.controller import Array
from agents.controllers.filters.hypotheses import FilterSettings, Hypotheses, assumed_ranges
from agents.controllers.filters.model import Model, Part
from rj_gym.tracking.task import TrackingTask

_SPREADS = 3.0  # standard deviations: how far an estimate of a tendon's stiffness may go
_UNBOUNDED = (-math.inf, math.inf)


@dataclass(frozen=True)
class Prior:
    """The distribution of states at the start, and what happens to them from step to step.

    Args:
        means, variances: of the states at the start, (H, states).
        memory: what a step leaves of every state, (states,). walk: variances of what it adds, (states,).
        low, high: beyond which no estimate of a state goes, (states,).
    """

    means: Array
    variances: Array
    memory: Array
    walk: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, task: TrackingTask, model: Model, some: FilterSettings, hypotheses: Hypotheses) -> Prior:
        """That of a task's settings, of what the filters assume and of what they differ in."""
        H, m = hypotheses.half_widths.shape
        play, friction = assumed_ranges(task.config, some)
        stiffening = _SPREADS * some.stiffness_sd
        width_sd, friction_sd = (
            some.width_share * (play[1] - play[0]) / 2,
            some.friction_share * (friction[1] - friction[0]),
        )
        place_sd = some.place_share * hypotheses.half_widths
        bias_walk = some.bias_walk_mm if some.bias_sd_mm > 0.0 else 0.0
        parts = [
            *model.load_prior(some.force_walk),
            Part(m, 0.0, some.offset_sd_mm, 1.0, some.offset_walk_mm, _UNBOUNDED),
            Part(m, 0.0, some.stiffness_sd, 1.0, 0.0, (-stiffening, stiffening)),
            Part(task.dimension, 0.0, some.bias_sd_mm, 1.0, bias_walk, _UNBOUNDED),
            Part(m, hypotheses.half_widths, width_sd, 1.0, 0.0, (0.25 * play[0], 0.75 * play[1])),
            Part(m, hypotheses.frictions, friction_sd, 1.0, 0.0, (0.0, 1.5 * friction[1])),
            Part(m, 0.0, place_sd, 1.0, 0.0, _UNBOUNDED),
        ]

        def column(which: str) -> Array:
            values = [(getattr(part, which), part.size) for part in parts]
            return np.concatenate([np.broadcast_to(np.asarray(v, float), (H, n)) for v, n in values], axis=1)

        bounds = np.array([part.bounds for part in parts for _ in range(part.size)])
        means, sds, memory, walk = map(column, ("mean", "sd", "memory", "walk"))
        return cls(means, sds**2, memory[0], walk[0] ** 2, *np.ascontiguousarray(bounds.T))


def start_measurement(
    model: Model, states: Array, played: Array, tension: float, sd: float
) -> tuple[Array, Array, Array, Array]:
    """That tendons begin at a known tension, as a measurement of their lengths: so commands are nearly known.

    Args:
        model: of the mechanism.
        states: at which it is linearised, (R, states).
        played: commands behind the play, (R, m) [mm].
        tension: at the start [N].
        sd: standard deviation of the lengths [mm].
    Returns:
        How far they are expected from where the model has them, with commands off by nothing, (R, m) [mm], the
        derivatives of that (R, m, states), measured (R, m), variances (R, m).
    """
    at, (rows, m), L = model.places, played.shape, model.N_LOAD
    start, by_load = model.start(states, tension)
    stretch = start.tensions / model.mechanism.stiffnesses * np.ones((rows, 1))
    columns = np.zeros((rows, m, at.total))
    columns[:, :, :L] = -by_load
    for j in range(m):
        columns[:, j, at.offsets + j] = columns[:, j, at.starts + j] = 1.0
        columns[:, j, at.stiffnesses + j] = -stretch[:, j]
    return played + stretch, columns, start.lengths * np.ones((rows, 1)), np.full((rows, m), sd**2)
