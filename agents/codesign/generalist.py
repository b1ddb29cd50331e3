"""A policy that knows the design: the parameters of a policy as an affine function of the design."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from agents.codesign.pair import PairSettings, Splits, descent
from agents.codesign.task import Array, PairTask


@dataclass(frozen=True)
class Generalist:
    """A policy for every design.

    Args:
        reference: a design, (d,). table: parameters of its policy, and their rates by the design, (size, 1 + d).
    """

    reference: Array
    table: Array

    def __call__(self, x: Array) -> Array:
        """Parameters of the policy of a design (d,), (size,)."""
        return np.asarray(self.table @ _features(x, self.reference))


def trained_generalist(
    task: PairTask,
    designs: Array,
    policy: Array,
    settings: PairSettings,
    splits: Splits,
    seed: int,
    shown: Callable[[], object] = lambda: None,
) -> Generalist:
    """A policy for all designs of the task's space, trained with one design in every update.

    Args:
        designs: (updates, d). policy: with which all designs begin, (size,). shown: called after every update.
    """
    reference, rng = np.asarray(task.space.reference()), np.random.default_rng(seed)
    table = torch.zeros(len(policy), 1 + len(reference), dtype=torch.float64)
    table[:, 0] = torch.tensor(policy)
    step = descent([{"params": [table], "lr": settings.policy_rate}], len(designs))
    for x in designs:
        features = _features(x, reference)
        slope = task.slope(x, table.numpy() @ features, splits.batch(task, rng, settings.batch), by_design=False)
        table.grad = torch.tensor(np.outer(slope.policy, features))
        step()
        shown()
    return Generalist(reference, table.numpy())


def _features(x: Array, reference: Array) -> Array:
    """1 and the change of the design, (1 + d,)."""
    return np.concatenate([[1.0], (x - reference) / len(reference) ** 0.5])
