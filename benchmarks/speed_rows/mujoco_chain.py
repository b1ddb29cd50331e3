"""A chain of hinges with two tendons in MuJoCo: what a general simulator does where this package solves an equilibrium.

It has the size, tendons, motor law and tip force of the five-link prototype, but hinges in place of rolling contacts:
its poses are similar, not equal. After every command it runs until it rests. Masses and dampers are free (they do not
move the equilibrium) and were chosen, with the time step, for the shortest way to rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.rolling import RollingChain

Array = NDArray[np.float64]

JOINT_STIFFNESS = 0.3  # N·m/rad: what the curved surfaces give the prototype, which plain hinges lack
TIME_STEP = 0.008  # s
DAMPING = 0.01  # N·m·s/rad
ARMATURE = 1e-5  # kg·m²
STEPS_BETWEEN_CHECKS = 5
REST_SPEED = 1e-3  # m/s of the tip
REST_ACCELERATION = 0.3  # rad/s² of every joint
MOST_STEPS = 20_000

HEIGHT, HALF_GAP, OFFSET = 0.020, 0.0035, 0.010  # of a link, of holes from the hinge, of tendons from the axis [m]


def description(mechanism: RollingChain, tension_limits: tuple[float, float]) -> str:
    """The model as MuJoCo's XML: a hinge between links, on each tendon a position servo that can only pull."""
    low, high = tension_limits
    body, closing = _holes(0, above=HEIGHT / 2 - HALF_GAP), ""
    for link in range(1, mechanism.n_links):
        body += (
            f'<body pos="0 0 {HEIGHT}"><joint type="hinge" axis="0 1 0" pos="0 0 {-HEIGHT / 2}"/>'
            f'<geom type="box" size="0.008 0.004 {HEIGHT / 2 - 0.002}" mass="0.005"/>'
        )
        body += _holes(link, below=-HEIGHT / 2 + HALF_GAP, above=HEIGHT / 2 - HALF_GAP)
        closing += "</body>"
    tendons = motors = ""
    for side, stiffness in zip("lr", mechanism.stiffnesses, strict=True):
        path = [f"{side}0above"]
        for link in range(1, mechanism.n_links):
            path += [f"{side}{link}below", f"{side}{link}above"]
        sites = "".join(f'<site site="{name}"/>' for name in path)
        tendons += f'<spatial name="{side}">{sites}</spatial>'
        motors += f'<position tendon="{side}" kp="{1e3 * stiffness}" forcerange="{-high} {-low}"/>'
    return f"""<mujoco>
  <option timestep="{TIME_STEP}" integrator="implicitfast" gravity="0 0 0"><flag contact="disable"/></option>
  <default><joint stiffness="{JOINT_STIFFNESS}" damping="{DAMPING}" armature="{ARMATURE}"/></default>
  <worldbody>{body}{closing}</worldbody>
  <tendon>{tendons}</tendon>
  <actuator>{motors}</actuator>
</mujoco>"""


def _holes(link: int, **heights: float) -> str:
    return "".join(
        f'<site name="{side}{link}{where}" pos="{x} 0 {z}"/>'
        for where, z in heights.items()
        for side, x in (("l", -OFFSET), ("r", OFFSET))
    )


class MujocoChain:
    """The simulated chain. Raises ImportError without MuJoCo."""

    def __init__(self, mechanism: RollingChain, tension_limits: tuple[float, float]) -> None:
        import mujoco

        self._engine: Any = mujoco
        self.model = mujoco.MjModel.from_xml_string(description(mechanism, tension_limits))
        self.state = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.state)
        self._neutral = self.state.ten_length.copy()

    @property
    def tip(self) -> Array:
        """Position (x, z) of the last link [mm]."""
        return 1e3 * self.state.xpos[-1, [0, 2]]

    def settle(self, shortening: Array, tip_force: Array) -> int:
        """Steps until the chain rests after its tendons were commanded this much below neutral [mm] under a force [N].

        Raises:
            RuntimeError: it does not come to rest.
        """
        self.state.ctrl[:] = self._neutral - 1e-3 * shortening
        self.state.xfrc_applied[-1, [0, 2]] = tip_force
        for step in range(0, MOST_STEPS, STEPS_BETWEEN_CHECKS):
            self._engine.mj_step(self.model, self.state, STEPS_BETWEEN_CHECKS)
            if self._rests():
                return step + STEPS_BETWEEN_CHECKS
        raise RuntimeError(f"the MuJoCo chain still moves after {MOST_STEPS} steps")

    def _rests(self) -> bool:
        fastest = np.abs(self.state.qvel).sum() * HEIGHT * self.model.nv
        return bool(fastest < REST_SPEED and np.abs(self.state.qacc).max() < REST_ACCELERATION)
