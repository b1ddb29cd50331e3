"""What co-design asks of a task: episodes that are the same for all designs, their scores, and gradients."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.codesign.policy import FlatPolicy
from agents.codesign.rollout import Rollout
from rollingjoint.design import DesignBox
from rollingjoint.differentiable import solve_tensions

Array = NDArray[np.float64]

TENSION_UNIT, COMMAND_UNIT = 10.0, 5.0
"""Of observations [N, mm]."""


class Scores(NamedTuple):
    """Scores of a pair in E episodes: its values of the task's measure, (E,); whether every step found a pose, (E,).

    extra: means of other numbers, (E,) each, by name with unit.
    """

    values: Array
    ok: NDArray[np.bool_]
    extra: Mapping[str, Array]


class Slope(NamedTuple):
    """Loss of a pair, a mean over episodes, and its gradient by the design, (d,), and by the policy, (size,)."""

    loss: float
    design: Array
    policy: Array


class PairTask(Protocol):
    """A task with the designs of a space."""

    space: DesignBox

    @property
    def settings(self) -> Any:
        """Its settings, with the name, the unit and `maximise` of its measure."""

    @property
    def policy(self) -> FlatPolicy:
        """The form of its policies."""

    def episodes(self, seeds: Sequence[int]) -> Any:
        """The episodes of these seeds, the same for all designs; they are drawn by these seeds alone."""

    def chosen(self, episodes: Any, rows: NDArray[np.int64]) -> Any:
        """Some of the episodes."""

    def scores(self, x: Array, parameters: Array, episodes: Any) -> Scores:
        """How the design (d,) with the policy (size,) does in every episode."""

    def slope(self, x: Array, parameters: Array, episodes: Any, by_design: bool = True) -> Slope:
        """The loss of a pair, and its gradient; zeros by the design where that is not asked for."""


class Rest:
    """The designs of a space at rest: every tendon has the same tension, there are no loads. Keeps the last one."""

    def __init__(self, space: DesignBox, tension: float) -> None:
        self._space, self._tension = space, tension
        self._last: tuple[bytes, Any, Tensor] = b"", None, torch.zeros(0)

    def of(self, design: Tensor) -> tuple[Any, Tensor]:
        """The mechanism of a design (d,), and its commands at rest, (m,) [mm], a function of the design."""
        key = design.detach().numpy().tobytes()
        if design.requires_grad or key != self._last[0]:
            chain: Any = self._space.chain(design)
            rest = solve_tensions(chain, torch.full((chain.n_tendons,), self._tension, dtype=torch.float64))
            self._last = key, chain.mechanism(), rest.lengths - self._tension / chain.stiffnesses
        _, mechanism, commands = self._last
        return mechanism, commands if design.requires_grad else commands.detach()


def slope_of(
    loss: Tensor, run: Rollout, chain: Any, limits: tuple[float, float], design: Tensor, parameters: Tensor
) -> Slope:
    """The gradient of a mean loss by the leaves: by the policy through its steps, by the design through all of them.

    Args:
        chain: of the design, as new tensors. limits: of the tensions [N].
    """
    loss.backward()
    if design.requires_grad:
        run.leave_to(chain, limits)
    gradients = [torch.zeros_like(leaf) if leaf.grad is None else leaf.grad for leaf in (design, parameters)]
    return Slope(float(loss.detach()), *(torch.nan_to_num(gradient).numpy() for gradient in gradients))
