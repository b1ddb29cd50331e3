"""Planar chains of links that roll on each other: links, surfaces and tendons, and the arrays that kernels read."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain import joint_table
from rollingjoint.chain.chain import Chain, Kernels, members, read_only, with_equal_rows
from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.tendon import Hole, OnSurface, Tendon
from rollingjoint.checks import as_floats, as_number
from rollingjoint.errors import InvalidInput, MechanismError
from rollingjoint.friction import CapstanFriction, checked_friction
from rollingjoint.kernels.joints import BUCKET_ENDS, aligned
from rollingjoint.kernels.lanes import MOST_JOINTS
from rollingjoint.kernels.rolling import BatchArrays, PinnedBatch, arc_lengths_of, new_results, poses_of
from rollingjoint.kernels.rolling import Chain as ChainArrays
from rollingjoint.kernels.rolling_lanes import memory_alone, solve_alone, solve_pinned, step_side_by_side
from rollingjoint.load import LOAD_COLUMNS, Gravity, Load, load_table
from rollingjoint.profile import LIMIT_TOLERANCE, Profile, Surface

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Link:
    """A rigid link: the parent surface rolls on the link below, the child surface carries the link above.

    Args:
        parent, child: its surfaces.
        weight: [N]; it acts in the solves that are given `RollingChain.gravity`.
        centre: where the weight acts, in the frame of the link [mm].
    Raises:
        MechanismError: a negative weight, a centre that is not two numbers.
    """

    parent: Surface
    child: Surface
    weight: float = 0.0
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        as_number("link weight", self.weight, 0.0, allowed="0 or more [N]", error=MechanismError)
        place = as_floats("link centre", self.centre, "two numbers (x, y) [mm]", MechanismError)
        if place.shape != (2,) or not np.isfinite(place).all():
            raise MechanismError("link centre", self.centre, "two numbers (x, y) [mm]")

    @property
    def height(self) -> float:
        """Distance between the two surfaces at s = 0 [mm]."""
        return float(np.hypot(*np.subtract(self.child.start, self.parent.start)))


@dataclass(frozen=True, eq=False, repr=False)
class RollingChain(Chain[Equilibrium]):
    """A chain of links, base first, pulled by tendons.

    Args:
        links: at least two; link 0 is fixed at the identity.
        tendons: at least one.
        name: for tables and pictures.
        springs: loads that belong to the mechanism and act in every solve; their kinds are load.SPRINGS.
        friction: of the tendons that have none of their own, and of the contacts. A solve takes it into account where
            it is given a history.
    Raises:
        MechanismError: surfaces that cannot roll on each other, holes that cross or lie beyond a surface, wrong counts,
            springs on links that do not exist.
    Source: rolling-contact paper, sec. III.
    """

    title: ClassVar[str] = "a planar chain of rolling links"
    dimension: ClassVar[int] = 2
    load_columns: ClassVar[tuple[str, ...]] = LOAD_COLUMNS
    slips: ClassVar[bool] = True
    equilibrium: ClassVar[type[Equilibrium]] = Equilibrium
    kernels: ClassVar[Kernels] = Kernels(
        batch_arrays=BatchArrays,
        new_results=new_results,
        torques="rates",
        pinned_batch=PinnedBatch,
        solve=solve_pinned,
        solve_alone=solve_alone,
        memory=memory_alone,
        step=step_side_by_side,
        most_joints=MOST_JOINTS,
        most_with_friction=MOST_JOINTS,
    )

    links: Sequence[Link]
    tendons: Sequence[Tendon]
    name: str = ""
    springs: Sequence[Load] = ()
    friction: CapstanFriction | None = None

    def __post_init__(self) -> None:
        checked_friction(self.friction)
        object.__setattr__(self, "links", members("links", self.links, Link, 2, ", the fixed base included"))
        object.__setattr__(self, "tendons", members("tendons", self.tendons, Tendon))
        for i, (proximal, distal) in enumerate(itertools.pairwise(self.links)):
            joint_table.check_rolling(i, proximal.child, distal.parent)
        self._check_holes()
        object.__setattr__(self, "springs", self._checked_springs())

    @property
    def n_links(self) -> int:
        """Number of links, the base included."""
        return len(self.links)

    @property
    def parts(self) -> str:
        """Number of links, in words."""
        return f"{len(self.links)} links"

    @cached_property
    def length(self) -> float:
        """Sum of the link heights [mm]."""
        return sum(link.height for link in self.links)

    @property
    def travel(self) -> str:
        """Range of its contacts, in words."""
        return f"s from {self.joint_limits[:, 0].min():g} to {self.joint_limits[:, 1].max():g} mm"

    @cached_property
    def joint_limits(self) -> Array:
        """Arc length range that both surfaces of a joint share, (n - 1, 2) [mm]."""
        pairs = itertools.pairwise(self.links)
        return read_only(np.array([joint_table.common_range(below.child, above.parent) for below, above in pairs]))

    @cached_property
    def neutral_angles(self) -> Array:
        """Joint angles at s = 0, (n - 1,) [rad]."""
        return read_only(self.joint_angles(np.zeros(self.n_joints)))

    @cached_property
    def neutral_lengths(self) -> Array:
        """Tendon lengths at s = 0, (m,) [mm].

        From the surfaces themselves: many a program asks for them first, and would wait for a kernel.
        """
        lengths = self._tendon_arrays[1][0].copy()
        for i, (below, above) in enumerate(itertools.pairwise(self.links)):
            angle, contact = self.neutral_angles[i], below.child.point(0.0)
            turned = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])  # of row vectors
            for j, points in enumerate(self.hole_points):
                if len(points) > i + 1:
                    across = contact + (points[i + 1, 0] - above.parent.point(0.0)) @ turned - points[i, 1]
                    lengths[j] += np.linalg.norm(across)
        return read_only(lengths)

    @cached_property
    def _tendon_arrays(self) -> tuple[Array, Array, Array]:
        """Holes, channels and directions, a stack of one design."""
        return tendon_arrays([points[None] for points in self.hole_points], self.n_joints)

    @cached_property
    def arrays(self) -> ChainArrays:
        """Tables for the kernels, a stack of one design."""
        pairs = itertools.pairwise(self.links)
        tables = [joint_table.tabulate(below.child, above.parent) for below, above in pairs]
        joints, buckets = np.zeros((self.n_joints, 3)), np.zeros((self.n_joints, BUCKET_ENDS), np.int64)
        before = 0
        for i, table in enumerate(tables):
            per_radian, ends = joint_table.buckets(table.cells)
            joints[i] = table.cells[0, 0], table.cells[-1, 1], per_radian
            buckets[i] = before + ends
            before += len(table.cells)
        cells, coefficients, arcs = (aligned(np.concatenate(parts)) for parts in zip(*tables, strict=True))
        crossed = np.array([len(points) - 1 for points in self.hole_points], np.int64)
        others = *self._tendon_arrays, crossed, load_table(self.springs, self.n_links)[None]
        return ChainArrays(joints[None], buckets[None], cells, coefficients, arcs, *others)

    @cached_property
    def hole_points(self) -> tuple[Array, ...]:
        """For every tendon the holes of the links it passes, (links, 2 for parent and child, 2) in link frames [mm]."""
        return tuple(
            read_only(
                np.array(
                    [
                        [_locate(parent, link.parent), _locate(child, link.child)]
                        for link, (parent, child) in zip(self.links, tendon.link_holes(self.n_links), strict=False)
                    ]
                )
            )
            for tendon in self.tendons
        )

    @staticmethod
    def join(parts: Sequence[ChainArrays]) -> ChainArrays:
        """The arrays of several chains with the same numbers of links, tendons and crossed joints, as one stack."""
        parts = with_equal_rows(parts)
        before = np.cumsum([0] + [len(part.cells) for part in parts[:-1]])
        joined = ChainArrays(*(aligned(np.concatenate(arrays)) for arrays in zip(*parts, strict=True)))
        return joined._replace(buckets=joined.buckets + before[:, None, None], tendon_joints=parts[0].tendon_joints)

    def joint_angles(self, arc_lengths: ArrayLike) -> Array:
        """Joint angles phi at contact arc lengths, (..., n - 1) both [rad, mm].

        An arc length up to 1e-9 mm beyond a limit counts as the limit.

        Raises:
            InvalidInput: wrong number of joints, or s further beyond a joint's limits.
        """
        s = self.per_joint("arc lengths", arc_lengths)
        low, high = self.joint_limits.T
        if not np.all((s >= low - LIMIT_TOLERANCE) & (s <= high + LIMIT_TOLERANCE)):
            raise InvalidInput("arc lengths", s, f"values between {low} and {high} mm, the surface limits")
        s = np.clip(s, low, high)
        pairs = zip(self.links[:-1], self.links[1:], np.moveaxis(s, -1, 0), strict=True)
        return np.stack(
            [below.child.tangent_angle(at) - above.parent.tangent_angle(at) for below, above, at in pairs], -1
        )

    def arc_lengths(self, joint_angles: ArrayLike) -> Array:
        """Contact arc lengths at joint angles, (..., n - 1) [mm]; beyond the surface limits, the limit."""
        phi = self.per_joint("joint angles", joint_angles)
        rows = phi.reshape(-1, self.n_joints)
        s = np.empty_like(rows)
        arc_lengths_of(self.arrays, np.zeros(len(rows), np.int64), rows, s)
        return np.clip(s.reshape(phi.shape), *self.joint_limits.T)

    def start_angles(self, values: Sequence[float]) -> Array:
        """Joint angles [rad] of contacts at these arc lengths [mm], (n - 1,)."""
        return self.joint_angles(values)

    def load_table(self, loads: Sequence[Load]) -> Array:
        """Rows of LOAD_COLUMNS for external loads, (rows, columns)."""
        return load_table(loads, self.n_links)

    def poses(self, joint_angles: ArrayLike) -> Array:
        """Link poses (x, y, angle) in the base frame, (..., n, 3) [mm, rad]."""
        return self._placed(joint_angles)[0]

    def gravity(self, direction: tuple[float, float] = (0.0, -1.0)) -> Gravity:
        """The weight of every link along a direction of the base frame."""
        return Gravity([float(link.weight) for link in self.links], direction, [link.centre for link in self.links])

    def own_weight(self, direction: Any) -> Gravity | None:
        """The weight of every link along a direction of the base frame; None where no link has a weight."""
        return self.gravity(direction) if any(link.weight > 0.0 for link in self.links) else None

    def tendon_lengths(self, joint_angles: ArrayLike) -> Array:
        """Length of every tendon: straight gaps plus channels inside the links, (..., m) [mm].

        Source: rolling-contact paper, eq. 28.
        """
        return self._placed(joint_angles)[1]

    def _placed(self, joint_angles: ArrayLike) -> tuple[Array, Array]:
        """Link poses and tendon lengths at joint angles."""
        phi = self.per_joint("joint angles", joint_angles)
        rows = phi.reshape(-1, self.n_joints)
        poses, lengths = np.empty((len(rows), self.n_links, 3)), np.empty((len(rows), self.n_tendons))
        poses_of(self.arrays, rows, poses, lengths)
        at = phi.shape[:-1]
        return poses.reshape(*at, self.n_links, 3), lengths.reshape(*at, self.n_tendons)

    def tendon_polyline(self, poses: ArrayLike) -> list[Array]:
        """World points of every tendon's holes, base to end, a list of (2 links passed, 2) [mm]."""
        poses = np.asarray(poses, float)
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        rotation = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], axis=-2)
        return [
            (np.einsum("lab,lhb->lha", rotation[: len(h)], h) + poses[: len(h), None, :2]).reshape(-1, 2)
            for h in self.hole_points
        ]

    def _check_holes(self) -> None:
        """Raise MechanismError unless holes are on their surfaces and none change places across a joint."""
        for i, (below, above) in enumerate(itertools.pairwise(self.links)):
            crossing = [j for j, holes in enumerate(self.hole_points) if len(holes) > i + 1]
            if crossing:
                holes = np.array([self.hole_points[j][i : i + 2] for j in crossing])
                joint_table.check_gaps(i, crossing, below.child, above.parent, holes[:, 0, 1], holes[:, 1, 0])


