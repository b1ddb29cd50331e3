"""A chain in space in MuJoCo: rolling contacts as coupled joints in their planes, hinges, tendons through their holes.

A contact works as in a planar chain (`coupling.py`), in the plane of its joint; springs of joints act on the joint that
leads. SI units inside; link frames are the frames of rollingjoint, in m.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain import se3
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.chain.spatial_joints import PointHinge, RollingContact, SpatialJoint
from rollingjoint.errors import InvalidInput
from rollingjoint.mujoco.arm import UNTOUCHED, numbers
from rollingjoint.mujoco.chain import HINGE, MASS, SLIDE, equality, model_text, tendon_text
from rollingjoint.mujoco.coupling import Circles, Slides, coupling

Array = NDArray[np.float64]

_SMALLEST = 1e-4  # m: half size of a body that no hole shows


def couplings(chain: SpatialChain) -> list[Circles | Slides | None]:
    """The joints of every rolling contact, base first; None at hinges."""
    return [coupling(j.child, j.parent) if isinstance(j, RollingContact) else None for j in chain.joints]


def space_mjcf(chain: SpatialChain, walls: str = "", outlines: Mapping[int, str] | None = None) -> str:
    """The chain as MuJoCo's XML, weightless, at rest at s = 0 and at angles 0 of hinges.

    Args:
        walls, outlines: geometry of the world, and of every link, which touch each other.
    Raises:
        InvalidInput: a joint that is neither a RollingContact nor a PointHinge.
    """
    body, equalities, outlines = _sites(chain, 0), "", outlines or {}
    for i, (joint, joined) in enumerate(zip(chain.joints, couplings(chain), strict=True)):
        placed, described, constraint = _contact(chain, i, joint, joined) if joined else _hinge(chain, i, joint)
        body += f'<body name="link{i + 1}" {placed}>{described}{_shape(chain, i + 1)}{_sites(chain, i + 1)}'
        body += outlines.get(i + 1, "")
        equalities += constraint
    paths = [
        [f"t{j}{side}{k}" for k in range(len(points)) for side in "ab"] for j, points in enumerate(chain.hole_points)
    ]
    tendons = tendon_text(paths, [tendon.stiffness for tendon in chain.tendons])
    body = walls + body + '<site name="tip"/>' + "</body>" * chain.n_joints
    return model_text(body, equalities, *tendons, contact=bool(walls))


def _contact(chain: SpatialChain, i: int, joint: SpatialJoint, joined: Circles | Slides) -> tuple[str, str, str]:
    """Place of the link above, its joints, the leading one named j and the number of the link, and their couplings."""
    lateral, axial, axis = joint.frame
    x, y, angle = joined.rest.tolist()
    place = 1e-3 * (x * lateral + y * axial)
    turn = se3.rotation(angle * axis)
    placed = f'pos="{numbers(place)}" xyaxes="{numbers(turn[:, 0])} {numbers(turn[:, 1])}"'
    name, (low, high) = f"j{i + 1}", (np.array(joined.angles) - angle).tolist()
    if isinstance(joined, Circles):
        first, second = (1e-3 * (centre @ joint.frame[:2]) for centre in joined.centres)
        lead = float(joined.rates[0] / joined.rates.sum())  # of the joint angle: how much of it the first hinge turns
        ends = f'range="{min(lead * low, lead * high)} {max(lead * low, lead * high)}"'
        described = (
            f'<joint name="{name}" {HINGE} axis="{numbers(axis)}" pos="{numbers(first)}" {ends}'
            f" {_spring(joint, angle, lead)}/>"
            f'<joint name="{name}b" {HINGE} axis="{numbers(axis)}" pos="{numbers(second)}"/>'
        )
        return placed, described, equality(f"{name}b", name, [0.0, 1.0 / lead - 1.0, 0.0, 0.0, 0.0])
    slides = [(f"{name}{side}", turn.T @ way) for side, way in (("x", lateral), ("y", axial))]
    described = "".join(f'<joint name="{slide}" {SLIDE} axis="{numbers(way)}"/>' for slide, way in slides)
    described += (
        f'<joint name="{name}" {HINGE} axis="{numbers(axis)}" range="{low} {high}" {_spring(joint, angle, 1.0)}/>'
    )
    pairs = zip(slides, joined.powers, strict=True)
    return placed, described, "".join(equality(slide, name, (1e-3 * powers).tolist()) for (slide, _), powers in pairs)


def _hinge(chain: SpatialChain, i: int, joint: SpatialJoint) -> tuple[str, str, str]:
    """Place of the link above, its hinge, and no coupling."""
    if not isinstance(joint, PointHinge):
        raise InvalidInput(f"joint {i}", joint, "a RollingContact or a PointHinge")
    low, high = chain.joint_limits[i]
    described = (
        f'<joint name="j{i + 1}" {HINGE} axis="{numbers(np.array(joint.axis))}"'
        f' pos="{numbers(1e-3 * np.array(joint.above))}" range="{low} {high}" {_spring(joint, 0.0, 1.0)}/>'
    )
    return f'pos="{numbers(1e-3 * np.subtract(joint.below, joint.above))}"', described, ""


def _spring(joint: SpatialJoint, rest: float, lead: float) -> str:
    """The spring of a joint on a hinge that turns by the share `lead` of the angle beyond `rest`."""
    return f'stiffness="{1e-3 * joint.stiffness / lead**2}" springref="{lead * (joint.rest_angle - rest)}"'


def _shape(chain: SpatialChain, link: int) -> str:
    """A box around the tendons' holes, with the mass of the link."""
    low, high = 1e-3 * chain.body_ends[link - 1]
    side = 0.7e-3 * chain.hole_radius + _SMALLEST
    sizes = np.array([side, side, 0.5 * (high - low) + _SMALLEST])
    return f'<geom type="box" size="{numbers(sizes)}" pos="0 0 {0.5 * (low + high)}" mass="{MASS}" {UNTOUCHED}/>'


def _sites(chain: SpatialChain, link: int) -> str:
    """The holes of a link."""
    return "".join(
        f'<site name="t{j}{side}{link}" pos="{numbers(1e-3 * point)}" size="0.0005"/>'
        for j, points in enumerate(chain.hole_points)
        if link < len(points)
        for side, point in zip("ab", points[link], strict=True)
    )
