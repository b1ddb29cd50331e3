"""Results of friction in a step, and the coefficients and the history with which it begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import FrictionState
from rollingjoint.kernels.friction import N_COEFFICIENTS, PRESLIDING, FrictionArrays, FrictionLaw, History
from rollingjoint.kernels.rubbed import begin_histories

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FrictionStep:
    """Results of friction in the step from a history to an equilibrium, or in many with a leading axis B.

    Attributes:
        gap_tensions: (n - 1, m) tension of every tendon in every gap, 0 beyond its end [N].
        slip: (n - 1, m) slip of every tendon in links 0 to n - 2 during the step, towards the tip positive [mm].
        work: work of friction in the step [N·mm].
        state: history of the next step.
    """

    gap_tensions: Array
    slip: Array
    work: float | Array
    state: FrictionState

    @classmethod
    def of(cls, arrays: FrictionArrays) -> Self:
        """The results of a batch, from its outputs."""
        before = arrays.before.slips
        slip = np.subtract(arrays.after.slips, before, out=np.zeros_like(before), where=np.isfinite(before))
        for array in (arrays.tension, slip, *arrays.after):
            array.setflags(write=False)
        return cls(arrays.tension, slip, arrays.work, FrictionState(*arrays.after))

    def row(self, index: int) -> FrictionStep:
        """The results of one row of a batch."""
        work = self.work[index].item()  # type: ignore[index]
        return FrictionStep(self.gap_tensions[index], self.slip[index], work, self.state.row(index))

    def check(self, rows: tuple[int, ...], n_joints: int, n_tendons: int) -> None:
        """Raise InvalidInput unless its arrays have the shapes of a mechanism, with these leading axes."""
        holes, joints = (*rows, n_joints, n_tendons), (*rows, n_joints)
        for name in ("gap_tensions", "slip"):
            check_shape(name, getattr(self, name), holes)
        shapes = holes, holes, holes, joints, joints
        for name, value, shape in zip(self.state._fields, self.state, shapes, strict=True):
            check_shape(f"friction state ({name})", value, shape)


def friction_laws(mechanism: AnyChain | Sequence[AnyChain], n_rows: int) -> FrictionLaw:
    """The coefficients of friction of every row of a batch."""
    if isinstance(mechanism, Sequence):
        tendons = np.array([chain.friction_coefficients for chain in mechanism])
        return FrictionLaw(tendons, np.array([chain.rolling_coefficients for chain in mechanism]))
    tendons, rolling = mechanism.friction_coefficients[None], mechanism.rolling_coefficients[None]
    if n_rows == 1:
        return FrictionLaw(tendons.copy(), rolling.copy())  # for arrays that are read-only kernels are compiled again
    return FrictionLaw(np.repeat(tendons, n_rows, axis=0), np.repeat(rolling, n_rows, axis=0))


def no_friction(angles: Array, n_tendons: int) -> tuple[FrictionLaw, History]:
    """Coefficients and histories of rows without friction, at joint angles (B, n - 1)."""
    tendons, holes = np.zeros((len(angles), n_tendons, N_COEFFICIENTS)), np.zeros((3, *angles.shape, n_tendons))
    tendons[..., PRESLIDING] = 1.0
    states, slips, grips = holes
    history = History(states, slips, grips, angles, np.zeros_like(angles))
    return FrictionLaw(tendons, np.tile([0.0, 1.0], (len(angles), 1))), history


def virgin_state(
    mechanism: AnyChain | Sequence[AnyChain],
    designs: tuple[Any, NDArray[np.int64]],
    tensions: Array,
    joint_angles: Array,
) -> FrictionState:
    """State of friction at equilibria before any slip; tensions (..., m) [N], joint angles (..., n - 1) [rad]."""
    shape, n_joints, n_tendons = joint_angles.shape[:-1], joint_angles.shape[-1], tensions.shape[-1]
    angles, tensions = joint_angles.reshape(-1, n_joints).copy(), tensions.reshape(-1, n_tendons).copy()
    states, slips, grips = (np.zeros((len(angles), n_joints, n_tendons)) for _ in range(3))
    history = History(states, slips, grips, angles, np.zeros_like(angles))
    begin_histories(*designs, friction_laws(mechanism, len(angles)), tensions, angles, history)
    return FrictionState(*(array.reshape(*shape, *array.shape[1:]) for array in history))


def check_shape(name: str, value: Any, expected: tuple[int, ...]) -> None:
    """Raise InvalidInput unless a field of an equilibrium has the shape of its mechanism."""
    if np.shape(value) != expected or (expected and not isinstance(value, np.ndarray)):
        raise InvalidInput(f"{name} of an equilibrium", value, f"an array of shape {expected}, as of its mechanism")
