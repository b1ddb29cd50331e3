"""Checked inputs of the solvers: starts and histories, limits of tensions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.friction_step import virgin_state
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.stacks import designs_of
from rollingjoint.checks import as_floats, seen_as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import FrictionState

Array = NDArray[np.float64]

Start = ArrayLike | Solution | None
"""Joint angles to start from, an equilibrium that has them, or None for the mechanism at rest."""

History = Solution | FrictionState | None
"""The equilibrium before a step with friction, its state of friction, or None for no friction at all."""

_ALLOWED = "an equilibrium or its friction_state"


def start_of(start: Start, history: History) -> ArrayLike | None:
    """The joint angles to start from: the history's if there is no other start."""
    if start is not None:  # isinstance takes four times as long
        return getattr(start, "joint_angles", start)  # type: ignore[arg-type]
    if isinstance(history, Solution):  # a step that failed leaves its own history as it was
        return history.joint_angles if history.friction is None else history.friction.state.angles
    return getattr(history, "angles", None)


def angles_of(mechanism: AnyChain, start: Start, history: History) -> Array:
    """Joint angles to start from, (n - 1,) [rad]. Not a copy: read them before returning.

    Raises:
        InvalidInput: other numbers of angles, or no numbers.
    """
    angles = start_of(start, history)
    if angles is None:
        return mechanism.neutral_angles
    return seen_as_vector("start", angles, mechanism.n_joints, "joint angles [rad], one per joint")


def checked_history(mechanism: AnyChain | tuple[AnyChain, ...], history: object, rows: int | None) -> FrictionState:
    """State of friction of one mechanism (rows: None) or of a batch of `rows` rows.

    Raises:
        InvalidInput: neither an equilibrium nor a FrictionState, or one of other numbers of rows, joints or tendons.
    """
    state = _state_of(mechanism, history)
    first = mechanism[0] if isinstance(mechanism, tuple) else mechanism
    leading = () if rows is None else (rows,)
    per_hole, per_joint = (*leading, first.n_joints, first.n_tendons), (*leading, first.n_joints)
    if isinstance(history, Solution) and state.states.shape == per_hole:
        return state
    arrays = [_floats(array) for array in state]
    if rows is not None and np.ndim(state.angles) == 1:
        arrays = [np.repeat(array[None], rows, axis=0) for array in arrays]
    shapes = [array.shape for array in arrays]
    if shapes != [per_hole, per_hole, per_hole, per_joint, per_joint]:
        raise InvalidInput("shape of the history's states", shapes[0], f"{per_hole}, as of this mechanism")
    return FrictionState(*arrays)


def _state_of(mechanism: AnyChain | tuple[AnyChain, ...], history: object) -> FrictionState:
    """The state of a history; of an equilibrium without friction, by the coefficients of the mechanism of the step."""
    if isinstance(history, FrictionState):
        return history
    if not isinstance(history, Solution):
        raise InvalidInput(
            "history", type(history).__name__, _ALLOWED, "solve_tensions and solve_lengths return equilibria."
        )
    if history.friction is not None or history.mechanism is mechanism:
        return history.friction_state
    first = mechanism[0] if isinstance(mechanism, tuple) else mechanism
    if (history.joint_angles.shape[-1], history.tensions.shape[-1]) != (first.n_joints, first.n_tendons):
        allowed = f"that of a mechanism with {first.n_joints} joints and {first.n_tendons} tendons"
        raise InvalidInput("history", history, allowed)
    rows = history.joint_angles.shape[0] if history.joint_angles.ndim > 1 else 1
    taking = mechanism if isinstance(mechanism, tuple) and len(mechanism) == rows else first
    designs = designs_of(taking, rows)
    return virgin_state(taking, designs, history.tensions, history.joint_angles)


def _floats(values: object) -> np.ndarray:
    """The values as contiguous floats; not copied where they are, since a step only reads its history."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and values.flags.c_contiguous:
        return values
    return as_floats("history", values, "numbers")


def broadcast_limits(limits: tuple[ArrayLike, ArrayLike], n_tendons: int) -> tuple[ArrayLike, ArrayLike]:
    """`tension_limits_of`, ready to broadcast: two floats, the usual case, stay unchanged, in a fifth of the time."""
    if type(limits) is tuple and len(limits) == 2 and type(limits[0]) is float and type(limits[1]) is float:
        return limits
    low, high = tension_limits_of(limits, n_tendons)
    return low, high


def tension_limits_of(limits: tuple[ArrayLike, ArrayLike], n_tendons: int) -> Array:
    """Minimum and maximum tension of every tendon, (2, m) [N]; InvalidInput for anything else."""
    return _lowest_and_highest("tension_limits", limits, n_tendons)


def joint_limits_of(limits: tuple[ArrayLike, ArrayLike] | None, mechanism: AnyChain) -> Array | None:
    """Lowest and highest angle of every joint, (2, n - 1) [rad], or None; InvalidInput for anything else."""
    if limits is None:
        return None
    low, high = each = _lowest_and_highest("joint_limits", limits, mechanism.n_joints)
    if not (low <= high).all():
        raise InvalidInput("joint_limits", limits, "lowest <= highest [rad]")
    return each


def _lowest_and_highest(what: str, limits: tuple[ArrayLike, ArrayLike], count: int) -> Array:
    """Two numbers, or `count` each, as (2, count)."""
    lowest_and_highest = np.empty((2, count))
    allowed = f"(lowest, highest), numbers or {count} values each"
    try:
        for side, values in zip(lowest_and_highest, limits, strict=True):
            array = as_floats(what, values, allowed)
            if array.shape not in ((), (count,)):
                raise InvalidInput(what, limits, allowed)
            side[:] = array
    except (TypeError, ValueError, OverflowError):
        raise InvalidInput(what, limits, allowed) from None
    return lowest_and_highest
