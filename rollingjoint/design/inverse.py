"""The numbers of the design of a mechanism, checked against the mechanism of that design."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.rolling import RollingChain, planar
from rollingjoint.chain.tendon import OnSurface
from rollingjoint.differentiable import DifferentiableChain
from rollingjoint.errors import InvalidInput
from rollingjoint.profile import Profile, Surface

Array = NDArray[np.float64]

_TOLERANCE = 1e-9  # mm, rad, and of curvatures × half width


def read(mechanism: RollingChain, n_links: int, alike: bool, places: Array) -> dict[str, Array]:
    """The numbers of the design of a mechanism, by name.

    Args:
        mechanism: to read.
        n_links, alike: of the space.
        places: of the free knots, within [-1, 1].
    Raises:
        InvalidInput: another number of links; tendons or surfaces of another kind.
    """
    if planar(mechanism).n_links != n_links:
        raise InvalidInput("links of the mechanism", mechanism.n_links, f"{n_links}, as in the space")
    holes = _holes(mechanism)
    joints = list(zip(mechanism.links[:-1], mechanism.links[1:], strict=True))
    pairs = [(below.child, above.parent) for below, above in (joints[:1] if alike else joints)]
    half_width = pairs[0][0].limits[1]
    surfaces = [(surface, sign) for pair in pairs for surface, sign in zip(pair, (-1.0, 1.0), strict=True)]
    links = mechanism.links[:1] if alike else mechanism.links
    return {
        "convexity": np.concatenate([sign * surface.curvature(places * half_width) for surface, sign in surfaces]),
        "angle": np.array([-sign * surface.angle for surface, sign in surfaces]),
        "height": np.array([link.child.start[1] - link.parent.start[1] for link in links]),
        "half_width": np.array([half_width]),
        "hole": np.abs(holes[:, 0, 0]),
    }


def compare(mechanism: RollingChain, design: DifferentiableChain) -> None:
    """Raise InvalidInput unless a mechanism is the design that was read from it."""
    numbers = {
        name: getattr(design, name).numpy() for name in ("breaks", "coefficients", "starts", "angles", "hole_arcs")
    }
    _same("arc lengths of the holes [mm]", _holes(mechanism), numbers["hole_arcs"])
    _same("stiffnesses of the tendons [N/mm]", mechanism.stiffnesses, design.stiffnesses.numpy())
    for i, link in enumerate(mechanism.links):
        for side, (name, surface) in enumerate((("parent", link.parent), ("child", link.child))):
            label = f"{name} surface of link {i}"
            breaks = numbers["breaks"][i, side]
            _same(f"ends of the {label} [mm]", np.array(surface.limits), breaks[[0, -1]])
            _same(f"start of the {label} [mm]", np.array(surface.start), numbers["starts"][i, side])
            _same(f"angle of the {label} [rad]", np.array(surface.angle), numbers["angles"][i, side])
            profile = Profile(breaks, numbers["coefficients"][i, side])
            s = _places(surface, breaks)
            width = surface.limits[1]
            _same(f"curvature of the {label} × half width", surface.curvature(s) * width, profile.curvature(s) * width)


def _places(surface: Surface, breaks: Array) -> Array:
    """Arc lengths that tell two curvatures apart: in every piece of both, and at both sides of their borders."""
    borders = np.union1d(surface.profile.breaks, breaks)
    interior = borders[:-1, None] + np.diff(borders)[:, None] * np.linspace(0.0, 1.0, 6)[:-1]
    before = np.nextafter(borders[1:], -np.inf)
    return np.clip(np.concatenate([interior.ravel(), before]), *surface.limits)


def _holes(mechanism: RollingChain) -> Array:
    """Arc lengths of the holes of two tendons that run to the tip, (2, n, 2) [mm]."""
    n = mechanism.n_links
    if mechanism.n_tendons != 2 or any(tendon.last_link(n) != n - 1 for tendon in mechanism.tendons):
        ends = [tendon.last_link(n) for tendon in mechanism.tendons]
        raise InvalidInput("links where tendons end", ends, f"two tendons that end at the tip, link {n - 1}")
    holes = [[hole for pair in tendon.link_holes(n) for hole in pair] for tendon in mechanism.tendons]
    if not all(isinstance(hole, OnSurface) for row in holes for hole in row):
        raise InvalidInput("holes of the tendons", holes[0], "holes on the surfaces, OnSurface(s)")
    arcs = np.array([[hole.s for hole in row if isinstance(hole, OnSurface)] for row in holes])
    return arcs.reshape(2, n, 2)


def _same(name: str, actual: Array, expected: Array) -> None:
    difference = np.abs(actual - expected)
    if not np.all(difference <= _TOLERANCE):
        worst = np.unravel_index(int(difference.argmax()), difference.shape)
        raise InvalidInput(
            name,
            float(actual[worst]),
            f"{float(expected[worst]):.9g}, as in the design of the space that is nearest",
            "Compare the fields of the space: knots, curve, symmetric, alike, stiffness.",
        )
