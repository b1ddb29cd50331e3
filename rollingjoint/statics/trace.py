"""Paths: one step after another, each from the one before."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from rollingjoint.chain.chain import Chain
from rollingjoint.chain.solution import stacked
from rollingjoint.chain.status import Status
from rollingjoint.checks import as_choice, as_floats
from rollingjoint.errors import InvalidInput
from rollingjoint.load import Load
from rollingjoint.statics.among import ORIGIN, Around, bases_of, walls_of
from rollingjoint.statics.inputs import History
from rollingjoint.statics.solve import solve_lengths, solve_tensions

S = TypeVar("S")


def trace(
    mechanism: Chain[S],
    inputs: ArrayLike,
    loads: Sequence[Load] | Sequence[Sequence[Load]] = (),
    given: str = "lengths",
    tension_limits: tuple[ArrayLike, ArrayLike] = (0.0, np.inf),
    history: History = None,
    surroundings: Around = None,
    base: ArrayLike = ORIGIN,
) -> S:
    """Equilibria along a path of inputs, each step taken from the one before.

    Args:
        mechanism: a RollingChain or a HingeChain.
        inputs: commanded lengths [mm] or tensions [N] of every step, (K, m).
        loads: external loads of all steps, or a list of loads for every step.
        given: "lengths" or "tensions".
        tension_limits: with lengths, minimum and maximum tendon tension, numbers or (m,) [N].
        history: the equilibrium before the first step. Without it the first step is the pose without friction, before
            any slip.
        surroundings: walls around the mechanism; None: none. base: pose of its base among them, x, y [mm], angle [rad],
            of all steps, (3,), or of every step, (K, 3); in space (3,) or (6,), x, y, z [mm], rotation vector [rad].
    Returns:
        Equilibrium or HingeEquilibrium, a leading axis K on its arrays. A step without a stable equilibrium has the
        status of its failure, and the next one is taken from the history of the last stable one.
    Raises:
        InvalidInput: wrong shapes or types.
    """
    as_choice("given", given, ("lengths", "tensions"))
    m = mechanism.n_tendons
    path = as_floats("inputs", inputs, f"numbers of shape (K, {m})")
    if path.ndim != 2 or path.shape[1] != m or not len(path):
        raise InvalidInput("shape of inputs", path.shape, f"(K, {m}), one row or more")
    every: list[Any] = [loads] * len(path) if not loads or isinstance(loads[0], Load) else list(loads)
    if len(every) != len(path):
        raise InvalidInput("number of lists of loads", len(every), f"{len(path)}, one per step")
    walls = None if surroundings is None else walls_of(surroundings, mechanism)
    steps: list[Any] = []
    for values, step_loads, at in zip(path, every, bases_of(base, len(path), mechanism.dimension), strict=True):
        among = {} if walls is None else {"surroundings": walls, "base": at}
        if given == "tensions":
            step: Any = solve_tensions(mechanism, values, step_loads, history=history, **among)
        else:
            step = solve_lengths(mechanism, values, step_loads, tension_limits=tension_limits, history=history, **among)
        if step.status <= Status.INDETERMINATE:
            history = step
        steps.append(step)
    return stacked(steps)
