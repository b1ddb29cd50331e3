"""The beliefs of filters before any measurement, and their change in a step."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from agents.controllers.controller import Array
from agents.controllers.filters.hypotheses import FilterSettings, Hypotheses, assumed_ranges
from agents.controllers.filters.model import FilterModel, StatePart
from rj_gym.tracking.task import TrackingTask

_SPREADS = 3.0  # standard deviations: how far an estimate of a tendon's stiffness may go
_UNBOUNDED = (-math.inf, math.inf)


@dataclass(frozen=True)
class Prior:
    """The distribution of states at the start, and its change from step to step.

    Args:
        means, variances: of the states at the start, (H, states).
        memory: factors of a step, (states,). walk: variances that it adds, (states,).
        low, high: beyond which no estimate of a state goes, (states,).
    """

    means: Array
    variances: Array
    memory: Array
    walk: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, task: TrackingTask, model: FilterModel, settings: FilterSettings, hypotheses: Hypotheses) -> Prior:
        """The prior of a task's settings, of assumptions and hypotheses."""
        H, m = hypotheses.half_widths.shape
        play, friction = assumed_ranges(task.config, settings)
        stiffening = _SPREADS * settings.stiffness_sd
        width_sd, friction_sd = (
            settings.width_share * (play[1] - play[0]) / 2,
            settings.friction_share * (friction[1] - friction[0]),
        )
        place_sd = settings.place_share * hypotheses.half_widths
        bias_walk = settings.bias_walk_mm if settings.bias_sd_mm > 0.0 else 0.0
        parts = [
            *model.load_prior(settings.force_walk),
            StatePart(m, 0.0, settings.offset_sd_mm, 1.0, settings.offset_walk_mm, _UNBOUNDED),
            StatePart(m, 0.0, settings.stiffness_sd, 1.0, 0.0, (-stiffening, stiffening)),
            StatePart(task.dimension, 0.0, settings.bias_sd_mm, 1.0, bias_walk, _UNBOUNDED),
            StatePart(m, hypotheses.half_widths, width_sd, 1.0, 0.0, (0.25 * play[0], 0.75 * play[1])),
            StatePart(m, hypotheses.frictions, friction_sd, 1.0, 0.0, (0.0, 1.5 * friction[1])),
            StatePart(m, 0.0, place_sd, 1.0, 0.0, _UNBOUNDED),
        ]

        def column(which: str) -> Array:
            values = [(getattr(part, which), part.size) for part in parts]
            return np.concatenate([np.broadcast_to(np.asarray(v, float), (H, n)) for v, n in values], axis=1)

        bounds = np.array([part.bounds for part in parts for _ in range(part.size)])
        means, sds, memory, walk = map(column, ("mean", "sd", "memory", "walk"))
        return cls(means, sds**2, memory[0], walk[0] ** 2, *np.ascontiguousarray(bounds.T))


def start_measurement(
    model: FilterModel, states: Array, played: Array, tension: float, sd: float
) -> tuple[Array, Array, Array, Array]:
    """That tendons begin at a known tension, as a measurement of their lengths: so commands are nearly known.

    Args:
        model: of the mechanism.
        states: at which it is linearised, (R, states).
        played: commands behind the play, (R, m) [mm].
        tension: at the start [N].
        sd: standard deviation of the lengths [mm].
    Returns:
        How far they are expected from where the model has them, without offsets of commands, (R, m) [mm], the
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