def planar(mechanism: object, hint: str = "") -> RollingChain:
    """The mechanism, where only a planar chain will do.

    Raises:
        InvalidInput: anything else, such as an arm of beads, with `hint` for the remedy.
    """
    if not isinstance(mechanism, RollingChain):
        raise InvalidInput("mechanism", mechanism, "a planar chain of rolling links, a RollingChain", hint)
    return mechanism


def _locate(hole: Hole, surface: Surface) -> Array:
    """The hole in its link's frame, (2,) [mm]."""
    if isinstance(hole, OnSurface):
        low, high = surface.limits
        if not low <= hole.s <= high:
            raise MechanismError(
                "hole on the surface at s", hole.s, f"an arc length on the surface, [{low:g}, {high:g}] mm"
            )
        return surface.placed(_on_curve(surface.profile, hole.s))
    return np.array(hole)


@functools.lru_cache(maxsize=1024)
def _on_curve(profile: Profile, s: float) -> Array:
    """The point of the profile's curve, (2,) [mm]; cached, since similar mechanisms share their profiles."""
    return profile.curve(s)


def tendon_arrays(points: Sequence[Array], n_joints: int) -> tuple[Array, Array, Array]:
    """Holes, channels and directions of D designs, as kernels take them.

    A channel without length counts as one along the link's y axis.

    Args:
        points: for every tendon the holes of the links it passes, (D, links, 2 for parent and child, 2) [mm].
        n_joints: of the chain.
    """
    count, m = len(points[0]), len(points)
    holes, directions = np.zeros((2, count, n_joints, m, 4))
    channels = np.zeros((count, m))
    for j, positions in enumerate(points):
        crossed = positions.shape[1] - 1
        holes[:, :crossed, j] = np.concatenate([positions[:, :-1, 1], positions[:, 1:, 0]], axis=-1)
        through = positions[:, :, 1] - positions[:, :, 0]
        lengths = np.linalg.norm(through, axis=-1, keepdims=True)
        channels[:, j] = lengths[..., 0].sum(axis=1)
        units = np.where(lengths > 0.0, through / np.where(lengths > 0.0, lengths, 1.0), [0.0, 1.0])
        directions[:, :crossed, j] = np.concatenate([units[:, :-1], units[:, 1:]], axis=-1)
    return holes, channels, directions
