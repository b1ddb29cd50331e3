"""A hinge chain in MuJoCo, exactly: hinges with springs, masses, tendons as straight segments through the same holes.

Tendons are of the "exact" model; pulled by motors under given tensions, and springs that only pull under given lengths.
SI units inside, mm, N and N·mm outside. Damping and armature are free (they do not move an equilibrium); those of a
simulation, and its time step, were chosen for the shortest way of flexible_arm to rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.load import Spring
from rollingjoint.spatial.chain import HingeChain

Array = NDArray[np.float64]

STANDARD_GRAVITY = 9.80665  # m/s²: what makes a weight of a mass; no equilibrium depends on it
TIME_STEP = 0.05  # s
SPRING_TIME_STEP = 0.005  # s, where tendons are springs, whose stiffness the integrator does not know
DAMPING = 0.4  # N·m·s/rad
ARMATURE = 1e-4  # kg·m²
STEPS_BETWEEN_CHECKS = 10
MOST_STEPS = 20_000

_LIGHT = 1e-3  # kg: mass of a bead where nothing has a weight
_NEVER = 1e3  # m: a tendon this long is slack


def description(
    arm: HingeChain, gravity: tuple[float, float, float] | None, payload: float, springs: Sequence[Spring]
) -> str:
    """The model as MuJoCo's XML; the payload [N] hangs at the tip, along the direction of gravity."""
    sites: list[list[str]] = [[] for _ in range(arm.n_links)]
    tendons = motors = ""
    for j, tendon in enumerate(arm.tendons):
        path = _path(arm, j)
        for link, name, point in path:
            sites[link].append(f'<site name="{name}" pos="{_numbers(point)}"/>')
        through = "".join(f'<site site="{name}"/>' for _, name, _ in path)
        stiffness = 1e3 * tendon.stiffness
        tendons += f'<spatial name="t{j}" stiffness="{stiffness!r}" springlength="0 {_NEVER}">{through}</spatial>'
        motors += f'<motor tendon="t{j}" gear="-1"/>'
    for q, spring in enumerate(springs):
        link = spring.link % arm.n_links
        point = 1e-3 * (np.array([0.0, 0.0, arm.beads[link - 1].spacing]) + spring.point)
        sites[link].append(f'<site name="s{q}" pos="{_numbers(point)}"/>')
        sites[0].append(f'<site name="s{q}anchor" pos="{_numbers(1e-3 * np.array(spring.anchor))}"/>')
        ends = f'<site site="s{q}"/><site site="s{q}anchor"/>'
        tendons += f'<spatial stiffness="{1e3 * spring.stiffness!r}" springlength="0 0">{ends}</spatial>'
    body, at = "".join(sites[0]), 0.0
    for link, bead in enumerate(arm.beads, start=1):
        mass = bead.weight / STANDARD_GRAVITY if gravity else _LIGHT
        half, spring = 0.5e-3 * bead.spacing, 1e-3 * bead.stiffness
        body += (
            f'<body pos="0 0 {at!r}"><joint axis="{_numbers(np.array(bead.axis))}" stiffness="{spring!r}"'
            f' springref="{bead.rest_angle!r}"/><geom type="cylinder" size="{half} {half}" pos="0 0 {half!r}"'
            f' mass="{mass!r}"/>{"".join(sites[link])}'
        )
        at = 2.0 * half
    body += f'<site name="tip" pos="0 0 {at!r}"/>'
    if payload:
        body += f'<geom type="sphere" size="0.01" pos="0 0 {at!r}" mass="{payload / STANDARD_GRAVITY!r}"/>'
    down = np.zeros(3) if gravity is None else STANDARD_GRAVITY * np.array(gravity) / np.linalg.norm(gravity)
    return f"""<mujoco>
  <compiler angle="radian"/>
  <option timestep="{TIME_STEP}" integrator="implicitfast" gravity="{_numbers(down)}"><flag contact="disable"/></option>
  <default><joint type="hinge" damping="{DAMPING}" armature="{ARMATURE}"/></default>
  <worldbody>{body}{"</body>" * arm.n_joints}</worldbody>
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


def _numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


class MujocoArm:
    """The simulated arm. Raises ImportError without MuJoCo."""

    def __init__(
        self,
        arm: HingeChain,
        gravity: tuple[float, float, float] | None = None,
        payload: float = 0.0,
        springs: Sequence[Spring] = (),
    ) -> None:
        import mujoco

        self._engine: Any = mujoco
        self.model = mujoco.MjModel.from_xml_string(description(arm, gravity, payload, springs))
        self.state = mujoco.MjData(self.model)
        self._tendons = slice(arm.n_tendons)

    def pull(self, tensions: ArrayLike) -> None:
        """Prescribe the tensions of all tendons [N]."""
        self.model.opt.timestep = TIME_STEP
        self.model.tendon_lengthspring[self._tendons, 1] = _NEVER
        self.state.ctrl[:] = tensions

    def wind(self, lengths: ArrayLike) -> None:
        """Prescribe the unstretched lengths of all tendons [mm]; shorter than that they are slack."""
        self.model.opt.timestep = SPRING_TIME_STEP
        self.model.tendon_lengthspring[self._tendons, 1] = 1e-3 * np.asarray(lengths)
        self.state.ctrl[:] = 0.0

    def place(self, joint_angles: ArrayLike) -> None:
        """Put the arm at these angles [rad], at rest, without forces from `push`."""
        self.state.qfrc_applied[:] = 0.0
        self.state.qpos[:] = joint_angles
        self.state.qvel[:] = 0.0
        self._engine.mj_forward(self.model, self.state)

    def push(self, link: int, point: ArrayLike, force: ArrayLike) -> None:
        """Add a force [N] at a point of the base frame [mm] on a link; it stays as it is in joint space."""
        body, at = link % (self.model.nv + 1), 1e-3 * np.asarray(point)
        wrench = np.asarray(force, float), np.zeros(3)
        self._engine.mj_applyFT(self.model, self.state, *wrench, at, body, self.state.qfrc_applied)
        self._engine.mj_forward(self.model, self.state)

    @property
    def unbalanced(self) -> Array:
        """Moment about every hinge that nothing balances, (n - 1,) [N·mm]."""
        return 1e3 * self.state.qfrc_smooth

    @property
    def spring_moments(self) -> Array:
        """Moments of springs, and of tendons under given lengths, (n - 1,) [N·mm]."""
        return 1e3 * self.state.qfrc_passive

    @property
    def lengths(self) -> Array:
        """Tendon lengths [mm]."""
        return 1e3 * self.state.ten_length[self._tendons]

    @property
    def tip(self) -> Array:
        """Position of the tip, (3,) [mm]."""
        return 1e3 * self.state.site("tip").xpos

    @property
    def tip_rotation(self) -> Array:
        """Rotation matrix of the last link, (3, 3)."""
        return self.state.site("tip").xmat.reshape(3, 3)

    def settle(self, speed: float = 1e-3) -> int:
        """Steps until the arm rests: until no hinge is faster [rad/s] nor, per second, accelerated more.

        Raises:
            RuntimeError: it does not come to rest.
        """
        for step in range(0, MOST_STEPS, STEPS_BETWEEN_CHECKS):
            self._engine.mj_step(self.model, self.state, STEPS_BETWEEN_CHECKS)
            if max(np.abs(self.state.qvel).max(), np.abs(self.state.qacc).max()) < speed:
                return step + STEPS_BETWEEN_CHECKS
        raise RuntimeError(f"the MuJoCo arm still moves after {MOST_STEPS} steps")
