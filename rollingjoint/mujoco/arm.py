"""A hinge chain in MuJoCo, exactly: hinges with springs, masses, tendons as straight segments through the same holes.

Tendons are of the "exact" model; pulled by motors under given tensions, and springs that only pull under given lengths.
SI units inside. Damping and armature are free (they do not move an equilibrium); their values and the time step were
chosen for the shortest way of flexible_arm to rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.hinge import HingeChain
from rollingjoint.load import Spring

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665  # m/s²: weight over mass; no equilibrium depends on it
TIME_STEP = 0.05  # s
DAMPING = 0.4  # N·m·s/rad
ARMATURE = 1e-4  # kg·m²
AMONG_WALLS = 0.001, 0.02  # time step and damping among walls, which are as stiff as the time step allows

_LIGHT = 1e-3  # kg: mass of a bead without gravity
NEVER = 1e3  # m: a tendon this long is slack
UNTOUCHED = 'contype="0" conaffinity="0"'


def arm_mjcf(
    arm: HingeChain,
    gravity: tuple[float, float, float] | None = None,
    payload: float = 0.0,
    springs: Sequence[Spring] = (),
    walls: str = "",
    outlines: Mapping[int, str] | None = None,
) -> str:
    """The arm as MuJoCo's XML, exactly.

    Args:
        gravity: its direction in the base frame; None: no weights.
        payload: weight at the tip, along the direction of gravity [N].
        springs: from points of links to points of the base frame.
        walls, outlines: geometry of the world, and of every link, which touch each other.
    """
    sites: list[list[str]] = [[] for _ in range(arm.n_links)]
    tendons = motors = ""
    for j, tendon in enumerate(arm.tendons):
        path = _path(arm, j)
        for link, name, point in path:
            sites[link].append(f'<site name="{name}" pos="{numbers(point)}"/>')
        through = "".join(f'<site site="{name}"/>' for _, name, _ in path)
        stiffness = 1e3 * tendon.stiffness
        tendons += f'<spatial name="t{j}" stiffness="{stiffness!r}" springlength="0 {NEVER}">{through}</spatial>'
        motors += f'<motor tendon="t{j}" gear="-1"/>'
    for q, spring in enumerate(springs):
        link = spring.link % arm.n_links
        point = 1e-3 * (np.array([0.0, 0.0, arm.beads[link - 1].spacing]) + spring.point)
        sites[link].append(f'<site name="s{q}" pos="{numbers(point)}"/>')
        sites[0].append(f'<site name="s{q}anchor" pos="{numbers(1e-3 * np.array(spring.anchor))}"/>')
        ends = f'<site site="s{q}"/><site site="s{q}anchor"/>'
        tendons += f'<spatial stiffness="{1e3 * spring.stiffness!r}" springlength="0 0">{ends}</spatial>'
    body, at = "".join(sites[0]), 0.0
    for link, bead in enumerate(arm.beads, start=1):
        mass = bead.weight / STANDARD_GRAVITY if gravity else _LIGHT
        half, elastic = 0.5e-3 * bead.spacing, 1e-3 * bead.stiffness
        body += (
            f'<body pos="0 0 {at!r}"><joint axis="{numbers(np.array(bead.axis))}" stiffness="{elastic!r}"'
            f' springref="{bead.rest_angle!r}"/><geom type="cylinder" size="{half} {half}" pos="0 0 {half!r}"'
            f' mass="{mass!r}" {UNTOUCHED}/>{"".join(sites[link])}{(outlines or {}).get(link, "")}'
        )
        at = 2.0 * half
    body += f'<site name="tip" pos="0 0 {at!r}"/>'
    if payload:
        body += f'<geom type="sphere" size="0.01" pos="0 0 {at!r}" mass="{payload / STANDARD_GRAVITY!r}" {UNTOUCHED}/>'
    contact, step, damping = ("enable", *AMONG_WALLS) if walls else ("disable", TIME_STEP, DAMPING)
    down = np.zeros(3) if gravity is None else STANDARD_GRAVITY * np.array(gravity) / np.linalg.norm(gravity)
    return f"""<mujoco>
  <compiler angle="radian"/>
  <option timestep="{step}" integrator="implicitfast" gravity="{numbers(down)}"><flag contact="{contact}"/></option>
  <default><joint type="hinge" damping="{damping}" armature="{ARMATURE}"/></default>
  <worldbody>{walls}{body}{"</body>" * arm.n_joints}</worldbody>
  <tendon>{tendons}</tendon>
  <actuator>{motors}</actuator>
</mujoco>"""


def _path(arm: HingeChain, j: int) -> list[tuple[int, str, Array]]:
    """Holes of a tendon from base to end: link, name, point in the frame at the link's hinge [m]."""
    holes = np.array(arm.tendons[j].link_holes(arm.n_links))
    gaps = [bead.gap for bead in arm.beads]
    gaps.append(gaps[-1])
    path = [(0, f"t{j}b0", np.array([*holes[0], -0.5 * gaps[0]]))]
    for i in range(len(holes) - 1):
        path.append((i + 1, f"t{j}a{i}", np.array([*holes[i + 1], 0.5 * gaps[i]])))
        path.append((i + 1, f"t{j}b{i + 1}", np.array([*holes[i + 1], arm.beads[i].spacing - 0.5 * gaps[i + 1]])))
    return [(link, name, 1e-3 * point) for link, name, point in path]


def numbers(values: Array) -> str:
    """Numbers as text for attributes, to the last bit."""
    return " ".join(repr(float(value)) for value in values)
