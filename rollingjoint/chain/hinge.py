"""Spatial chains of beads on elastic hinges: beads, tendons, and the arrays that kernels read."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain import se3
from rollingjoint.chain.chain import Chain, Kernels, members, read_only, with_equal_rows
from rollingjoint.chain.equilibrium import HingeEquilibrium
from rollingjoint.chain.tendon import BeadTendon
from rollingjoint.checks import as_floats, as_number, as_positive
from rollingjoint.errors import InvalidInput, MechanismError
from rollingjoint.friction import CapstanFriction, checked_friction
from rollingjoint.kernels.hinge_lanes import (
    MOST_HINGES,
    memory_alone,
    solve_hinges_alone,
    solve_hinges_pinned,
    step_hinges_side_by_side,
)
from rollingjoint.kernels.hinges import N_TURNS, HingeBatchArrays, Hinges, PinnedHinges, new_hinge_results
from rollingjoint.load import SPATIAL_LOAD_COLUMNS, Gravity, Load, spatial_load_table

Array = NDArray[np.float64]
_P = TypeVar("_P")

TENDON_MODELS = ("exact", "linear", "end_couple")
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_TORSION, _OTHER = map(SPATIAL_LOAD_COLUMNS.index, ("torsion", "other"))
CLOSED = 1e-3  # of the gap between two beads: its share that remains where a hinge ends
_UNIT = 1e-14  # rounding error of the length of a unit vector


@dataclass(frozen=True)
class Bead:
    """A rigid bead and the elastic hinge that carries it.

    Args:
        spacing: from its hinge to the next, or to its distal face if it is the last [mm].
        axis: of its hinge, "x", "y", "z" or a direction in the frame of the link below; held as a unit vector.
        stiffness: of its hinge, positive [N·mm/rad].
        gap: between the holes below and above its hinge, which is in the middle [mm].
        weight: [N]; it acts halfway between the hinge and the next.
        rest_angle: where the hinge carries no moment [rad].
        limits: smallest and largest angle of the hinge [rad].
    Raises:
        MechanismError: a size that is not positive, an axis without direction, limits without the rest angle.
    """

    spacing: float
    axis: str | Sequence[float]
    stiffness: float
    gap: float = 10.0
    weight: float = 0.0
    rest_angle: float = 0.0
    limits: tuple[float, float] = (-np.pi, np.pi)

    def __post_init__(self) -> None:
        for name, unit in (("spacing", "mm"), ("stiffness", "N·mm/rad"), ("gap", "mm")):
            as_positive(f"bead {name}", getattr(self, name), f"a positive number [{unit}]", MechanismError)
        if not self.gap < self.spacing:
            raise MechanismError("bead gap", self.gap, f"less than the spacing, {self.spacing:g} mm")
        as_number("bead weight", self.weight, 0.0, allowed="0 or more [N]", error=MechanismError)
        rest_angle = as_number("bead rest_angle", self.rest_angle, allowed="a number", error=MechanismError)
        axis = _numbers("axis", AXES.get(self.axis, self.axis) if isinstance(self.axis, str) else self.axis, 3)
        length = float(np.linalg.norm(axis))
        if not 0 < length < np.inf:
            raise MechanismError("bead axis", self.axis, "a direction other than (0, 0, 0)")
        length = 1.0 if abs(length - 1.0) < _UNIT else length  # a unit vector is held to the last bit
        object.__setattr__(self, "axis", tuple((axis / length).tolist()))
        low, high = _numbers("limits", self.limits, 2)
        if not -2 * np.pi <= low < rest_angle < high <= 2 * np.pi:
            raise MechanismError("bead limits", self.limits, f"-2π to 2π [rad], {self.rest_angle} between them")
        object.__setattr__(self, "limits", (float(low), float(high)))


@dataclass(frozen=True, eq=False, repr=False)
class HingeChain(Chain[HingeEquilibrium]):
    """A chain of beads on a fixed base, each on an elastic hinge, pulled by tendons.

    Link 0 is the base and link i carries bead i, counted from 1; hinge i lies at the origin of link i and carries
    link i + 1. At angles 0 all frames are parallel and z points along the chain; the tip frame is on the last distal
    face. A tendon at +x bends the tip towards +x.

    Args:
        beads: base to tip, at least one.
        tendons: at least one.
        model: "exact": straight tendon segments from bead to bead; a hinge ends where two holes meet. "linear": lengths
            linear in the angles, tangent to the exact ones at 0. "end_couple": linear lengths, and a couple on the
            tendon's last bead in place of everything that it does; the paper's model, without a potential.
        name: for tables and pictures.
        friction: of the tendons that have none of their own; the model must be "exact". A solve takes it into account
            where it is given a history.
        springs: loads that belong to the mechanism and act in every solve; their kinds are load.SPRINGS.
    Raises:
        MechanismError: wrong counts, holes that meet at rest, friction with another model, rolling resistance, springs
            on links that do not exist.
    Source: flexible-joint paper, sec. II; docs/theory.md, sections 1 and 8.
    """

    title: ClassVar[str] = "an arm of beads"
    dimension: ClassVar[int] = 3
    joint: ClassVar[str] = "hinge"
    load_columns: ClassVar[tuple[str, ...]] = SPATIAL_LOAD_COLUMNS
    equilibrium: ClassVar[type[HingeEquilibrium]] = HingeEquilibrium
    kernels: ClassVar[Kernels] = Kernels(
        batch_arrays=HingeBatchArrays,
        new_results=new_hinge_results,
        torques="torques",
        pinned_batch=PinnedHinges,
        solve=solve_hinges_pinned,
        solve_alone=solve_hinges_alone,
        memory=memory_alone,
        step=step_hinges_side_by_side,
        most_joints=MOST_HINGES,
        most_with_friction=MOST_HINGES,
    )

    beads: Sequence[Bead]
    tendons: Sequence[BeadTendon]
    model: str = "exact"
    name: str = ""
    friction: CapstanFriction | None = None
    springs: Sequence[Load] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "beads", members("beads", self.beads, Bead))
        object.__setattr__(self, "tendons", members("tendons", self.tendons, BeadTendon))
        if self.model not in TENDON_MODELS:
            raise MechanismError("tendon model", self.model, f"one of {', '.join(TENDON_MODELS)}")
        self._check_friction()
        object.__setattr__(self, "springs", self._checked_springs())
        low, high = self.joint_limits.T
        rest_angle = np.array([bead.rest_angle for bead in self.beads])
        if not np.all((low < rest_angle) & (rest_angle < high)):
            i = int(np.argmin((low < rest_angle) & (rest_angle < high)))
            allowed = f"a rest angle between {low[i]:g} and {high[i]:g} rad, where tendon holes meet"
            raise MechanismError(f"beads[{i}] rest_angle", rest_angle[i], allowed)

    def _check_friction(self) -> None:
        friction = checked_friction(self.friction)
        if friction is not None and friction.rolling > 0.0:
            raise MechanismError("friction rolling", friction.rolling, "0: hinges do not roll")
        if self.model != "exact" and self.has_friction:
            hint = "Friction needs the true direction of the tendons between the beads."
            raise MechanismError("tendon model with friction", self.model, "exact", hint)

    @property
    def n_links(self) -> int:
        """Number of links, the base included."""
        return len(self.beads) + 1

    @property
    def parts(self) -> str:
        """Number of beads, in words."""
        return f"{len(self.beads)} beads"

    @cached_property
    def length(self) -> float:
        """Sum of the spacings [mm]."""
        return float(sum(bead.spacing for bead in self.beads))

    @property
    def travel(self) -> str:
        """Range of its hinges, in words, and the tendon model if it is not the default."""
        low, high = self.joint_limits[:, 0].min(), self.joint_limits[:, 1].max()
        model = "" if self.model == HingeChain.model else f", model {self.model}"
        return f"hinges from {low:.3g} to {high:.3g} rad{model}"

    @cached_property
    def neutral_angles(self) -> Array:
        """Rest angles of the hinges, (n - 1,) [rad]."""
        return read_only(np.array([bead.rest_angle for bead in self.beads], float))

    @cached_property
    def joint_limits(self) -> Array:
        """Angles between which a hinge moves, (n - 1, 2): its own limits, and with "exact" where holes meet [rad]."""
        limits = np.array([bead.limits for bead in self.beads], float)
        if self.model == "exact":
            for i, j in np.argwhere(self._crosses):
                low, high = open_range(self._gaps[i, j, :3], CLOSED * self.beads[i].gap)
                limits[i] = max(limits[i, 0], low), min(limits[i, 1], high)
        return read_only(limits)

    @cached_property
    def arrays(self) -> Hinges:
        """Tables for the kernels, a stack of one design."""
        gaps = np.array([*(bead.gap for bead in self.beads), self.beads[-1].gap])
        channels = [bead.spacing for bead in self.beads] - 0.5 * (gaps[:-1] + gaps[1:])
        return Hinges(
            np.column_stack([self.joint_limits, self.neutral_angles])[None],
            np.array([bead.axis for bead in self.beads], float)[None],
            np.array([bead.stiffness for bead in self.beads], float)[None],
            np.array([bead.spacing for bead in self.beads], float)[None],
            self._gaps[None],
            np.array([channels[:last].sum() for last in self.last_links])[None],
            np.array([holes[-1] for holes in self._holes], float)[None],
            np.array([TENDON_MODELS.index(self.model)]),
            np.array(self.last_links),
            self._turns[None],
            self.load_table(self.springs)[None],
        )

    @staticmethod
    def join(parts: Sequence[Hinges]) -> Hinges:
        """The arrays of several arms with the same numbers of beads, tendons and crossed hinges, as one stack."""
        joined = Hinges(*(np.concatenate(arrays) for arrays in zip(*with_equal_rows(parts), strict=True)))
        return joined._replace(tendon_joints=parts[0].tendon_joints)

    def scaled(self, hinges: Array, tendons: Array, weights: Array) -> HingeChain:
        """A copy with multiples of the stiffnesses and weights; the geometry is taken over, not computed anew.

        Args:
            hinges: positive factors of the hinges' stiffnesses, (n - 1,).
            tendons: positive factors of the tendons' stiffnesses, (m,).
            weights: factors of the beads' weights, 0 or more, (n - 1,).
        """
        beads = tuple(
            with_values(bead, stiffness=bead.stiffness * hinge, weight=bead.weight * weight)
            for bead, hinge, weight in zip(self.beads, hinges.tolist(), weights.tolist(), strict=True)
        )
        strings = zip(self.tendons, tendons.tolist(), strict=True)
        varied_tendons = tuple(with_values(tendon, stiffness=tendon.stiffness * factor) for tendon, factor in strings)
        varied = with_values(self, beads=beads, tendons=varied_tendons)
        for derived in ("stiffnesses", "spares"):
            varied.__dict__.pop(derived, None)
        varied.__dict__["arrays"] = self.arrays._replace(springs=self.arrays.springs * hinges)
        return varied

    def gravity(self, direction: tuple[float, float, float] = (0.0, 0.0, -1.0)) -> Gravity:
        """The weight of every bead along a direction of the base frame; (0, 0, 1) lets the arm hang."""
        weights = [0.0, *(float(bead.weight) for bead in self.beads)]
        centres = [(0.0, 0.0, 0.0), *((0.0, 0.0, -0.5 * float(bead.spacing)) for bead in self.beads)]
        return Gravity(weights, direction, centres)

    def own_weight(self, direction: Any) -> Gravity:
        """The weight of every bead along a direction of the base frame."""
        return self.gravity(direction)

    def load_table(self, loads: Sequence[Load]) -> Array:
        """Rows of SPATIAL_LOAD_COLUMNS for external loads, (rows, columns)."""
        return checked_load_table(loads, [bead.axis for bead in self.beads])

    def poses(self, joint_angles: ArrayLike) -> Array:
        """Link poses in the base frame, (..., n, 4, 4) [mm]: products of exponentials, one per hinge."""
        theta = self.per_joint("joint angles", joint_angles)
        poses = np.empty((*theta.shape[:-1], self.n_links, 4, 4))
        poses[..., 0, :, :] = np.eye(4)
        for i, bead in enumerate(self.beads):
            R = se3.rotation(theta[..., i, None] * np.array(bead.axis))
            step = se3.pose(R, bead.spacing * R[..., :, 2])
            poses[..., i + 1, :, :] = poses[..., i, :, :] @ step
        return poses

    def tendon_lengths(self, joint_angles: ArrayLike) -> Array:
        """Length of every tendon: gaps plus channels inside the beads, (..., m) [mm]."""
        theta = self.per_joint("joint angles", joint_angles)[..., None]
        square, b, c, neutral, slope = np.moveaxis(self._gaps, -1, 0)
        if self.model == "exact":
            gaps = np.sqrt(np.maximum(square - 2.0 * (b * np.cos(theta) + c * np.sin(theta)), 0.0))
        else:
            gaps = neutral + slope * theta
        return np.asarray(self.arrays.channels[0] + np.where(self._crosses, gaps, 0.0).sum(axis=-2), float)

    def tendon_polyline(self, poses: ArrayLike) -> list[Array]:
        """World points of every tendon's holes below and above each hinge, base to end, a list of (k, 3) [mm]."""
        T, lines = np.asarray(poses, float), []
        for holes in self._holes:
            points = [T[0, :3, :3] @ np.array([*holes[0], -0.5 * self.beads[0].gap]) + T[0, :3, 3]]
            for i in range(len(holes) - 1):
                hinge = se3.pose(T[i + 1, :3, :3], T[i, :3, 3])
                upper = [*holes[i + 1], 0.5 * self.beads[i].gap]
                following = self.beads[min(i + 1, self.n_joints - 1)].gap
                lower = [*holes[i + 1], self.beads[i].spacing - 0.5 * following]
                points += [hinge[:3, :3] @ np.array(at) + hinge[:3, 3] for at in (upper, lower)]
            lines.append(np.array(points))
        return lines

    @property
    def weights(self) -> Array:
        """Of the beads, (n - 1,) [N]."""
        return np.array([bead.weight for bead in self.beads], float)

    @property
    def centres(self) -> Array:
        """Where the weights of the beads act, in the frames of their links, (n - 1, 3) [mm]."""
        return np.array([(0.0, 0.0, -0.5 * bead.spacing) for bead in self.beads])

    @property
    def joint_stiffnesses(self) -> Array:
        """Of the hinges, (n - 1,) [N·mm/rad]."""
        return np.array([bead.stiffness for bead in self.beads], float)

    @property
    def base_height(self) -> float:
        """Highest z of the holes of the base, for pictures [mm]."""
        return -0.5 * self.beads[0].gap

    @cached_property
    def hole_radius(self) -> float:
        """Largest distance of a hole from the z axis of its link [mm]."""
        return float(max(np.hypot(*hole) for tendon in self.tendons for hole in tendon.holes))

    @cached_property
    def body_ends(self) -> Array:
        """Lowest and highest z of the holes of every moving link, (n - 1, 2), for pictures [mm]."""
        gaps = [bead.gap for bead in self.beads]
        pairs = zip(self.beads, [*gaps[1:], 0.0], strict=True)
        return read_only(np.array([(0.5 * bead.gap - bead.spacing, -0.5 * above) for bead, above in pairs]))

    @cached_property
    def link_axes(self) -> Array:
        """Both ends of the axis of every bead in its frame, up to the next hinge or its face, (n - 1, 2, 3) [mm]."""
        return read_only(np.array([[(0.0, 0.0, -bead.spacing), (0.0, 0.0, 0.0)] for bead in self.beads]))

    @cached_property
    def _holes(self) -> tuple[Array, ...]:
        """Holes of every link that a tendon passes, the base included, (links, 2) each [mm]."""
        return tuple(np.array(tendon.link_holes(self.n_links), float) for tendon in self.tendons)

    @cached_property
    def _crosses(self) -> NDArray[np.bool_]:
        """Whether tendon j crosses hinge i, (n - 1, m)."""
        return np.arange(self.n_joints)[:, None] < self.last_links

    @cached_property
    def _gaps(self) -> Array:
        """G, B, C of gap² = G - 2 (B cos + C sin), and gap and slope at angle 0, (n - 1, m, 5)."""
        gaps = np.zeros((self.n_joints, self.n_tendons, 5))
        for i, j in np.argwhere(self._crosses):
            axis, w, u = self._holes_about(i, j)
            along = (axis @ u) * (axis @ w)
            gaps[i, j, :3] = u @ u + w @ w - 2.0 * along, w @ u - along, w @ _cross(axis, u)
            gaps[i, j, 3] = np.linalg.norm(u - w)
            gaps[i, j, 4] = -gaps[i, j, 2] / gaps[i, j, 3]
        return gaps

    @cached_property
    def _turns(self) -> Array:
        """Columns of the kernels' Hinges.turns, (n - 1, m, 16)."""
        turns = np.zeros((self.n_joints, self.n_tendons, N_TURNS))
        for i, j in np.argwhere(self._crosses):
            axis, w, u = self._holes_about(i, j)
            across = np.outer(axis, axis) - np.eye(3)
            halves = axis[2] == 0.0 and np.array_equal(u[:2], w[:2])
            turned = _cross(axis, u), across @ u, _cross(axis, w), -across @ w
            turns[i, j] = np.concatenate([u - w, *turned, [halves]])
        return turns

    def _holes_about(self, i: int, j: int) -> tuple[Array, Array, Array]:
        """Axis of hinge i, and the holes of tendon j below and above it, seen from the hinge at angle 0, (3,) each."""
        below, above = self._holes[j][i : i + 2]
        half = 0.5 * self.beads[i].gap
        return np.array(self.beads[i].axis), np.array([*below, -half]), np.array([*above, half])


