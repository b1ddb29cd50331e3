"""Friction of the running episodes of a tracking task: its arrays, and what takes the solver's place with it.

Also that for mechanisms that cannot be solved together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.config import FrictionConfig
from rj_gym.core.draws import of_lanes
from rollingjoint.chain.stacks import Variations
from rollingjoint.compiled import (
    MU,
    N_COEFFICIENTS,
    PRESLIDING,
    FrictionArrays,
    FrictionLaw,
    History,
    new_friction_arrays,
)


def distinct(mechanisms: Sequence[Any]) -> Sequence[Any]:
    """The mechanisms; of variations, which share what is asked of them, the nominal one."""
    return (mechanisms.nominal,) if isinstance(mechanisms, Variations) else mechanisms


def no_history(capacity: int, n_joints: int, n_tendons: int) -> FrictionArrays:
    """Friction of so many lanes that has still to be filled."""
    law = FrictionLaw(np.ones((capacity, n_tendons, N_COEFFICIENTS)), np.ones((capacity, 2)))
    states, slips, grips = (np.zeros((capacity, n_joints, n_tendons)) for _ in range(3))
    angles, rolling = (np.zeros((capacity, n_joints)) for _ in range(2))
    return new_friction_arrays(law, History(states, slips, grips, angles, rolling))


def enter_friction(friction: FrictionArrays, draws: Any, config: FrictionConfig | None) -> None:
    """Put coefficients of friction into the first lanes: the drawn ones in place of the mechanisms'."""
    law, count, mechanisms = friction.law, len(draws), distinct(draws.mechanisms)
    designs = draws.designs if len(mechanisms) > 1 else np.zeros(count, np.int64)
    law.tendons[:count] = of_lanes([each.friction_coefficients for each in mechanisms], designs)
    law.rolling[:count] = of_lanes([each.rolling_coefficients for each in mechanisms], designs)
    if config is not None:
        law.tendons[:count, :, PRESLIDING] = config.presliding
    if draws.friction_mu is not None:
        law.tendons[:count, :, MU] = draws.friction_mu


class FrictionSteps:
    """In place of PinnedRange where steps have friction: a step that stands becomes the history of the next one."""

    def __init__(self, *works: Callable[[int, int], object]) -> None:
        self._step, self._keep, self.begin = works

    def __call__(self, first: int, last: int) -> None:
        """The steps of lanes first to last - 1, of which nothing is remembered."""
        self._step(first, last)

    def solve_the_rest(self, first: int, last: int) -> None:
        """The steps of lanes first to last - 1."""
        self._step(first, last)
        self._keep(first, last)


class LaneByLane:
    """In place of PinnedRange where mechanisms cannot be stacked: one solver per mechanism."""

    entry = pins = 0

    def __init__(self, solvers: Sequence[Callable[[int, int], object]], designs: NDArray[np.int64]) -> None:
        self._solvers, self._designs = solvers, designs

    def __call__(self, first: int, last: int) -> None:
        """Solve lanes first to last - 1."""
        for lane in range(first, last):
            self._solvers[self._designs[lane]](lane, lane + 1)

    solve_the_rest = __call__
