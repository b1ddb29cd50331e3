"""A planar chain in MuJoCo: links in the x-y plane, rolling contacts as coupled joints, tendons through the same holes.

SI units inside; link frames are the frames of rollingjoint, in m. Masses, damping and armature are
free: they do not move an equilibrium.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.rolling import RollingChain
from rollingjoint.mujoco.arm import NEVER, UNTOUCHED, numbers
from rollingjoint.mujoco.coupling import Circles, Slides, coupling

Array = NDArray[np.float64]

MASS = 0.005  # kg of a link
TIME_STEP = 0.001  # s
HINGE = 'damping="0.02" armature="1e-3"'  # N·m·s/rad, kg·m²: the heavier, the stiffer MuJoCo makes the couplings
SLIDE = 'type="slide" damping="1" armature="1"'  # N·s/m, kg
CONSTRAINT = 'solref="0.002 1" solimp="0.9999 0.9999 0.001"'  # as stiff as the time step allows


def couplings(chain: RollingChain) -> list[Circles | Slides]:
    """The joints of every rolling contact, base first."""
    return [coupling(below.child, above.parent) for below, above in itertools.pairwise(chain.links)]


def chain_mjcf(chain: RollingChain, walls: str = "", outlines: Mapping[int, str] | None = None) -> str:
    """The chain as MuJoCo's XML, at rest at s = 0; tendons are pulled by motors, or by springs as in an arm.

    walls, outlines: geometry of the world, and of every link, which touch each other.
    """
    joints, outlines = couplings(chain), outlines or {}
    body, equalities = _shape(chain, 0) + _sites(chain, 0), ""
    for link, joint in enumerate(joints, start=1):
        x, y, angle = joint.rest.tolist()
        body += f'<body name="link{link}" pos="{numbers(np.array([1e-3 * x, 1e-3 * y, 0.0]))}" euler="0 0 {angle!r}">'
        described, constraint = _hinges(link, joint) if isinstance(joint, Circles) else _slides(link, joint)
        body += described + _shape(chain, link) + _sites(chain, link) + outlines.get(link, "")
        equalities += constraint
    body += '<site name="tip"/>'
    paths = [[name for name, _, _ in _path(chain, j)] for j in range(chain.n_tendons)]
    tendons = tendon_text(paths, chain.stiffnesses.tolist())
    return model_text(walls + body + "</body>" * chain.n_joints, equalities, *tendons, contact=bool(walls))


def tendon_text(paths: Sequence[Sequence[str]], stiffnesses: Sequence[float]) -> tuple[str, str]:
    """Tendons through sites, and their motors; stiffnesses in N/mm."""
    tendons = motors = ""
    for j, (path, stiffness) in enumerate(zip(paths, stiffnesses, strict=True)):
        through = "".join(f'<site site="{name}"/>' for name in path)
        spring = f'stiffness="{1e3 * float(stiffness)!r}" springlength="0 {NEVER}"'
        tendons += f'<spatial name="t{j}" {spring}>{through}</spatial>'
        motors += f'<motor tendon="t{j}" gear="-1"/>'
    return tendons, motors


def model_text(body: str, equalities: str, tendons: str, motors: str, contact: bool = False) -> str:
    """A weightless model, without contacts unless they are wanted."""
    flag = "enable" if contact else "disable"
    return f"""<mujoco>
  <compiler angle="radian"/>
  <option timestep="{TIME_STEP}" integrator="implicitfast" gravity="0 0 0"><flag contact="{flag}"/></option>
  <worldbody>{body}</worldbody>
  <equality>{equalities}</equality>
  <tendon>{tendons}</tendon>
  <actuator>{motors}</actuator>
</mujoco>"""


def _hinges(link: int, joint: Circles) -> tuple[str, str]:
    """Two hinges at the centres of curvature, the first leading, and their coupling."""
    first, second = 1e-3 * joint.centres
    low, high = sorted(joint.coordinates(np.array(joint.angles))[:, 0])
    described = (
        f'<joint name="j{link}" {HINGE} axis="0 0 1" pos="{numbers(np.append(first, 0.0))}" range="{low} {high}"/>'
        f'<joint name="j{link}b" {HINGE} axis="0 0 1" pos="{numbers(np.append(second, 0.0))}"/>'
    )
    return described, equality(f"j{link}b", f"j{link}", [0.0, float(joint.rates[1] / joint.rates[0]), 0.0, 0.0, 0.0])


def _slides(link: int, joint: Slides) -> tuple[str, str]:
    """Two slides along the axes of the link below, and the hinge that leads them."""
    cos, sin = np.cos(joint.rest[2]), np.sin(joint.rest[2])
    axes = np.array([[cos, -sin, 0.0], [sin, cos, 0.0]])  # of the link below, in the frame of this link at rest
    described = "".join(
        f'<joint name="j{link}{name}" {SLIDE} axis="{numbers(axis)}"/>' for name, axis in zip("xy", axes, strict=True)
    )
    low, high = np.array(joint.angles) - joint.rest[2]
    described += f'<joint name="j{link}" {HINGE} axis="0 0 1" range="{low} {high}"/>'
    return described, "".join(
        equality(f"j{link}{name}", f"j{link}", (1e-3 * powers).tolist())
        for name, powers in zip("xy", joint.powers, strict=True)
    )


def equality(follower: str, leader: str, powers: Sequence[float]) -> str:
    """The constraint that keeps one joint at a polynomial of another, ascending powers."""
    polynomial = " ".join(map(repr, powers))
    return f'<joint joint1="{follower}" joint2="{leader}" polycoef="{polynomial}" {CONSTRAINT}/>'


def _shape(chain: RollingChain, link: int) -> str:
    """A capsule from surface to surface, with the mass of the link."""
    ends = [
        np.append(1e-3 * np.array(surface.start), 0.0)
        for surface in (chain.links[link].parent, chain.links[link].child)
    ]
    radius = 2e-4 * chain.links[link].height
    between = " ".join(map(numbers, ends))
    return f'<geom type="capsule" fromto="{between}" size="{radius!r}" mass="{MASS}" {UNTOUCHED}/>'


def _path(chain: RollingChain, j: int) -> list[tuple[str, int, Array]]:
    """Holes of a tendon from the base to its end: name, link, point in the frame of the link [m]."""
    path = []
    for link, (below, above) in enumerate(chain.hole_points[j]):
        path += [(f"a{link}", link, below), (f"b{link}", link, above)]
    return [(f"t{j}{name}", link, np.append(1e-3 * point, 0.0)) for name, link, point in path]


def _sites(chain: RollingChain, link: int) -> str:
    return "".join(
        f'<site name="{name}" pos="{numbers(point)}" size="0.0005"/>'
        for j in range(chain.n_tendons)
        for name, at, point in _path(chain, j)
        if at == link
    )
