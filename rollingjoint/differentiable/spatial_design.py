"""Chains in space as tensors, for derivatives of equilibria by their parameters."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from rollingjoint.chain.hinge import checked_load_table
from rollingjoint.chain.spatial import SpatialChain, SpatialLink
from rollingjoint.chain.spatial_joints import PointHinge, RollingContact, SpatialJoint
from rollingjoint.chain.tendon import SpaceTendon
from rollingjoint.differentiable.friction import DifferentiableFriction
from rollingjoint.differentiable.geometry import Geometry, Planes, Routes
from rollingjoint.differentiable.looking import seen
from rollingjoint.differentiable.parameters import (
    Array,
    Axes,
    ChainTensors,
    drawable,
    largest_table,
    rolling,
    surface_of,
    tables_of,
)
from rollingjoint.differentiable.spatial_loads import SpatialLoads
from rollingjoint.differentiable.surface import Surfaces
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import CapstanFriction
from rollingjoint.load import Load
from rollingjoint.profile import Profile, Surface

SPATIAL_PARAMETERS: dict[str, Axes] = {  # 2 for (parent, child), the links above and below a joint
    "breaks": ("J", 2, "p + 1"),
    "coefficients": ("J", 2, "p", "k"),
    "starts": ("J", 2, 2),
    "angles": ("J", 2),
    "azimuths": ("J",),
    "half_widths": ("J",),
    "middles": ("J",),
    "hinge_axes": ("J", 3),
    "hinge_points": ("J", 2, 3),
    "joint_stiffnesses": ("J",),
    "rest_angles": ("J",),
    "holes": ("m", "n", 2, 3),
    "stiffnesses": ("m",),
}
_OF_CONTACTS = ("azimuths", "half_widths", "middles")
_ALONG_Z = 1e-9  # of an axis: its part across z, below which the lateral direction is x, as of a PointHinge
_PLAIN = Surface(Profile.constant(1.0, (-1.0, 1.0)), (0.0, 0.0))  # in the tables of hinges, without effect


@dataclass(frozen=True, eq=False)
class DifferentiableSpatialChain(ChainTensors):
    """Chains in space of one structure, as tensors of double precision.

    Every parameter may have leading axes; together they broadcast to `batch`. Joints count from the base, surfaces are
    (parent, child), of the links above and below. Padding (pieces of zero length at the end, numbers of a joint of the
    other kind) has no effect. Hinges keep their limits; where a parameter moves the holes at a hinge, they are not
    searched anew for angles at which holes meet.

    Args:
        breaks: borders of the pieces of every curvature, (..., J, 2, p + 1) [mm].
        coefficients: ascending powers of the arc length from the beginning of the piece, (..., J, 2, p, k) [1/mm, ...].
        starts: point of every surface at s = 0, (lateral, axial), (..., J, 2, 2) [mm].
        angles: tangent angle of every surface at s = 0, (..., J, 2) [rad].
        azimuths: angle of the plane of every contact about z, (..., J) [rad].
        half_widths, middles: of the contact lines, (..., J) [mm].
        hinge_axes: directions, (..., J, 3).
        hinge_points: of the hinges in the frames of the links above and below, (..., J, 2, 3) [mm].
        joint_stiffnesses, rest_angles: of the torsion springs, (..., J) [N·mm/rad, rad].
        holes: parent and child hole of every tendon in every link, (..., m, n, 2, 3) [mm].
        stiffnesses: of the tendons, (..., m) [N/mm].
        hinges: True for joints that are hinges, (J,).
        hinge_limits: smallest and largest angle of every hinge, (J, 2) [rad].
        crossed: number of joints that each tendon crosses, (m,).
        links: weights of the links of every mechanism, constant.
        springs: loads that belong to every mechanism, constant.
        friction: of the tendons.
    Raises:
        InvalidInput: shapes that disagree.
    """

    parameters: ClassVar[dict[str, Axes]] = SPATIAL_PARAMETERS
    structure: ClassVar[tuple[str, ...]] = ("hinges", "hinge_limits", "crossed")
    loads: ClassVar[type[SpatialLoads]] = SpatialLoads

    breaks: Tensor
    coefficients: Tensor
    starts: Tensor
    angles: Tensor
    azimuths: Tensor
    half_widths: Tensor
    middles: Tensor
    hinge_axes: Tensor
    hinge_points: Tensor
    joint_stiffnesses: Tensor
    rest_angles: Tensor
    holes: Tensor
    stiffnesses: Tensor
    hinges: Tensor
    hinge_limits: Tensor
    crossed: Tensor
    links: tuple[SpatialLink, ...] = ()
    springs: tuple[Load, ...] = ()
    friction: DifferentiableFriction | None = None

    @classmethod
    def _checked(cls, mechanism: object) -> SpatialChain:
        if not isinstance(mechanism, SpatialChain):
            hint = "An arm: SpatialChain.from_arm(arm). A RollingChain: DifferentiableChain."
            raise InvalidInput("mechanism", mechanism, "a SpatialChain", hint)
        return mechanism

    @classmethod
    def _rows(cls, chains: Sequence[SpatialChain]) -> list[dict[str, Array]]:
        pairs = [[_surfaces(joint) for joint in chain.joints] for chain in chains]
        size = largest_table([pair for surfaces in pairs for pair in surfaces])
        return [tables_of(surfaces, *size) | _planes(chain) for surfaces, chain in zip(pairs, chains, strict=True)]

    def _fill_plain(self, plain: dict[str, Tensor]) -> None:
        plain["coefficients"][..., 0, :, 0].fill_(0.05)
        plain["coefficients"][..., 1, :, 0].fill_(-0.05)
        for side, height in enumerate((-10.0, 10.0)):
            plain["starts"][..., side, 1].fill_(height)
            plain["hinge_points"][..., side, 2].fill_(height)
        plain["hinge_axes"][..., 0].fill_(1.0)
        plain["half_widths"].fill_(1.0)
        plain["joint_stiffnesses"].fill_(1.0)

    def geometry(self) -> Geometry:
        """All that does not depend on the pose, with derivatives by the parameters."""
        frames = self.frames()
        links = torch.arange(self.n_links, device=self.device)
        passed = (links <= self.crossed[:, None]).to(torch.float64)
        crosses = (links[:-1] < self.crossed[:, None]).to(torch.float64)
        through = self.holes[..., 1, :] - self.holes[..., 0, :]
        square = through.square().sum(-1)
        drilled = square.detach() > 0.0
        lengths = torch.where(drilled, square, 1.0).sqrt()
        upwards = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64, device=self.device)
        units = torch.where(drilled[..., None], through / lengths[..., None], upwards)
        above, below = (_in_frames(frames, self.hinge_points[..., side, :]) for side in (0, 1))
        middles = torch.where(self.hinges, below[..., 2], self.middles)
        shifts = torch.where(self.hinges, below[..., 2] - above[..., 2], 0.0)
        of_joints = frames[..., None, :, :, :]  # tendons come before joints
        lower, upper = (_in_frames(of_joints, hole) for hole in (self.holes[..., :-1, 1, :], self.holes[..., 1:, 0, :]))
        routes = Routes(
            _complex(lower),
            _complex(upper),
            crosses,
            (torch.where(drilled, lengths, 0.0) * passed).sum(-1),
            aside=upper[..., 2] + shifts[..., None, :] - lower[..., 2],
            entry=lower[..., 2] - middles[..., None, :],
            leads=torch.stack([_in_frames(of_joints, unit) for unit in (units[..., :-1, :], units[..., 1:, :])], -2),
        )
        springs = self.joint_stiffnesses, self.rest_angles
        planes = Planes(
            frames, self.half_widths, middles, shifts, *springs, _complex(below), _complex(above), self.hinges
        )
        return Geometry(self.surfaces(), routes, planes)

    def frames(self) -> Tensor:
        """Lateral and axial direction and axis of the plane of every joint, rows, (..., J, 3, 3)."""
        cos, sin = self.azimuths.cos(), self.azimuths.sin()
        zero, unit = torch.zeros_like(cos), torch.ones_like(cos)
        contacts = torch.stack([cos, sin, zero, zero, zero, unit, sin, -cos, zero], -1).unflatten(-1, (3, 3))
        if not seen(self.hinges.any(), True):
            return contacts
        safe = torch.where(self.hinges[:, None], self.hinge_axes, unit[..., None])
        axes = safe / safe.norm(dim=-1, keepdim=True)
        x, y, z = axes.unbind(-1)
        across = torch.stack([-y, x, torch.zeros_like(x)], -1)
        beside = torch.stack([1.0 - x * x, -x * y, -x * z], -1)
        along_z = across.detach().norm(dim=-1, keepdim=True) <= _ALONG_Z
        lateral = torch.where(along_z, beside, torch.where(along_z, 1.0, across))
        lateral = lateral / lateral.norm(dim=-1, keepdim=True)
        rows = torch.stack([lateral, torch.linalg.cross(axes, lateral), axes], -2)
        return torch.where(self.hinges[:, None, None], rows, contacts)

    def surfaces(self) -> Surfaces:
        """The surfaces of every joint, child below and parent above, (..., J, 2).

        At a hinge they are curves that roll by 1 rad per mm over its limits; they have no place in space.
        """
        return Surfaces.of(*(table.flip(-1 - axes) for table, axes in self._tables()))

    def _tables(self) -> tuple[tuple[Tensor, int], ...]:
        """Breaks, coefficients, starts and angles of the surfaces, with their numbers of axes after (parent, child)."""
        breaks, coefficients, starts, angles = self.breaks, self.coefficients, self.starts, self.angles
        if seen(self.hinges.any(), True):
            low, high = self.hinge_limits.unbind(-1)
            rest = torch.minimum(torch.maximum(self.rest_angles.detach(), low), high)
            ends = (rest - low)[..., None].expand(*rest.shape, breaks.shape[-1] - 1)
            turns = torch.cat([(rest - high)[..., None], ends], -1)[..., None, :]
            rates = torch.zeros_like(coefficients)
            rates[..., 1, :, 0] = -1.0
            at = self.hinges
            breaks = torch.where(at[:, None, None], turns, breaks)
            coefficients = torch.where(at[:, None, None, None], rates, coefficients)
            starts = torch.where(at[:, None, None], 0.0, starts)
            rests = torch.stack([torch.zeros_like(rest), rest], -1)
            angles = torch.where(at[:, None], rests, angles)
        return (breaks, 1), (coefficients, 2), (starts, 1), (angles, 0)

    def valid(self) -> Tensor:
        """Whether links can roll on each other, (batch): a relative curvature below 0 at 9 places of every piece.

        False also for numbers that are not finite, beyond 1e12, out of order, or no surface.
        """
        with torch.no_grad():
            good = self.finite()
            design = self.where(good)
            (breaks, _), (coefficients, _), *_ = design._tables()
            above, below = ((breaks[..., side, :], coefficients[..., side, :, :]) for side in (0, 1))
            return good & rolling(below, above, design.surfaces)

    def finite(self) -> Tensor:
        """Whether the numbers are finite, in range and in order, (batch): necessary for a mechanism."""
        (breaks, _), (coefficients, _), *_ = self._tables()
        axes = self.hinge_axes.square().sum(-1) > 0.0
        good = self._finite() & drawable(breaks, coefficients).flatten(-2).all(-1)
        good = good & (self.joint_stiffnesses >= 0.0).all(-1) & (axes | ~self.hinges).all(-1)
        return good & ((self.half_widths > 0.0) | self.hinges).all(-1)

    def load_table(self, loads: Sequence[Load]) -> Array:
        """The load table of external loads, (rows, columns); InvalidInput for loads that it cannot have.

        Whether the joints that a torsion spring spans are parallel is checked for the first design alone.
        """
        axes = self.frames()[..., 2, :].detach().reshape(-1, self.n_links - 1, 3)[0]
        return checked_load_table(loads, list(axes.cpu().numpy()))

    def mechanism(self, place: int = 0) -> SpatialChain:
        """One design as a mechanism, by its place in the flattened batch. The latest ones are cached.

        Raises:
            MechanismError: it cannot be built.
        """
        shapes, raw, frictions = self._numbers(place)
        hinges = tuple(map(tuple, torch.where(self.hinges[:, None], self.hinge_limits, torch.nan).tolist()))
        return _mechanism(self.links, self.springs, hinges, tuple(self.crossed.tolist()), frictions, shapes, *raw)


def _surfaces(joint: SpatialJoint) -> tuple[Surface, Surface]:
    """Parent and child surface of a joint."""
    return (joint.parent, joint.child) if isinstance(joint, RollingContact) else (_PLAIN, _PLAIN)


def _planes(chain: SpatialChain) -> dict[str, Array]:
    """Parameters of planes, hinges and tendons of one mechanism, and its structure."""
    joints, n, m = chain.joints, chain.n_links, chain.n_tendons
    numbers = np.zeros((len(_OF_CONTACTS), n - 1))
    numbers[1] = 1.0
    axes, points = np.tile([1.0, 0.0, 0.0], (n - 1, 1)), np.zeros((n - 1, 2, 3))
    limits, holes = np.tile([-1.0, 1.0], (n - 1, 1)), np.zeros((m, n, 2, 3))
    for i, joint in enumerate(joints):
        if isinstance(joint, RollingContact):
            numbers[:, i] = joint.azimuth, joint.half_width, joint.middle
        elif isinstance(joint, PointHinge):
            axes[i], points[i], limits[i] = joint.axis, (joint.above, joint.below), chain.joint_limits[i]
        else:
            raise InvalidInput("joint", joint, "a RollingContact or a PointHinge")
    for j, passed in enumerate(chain.hole_points):
        holes[j, : len(passed)] = passed
    return dict(zip(_OF_CONTACTS, numbers, strict=True)) | {
        "hinge_axes": axes,
        "hinge_points": points,
        "joint_stiffnesses": chain.joint_stiffnesses,
        "rest_angles": np.array([joint.rest_angle for joint in joints]),
        "holes": holes,
        "stiffnesses": chain.stiffnesses.copy(),
        "hinges": np.array([isinstance(joint, PointHinge) for joint in joints]),
        "hinge_limits": limits,
        "crossed": np.array(chain.last_links),
    }


@functools.lru_cache(maxsize=256)
def _mechanism(
    links: tuple[SpatialLink, ...],
    springs: tuple[Load, ...],
    hinges: tuple[tuple[float, float], ...],
    crossed: tuple[int, ...],
    frictions: tuple[CapstanFriction | None, ...],
    shapes: tuple[tuple[int, ...], ...],
    *raw: bytes,
) -> SpatialChain:
    """The chain with these numbers; hinges: limits of every joint, NaN for contacts."""
    arrays = (np.frombuffer(row).reshape(shape) for row, shape in zip(raw, shapes, strict=True))
    number = dict(zip(SPATIAL_PARAMETERS, arrays, strict=True))
    tables = [number[name] for name in ("breaks", "coefficients", "starts", "angles")]
    joints: list[SpatialJoint] = []
    for i, limits in enumerate(hinges):
        spring = float(number["joint_stiffnesses"][i]), float(number["rest_angles"][i])
        if np.isnan(limits[0]):
            parent, child = (surface_of(*(table[i, side] for table in tables)) for side in (0, 1))
            azimuth, half_width, middle = (float(number[name][i]) for name in _OF_CONTACTS)
            joints.append(RollingContact(azimuth, parent, child, half_width, middle, *spring))
        else:
            above, below = number["hinge_points"][i]
            joints.append(PointHinge(number["hinge_axes"][i], below, above, *spring, limits))
    holes, stiffnesses = number["holes"], number["stiffnesses"]
    tendons = [
        SpaceTendon(holes[j, : end + 1].tolist(), end, float(stiffnesses[j]), frictions[j])
        for j, end in enumerate(crossed)
    ]
    return SpatialChain(joints, tendons, links, "design", springs=springs)


def _in_frames(frames: Tensor, vectors: Tensor) -> Tensor:
    """Vectors (..., J, 3) of links, in the directions of the planes (..., J, 3, 3)."""
    return (frames @ vectors[..., None])[..., 0]


def _complex(vectors: Tensor) -> Tensor:
    """The parts of vectors (..., 3) in their plane, as complex numbers."""
    return torch.complex(vectors[..., 0].contiguous(), vectors[..., 1].contiguous())
