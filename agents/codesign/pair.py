"""A pair of a design and a policy, trained by one gradient: Adam on both vectors at once, or on the policy alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import torch

from agents.codesign.task import Array, PairTask
from agents.runs.checks import check_fields, integer, number
from rollingjoint.design import Problem

FAILED_SHARE = 0.2  # of the validation episodes without a pose: more, and a pair is not chosen


@dataclass(frozen=True)
class PairSettings:
    """How pairs are trained.

    Args:
        updates: steps of Adam, each with a batch of new rows of the training episodes; 0: a pair stays as it is.
        batch: episodes of an update.
        design_rate: step of Adam in the design's box, which is 2 wide; it falls to a tenth along a cosine.
        policy_rate: of the policy's parameters, likewise.
        check_every: updates between looks at the validation episodes; the best pair seen there is kept.
        patience: looks without an improvement by 1 % after which training ends; 0: it never ends early.
    """

    updates: Annotated[int, integer(0, 100_000)] = 70
    batch: Annotated[int, integer(1, 10_000)] = 16
    design_rate: Annotated[float, number(1e-6, 1.0)] = 0.12
    policy_rate: Annotated[float, number(1e-6, 1.0)] = 0.05
    check_every: Annotated[int, integer(1, 10_000)] = 7
    patience: Annotated[int, integer(0, 10_000)] = 0

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True)
class Splits:
    """Training, validation and test episodes of a task."""

    train: Any
    train_count: int
    validation: Any
    test: Any

    def batch(self, task: PairTask, rng: np.random.Generator, size: int) -> Any:
        """Some of the training episodes, all of them where there are fewer."""
        rows = rng.choice(self.train_count, min(size, self.train_count), replace=False)
        return task.chosen(self.train, np.sort(rows))


@dataclass(frozen=True)
class Pair:
    """A trained pair.

    Attributes:
        x: design, (d,). parameters: of the policy, (size,). validation: mean of the measure there; NaN: no feasible
            pair was seen. seconds: processor time.
        history: update, validation and design of every look, in their order.
    """

    x: Array
    parameters: Array
    validation: float
    seconds: float
    history: tuple[tuple[int, float, Array], ...]


def descent(groups: Sequence[dict[str, Any]], updates: int) -> Callable[[], None]:
    """A step of Adam for groups of parameters with gradients; rates fall to a tenth along a cosine over the updates."""
    adam = torch.optim.Adam(groups, betas=(0.9, 0.95))
    last = max(updates, 1)
    fall = torch.optim.lr_scheduler.LambdaLR(adam, lambda k: 0.1 + 0.45 * (1.0 + np.cos(np.pi * k / last)))

    def step() -> None:
        adam.step()
        fall.step()

    return step


def trained(
    task: PairTask,
    problem: Problem,
    start: tuple[Array, Array],
    settings: PairSettings,
    splits: Splits,
    seed: int,
    by_design: bool = True,
    shown: Callable[[], object] = lambda: None,
) -> Pair:
    """The best pair that Adam finds from a start (x, parameters); by_design: whether the design is trained, too.

    The design pays for what it lacks of the problem's limits and margins as in a search (`Problem`).

    Args:
        shown: called after every update.
    """
    begin, rng = time.process_time(), np.random.default_rng(seed)
    x, theta = (torch.tensor(np.asarray(part, float)) for part in start)
    groups = [{"params": [theta], "lr": settings.policy_rate}]
    if by_design:
        groups.append({"params": [x], "lr": settings.design_rate})
    last = settings.updates
    step = descent(groups, last)
    best, history = Pair(x.numpy().copy(), theta.numpy().copy(), np.nan, 0.0, ()), []
    sign, since, mark = (1.0 if task.settings.maximise else -1.0), 0, np.nan
    for update in range(last + 1):
        if update % settings.check_every == 0 or update == last:
            design, parameters = x.numpy().copy(), theta.numpy().copy()
            scores = task.scores(design, parameters, splits.validation)
            value = float(scores.values.mean())
            history.append((update, value, design))
            allowed = not by_design or bool(problem.evaluate(design[None]).feasible[0])
            fit = allowed and scores.ok.mean() >= 1.0 - FAILED_SHARE
            if fit and not sign * value <= sign * best.validation:
                best = Pair(design, parameters, value, 0.0, ())
            since += 1
            if not sign * value <= sign * mark + 0.01 * abs(mark):
                since, mark = 0, value
        if update == last or since == settings.patience > 0:
            break
        slope = task.slope(x.numpy(), theta.numpy(), splits.batch(task, rng, settings.batch), by_design)
        theta.grad = torch.tensor(slope.policy)
        if by_design:
            _, penalty = problem.with_gradient(x.numpy()[None])
            x.grad = torch.tensor(slope.design + penalty[0])
        step()
        with torch.no_grad():
            x.clamp_(-1.0, 1.0)
        shown()
    return Pair(best.x, best.parameters, best.validation, time.process_time() - begin, tuple(history))
