"""Named mechanisms."""

from __future__ import annotations

from collections.abc import Callable

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.hinge import Bead, HingeChain
from rollingjoint.chain.rolling import Link, RollingChain
from rollingjoint.chain.tendon import DEFAULT_STIFFNESS, BeadTendon, Tendon
from rollingjoint.checks import as_choice, as_integer, as_positive
from rollingjoint.profile import Profile, Surface

_LIMITS = (-15.0, 15.0)


def five_link(stiffness: float = DEFAULT_STIFFNESS) -> RollingChain:
    """The five-link prototype with general contact surfaces, two tendons [N/mm].

    Source: rolling-contact paper, fig. 1 and its published code.
    """
    convex = Profile.polynomial([-0.05, 0.0, 0.002 / 25], _LIMITS)
    concave = Profile.polynomial([0.05, 0.0, -0.002 / 25], _LIMITS)

    def jump(below: float, above: float) -> Profile:
        return Profile.piecewise_constant([_LIMITS[0], 0.0, _LIMITS[1]], [below, above])

    table = [
        (concave, 0.0, convex, 0.0),
        (jump(-0.03, 0.05), -0.3, convex, 0.0),
        (Profile.constant(-0.02, _LIMITS), -0.3, jump(-0.04, 0.0), -0.2),
        (Profile.constant(0.02, _LIMITS), -0.3, Profile.constant(-0.04, _LIMITS), -0.2),
        (Profile.constant(0.0, _LIMITS), 0.0, convex, 0.0),
    ]
    links = [
        Link(Surface(parent, (0.0, -10.0), parent_angle), Surface(child, (0.0, 10.0), child_angle))
        for parent, parent_angle, child, child_angle in table
    ]
    tendons = [Tendon.on_surfaces(s, stiffness=stiffness) for s in (-10.0, 10.0)]
    return RollingChain(links, tendons, "five_link")


def uniform(
    n: int = 5,
    *,
    height: float = 20.0,
    radius: float = 20.0,
    half_width: float = 15.0,
    tendon_offset: float = 10.0,
    stiffness: float = DEFAULT_STIFFNESS,
) -> RollingChain:
    """n equal links with circular surfaces of one radius, two tendons.

    Args:
        n: number of links, the base included, at least 2.
        height: distance between the surfaces of a link at s = 0 [mm].
        radius: radius of every convex arc [mm].
        half_width: surfaces run over s from -half_width to half_width [mm].
        tendon_offset: holes at the surface points s = ±tendon_offset [mm].
        stiffness: of each tendon [N/mm].
    """
    n = as_integer("n", n, 2, allowed="2 or more links, the base included")
    _check_lengths(height=height, radius=radius, half_width=half_width, tendon_offset=tendon_offset)
    link = _round_link(height, radius, half_width)
    tendons = [Tendon.on_surfaces(s, stiffness=stiffness) for s in (-tendon_offset, tendon_offset)]
    return RollingChain([link] * n, tendons, "uniform")


def two_segment(
    n_proximal: int = 3,
    n_distal: int = 3,
    *,
    height: float = 15.0,
    radius: float = 20.0,
    half_width: float = 12.0,
    stiffness: float = DEFAULT_STIFFNESS,
) -> RollingChain:
    """Two segments with a pair of tendons each, so that the tip reaches an area.

    Tendons: proximal left, proximal right, distal left, distal right.

    Args:
        n_proximal: moving links of the first segment; its tendons end at the last of them.
        n_distal: moving links of the second segment; its tendons run through the first and end at the tip.
        height: distance between the surfaces of a link [mm].
        radius: radius of every convex arc [mm].
        half_width: surfaces run over s from -half_width to half_width [mm].
        stiffness: of each tendon [N/mm].
    """
    n_proximal = as_integer("n_proximal", n_proximal, 1, allowed="1 or more moving links")
    n_distal = as_integer("n_distal", n_distal, 1, allowed="1 or more moving links")
    _check_lengths(height=height, radius=radius, half_width=half_width)
    link = _round_link(height, radius, half_width)
    outer, inner = 0.75 * half_width, 0.5 * half_width
    tendons = [Tendon.on_surfaces(s, n_proximal, stiffness) for s in (-outer, outer)]
    tendons += [Tendon.on_surfaces(s, -1, stiffness) for s in (-inner, inner)]
    return RollingChain([link] * (1 + n_proximal + n_distal), tendons, "two_segment")


def flexible_arm(model: str = "exact", *, stiffness: float = 681.6134060913569, compliance: float = 0.1) -> HingeChain:
    """The flexible-joint arm of 0.7 m: two segments of 16 beads of 10 g, four tendons each.

    Tendons 0 to 3 lie at +x, +y, -x, -y and end at link 16; tendons 4 to 7 lie between them and end at the tip.

    Args:
        model: of the tendons, as in HingeChain.
        stiffness: of every hinge [N·mm/rad].
        compliance: of every tendon [mm/N].
    Source: flexible-joint paper, fig. 1 and sec. IV (beads, segments, weight, length). It does not print the radius
        of the holes, their gap and the stiffness: 25 mm, 10 mm and E I / spacing of its 1.5 mm rod at 60 GPa.
    """
    axes = ("x", "y") * 16
    beads = [Bead(21.875, axis, stiffness, gap=10.0, weight=0.0981) for axis in axes]
    near, far = 25.0, 25.0 * 0.5**0.5
    rings = [(16, ((near, 0.0), (0.0, near), (-near, 0.0), (0.0, -near)))]
    rings += [(-1, ((far, far), (-far, far), (-far, -far), (far, -far)))]
    tendons = [BeadTendon([hole], end, 1.0 / compliance) for end, holes in rings for hole in holes]
    return HingeChain(beads, tendons, model, "flexible_arm")


def small_arm(n: int = 4, model: str = "exact", *, stiffness: float = 500.0, weight: float = 0.1) -> HingeChain:
    """A short arm of n beads with four tendons to its tip, for trying things out.

    Args:
        n: number of beads.
        model: of the tendons, as in HingeChain.
        stiffness: of every hinge [N·mm/rad].
        weight: of every bead [N].
    """
    n = as_integer("n", n, 1, allowed="1 or more beads")
    beads = [Bead(20.0, "xy"[i % 2], stiffness, gap=8.0, weight=weight) for i in range(n)]
    holes = ((15.0, 0.0), (0.0, 15.0), (-15.0, 0.0), (0.0, -15.0))
    return HingeChain(beads, [BeadTendon([hole]) for hole in holes], model, "small_arm")


PRESETS: dict[str, Callable[[], AnyChain]] = {
    build.__name__: build for build in (five_link, uniform, two_segment, flexible_arm, small_arm)
}
"""The functions that make them, by name."""


def preset(name: str) -> AnyChain:
    """The named mechanism with its default dimensions.

    Raises:
        InvalidInput: an unknown name.
    """
    return PRESETS[as_choice("preset", name, tuple(PRESETS))]()


def presets_of(kind: type[AnyChain]) -> list[str]:
    """Names of the mechanisms of a class."""
    return [name for name, build in PRESETS.items() if isinstance(build(), kind)]


def _round_link(height: float, radius: float, half_width: float) -> Link:
    limits = (-half_width, half_width)
    parent = Surface(Profile.constant(1.0 / radius, limits), (0.0, -0.5 * height))
    child = Surface(Profile.constant(-1.0 / radius, limits), (0.0, 0.5 * height))
    return Link(parent, child)


def _check_lengths(**lengths: float) -> None:
    for name, value in lengths.items():
        as_positive(name, value, "a positive length [mm]")
