"""Tasks in the lumen: an instrument is fed into bent lumens that it does not see, and presses on their walls.

Force: the peak of the wall force counts. Reach: the depth of the tip counts, before the wall force exceeds a limit.

The gradient by design and policy is exact where walls do not rub; with friction at the walls, what a contact remembers
of the steps before is a constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from agents.codesign.policy import FlatPolicy
from agents.codesign.rollout import Rollout
from agents.codesign.task import COMMAND_UNIT, TENSION_UNIT, Array, Rest, Scores, Slope, slope_of
from agents.runs.checks import check_fields, choice, integer, integers, number
from rj_gym.surroundings.config import FAMILIES, LumenConfig
from rj_gym.surroundings.drawing import LINE_BEFORE
from rj_gym.surroundings.scenes import Scenes, along
from rj_gym.surroundings.task import LumenTask
from rollingjoint import RollingChain
from rollingjoint.design import DesignBox
from rollingjoint.errors import ConfigError

_FEED_UNIT = 50.0  # mm, of observations
_SHARPNESS = 8  # of the peak of a force: a norm of this order over all links and steps
_STEEPNESS = 2  # of the smooth step of a reach: the order in which it falls with a peak beyond the limit
_FAILED = 10.0  # N: the peak of an episode in which a step found no pose


@dataclass(frozen=True)
class LumenPush:
    """Settings of the tasks in the lumen.

    Args:
        goal: "force", the least peak of the wall force, or "reach", the deepest place of the tip before the wall force
            exceeds `force_limit`.
        family: of the lumens, a name of rj_gym.surroundings.config.FAMILIES.
        mu: coefficient of friction of the walls.
        steps: of an episode.
        feed_mm: way of the base in a step [mm].
        start_tension: of every tendon at the start [N].
        low: least tension [N]; at a limit the command follows the tendon.
        high: largest tension [N].
        action_mm: change of a command by an action of 1 [mm].
        hidden: widths of the hidden layers of the policy.
        force_limit: wall force up to which the reach is measured [N].
    """

    goal: Annotated[str, choice("force", "reach")] = "force"
    family: Annotated[str, choice(*FAMILIES)] = "gentle"
    mu: Annotated[float, number(0.0, 1.0)] = 0.15
    steps: Annotated[int, integer(1, 200)] = 20
    feed_mm: Annotated[float, number(0.1, 10.0)] = 3.0
    start_tension: Annotated[float, number(0.1, 100.0)] = 3.0
    low: Annotated[float, number(0.01, 100.0)] = 1.0
    high: Annotated[float, number(0.1, 1000.0)] = 15.0
    action_mm: Annotated[float, number(0.01, 5.0)] = 0.5
    hidden: Annotated[Sequence[int], integers(1, 256)] = (8,)
    force_limit: Annotated[float, number(0.01, 100.0)] = 1.0

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.low <= self.start_tension <= self.high:
            allowed = f"a tension from low to high, {self.low:g} to {self.high:g} N"
            raise ConfigError("task.start_tension", self.start_tension, allowed)

    @property
    def name(self) -> str:
        """Name of the measure."""
        return "peak wall force" if self.goal == "force" else "reach below the limit"

    @property
    def unit(self) -> str:
        """Its unit."""
        return "N" if self.goal == "force" else "mm"

    @property
    def maximise(self) -> bool:
        """Whether more is better."""
        return self.goal == "reach"

    def on(self, space: DesignBox) -> LumenPushes:
        """The task with the designs of a space."""
        return LumenPushes(self, space)


class LumenPushes:
    """Episodes of the tasks in the lumen, with the designs of a space.

    Args:
        settings: of the task. space: of planar designs whose outline is that of the space's own mechanism.
    Raises:
        ConfigError: a space of other mechanisms, or one whose links differ in height.
    """

    def __init__(self, settings: LumenPush, space: DesignBox) -> None:
        own = space.mechanism(space.reference()) if space.dimension == 2 else None
        if not isinstance(own, RollingChain):
            raise ConfigError("space", space, "designs in the plane", "Walls are for planar chains.")
        height = getattr(space, "height", None)
        if height is not None and height[0] != height[1]:
            raise ConfigError("space.height", height, "the same for all designs: lumens surround one outline")
        self.settings, self.space = settings, space
        self._task, self._rest = self._with(own), Rest(space, settings.start_tension)
        joints, m = own.n_joints, own.n_tendons
        self.policy = FlatPolicy(joints + 2 * m + 2, m, tuple(settings.hidden))

    def episodes(self, seeds: Sequence[int]) -> Scenes:
        """The lumens of these seeds, the same for all designs."""
        scenes, _ = self._task.sample([np.random.default_rng(seed) for seed in seeds])
        return scenes

    def chosen(self, episodes: Scenes, rows: NDArray[np.int64]) -> Scenes:
        """Some of the episodes."""
        walls = type(episodes.walls)(*(table[rows] for table in episodes.walls))
        return Scenes(walls, *(part[rows] for part in episodes[1:]))

    def scores(self, x: Array, parameters: Array, episodes: Scenes) -> Scores:
        """How a pair does in episodes; values are the peaks of the wall force [N], or how deep the tip gets [mm]."""
        with torch.no_grad():
            run, _ = self._run(torch.as_tensor(x), torch.as_tensor(parameters), episodes)
        limit = self.settings.force_limit
        found = [step.solution for step in run.steps[1:]]
        tips = np.array([solution.tip for solution in found])
        tips[..., 1] += self.settings.feed_mm * np.arange(1.0, len(found) + 1)[:, None]
        arcs = np.array([along(episodes.line, tip)[0] for tip in tips]) - LINE_BEFORE
        peaks = np.maximum.accumulate([self._task.forces(solution) for solution in found], axis=0)
        reach = np.maximum(np.where(peaks <= limit, arcs, 0.0).max(axis=0), 0.0)
        extra = {
            "peak wall force [N]": peaks[-1],
            "reach below the limit [mm]": reach,
            "depth [mm]": arcs[-1],
            "mean tension [N]": np.mean([solution.tensions.mean(axis=1) for solution in found], axis=0),
        }
        values = extra.pop(f"{self.settings.name} [{self.settings.unit}]")
        return Scores(np.where(run.ok, values, 0.0 if self.settings.maximise else _FAILED), run.ok, extra)

    def slope(self, x: Array, parameters: Array, episodes: Scenes, by_design: bool = True) -> Slope:
        """The mean loss and its gradient by the design, (d,), and the policy, (size,).

        It is a smooth peak of the wall force [N], or the share of the way on which the smooth peak so far is above the
        limit, by a smooth step.
        """
        design = torch.tensor(np.asarray(x, float), requires_grad=by_design)
        theta = torch.tensor(np.asarray(parameters, float), requires_grad=True)
        run, losses = self._run(design, theta, episodes)
        return slope_of(losses.mean(), run, self.space.chain(design), self._limits, design, theta)

    @property
    def _limits(self) -> tuple[float, float]:
        return self.settings.low, self.settings.high

    def _with(self, mechanism: RollingChain) -> LumenTask:
        """The environment's task with a mechanism."""
        settings = self.settings
        config = LumenConfig(
            mechanism=mechanism,
            families=[settings.family],
            mu=settings.mu,
            start_tension=settings.start_tension,
            tension_range=self._limits,
            action_scale_mm=settings.action_mm,
        )
        return LumenTask(config)

    def _run(self, design: Tensor, theta: Tensor, episodes: Scenes) -> tuple[Rollout, Tensor]:
        """The episodes of a pair, and the loss of each, (E,), with a graph where gradients are on."""
        settings, count = self.settings, len(episodes.target)
        mechanism, rest = self._rest.of(design)
        task, start = self._with(mechanism), rest.expand(count, -1)

        def solve(commands: Array, step: int, before: Any) -> Any:
            if before is None:
                return task.at_rest(episodes.walls, commands)
            return task.solve(episodes.walls, commands, np.full(count, settings.feed_mm * step), before)

        run, peaks = Rollout(mechanism, solve), list[Tensor]()
        state = run.step(start)
        for step in range(1, settings.steps + 1):
            feed = torch.full((count, 1), settings.feed_mm * step / _FEED_UNIT, dtype=torch.float64)
            push = -state.forces[..., 1].sum(-1, keepdim=True)
            seen = state.angles, state.tensions / TENSION_UNIT, (state.commands - start) / COMMAND_UNIT, push, feed
            actions = self.policy(theta, torch.cat(seen, -1))
            state = run.step(state.commands - settings.action_mm * actions)
            peaks.append(state.forces.square().sum(-1))
        powers = (torch.stack(peaks) + 1e-12).pow(0.5 * _SHARPNESS).sum(-1)
        smooth = powers.cumsum(0).pow(1.0 / _SHARPNESS)
        if settings.goal == "force":
            return run, smooth[-1]
        excess = (smooth / settings.force_limit).pow(_STEEPNESS)
        return run, (excess / (1.0 + excess)).mean(0)
