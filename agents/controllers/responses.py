"""Responses of tip and tensions to tendon increments, and increments within bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from agents.evaluation.controller import Array
from rollingjoint.chain.solution import Solution
from rollingjoint.statics.sensitivity import dtip_dtensions, tip_and_tensions_dlengths

Mask = NDArray[np.bool_]
Equilibria = TypeVar("Equilibria", bound=Solution)

_ROUNDING = 1e-10  # of a hessian's trace, added to its diagonal: near a snap-through responses grow without bound


def length_responses(equilibria: Solution) -> tuple[Array, Array]:
    """d tip / d commanded lengths (B, d, m) [mm/mm] and d tensions / d commanded lengths (B, m, m) [N/mm].

    Where an equilibrium is not usable the pose is taken as held, so that tendons only stretch.
    """
    usable, stiffnesses = np.asarray(equilibria.ok), equilibria.mechanism.stiffnesses
    tips = np.zeros((*equilibria.tip.shape, len(stiffnesses)))
    tensions = np.repeat(-np.diag(stiffnesses)[None], len(usable), axis=0)
    if usable.any():
        tips[usable], tensions[usable] = tip_and_tensions_dlengths(rows_of(equilibria, usable))
    return tips, tensions


def tension_response(equilibria: Solution) -> Array:
    """d tip / d tensions, (B, d, m) [mm/N]; zero where an equilibrium is not usable."""
    usable = np.asarray(equilibria.ok)
    tips = np.zeros((*equilibria.tip.shape, equilibria.tensions.shape[1]))
    if usable.any():
        tips[usable] = dtip_dtensions(rows_of(equilibria, usable))
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
        rest = np.where(held, 0.0, slope + _times(hessian, np.where(held, step, 0.0)))
        chosen = np.where(held, step, -np.linalg.solve(reduced, rest[..., None])[..., 0])
        step = np.clip(chosen, low, high)
        held |= step != chosen
    return step


def rows_of(equilibria: Equilibria, rows: Mask) -> Equilibria:
    """Some of the equilibria of one mechanism, solved without friction."""
    return with_arrays(equilibria, {name: getattr(equilibria, name)[rows] for name in _array_names(equilibria)})


def choose(rows: Mask, one: Equilibria, other: Equilibria) -> Equilibria:
    """The equilibria of `one` in these rows, those of `other`, under as many loads, elsewhere."""
    chosen = {}
    for name in _array_names(one):
        first, second = getattr(one, name), getattr(other, name)
        chosen[name] = np.where(rows.reshape(-1, *[1] * (first.ndim - 1)), first, second)
    return with_arrays(one, chosen)


def with_arrays(equilibria: Equilibria, arrays: Mapping[str, Array]) -> Equilibria:
    """The equilibria with other arrays."""
    either_class: Any = equilibria
    changed: Equilibria = replace(either_class, **arrays)
    return changed


def _array_names(equilibria: Any) -> list[str]:
    return [field.name for field in fields(equilibria) if field.name not in ("mechanism", "friction")]


def _times(matrices: Array, vectors: Array) -> Array:
    """Matrices (B, k, m) times vectors (B, m), (B, k)."""
    return (matrices @ vectors[..., None])[..., 0]
