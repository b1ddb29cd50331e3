"""Tasks at the tip: to hold places that are the same for all designs, blind under a new load, or under a growing force.

Precision: the policy sees the tip for the first half of an episode, without load; then the tip is hidden, a force acts
at it that is not told, and the error at the end counts. Force: the tip is seen throughout while the force grows from
step to step, and what counts is the force up to which the error keeps to a tolerance under a limit of the tension.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.codesign.policy import FlatPolicy
from agents.codesign.rollout import Rollout
from agents.codesign.task import COMMAND_UNIT, TENSION_UNIT, Array, Rest, Scores, Slope, slope_of
from agents.runs.checks import check_fields, choice, integer, integers, number
from rollingjoint import RollingChain, WorldForce, solve_lengths_batch, solve_tensions_batch
from rollingjoint.design import DesignBox
from rollingjoint.errors import ConfigError
from rollingjoint.load import LOAD_COLUMNS, load_table

_ERROR_UNIT, _PLACE_UNIT = 5.0, 50.0  # mm, of observations
_FAILED_MM = 50.0  # error of an episode in which a step found no pose
_MOST_DRAWS = 100
_FX = LOAD_COLUMNS.index("fx")


@dataclass(frozen=True)
class TipHold:
    """Settings of the tasks at the tip.

    Args:
        goal: "precision", the error at the end, or "force", the largest force within the tolerance.
        steps: of an episode.
        force: range of the magnitude of the force, drawn with a direction in every episode [N]; with the goal "force"
            the force grows to the upper end.
        tensions: range of the tensions of the space's own mechanism at the targets, drawn tendon by tendon [N].
        start_tension: of every tendon at the start [N].
        low: least tension [N]; at a limit the command follows the tendon.
        high: largest tension [N].
        action_mm: change of a command by an action of 1 [mm].
        tolerance_mm: largest error of a force that is carried [mm].
        hidden: widths of the hidden layers of the policy.
    """

    goal: Annotated[str, choice("precision", "force")] = "precision"
    steps: Annotated[int, integer(2, 200)] = 16
    force: Any = (0.05, 0.15)
    tensions: Any = (3.0, 6.0)
    start_tension: Annotated[float, number(0.1, 100.0)] = 4.0
    low: Annotated[float, number(0.0, 100.0)] = 0.5
    high: Annotated[float, number(0.1, 1000.0)] = 15.0
    action_mm: Annotated[float, number(0.01, 10.0)] = 2.0
    tolerance_mm: Annotated[float, number(1e-3, 100.0)] = 1.0
    hidden: Annotated[Sequence[int], integers(1, 256)] = (8,)

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("force", "tensions"):
            values = getattr(self, name)
            if not isinstance(values, list | tuple) or len(values) != 2:
                raise ConfigError(f"task.{name}", values, "two numbers, low and high [N]")
            low, high = (number(0.0, 1000.0)(f"task.{name}", value) for value in values)
            if not low <= high or high == 0.0:
                raise ConfigError(f"task.{name}", values, "low <= high, and high above 0 [N]")
            object.__setattr__(self, name, (low, high))
        if not self.low <= self.start_tension <= self.high:
            allowed = f"a tension from low to high, {self.low:g} to {self.high:g} N"
            raise ConfigError("task.start_tension", self.start_tension, allowed)

    @property
    def name(self) -> str:
        """Name of the measure."""
        return "error at the end" if self.goal == "precision" else "force carried"

    @property
    def unit(self) -> str:
        """Its unit."""
        return "mm" if self.goal == "precision" else "N"

    @property
    def maximise(self) -> bool:
        """Whether more is better."""
        return self.goal == "force"

    def on(self, space: DesignBox) -> TipHolds:
        """The task with the designs of a space."""
        return TipHolds(self, space)


class Holds(NamedTuple):
    """E episodes: targets (E, 2) [mm], forces at their largest (E, 2) [N]."""

    targets: Array
    forces: Array


class TipHolds:
    """Episodes of the tasks at the tip, with planar designs of a space.

    Raises:
        ConfigError: a space of mechanisms that are not in the plane.
    """

    def __init__(self, settings: TipHold, space: DesignBox) -> None:
        own = space.mechanism(space.reference()) if space.dimension == 2 else None
        if not isinstance(own, RollingChain):
            raise ConfigError("space", space, "designs in the plane")
        self.settings, self.space, self._own = settings, space, own
        self._rest = Rest(space, settings.start_tension)
        m = own.n_tendons
        self.policy = FlatPolicy(5 + 2 * m, m, tuple(settings.hidden))
        self._row = load_table([WorldForce(-1, (1.0, 0.0))], own.n_links)

    def episodes(self, seeds: Sequence[int]) -> Holds:
        """Targets of the space's own mechanism under random tensions, and forces, of these seeds.

        Raises:
            ConfigError: tensions under which it has no equilibrium.
        """
        (low, high), m = self.settings.tensions, self._own.n_tendons
        rngs = [np.random.default_rng(seed) for seed in seeds]
        angles = np.array([rng.uniform(-np.pi, np.pi) for rng in rngs])
        sizes = np.array([rng.uniform(*self.settings.force) for rng in rngs])
        if self.settings.goal == "force":
            sizes[:] = self.settings.force[1]
        targets, missing = np.zeros((len(rngs), 2)), np.arange(len(rngs))
        for _ in range(_MOST_DRAWS):
            tensions = np.array([rngs[lane].uniform(low, high, m) for lane in missing])
            found = solve_tensions_batch(self._own, tensions)
            good = np.asarray(found.ok)
            targets[missing[good]] = found.tip[good]
            missing = missing[~good]
            if not len(missing):
                return Holds(targets, sizes[:, None] * np.stack([np.cos(angles), np.sin(angles)], -1))
        raise ConfigError("task.tensions", (low, high), "tensions with a stable equilibrium", "Narrow the range.")

    def chosen(self, episodes: Holds, rows: NDArray[np.int64]) -> Holds:
        """Some of the episodes."""
        return Holds(episodes.targets[rows], episodes.forces[rows])

    def scores(self, x: Array, parameters: Array, episodes: Holds) -> Scores:
        """How a pair does in episodes; values are errors [mm] or forces carried [N]."""
        with torch.no_grad():
            run, errors = self._run(torch.as_tensor(x), torch.as_tensor(parameters), episodes)
        errors_mm, settings = errors.numpy(), self.settings
        tension = np.mean([step.solution.tensions.mean(axis=1) for step in run.steps[1:]], axis=0)
        extra = {"error at the end [mm]": errors_mm[-1], "mean tension [N]": tension}
        if settings.goal == "precision":
            return Scores(np.where(run.ok, extra.pop("error at the end [mm]"), _FAILED_MM), run.ok, extra)
        half = settings.steps // 2
        carried = np.cumprod(errors_mm[half:] <= settings.tolerance_mm, axis=0).sum(axis=0)
        levels = self._shares()[half:]
        forces = np.where(carried > 0, levels[np.maximum(carried - 1, 0)], 0.0) * settings.force[1]
        return Scores(np.where(run.ok, forces, 0.0), run.ok, extra)

    def slope(self, x: Array, parameters: Array, episodes: Holds, by_design: bool = True) -> Slope:
        """The mean loss and its gradient by the design, (d,), and the policy, (size,).

        It is the error of the second half of an episode, of forces that grow in logarithms of the tolerance, by which
        errors that are far above it count little.
        """
        design = torch.tensor(np.asarray(x, float), requires_grad=by_design)
        theta = torch.tensor(np.asarray(parameters, float), requires_grad=True)
        run, errors = self._run(design, theta, episodes)
        late = errors[self.settings.steps // 2 :]
        if self.settings.goal == "force":
            late = torch.log1p((late / self.settings.tolerance_mm).square())
        losses = late.mean(0) + 0.05 * errors.mean(0)
        return slope_of(losses.mean(), run, self.space.chain(design), self._limits, design, theta)

    @property
    def _limits(self) -> tuple[float, float]:
        return self.settings.low, self.settings.high

    def _shares(self) -> Array:
        """The share of the force that acts in every step, (steps,)."""
        late = np.arange(1.0, self.settings.steps + 1) - self.settings.steps // 2
        if self.settings.goal == "precision":
            return np.asarray(late > 0, float)
        return np.clip(late / late[-1], 0.0, 1.0)

    def _run(self, design: Tensor, theta: Tensor, episodes: Holds) -> tuple[Rollout, Tensor]:
        """The episodes of a pair, and the error after every step, (steps, E) [mm]."""
        settings, count = self.settings, len(episodes.targets)
        mechanism, rest = self._rest.of(design)
        start = rest.expand(count, -1)
        shares = np.concatenate([[0.0], self._shares()])

        def solve(commands: Array, step: int, before: Any) -> Any:
            table = np.repeat(self._row[None], count, axis=0)
            table[:, 0, _FX : _FX + 2] = shares[step] * episodes.forces
            return solve_lengths_batch(mechanism, commands, table, before, self._limits)

        run, errors = Rollout(mechanism, solve), list[Tensor]()
        targets = torch.tensor(episodes.targets)
        state = first = run.step(start)
        for step in range(1, settings.steps + 1):
            is_seen = float(settings.goal == "force" or step <= settings.steps // 2)
            error = is_seen * (targets - state.tip) / _ERROR_UNIT
            flag = torch.full((count, 1), is_seen, dtype=torch.float64)
            own = (targets - first.tip) / _PLACE_UNIT
            parts = error, own, state.tensions / TENSION_UNIT, (state.commands - start) / COMMAND_UNIT, flag
            actions = self.policy(theta, torch.cat(parts, -1))
            state = run.step(state.commands - settings.action_mm * actions)
            errors.append(((targets - state.tip).square().sum(-1) + 1e-12).sqrt())
        return run, torch.stack(errors)
