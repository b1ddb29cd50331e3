"""Many chains that differ from a nominal one in the places of their surfaces and the stiffnesses of their tendons.

Their arrays are filled all at once; a single chain is built only when it is asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain import joint_table
from rollingjoint.chain.rolling import RollingChain, tendon_arrays
from rollingjoint.chain.stacks import Deferred, Variations
from rollingjoint.chain.tendon import OnSurface
from rollingjoint.errors import MechanismError
from rollingjoint.kernels.joints import BUCKETS
from rollingjoint.kernels.rolling import Chain
from rollingjoint.load import load_table
from rollingjoint.profile import Surface

Array = NDArray[np.float64]


def varied_chain(nominal: RollingChain, offsets: Array, factors: Array) -> RollingChain:
    """The chain with displaced contact surfaces and other tendon stiffnesses; itself where all are unchanged.

    Offsets under which the chain could not be built are halved until it can.

    Args:
        nominal: the chain.
        offsets: x, y, angle of every link's parent and child surface, (n, 2, 3) [mm, rad].
        factors: of the tendon stiffnesses, (m,).
    """
    changes: dict[str, object] = {}
    if np.any(factors != 1):
        changes["tendons"] = tuple(
            replace(tendon, stiffness=tendon.stiffness * float(factor))
            for tendon, factor in zip(nominal.tendons, factors, strict=True)
        )
    while np.any(np.abs(offsets) > 1e-6):
        links = tuple(
            replace(link, parent=_displaced(link.parent, parent), child=_displaced(link.child, child))
            for link, (parent, child) in zip(nominal.links, offsets, strict=True)
        )
        try:
            return nominal.replace(links=links, **changes)
        except MechanismError:  # tendon holes that would cross: a workshop would scrap the part; halve the error
            offsets = 0.5 * offsets
    return nominal.replace(**changes) if changes else nominal


def _displaced(surface: Surface, offset: Array) -> Surface:
    (x, y), (dx, dy, turn) = surface.start, offset
    return replace(surface, start=(x + dx, y + dy), angle=surface.angle + turn)


class ChainVariations(Variations[RollingChain]):
    """D variations of a chain, as `varied_chain` makes them one by one.

    Args:
        nominal: the chain.
        offsets: (D, n, 2, 3) [mm, rad]. factors: (D, m).
    """

    def __init__(self, nominal: RollingChain, offsets: Array, factors: Array) -> None:
        self._offsets, self._factors = offsets.copy(), factors.copy()
        super().__init__(nominal, len(offsets), nominal.stiffnesses * factors)
        self._moves = bool(np.any(np.abs(offsets) > 1e-6))
        if not self._moves:
            self.arrays, self.designs = nominal.arrays, np.zeros(len(offsets), np.int64)
            self.neutral_angles = np.repeat(nominal.neutral_angles[None], len(offsets), axis=0)
            return
        placed = _Placed(nominal, offsets)
        self.arrays, self.designs = placed.arrays(), np.arange(len(offsets))
        self.neutral_angles = placed.neutral_angles()
        for place in np.flatnonzero(placed.crossed()).tolist():
            self._enter(place, self[place])

    def get_state(self) -> dict[str, Array]:
        """Their offsets and factors, copied."""
        return {"offsets": self._offsets.copy(), "factors": self._factors.copy()}

    def _build(self, place: int) -> RollingChain:
        return varied_chain(self.nominal, self._offsets[place], self._factors[place])

    def members(self) -> Deferred[RollingChain]:
        """Their present values, unchanged by a later `take`."""
        nominal, offsets, factors = self.nominal, self._offsets.copy(), self._factors.copy()
        return Deferred(len(self), lambda place: varied_chain(nominal, offsets[place], factors[place]))

    def _take(self, rows: NDArray[np.int64], other: ChainVariations, places: NDArray[np.int64]) -> bool:
        if self._moves != other._moves:
            return False
        self._offsets[rows], self._factors[rows] = other._offsets[places], other._factors[places]
        if self._moves:
            _copy(self.arrays, rows, other.arrays, places)
        return True

    def _enter(self, place: int, chain: RollingChain) -> None:
        """Enter a chain's own arrays in place of the computed ones."""
        _copy(self.arrays, np.array([place]), chain.arrays, np.zeros(1, np.int64))
        self.neutral_angles[place] = chain.neutral_angles


def _copy(stack: Chain, rows: NDArray[np.int64], source: Chain, places: NDArray[np.int64]) -> None:
    """Copy designs of one stack to rows of another one, all with equally many cells."""
    cells = len(stack.cells) // len(stack.joints)
    for name in ("cells", "coefficients", "arc_coefficients"):
        target, values = getattr(stack, name), getattr(source, name)
        target.reshape(-1, cells, *target.shape[1:])[rows] = values.reshape(-1, cells, *values.shape[1:])[places]
    for name in ("joints", "holes", "channels", "directions"):
        getattr(stack, name)[rows] = getattr(source, name)[places]
    stack.buckets[rows] = source.buckets[places] + cells * (rows - places)[:, None, None]