def checked_load_table(loads: Sequence[Load], axes: Sequence[Any]) -> Array:
    """Rows of SPATIAL_LOAD_COLUMNS for external loads, (rows, columns); axes: of all joints, in the links below them.

    Raises:
        InvalidInput: a torsion spring over joints that are not parallel, and as `spatial_load_table`.
    """
    table = spatial_load_table(loads, len(axes) + 1)
    for row in table[table[:, _TORSION] != 0.0] if np.count_nonzero(table[:, _TORSION]) else ():
        low, high = sorted((int(row[0]), int(row[_OTHER])))
        spanned = np.array(axes[low:high])
        if not np.allclose(spanned, spanned[0], rtol=0.0, atol=_UNIT):
            raise InvalidInput("links of a TorsionSpring", (low, high), "neighbours, or parallel joints between them")
    return table


def with_values(part: _P, **values: object) -> _P:
    """A copy of a frozen object with other, unchecked values; it shares all cached values."""
    changed = copy(part)
    changed.__dict__.update(values)
    return changed


def _cross(a: Array, b: Array) -> Array:
    """The cross product of two vectors, (3,): np.cross takes ten times as long for three numbers."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def open_range(gap: Array, smallest: float) -> tuple[float, float]:
    """Angles around 0 between which the gap is above the smallest [rad]."""
    square, b, c = gap
    size, closest = float(np.hypot(b, c)), float(np.arctan2(c, b))
    cosine = 1.0 - (smallest**2 - (square - 2.0 * size)) / (2.0 * size) if size > 0 else -1.0
    if cosine >= 1.0:
        return -np.inf, np.inf
    margin = float(np.arccos(max(cosine, -1.0)))
    if closest > 0:
        return closest + margin - 2 * np.pi, closest - margin
    return closest + margin, closest - margin + 2 * np.pi


def _numbers(what: str, values: object, count: int) -> Array:
    allowed = f"{count} numbers"
    array = as_floats(f"bead {what}", values, allowed, MechanismError)
    if array.shape != (count,) or not np.all(np.isfinite(array)):
        raise MechanismError(f"bead {what}", values, allowed)
    return array
