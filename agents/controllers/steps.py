"""Steps of tensions and lengths: responses of a model, bounded steps on them, and the settings of feedback."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, TypeVar

import numpy as np

from agents.controllers.controller import Array, Mask, restarted, saturated
from rj_gym.core.settings import Settings
from rollingjoint import solve_tensions_batch
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.solution import Solution
from rollingjoint.checks import as_number
from rollingjoint.load import Load
from rollingjoint.statics.sensitivity import dtip_dtensions, tip_and_tensions_dlengths

KEEP = 3.0  # mm/N: weight of a tension beyond the margin, above any error's
_MARGIN = 0.05  # of the tension range, kept free at both ends: a slack or yielding tendon has no effect


def tensions_within_margin(limits: tuple[Any, Any]) -> tuple[Any, Any]:
    """The tensions that feedback uses, of those that the motors can hold [N]; limits may be arrays (B, m)."""
    low, high = limits
    margin = _MARGIN * (high - low)
    return low + margin, high - margin


def pulling_in(moves: Array, action_scale_mm: float) -> Array:
    """Actions that change the commanded lengths by moves (B, m) [mm], as far as one step can."""
    return saturated(-moves / action_scale_mm)


class TargetMotion:
    """The way of targets from step to step."""

    def __init__(self) -> None:
        self._before = np.empty(0)

    def reset(self, mask: Mask, dimension: int) -> None:
        """Forget the targets of the episodes of the mask, (B,)."""
        self._before = restarted(self._before, mask, np.full((len(mask), dimension), np.nan))

    def since_last(self, target: Array) -> Array:
        """How far targets (B, d) moved since the last call, (B, d) [mm]; 0 at the first one."""
        before = np.where(np.isnan(self._before), target, self._before)
        self._before = target
        return target - before


@dataclass(frozen=True)
class FeedbackSettings(Settings):
    """Weights of the increments of JacobianFeedback, and how motors cross the play of their tendons.

    Args:
        gain: share of the error that a step removes: less than 1 averages noise.
        stiffen: weight of tensions [mm/N]: weak against the error, strong enough to end at high tensions in an episode.
        damping: the smallest response of the tip to lengths that is used [mm/mm].
        far: more damping far from the target, where the response will have changed on arrival [1/mm].
        crossing: share of the play's half width by which a motor goes ahead of a tendon that it moves.
        dead_band_mm: moves of a tendon that are not worth crossing the play for [mm].
        half_width_mm: of the play, where no filter estimates it [mm].
        rest_tension: mean tension for which feedback on filters goes where high ones do not stiffen, as in an arm [N].
    """

    _SECTION: ClassVar[str] = "feedback."
    gain: float = 0.8
    stiffen: float = 0.1
    damping: float = 0.3
    far: float = 0.05
    crossing: float = 1.0
    dead_band_mm: float = 0.1
    half_width_mm: float = 0.0
    rest_tension: float = 3.0

    def __post_init__(self) -> None:
        self._check(as_number, "gain", low=0.0, high=2.0)
        self._check(as_number, "stiffen", "far", "dead_band_mm", "half_width_mm", low=0.0, high=100.0)
        self._check(as_number, "damping", "rest_tension", low=1e-3, high=100.0)
        self._check(as_number, "crossing", low=0.0, high=2.0)


Equilibria = TypeVar("Equilibria", bound=Solution)

_ROUNDING = 1e-10  # of a hessian's trace, added to its diagonal: near a snap-through responses grow without bound


def length_responses(equilibria: Solution) -> tuple[Array, Array]:
    """d tip / d commanded lengths (B, d, m) [mm/mm] and d tensions / d commanded lengths (B, m, m) [N/mm].

    Where an equilibrium is not usable the pose is taken as held, so that tendons only stretch.
    """
    valid, stiffnesses = np.asarray(equilibria.ok), equilibria.mechanism.stiffnesses
    tips = np.zeros((*equilibria.tip.shape, len(stiffnesses)))
    tensions = np.repeat(-np.diag(stiffnesses)[None], len(valid), axis=0)
    if valid.any():
        tips[valid], tensions[valid] = tip_and_tensions_dlengths(rows_of(equilibria, valid))
    return tips, tensions


def tension_response(equilibria: Solution) -> Array:
    """d tip / d tensions, (B, d, m) [mm/N]; zero where an equilibrium is not usable."""
    valid = np.asarray(equilibria.ok)
    tips = np.zeros((*equilibria.tip.shape, equilibria.tensions.shape[1]))
    if valid.any():
        tips[valid] = dtip_dtensions(rows_of(equilibria, valid))
    return tips


def bounded_step(hessian: Array, slope: Array, low: Array, high: Array) -> Array:
    """Steps x (B, m) within bounds that make x·hessian·x / 2 + slope·x small.

    Entries that the minimum would take beyond the bounds stop there, and the others are chosen again: the best ones
    given those that stopped. Compared with steps that are sure to descend (straight to the first
    bound, then along it), control with these got stuck less often.

    Args:
        hessian: (B, m, m), positive definite up to rounding.
        slope: (B, m).
        low, high: bounds, (B, m).
    """
    step, held = np.zeros_like(slope), np.zeros(slope.shape, bool)
    eye = np.eye(slope.shape[1])
    hessian = hessian + _ROUNDING * np.trace(hessian, axis1=1, axis2=2)[:, None, None] * eye
    for _ in range(slope.shape[1]):
        reduced = np.where(held[:, :, None] | held[:, None, :], eye, hessian)
        gradient = np.where(held, 0.0, slope + _times(hessian, np.where(held, step, 0.0)))
        minimum = np.where(held, step, -np.linalg.solve(reduced, gradient[..., None])[..., 0])
        step = np.clip(minimum, low, high)
        held |= step != minimum
    return step


def rows_of(equilibria: Equilibria, rows: Mask) -> Equilibria:
    """Some of the equilibria of one mechanism, solved without friction."""
    return with_arrays(equilibria, {name: getattr(equilibria, name)[rows] for name in _array_names(equilibria)})


def choose(rows: Mask, candidates: Equilibria, equilibria: Equilibria) -> Equilibria:
    """The candidates in these rows, the equilibria, with as many loads, elsewhere.

    Where both have friction, so has the choice; it has the candidates' mechanisms.
    """
    arrays: dict[str, Any] = {
        name: restarted(getattr(equilibria, name), rows, getattr(candidates, name)) for name in _array_names(candidates)
    }
    first, second = getattr(candidates, "friction", None), getattr(equilibria, "friction", None)
    if first is not None and second is not None:
        arrays["friction"] = type(first)(*(restarted(b, rows, a) for a, b in zip(first, second, strict=True)))
    return with_arrays(candidates, arrays)


def with_arrays(equilibria: Equilibria, arrays: Mapping[str, Any]) -> Equilibria:
    """The equilibria with other arrays."""
    either_class: Any = equilibria
    changed: Equilibria = replace(either_class, **arrays)
    return changed


def _array_names(equilibria: Any) -> list[str]:
    return [field.name for field in fields(equilibria) if field.name not in ("mechanism", "friction", "walls")]


def _times(matrices: Array, vectors: Array) -> Array:
    """Matrices (B, k, m) times vectors (B, m), (B, k)."""
    return (matrices @ vectors[..., None])[..., 0]


_PULL = 1e-3  # of the mechanism's length: tip error that a factor e between a tension and its rest may cost
_CLOSE = 1e-6  # of a tension: smaller steps end the search


def nearest_tensions(
    mechanism: AnyChain,
    targets: Array,
    limits: tuple[float, float],
    rest: Array,
    starts: Array,
    loads: Array | Sequence[Load] = (),
    most_steps: int = 30,
) -> Array:
    """Tensions (B, m) [N] within `limits` at which the model's tip is nearest to the target.

    Levenberg-Marquardt over the logarithms of the tensions, all targets at once. Unloaded, only ratios of tensions
    matter, and more than two tendons leave a choice: a weak pull towards the tensions at rest decides.

    Args:
        mechanism: the model.
        targets: (B, d) [mm].
        limits: lowest and highest tension [N].
        rest, starts: tensions at rest, and the first guess, (B, m) [N].
        loads: load tables, (B, rows, columns), or loads that act on all rows; none by default.
        most_steps: limit of the iterations.
    """
    low, high = np.log(np.maximum(limits, 1e-3))
    pull, calm = (_PULL * mechanism.length) ** 2, np.log(rest)
    best = np.clip(np.log(starts), low, high)
    equilibria: Solution = solve_tensions_batch(mechanism, np.exp(best), loads)
    lowest, damping = _cost(equilibria, targets, pull, best - calm), np.full(len(best), 1e-3)
    going = np.ones((len(best), 1), bool)
    for _ in range(most_steps):
        rates = tension_response(equilibria) * np.exp(best)[:, None]
        hessian = np.swapaxes(rates, 1, 2) @ rates
        size = pull + damping * np.trace(hessian, axis1=1, axis2=2)
        hessian += size[:, None, None] * np.eye(best.shape[1])
        slope = np.einsum("bim,bi->bm", rates, equilibria.tip - targets) + pull * (best - calm)
        step = going * bounded_step(hessian, slope, low - best, high - best)
        trial = solve_tensions_batch(mechanism, np.exp(best + step), loads, equilibria)
        cost = _cost(trial, targets, pull, best + step - calm)
        better = cost < lowest
        best, lowest = best + step * better[:, None], np.where(better, cost, lowest)
        equilibria = choose(better, trial, equilibria)
        damping *= np.where(better, 0.1, 10.0)
        going = np.abs(step).max(axis=1, keepdims=True) > _CLOSE
        if not going.any():
            break
    return np.exp(best)


def _cost(equilibria: Solution, targets: Array, pull: float, deviation: Array) -> Array:
    """The cost of tensions, (B,) [mm²]."""
    cost = np.sum((equilibria.tip - targets) ** 2, axis=1) + pull * np.sum(deviation**2, axis=1)
    return np.where(equilibria.ok, cost, np.inf)