class _Placed:
    """The surfaces of D variations, by link: where each starts and how it is turned."""

    def __init__(self, nominal: RollingChain, offsets: Array) -> None:
        sides = [(link.parent, link.child) for link in nominal.links]
        self.nominal, self.count = nominal, len(offsets)
        self.starts = np.array([[side.start for side in pair] for pair in sides]) + offsets[..., :2]  # (D, n, 2, 2)
        self.angles = np.array([[side.angle for side in pair] for pair in sides]) + offsets[..., 2]  # (D, n, 2)
        flat = self.angles.ravel().tolist()
        cos, sin = (np.array([turn(angle) for angle in flat]) for turn in (math.cos, math.sin))
        self._turns = np.stack([cos, sin, -sin, cos], axis=-1).reshape(*self.angles.shape, 2, 2)  # as Surface.placed
        self._points = [self._hole_points(j) for j in range(nominal.n_tendons)]

    def placed(self, link: int, side: int, curve: Array) -> Array:
        """Points of a profile's curve (K, 2) in the link frames, (D, K, 2) [mm]."""
        return curve @ self._turns[:, link, side] + self.starts[:, link, side, None]

    def neutral_angles(self) -> Array:
        """Joint angles at s = 0, (D, J) [rad]."""
        angles = np.empty((self.count, self.nominal.n_joints))
        for i, (child, parent) in enumerate(_joints(self.nominal)):
            at = np.clip(0.0, *self.nominal.joint_limits[i])
            below, above = child.profile.turning(at), parent.profile.turning(at)
            angles[:, i] = (self.angles[:, i, 1] + below) - (self.angles[:, i + 1, 0] + above)
        return angles

    def arrays(self) -> Chain:
        """The tables of all variations as one stack."""
        nominal, count = self.nominal, self.count
        tables = [joint_table.profile_table(child.profile, parent.profile) for child, parent in _joints(nominal)]
        stops = np.cumsum([0] + [len(table.cells) for table in tables])
        cells, coefficients, arcs = (_aligned_room((count, stops[-1], *part.shape[1:])) for part in tables[0])
        joints = np.empty((count, nominal.n_joints, 3))
        for i, table in enumerate(tables):
            part = slice(stops[i], stops[i + 1])
            angles, starts = (
                (self.angles[:, i, 1], self.angles[:, i + 1, 0]),
                (self.starts[:, i, 1], self.starts[:, i + 1, 0]),
            )
            joint_table.place(table, angles, starts, cells[:, part], coefficients[:, part])
            arcs[:, part] = table.arc_coefficients
            low, high = cells[:, stops[i], 0], cells[:, stops[i + 1] - 1, 1]
            joints[:, i, 0], joints[:, i, 1], joints[:, i, 2] = low, high, BUCKETS / (high - low)
        return Chain(
            joints,
            nominal.arrays.buckets + stops[-1] * np.arange(count)[:, None, None],
            cells.reshape(-1, *cells.shape[2:]),
            coefficients.reshape(-1, *coefficients.shape[2:]),
            arcs.reshape(-1, *arcs.shape[2:]),
            *tendon_arrays(self._points, nominal.n_joints),
            nominal.arrays.tendon_joints,
            np.repeat(load_table(nominal.springs, nominal.n_links)[None], count, axis=0),
        )

    def crossed(self) -> NDArray[np.bool_]:
        """Whether holes of a variation cross somewhere, (D,).

        Holes on both surfaces of a joint move with them: their heights there stay as in the nominal chain.
        """
        crossed = np.zeros(self.count, bool)
        for i, (child, parent) in enumerate(_joints(self.nominal)):
            tendons = [points[:, i : i + 2] for j, points in enumerate(self._points) if self._is_free(j, i)]
            if tendons:
                holes = np.stack([t[:, 0, 1] for t in tendons], axis=1), np.stack([t[:, 1, 0] for t in tendons], axis=1)
                contact = joint_table.contacts(child.profile, parent.profile)
                places = self.placed(i, 1, contact.child_curve), self.placed(i + 1, 0, contact.parent_curve)
                height = joint_table.heights(contact, (self.angles[:, i, 1], self.angles[:, i + 1, 0]), places, holes)
                crossed |= height.min(axis=(1, 2)) < -joint_table.CROSSING
        return crossed

    def _is_free(self, tendon: int, joint: int) -> bool:
        """Whether a tendon crosses a joint through a hole that does not move with its surface."""
        holes = self.nominal.tendons[tendon].link_holes(self.nominal.n_links)
        if len(holes) <= joint + 1:
            return False
        return not (isinstance(holes[joint][1], OnSurface) and isinstance(holes[joint + 1][0], OnSurface))

    def _hole_points(self, tendon: int) -> Array:
        """As RollingChain.hole_points of one tendon, (D, links, 2, 2) [mm]."""
        nominal = self.nominal
        points = np.repeat(nominal.hole_points[tendon][None], self.count, axis=0)
        holes = nominal.tendons[tendon].link_holes(nominal.n_links)
        for k, pair in enumerate(holes):
            for side, hole in enumerate(pair):
                if isinstance(hole, OnSurface):
                    link = nominal.links[k]
                    profile = (link.parent, link.child)[side].profile
                    points[:, k, side] = self.placed(k, side, profile.curve(hole.s)[None])[:, 0]
        return points


def _joints(nominal: RollingChain) -> Sequence[tuple[Surface, Surface]]:
    """The surfaces that touch at every joint: child of the link below, parent of the link above."""
    return [(below.child, above.parent) for below, above in zip(nominal.links[:-1], nominal.links[1:], strict=True)]


def _aligned_room(shape: tuple[int, ...]) -> Array:
    """Empty memory that begins at a multiple of 64 bytes, as kernels.joints.aligned."""
    size = 8 * math.prod(shape)
    memory = np.empty(size + 64, np.uint8)
    start = -memory.ctypes.data % 64
    return memory[start : start + size].view(np.float64).reshape(shape)
