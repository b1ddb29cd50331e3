"""Workspaces: where the tip of a mechanism can be, and how well it moves, presses and holds there."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain, check_chain
from rollingjoint.checks import as_choice, as_integer
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse.search import reach_batch
from rollingjoint.inverse.searches import PREFERENCES
from rollingjoint.inverse.starts import sampled
from rollingjoint.load import Load
from rollingjoint.statics.inputs import tension_limits_of
from rollingjoint.statics.sensitivity import dtip_dforce, dtip_dtensions, tip_and_tensions_dlengths
from rollingjoint.statics.solve import solve_lengths_batch

Array = NDArray[np.float64]

CELLS = {2: 40, 3: 16}  # along the longest side, by the dimension
MOST_CELLS = 400
_SAMPLES = 4096
_SAME = 1e-6  # mm
_STARTS = 4
_RIGID = 1e-9  # of the largest compliance: a smaller one is none
_ROUNDING = 1e-12  # of the longest generator: shorter directions are none


@dataclass(frozen=True, eq=False, repr=False)
class Workspace:
    """Cells in which the tip can be, N of them, each with the preferred equilibrium at its middle or next to it.

    Attributes:
        cells: whole numbers, (N, 2 or 3): a cell reaches from these, times its side, to the next ones.
        cell: side of a cell [mm].
        equilibria: with the tip in the cells, N rows, lengths held.
        tension_limits: lowest and highest, (m,) each [N].
    """

    cells: NDArray[np.int64]
    cell: float
    equilibria: Any
    tension_limits: tuple[Array, Array]

    @property
    def centres(self) -> Array:
        """(N, 2 or 3) middles of the cells [mm]."""
        return np.asarray((self.cells + 0.5) * self.cell)

    @property
    def size(self) -> float:
        """Area [mm²] or volume [mm³] of the cells."""
        return float(len(self.cells) * self.cell ** self.cells.shape[1])

    @cached_property
    def motion(self) -> Array:
        """(N, 2 or 3, m) d tip / d commanded lengths [mm/mm]."""
        return np.asarray(tip_and_tensions_dlengths(self.equilibria)[0])

    @property
    def dexterity(self) -> Array:
        """(N,) smallest over largest speed of the tip per speed of the lengths, from 0 to 1.

        1: all directions alike. 0: none across some direction. Source: Salisbury and Craig, Articulated hands, 1982.
        """
        gains = np.linalg.svd(self.motion, compute_uv=False)
        return np.asarray(gains[:, -1] / np.maximum(gains[:, 0], np.finfo(float).tiny))

    @cached_property
    def compliance(self) -> Array:
        """(N, 2 or 3, 2 or 3) d tip / d force on it, lengths held [mm/N]; symmetric: an ellipse."""
        rates = dtip_dforce(self.equilibria)
        return np.asarray(0.5 * (rates + np.swapaxes(rates, -1, -2)))

    @property
    def principal_stiffness(self) -> tuple[Array, Array]:
        """Stiffnesses along the axes of the ellipses, (N, 2 or 3) [N/mm], smallest first, and unit axes as columns.

        Infinite where joints at their limits leave the tip no way to move.
        """
        values, axes = np.linalg.eigh(self.compliance)
        values, axes = values[:, ::-1], axes[:, :, ::-1]
        rigid = values <= _RIGID * values[:, :1]
        return np.where(rigid, np.inf, 1.0 / np.where(rigid, 1.0, values)), axes

    @cached_property
    def force_rates(self) -> Array:
        """(N, 2 or 3, m) force with which a tip that cannot move presses per change of tension [N/N].

        Of a tip held in its place: (d tip / d tensions) x change = compliance x force, all at given tensions.
        """
        at = self.equilibria
        return np.asarray(np.linalg.pinv(dtip_dforce(at, "tensions"), rcond=_RIGID) @ dtip_dtensions(at))

    @cached_property
    def force(self) -> Array:
        """(N,) largest force that a tip held in its place can press with in every direction, within the limits [N].

        To first order in the changes of tension: the radius of the largest circle or sphere about 0 in the zonotope of
        the forces. 0 at the edge of the reachable set. Source: Chiacchio et al., Force polytope and force ellipsoid
        for redundant manipulators, J. Robotic Systems 14, 1997.
        """
        tensions = self.equilibria.tensions
        low, high = self.tension_limits[0] - tensions, self.tension_limits[1] - tensions
        rates = np.swapaxes(self.force_rates, -1, -2)  # (N, m, d): generators
        m, d = rates.shape[-2:]
        radius = np.full(len(rates), np.inf)
        for chosen in itertools.combinations(range(m), d - 1):
            normal = _across(rates[:, list(chosen)])
            length = np.linalg.norm(normal, axis=-1)
            usable = length > _ROUNDING * np.abs(rates).max(axis=(1, 2)) ** (d - 1)
            shares = (rates @ normal[..., None])[..., 0] / np.where(usable, length, 1.0)[:, None]
            for side in (shares, -shares):
                farthest = np.sum(np.maximum(side * low, side * high), axis=1)
                radius = np.where(usable, np.minimum(radius, farthest), radius)
        return np.where(np.isfinite(radius), np.maximum(radius, 0.0), 0.0)

    def __repr__(self) -> str:
        unit = "mm²" if self.cells.shape[1] == 2 else "mm³"
        return f"<Workspace, {len(self.cells)} cells of {self.cell:.3g} mm: {self.size:.3g} {unit}>"


def workspace(
    mechanism: AnyChain,
    loads: Sequence[Load] = (),
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.5, 20.0),
    *,
    cells: int | None = None,
    prefer: str = "margins",
) -> Workspace:
    """Where the tip of a mechanism can be within tension limits, and how well it moves, presses and holds there.

    Tips under 4,096 random tensions say which cells of a grid are tried, with those next to them; `reach_batch` looks
    for the tip nearest to the middle of each, and the cell counts where it lies in it.

    Args:
        mechanism: a chain of any class.
        loads: external loads.
        tension_limits: minimum and maximum tendon tension, finite, numbers or (m,) [N].
        cells: along the longest side of the tips: 40 in the plane, 16 in space.
        prefer: which of many solutions, as of `reach`.
    Raises:
        InvalidInput: wrong shapes or types, limits that are infinite or out of order, no stable equilibrium.
    Source: docs/workspace.md.
    """
    check_chain(mechanism)
    as_choice("prefer", prefer, PREFERENCES)
    low, high = tension_limits_of(tension_limits, mechanism.n_tendons)
    if not ((low >= 0.0) & (low < high) & np.isfinite(high)).all():
        raise InvalidInput("tension_limits", tension_limits, "0 <= lowest < highest, finite")
    count = CELLS[mechanism.dimension] if cells is None else as_integer("cells", cells, 1, MOST_CELLS)
    tips = sampled(mechanism, mechanism.load_table(loads)[None], low, high, _SAMPLES).require().tip
    if not len(tips):
        raise InvalidInput("loads", list(loads), "some under which there are stable equilibria within the limits")
    side = float(np.ptp(tips, axis=0).max()) / count
    if not side > 0.0:
        raise InvalidInput("mechanism", mechanism, "one that its tendons move")
    around = np.array(list(itertools.product((-1, 0, 1), repeat=mechanism.dimension)))
    inside = np.unique(np.floor(tips / side).astype(np.int64), axis=0)
    tried = np.unique((inside[:, None] + around).reshape(-1, mechanism.dimension), axis=0)
    there = reach_batch(mechanism, (tried + 0.5) * side, loads, (low, high), prefer=prefer, starts=_STARTS)
    stable = there.equilibrium.ok & (np.floor(there.tip / side) == tried).all(axis=1)
    lengths, angles = there.lengths[stable], there.joint_angles[stable]
    held = solve_lengths_batch(mechanism, lengths, loads, angles)  # without limits no tendon yields
    kept = np.flatnonzero(held.ok & (np.abs(held.tip - there.tip[stable]).max(axis=1, initial=0.0) < _SAME))
    if len(kept) < len(lengths):
        held = solve_lengths_batch(mechanism, lengths[kept], loads, angles[kept])
    return Workspace(tried[stable][kept], side, held, (low, high))


def _across(vectors: Array) -> Array:
    """A vector across d - 1 others, (N, d - 1, d), of them in the plane or in space."""
    if vectors.shape[-1] == 2:
        return np.stack([-vectors[:, 0, 1], vectors[:, 0, 0]], axis=-1)
    return np.cross(vectors[:, 0], vectors[:, 1])
