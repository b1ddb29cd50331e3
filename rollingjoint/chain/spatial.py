"""Chains in space: links that roll on each other about axes of any direction, and the arrays that kernels read.

A joint is a planar map of one angle, tabulated, in a plane that is fixed in its links: docs/theory.md, section 11.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain import joint_table
from rollingjoint.chain.chain import Chain, Kernels, members, read_only, with_equal_rows
from rollingjoint.chain.hinge import HingeChain, checked_load_table, with_values
from rollingjoint.chain.space_outline import SpatialOutline, rail
from rollingjoint.chain.spatial_equilibrium import SpatialEquilibrium
from rollingjoint.chain.spatial_joints import PointHinge, SpatialJoint
from rollingjoint.chain.tendon import SpaceTendon
from rollingjoint.checks import Triple, as_floats, as_number
from rollingjoint.errors import MechanismError
from rollingjoint.friction import CapstanFriction, checked_friction
from rollingjoint.kernels.contact_lanes import memory_alone, solve_contacts_alone, solve_contacts_pinned
from rollingjoint.kernels.contacts import (
    ContactBatchArrays,
    ContactJoints,
    PinnedContacts,
    new_contact_results,
    spatial_poses_of,
)
from rollingjoint.kernels.joints import BUCKET_ENDS, aligned
from rollingjoint.kernels.lanes import MOST_JOINTS
from rollingjoint.load import SPATIAL_LOAD_COLUMNS, Gravity, Load

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SpatialLink:
    """The weight of a link of a chain in space; its joints and the tendons' holes have its geometry.

    Args:
        weight: [N]; it acts in the solves that are given `SpatialChain.gravity`.
        centre: where the weight acts, in the frame of the link [mm].
    Raises:
        MechanismError: a negative weight, a centre that is not three numbers.
    """

    weight: float = 0.0
    centre: Triple = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        weight = as_number("link weight", self.weight, 0.0, allowed="0 or more [N]", error=MechanismError)
        allowed = "three numbers (x, y, z) [mm]"
        centre = as_floats("link centre", self.centre, allowed, MechanismError)
        if centre.shape != (3,) or not np.isfinite(centre).all():
            raise MechanismError("link centre", self.centre, allowed)
        object.__setattr__(self, "weight", weight)
        object.__setattr__(self, "centre", tuple(centre.tolist()))


_WEIGHTLESS = SpatialLink()


@dataclass(frozen=True, eq=False, repr=False)
class SpatialChain(Chain[SpatialEquilibrium]):
    """A chain of links in space, base first, pulled by tendons; its joints turn about axes of any direction.

    Link 0 is the base, fixed at the identity; joint i connects links i and i + 1. The z axes of links point to the tip,
    and at angles 0 all frames are parallel.

    Args:
        joints: base to tip, at least one, of any kinds.
        tendons: at least one.
        links: their weights, the base included; none: links without weight.
        name: for tables and pictures.
        friction: of the tendons that have none of their own, and of the rolling contacts. A solve takes it into account
            where it is given a history.
        springs: loads that belong to the mechanism and act in every solve; their kinds are load.SPRINGS.
    Raises:
        MechanismError: surfaces that cannot roll on each other, holes that cross or are swapped, wrong counts, springs
            on links that do not exist.
    Source: docs/theory.md, section 11.
    """

    title: ClassVar[str] = "a chain in space"
    dimension: ClassVar[int] = 3
    load_columns: ClassVar[tuple[str, ...]] = SPATIAL_LOAD_COLUMNS
    slips: ClassVar[bool] = True
    equilibrium: ClassVar[type[SpatialEquilibrium]] = SpatialEquilibrium
    kernels: ClassVar[Kernels] = Kernels(
        batch_arrays=ContactBatchArrays,
        new_results=new_contact_results,
        torques="torques",
        pivots="contacts",
        pinned_batch=PinnedContacts,
        solve=solve_contacts_pinned,
        solve_alone=solve_contacts_alone,
        memory=memory_alone,
        most_joints=MOST_JOINTS,
    )

    joints: Sequence[SpatialJoint]
    tendons: Sequence[SpaceTendon]
    links: Sequence[SpatialLink] = ()
    name: str = ""
    friction: CapstanFriction | None = None
    springs: Sequence[Load] = ()

    def __post_init__(self) -> None:
        checked_friction(self.friction)
        object.__setattr__(self, "joints", members("joints", self.joints, SpatialJoint))
        object.__setattr__(self, "tendons", members("tendons", self.tendons, SpaceTendon))
        object.__setattr__(self, "links", members("links", self.links, SpatialLink, 0))
        if self.links and len(self.links) != self.n_links:
            raise MechanismError("number of links", len(self.links), f"{self.n_links}, the base included, or none")
        for number, joint in enumerate(self.joints):
            joint.check(number)
        object.__setattr__(self, "springs", self._checked_springs())
        self._check_channels()
        self.joint_limits  # noqa: B018  (holes that cross are refused here)

    def _check_channels(self) -> None:
        """Raise MechanismError where a tendon runs through a link towards the base: its holes are swapped."""
        for tendon, points in enumerate(self.hole_points):
            for link, (parent, child) in enumerate(points):
                if child[2] < parent[2]:
                    raise MechanismError(
                        f"rise of tendon {tendon} from parent to child hole in link {link}",
                        float(child[2] - parent[2]),
                        "0 or more [mm]: a tendon enters a link at its parent hole, on the side of the base",
                        "Swap the holes.",
                    )

    @classmethod
    def from_arm(cls, arm: HingeChain) -> SpatialChain:
        """An arm of beads as a chain of hinges in space, with the same equilibria.

        Raises:
            MechanismError: tendons of another model than "exact".
        """
        if arm.model != "exact":
            raise MechanismError("tendon model", arm.model, "exact, the one of chains in space")
        joints, links = [], [SpatialLink()]
        for bead, limits in zip(arm.beads, arm.joint_limits.tolist(), strict=True):
            spring = bead.stiffness, bead.rest_angle
            joints.append(
                PointHinge(cast(Triple, bead.axis), (0.0, 0.0, 0.0), (0.0, 0.0, -bead.spacing), *spring, limits)
            )
            links.append(SpatialLink(bead.weight, (0.0, 0.0, -0.5 * bead.spacing)))
        gaps = [*(bead.gap for bead in arm.beads), arm.beads[-1].gap]
        lower = [-0.5 * gaps[0], *(0.5 * bead.gap - bead.spacing for bead in arm.beads)]  # a tendon begins at a hinge
        tendons = []
        for tendon in arm.tendons:
            holes = [
                ((x, y, lower[k]), (x, y, -0.5 * gaps[k])) for k, (x, y) in enumerate(tendon.link_holes(arm.n_links))
            ]
            tendons.append(SpaceTendon(holes, tendon.end, tendon.stiffness, tendon.friction))
        return cls(joints, tendons, links, arm.name, arm.friction, arm.springs)

    @property
    def n_links(self) -> int:
        """Number of links, the base included."""
        return len(self.joints) + 1

    @property
    def parts(self) -> str:
        """Number of joints, in words."""
        return f"{len(self.joints)} joints"

    @cached_property
    def length(self) -> float:
        """Sum of the distances between the origins of neighbouring links at rest [mm]."""
        return float(sum(joint.spacing() for joint in self.joints))

    @property
    def travel(self) -> str:
        """Range of its joints, in words."""
        return f"joints from {self.joint_limits[:, 0].min():.3g} to {self.joint_limits[:, 1].max():.3g} rad"

    @cached_property
    def neutral_angles(self) -> Array:
        """Joint angles at rest, (n - 1,) [rad]."""
        return read_only(np.clip([joint.neutral for joint in self.joints], *self.joint_limits.T))

    @cached_property
    def joint_limits(self) -> Array:
        """Smallest and largest angle of every joint, (n - 1, 2) [rad]."""
        holes, limits = self._holes[0], []
        for number, joint in enumerate(self.joints):
            crossing = [tendon for tendon, last in enumerate(self.last_links) if number < last]
            below, above = np.split(holes[number, crossing], 2, axis=-1)
            limits.append(joint.open_range(number, crossing, below, above) if crossing else joint.range)
        return read_only(np.array(limits))

    @cached_property
    def hole_points(self) -> tuple[Array, ...]:
        """For every tendon the holes of the links it passes, (links, 2 for parent and child, 3) in link frames [mm]."""
        return tuple(read_only(np.array(tendon.link_holes(self.n_links))) for tendon in self.tendons)

    @cached_property
    def hole_radius(self) -> float:
        """Largest distance of a hole from the z axis of its link [mm]."""
        return float(max(np.hypot(points[..., 0], points[..., 1]).max() for points in self.hole_points))

    @property
    def base_height(self) -> float:
        """Highest z of the holes of the base, for pictures [mm]."""
        return float(max(points[0, 1, 2] for points in self.hole_points))

    @cached_property
    def body_ends(self) -> Array:
        """Lowest and highest z of the holes of every moving link, (n - 1, 2), for pictures [mm]."""
        ends = np.zeros((self.n_joints, 2))
        for k in range(1, self.n_links):
            heights = [height for points in self.hole_points if len(points) > k for height in points[k, :, 2].tolist()]
            ends[k - 1] = min(heights, default=0.0), max(heights, default=0.0)
        return read_only(ends)

    @cached_property
    def link_axes(self) -> Array:
        """Both ends of the axis of every moving link in its frame, (n - 1, 2, 3) [mm].

        From joint to joint, of rolling contacts from s = 0 to s = 0; the last one ends on the z axis at its highest
        hole or at its origin, whichever is higher.
        """
        ends = [joint.ends for joint in self.joints]
        last = (0.0, 0.0, max(0.0, float(self.body_ends[-1, 1])))
        seconds = [*(below for below, _ in ends[1:]), np.array(last)]
        return read_only(np.array([(above, second) for (_, above), second in zip(ends, seconds, strict=True)]))

    def outlines(self, count: int = 9) -> list[SpatialOutline]:
        """The outline of every link, base first, with contact surfaces of `count` places along their curves."""
        strips: list[list[Array]] = [[] for _ in range(self.n_links)]
        for i, joint in enumerate(self.joints):
            for link, strip in zip((i, i + 1), joint.strips(count), strict=False):
                strips[link].append(strip)
        outlines = []
        for link, surfaces in enumerate(strips):
            heights = [z for points in self.hole_points if link < len(points) for z in points[link, :, 2].tolist()]
            low, high = min(heights, default=0.0), max(heights, default=0.0)
            rails = [rail(strip, low, high) for strip in surfaces]
            outlines.append(SpatialOutline(low, high, surfaces, rails))
        return outlines

    @cached_property
    def axes(self) -> Array:
        """Unit axes of the joints, (n - 1, 3), in the links below."""
        return read_only(np.array([joint.frame[2] for joint in self.joints]))

    @cached_property
    def arrays(self) -> ContactJoints:
        """Tables for the kernels, a stack of one design."""
        holes, directions, channels = self._holes
        rests = [joint.rest_angle for joint in self.joints]
        lookup, buckets, cells, coefficients = self._tables()
        return ContactJoints(
            joints=np.column_stack([self.joint_limits, rests])[None],
            axes=self.axes[None].copy(),
            springs=np.array([joint.stiffness for joint in self.joints])[None],
            frames=np.array([joint.frame.ravel() for joint in self.joints])[None],
            offsets=np.array([joint.offsets for joint in self.joints])[None],
            lookup=lookup[None],
            buckets=buckets[None],
            cells=cells,
            coefficients=coefficients,
            holes=holes[None],
            directions=directions[None],
            channels=channels[None],
            tendon_joints=np.array(self.last_links),
            standing=self.load_table(self.springs)[None],
        )

    def _tables(self) -> tuple[Array, NDArray[np.int64], Array, Array]:
        """Lookup, buckets, cells and coefficients of the tables of all joints, as ContactJoints has them."""
        tables, before = [joint.table() for joint in self.joints], 0
        lookup, buckets = np.zeros((self.n_joints, 3)), np.zeros((self.n_joints, BUCKET_ENDS), np.int64)
        for i, table in enumerate(tables):
            per_radian, ends = joint_table.buckets(table.cells)
            lookup[i] = table.cells[0, 0], table.cells[-1, 1], per_radian
            buckets[i] = before + ends
            before += len(table.cells)
        cells, coefficients, _ = (aligned(np.concatenate(parts)) for parts in zip(*tables, strict=True))
        return lookup, buckets, cells, coefficients

    @cached_property
    def _holes(self) -> tuple[Array, Array, Array]:
        """Holes and directions of channels as ContactJoints has them, (n - 1, m, 6) both, and channels, (m,)."""
        holes, directions = np.zeros((2, self.n_joints, self.n_tendons, 6))
        channels = np.zeros(self.n_tendons)
        for j, points in enumerate(self.hole_points):
            through = points[:, 1] - points[:, 0]
            lengths = np.linalg.norm(through, axis=1, keepdims=True)
            channels[j] = lengths.sum()
            units = np.where(lengths > 0.0, through / np.where(lengths > 0.0, lengths, 1.0), [0.0, 0.0, 1.0])
            for i, joint in enumerate(self.joints[: len(points) - 1]):
                frame, (_, shift) = joint.frame, joint.offsets
                holes[i, j] = *(frame @ points[i, 1]), *(frame @ points[i + 1, 0] + [0.0, 0.0, shift])
                directions[i, j] = *(frame @ units[i]), *(frame @ units[i + 1])
        return holes, directions, channels

    @staticmethod
    def join(parts: Sequence[ContactJoints]) -> ContactJoints:
        """The arrays of several chains with the same numbers of links, tendons and crossed joints, as one stack."""
        parts = with_equal_rows(parts)
        before = np.cumsum([0] + [len(part.cells) for part in parts[:-1]])
        joined = ContactJoints(*(aligned(np.concatenate(arrays)) for arrays in zip(*parts, strict=True)))
        return joined._replace(buckets=joined.buckets + before[:, None, None], tendon_joints=parts[0].tendon_joints)

    def scaled(self, joints: Array, tendons: Array, weights: Array) -> SpatialChain:
        """A copy with multiples of the stiffnesses and weights; the geometry is taken over, not computed anew.

        Args:
            joints: positive factors of the joints' stiffnesses, (n - 1,).
            tendons: positive factors of the tendons' stiffnesses, (m,).
            weights: factors of the weights of the moving links, 0 or more, (n - 1,).
        """
        varied_joints = zip(self.joints, joints.tolist(), strict=True)
        strings = zip(self.tendons, tendons.tolist(), strict=True)
        loaded = zip(self.links, [1.0, *weights.tolist()], strict=True) if self.links else ()
        varied = with_values(
            self,
            joints=tuple(with_values(joint, stiffness=joint.stiffness * factor) for joint, factor in varied_joints),
            tendons=tuple(with_values(tendon, stiffness=tendon.stiffness * factor) for tendon, factor in strings),
            links=tuple(with_values(link, weight=link.weight * factor) for link, factor in loaded),
        )
        for derived in ("stiffnesses", "spares"):
            varied.__dict__.pop(derived, None)
        varied.__dict__["arrays"] = self.arrays._replace(springs=self.arrays.springs * joints)
        return varied

    @property
    def weights(self) -> Array:
        """Of the moving links, (n - 1,) [N]."""
        return np.array([link.weight for link in self._bodies[1:]])

    @property
    def centres(self) -> Array:
        """Where the weights of the moving links act, in the frames of their links, (n - 1, 3) [mm]."""
        return np.array([link.centre for link in self._bodies[1:]])

    @property
    def joint_stiffnesses(self) -> Array:
        """Of the torsion springs of the joints, (n - 1,) [N·mm/rad]."""
        return np.array([joint.stiffness for joint in self.joints])

    @property
    def _bodies(self) -> Sequence[SpatialLink]:
        """The links with their weights, the base included."""
        return self.links or (_WEIGHTLESS,) * self.n_links

    def gravity(self, direction: Triple = (0.0, 0.0, -1.0)) -> Gravity:
        """The weight of every link along a direction of the base frame; (0, 0, 1) lets the chain hang."""
        links = self._bodies
        return Gravity([link.weight for link in links], direction, [link.centre for link in links])

    def own_weight(self, direction: Any) -> Gravity | None:
        """The weight of every link along a direction of the base frame; None where no link has a weight."""
        return self.gravity(direction) if any(link.weight > 0.0 for link in self.links) else None

    def load_table(self, loads: Sequence[Load]) -> Array:
        """Rows of SPATIAL_LOAD_COLUMNS for external loads, (rows, columns)."""
        return checked_load_table(loads, list(self.axes))

    def poses(self, joint_angles: ArrayLike) -> Array:
        """Link poses in the base frame at joint angles within the limits, (..., n, 4, 4) [mm]."""
        return self._placed(joint_angles)[0]

    def tendon_lengths(self, joint_angles: ArrayLike) -> Array:
        """Length of every tendon: straight gaps plus channels inside the links, (..., m) [mm]."""
        return self._placed(joint_angles)[1]

    def _placed(self, joint_angles: ArrayLike) -> tuple[Array, Array]:
        """Link poses and tendon lengths at joint angles."""
        angles = self.per_joint("joint angles", joint_angles)
        rows, at = np.ascontiguousarray(angles.reshape(-1, self.n_joints)), angles.shape[:-1]
        poses, lengths = np.empty((len(rows), self.n_links, 4, 4)), np.empty((len(rows), self.n_tendons))
        spatial_poses_of(self.arrays, rows, poses, lengths)
        return poses.reshape(*at, self.n_links, 4, 4), lengths.reshape(*at, self.n_tendons)

    def tendon_polyline(self, poses: ArrayLike) -> list[Array]:
        """World points of every tendon's holes, base to end, a list of (2 links passed, 3) [mm]."""
        T = np.asarray(poses, float)
        return [
            (np.einsum("lab,lhb->lha", T[: len(h), :3, :3], h) + T[: len(h), None, :3, 3]).reshape(-1, 3)
            for h in self.hole_points
        ]
