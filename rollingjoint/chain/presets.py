"""Named mechanisms."""

from __future__ import annotations

import math
from collections.abc import Callable

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.hinge import Bead, HingeChain
from rollingjoint.chain.rolling import Link, RollingChain
from rollingjoint.chain.spatial import SpatialChain, SpatialLink
from rollingjoint.chain.spatial_joints import RollingContact
from rollingjoint.chain.tendon import DEFAULT_STIFFNESS, BeadTendon, SpaceTendon, Tendon
from rollingjoint.checks import as_choice, as_integer, as_positive
from rollingjoint.profile import Profile, Surface

_LIMITS = (-15.0, 15.0)
_MOST_BEND = 0.5  # rad, of a joint between pitch and yaw


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


def pitch_yaw(
    n: int = 12, *, joint_stiffness: float = 2.0, stiffness: float = 10.0, weight: float = 0.0
) -> SpatialChain:
    """A tube of n rolling joints about pitch and yaw axes in turn, with four tendons to its tip.

    Its tip moves on a surface. All dimensions are assumed: diameter 8 mm, surfaces of radius 5 mm as wide as the tube,
    links of 5 mm, holes on a circle of 6 mm and 0.8 mm below the surfaces, joints to 0.5 rad.

    Args:
        n: number of joints.
        joint_stiffness: of every joint [N·mm/rad].
        stiffness: of every tendon [N/mm].
        weight: of every moving link, in its middle [N].
    """
    n = as_integer("n", n, 1, allowed="1 or more joints")
    return _tube("pitch_yaw", (n,), 8.0, 5.0, 5.0, (3.0, 1.7), joint_stiffness, stiffness, weight)


def pitch_yaw_two_segment(
    n_proximal: int = 7,
    n_distal: int = 7,
    *,
    joint_stiffness: float = 1.0,
    stiffness: float = 10.0,
    weight: float = 0.0,
) -> SpatialChain:
    """Two segments of rolling joints about pitch and yaw axes in turn, with four tendons each; the tip fills space.

    Tendons 0 to 3 end at the last link of the first segment, 4 to 7, between them, at the tip. All dimensions are
    assumed: diameter 12 mm, surfaces of radius 7 mm as wide as the tube, links of 8 mm, holes on a circle of 10 mm and
    1.2 mm below the surfaces, joints to 0.5 rad.

    Args:
        n_proximal, n_distal: numbers of joints of the segments.
        joint_stiffness: of every joint [N·mm/rad].
        stiffness: of every tendon [N/mm].
        weight: of every moving link, in its middle [N].
    """
    n_proximal = as_integer("n_proximal", n_proximal, 1, allowed="1 or more joints")
    n_distal = as_integer("n_distal", n_distal, 1, allowed="1 or more joints")
    ends = n_proximal, n_proximal + n_distal
    return _tube("pitch_yaw_two_segment", ends, 12.0, 7.0, 8.0, (5.0, 2.8), joint_stiffness, stiffness, weight)


PRESETS: dict[str, Callable[[], AnyChain]] = {
    build.__name__: build
    for build in (five_link, uniform, two_segment, flexible_arm, small_arm, pitch_yaw, pitch_yaw_two_segment)
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


def _tube(
    name: str,
    ends: tuple[int, ...],
    diameter: float,
    radius: float,
    height: float,
    hole: tuple[float, float],
    joint_stiffness: float,
    stiffness: float,
    weight: float,
) -> SpatialChain:
    """A tube of equal links; four tendons to every end, the rings turned against each other.

    hole: distance from the middle of the tube, and from the middle of the link [mm].
    """
    reach = 0.5 * _MOST_BEND * radius  # arc length at the largest angle
    child = Surface(Profile.constant(-1.0 / radius, (-reach, reach)), (0.0, 0.5 * height))
    parent = Surface(Profile.constant(1.0 / radius, (-reach, reach)), (0.0, -0.5 * height))
    planes = 0.0, 0.5 * math.pi
    joints = [
        RollingContact(planes[i % 2], parent, child, 0.5 * diameter, stiffness=joint_stiffness) for i in range(ends[-1])
    ]
    tendons = []
    for ring, end in enumerate(ends):
        for k in range(4):
            angle = 0.5 * math.pi * k + 0.25 * math.pi * ring
            x, y = hole[0] * math.cos(angle), hole[0] * math.sin(angle)
            tendons.append(SpaceTendon([((x, y, -hole[1]), (x, y, hole[1]))], end, stiffness))
    links = (SpatialLink(), *[SpatialLink(weight)] * ends[-1]) if weight else ()
    return SpatialChain(joints, tendons, links, name)


def _check_lengths(**lengths: float) -> None:
    for name, value in lengths.items():
        as_positive(name, value, "a positive length [mm]")
