"""A hinge chain in MuJoCo: the model that rollingjoint.mujoco writes, driven in mm, N and N·mm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.hinge import HingeChain
from rollingjoint.load import Spring
from rollingjoint.mujoco.arm import NEVER, TIME_STEP, arm_mjcf

Array = NDArray[np.float64]

SPRING_TIME_STEP = 0.005  # s, where tendons are springs, whose stiffness the integrator does not know
STEPS_BETWEEN_CHECKS = 10
MOST_STEPS = 20_000


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
        self.model = mujoco.MjModel.from_xml_string(arm_mjcf(arm, gravity, payload, springs))
        self.state = mujoco.MjData(self.model)
        self._tendons = slice(arm.n_tendons)

    def pull(self, tensions: ArrayLike) -> None:
        """Prescribe the tensions of all tendons [N]."""
        self.model.opt.timestep = TIME_STEP
        self.model.tendon_lengthspring[self._tendons, 1] = NEVER
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
