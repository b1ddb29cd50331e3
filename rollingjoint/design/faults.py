"""Faults that keep a mechanism from being manufactured: an independent check of the margins.

It reads the exact surfaces of a mechanism, finely sampled, and finds nearest points with trees; it needs no torch.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain import joint_table
from rollingjoint.chain.outline import rotation
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.chain.spatial_joints import RollingContact
from rollingjoint.chain.tendon import OnSurface
from rollingjoint.profile import Surface

Array = NDArray[np.float64]

LEAST_CURVATURE = 0.003
"""Least relative curvature of a joint [1/mm]; at zero the contact would run away."""

_ROUNDING = 1e-9  # mm
_STEP = 0.05  # mm between points of a surface
_CONTACTS = 25  # of a joint, from end to end
_DEPTH = 1e-3  # mm; a smaller overlap is rounding of the sampled surfaces


def faults(
    mechanism: RollingChain, smallest_radius: float, wall: float, least_curvature: float = LEAST_CURVATURE
) -> list[str]:
    """Faults of a mechanism, one line each; empty if it can be made.

    Args:
        mechanism: links, surfaces and tendons; its constructor has checked that links can roll on each other and
            that no holes cross.
        smallest_radius: smallest radius that can be machined [mm].
        wall: minimum wall thickness [mm].
        least_curvature: least relative curvature of a joint [1/mm].
    """
    return [
        *_relative_curvatures(mechanism, least_curvature),
        *_overlaps(mechanism),
        *_radii(mechanism, smallest_radius),
        *_holes(mechanism, wall),
        *_thicknesses(mechanism, wall),
    ]


def spatial_faults(mechanism: SpatialChain, smallest_radius: float, wall: float, tube_radius: float) -> list[str]:
    """Faults of a chain in space, one line each; empty if it can be made.

    Args:
        mechanism: its constructor has checked that links can roll on each other and that no holes cross.
        smallest_radius, wall: as for `faults`; the wall of holes to the outside and to those at the link's other end.
        tube_radius: outer radius [mm].
    """
    messages = []
    radius = mechanism.hole_radius + wall
    if radius > tube_radius + _ROUNDING:
        messages.append(f"holes end {radius:.4g} mm from the axis, outside the tube of {tube_radius:g} mm")
    lengths = [np.linalg.norm(points[1:-1, 1] - points[1:-1, 0], axis=-1) for points in mechanism.hole_points]
    shortest = min((float(length.min()) for length in lengths if length.size), default=math.inf)
    if shortest < wall - _ROUNDING:
        messages.append(f"channels of {shortest:.4g} mm are shorter than the wall of {wall:g} mm")
    for number, joint in enumerate(mechanism.joints):
        if isinstance(joint, RollingContact):
            messages += _contact_faults(number, joint, smallest_radius, tube_radius)
    return messages


def _contact_faults(number: int, joint: RollingContact, smallest_radius: float, tube_radius: float) -> Iterator[str]:
    corner = math.hypot(max(map(abs, joint.limits)), joint.half_width)
    if corner > tube_radius + _ROUNDING:
        yield f"contact of joint {number} reaches {corner:.4g} mm from the axis, outside the tube"
    s = np.linspace(*joint.limits, 201)
    sharpest = max(float(np.abs(surface.profile.curvature(s)).max()) for surface in (joint.child, joint.parent))
    if sharpest * smallest_radius > 1.0 + _ROUNDING:
        yield f"surfaces of joint {number} have a radius of {1.0 / sharpest:.4g} mm, too small to machine"


def _relative_curvatures(mechanism: RollingChain, least: float) -> Iterator[str]:
    for i, child, parent in _joints(mechanism):
        s = _arc_lengths(child)
        kappa = child.curvature(s) - parent.curvature(s)
        if kappa.max() > -least:
            yield (
                f"joint {i} has a relative curvature of {kappa.max():.3g} /mm at s = {s[kappa.argmax()]:.3g} mm,"
                f" above {-least:g}"
            )


def _overlaps(mechanism: RollingChain) -> Iterator[str]:
    """Places where one surface of a joint cuts into the other, at any contact."""
    for i, child, parent in _joints(mechanism):
        contacts = np.linspace(*joint_table.common_range(child, parent), _CONTACTS)
        depths = np.maximum(_depths(child, parent, contacts, 1.0), _depths(parent, child, contacts, -1.0))
        worst = int(np.argmax(depths))
        if depths[worst] > _DEPTH:
            yield (
                f"the surfaces of joint {i} overlap by {depths[worst]:.3g} mm with the contact"
                f" at s = {contacts[worst]:.3g} mm"
            )


def _depths(surface: Surface, counterpart: Surface, contacts: Array, side: float) -> Array:
    """Largest depth of the other surface on the wrong side of a surface at every contact, (c,) [mm].

    Side 1: points to the left of the surface, above it, are on the right side.
    """
    from scipy.spatial import KDTree

    curve, points = surface.point(_arc_lengths(surface)), counterpart.point(_arc_lengths(counterpart))
    turned = [rotation(float(surface.tangent_angle(s) - counterpart.tangent_angle(s))) for s in contacts]
    moved = np.stack(
        [surface.point(s) + (points - counterpart.point(s)) @ turn.T for s, turn in zip(contacts, turned, strict=True)]
    )
    _, nearest = KDTree(curve).query(moved)
    at = np.clip(nearest, 1, len(curve) - 2)
    tangent, offset = curve[at + 1] - curve[at - 1], moved - curve[at]
    depth = side * (tangent[..., 1] * offset[..., 0] - tangent[..., 0] * offset[..., 1]) / np.hypot(*tangent.T).T
    return np.where(at == nearest, depth, 0.0).max(axis=1)  # no overlap beyond the ends of a surface


def _radii(mechanism: RollingChain, smallest_radius: float) -> Iterator[str]:
    for i, link in enumerate(mechanism.links):
        for name, surface in (("parent", link.parent), ("child", link.child)):
            sharpest = np.abs(surface.curvature(_arc_lengths(surface))).max()
            if sharpest * smallest_radius > 1.0 + 1e-12:
                yield f"the {name} surface of link {i} has a radius of {1 / sharpest:.3g} mm, below {smallest_radius:g}"


def _holes(mechanism: RollingChain, wall: float) -> Iterator[str]:
    for j, tendon in enumerate(mechanism.tendons):
        for i, holes in enumerate(tendon.link_holes(mechanism.n_links)):
            link = mechanism.links[i]
            for hole, surface in zip(holes, (link.parent, link.child), strict=True):
                if isinstance(hole, OnSurface):
                    margin = min(surface.limits[1] - hole.s, hole.s - surface.limits[0])
                    if margin < wall - 1e-12:
                        yield f"tendon {j} has {margin:.3g} mm beside its hole in link {i}, below {wall:g}"


def _thicknesses(mechanism: RollingChain, wall: float) -> Iterator[str]:
    from scipy.spatial import KDTree

    for i, link in enumerate(mechanism.links):
        bottom, top = (surface.point(_arc_lengths(surface)) for surface in (link.parent, link.child))
        thickness = KDTree(bottom).query(top)[0].min()
        if thickness < wall:
            yield f"link {i} is {thickness:.3g} mm thick, below {wall:g}"


def _joints(mechanism: RollingChain) -> list[tuple[int, Surface, Surface]]:
    """(joint, child, parent) of every distinct joint, without regard to the places of the links."""
    distinct: dict[object, tuple[int, Surface, Surface]] = {}
    for i, (below, above) in enumerate(itertools.pairwise(mechanism.links)):
        pair = below.child, above.parent
        key = tuple((s.profile.breaks.tobytes(), s.profile.coefficients.tobytes(), s.angle) for s in pair)
        distinct.setdefault(key, (i, *pair))
    return list(distinct.values())


def _arc_lengths(surface: Surface) -> Array:
    low, high = surface.limits
    return np.linspace(low, high, 1 + int(np.ceil((high - low) / _STEP)))
