"""Faults that keep a mechanism from being manufactured: an independent check of the margins.

It reads the exact surfaces of a mechanism, finely sampled, and finds nearest points with trees; it needs no torch.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain import joint_table
from rollingjoint.chain.outline import rotation
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.tendon import OnSurface
from rollingjoint.profile import Surface

Array = NDArray[np.float64]

LEAST_CURVATURE = 0.003
"""Least relative curvature of a joint [1/mm]; at zero the contact would run away."""

_STEP = 0.05  # mm between points of a surface
_CONTACTS = 25  # of a joint, from end to end
_DEPTH = 1e-3  # mm; a smaller overlap is rounding of the sampled surfaces


def faults(mechanism: RollingChain, smallest_radius: float, wall: float) -> list[str]:
    """Faults of a mechanism, one line each; empty if it can be made.

    Args:
        mechanism: links, surfaces and tendons; its constructor has checked that links can roll on each other and
            that no holes cross.
        smallest_radius: smallest radius that can be machined [mm].
        wall: minimum wall thickness [mm].
    """
    return [
        *_relative_curvatures(mechanism),
        *_overlaps(mechanism),
        *_radii(mechanism, smallest_radius),
        *_holes(mechanism, wall),
        *_thicknesses(mechanism, wall),
    ]


def _relative_curvatures(mechanism: RollingChain) -> Iterator[str]:
    for i, child, parent in _joints(mechanism):
        s = _arc_lengths(child)
        kappa = child.curvature(s) - parent.curvature(s)
        if kappa.max() > -LEAST_CURVATURE:
            yield (
                f"joint {i} has a relative curvature of {kappa.max():.3g} /mm at s = {s[kappa.argmax()]:.3g} mm,"
                f" above {-LEAST_CURVATURE:g}"
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
