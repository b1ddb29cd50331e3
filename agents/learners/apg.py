"""Analytic policy gradients: a policy with memory, improved by the exact derivative of its errors.

Where the simulator is differentiable no gradient has to be estimated from random actions: the tip errors' gradient over
whole episodes goes back through equilibria, play, sensors and the policy's memory, so the policy also learns which
movements tell it the hidden state. Source: Freeman et al., Brax, 2021, section 4.3; Xu et al., Accelerated Policy
Learning with Parallel Differentiable Simulation, 2022.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from stable_baselines3.common.type_aliases import GymEnv, Schedule
from stable_baselines3.common.utils import FloatSchedule

from agents.learners.demonstrations import Acting, ActingInside, Demonstrations
from agents.learners.distill import Distill
from agents.learners.episodes import DifferentiableEpisodes, Played
from agents.learners.learner import EpisodePlayer, base_of, native_env
from agents.learners.policy import EpisodePolicy
from agents.learners.walled_episodes import PlayedAmongWalls, WalledEpisodes, check_lumen
from rj_gym.surroundings.task import SurroundingsTask
from rollingjoint.errors import ConfigError

_SHARPNESS = 8  # of the peak of a force: a norm of this order over all links and steps


class APG(Distill):
    """Analytic policy gradients on a native vector environment of a tracking task or of Lumen, after lessons if wanted.

    One update per episode of all lanes: the loss is the mean tip error over the last `settled_steps` steps plus
    `whole_weight` times that over all steps. In lumens half the mean square of the settled errors takes the place of
    their mean, since an end 3 mm off is a failure, and the peak force of the walls is added. Gradients find the nearest
    way down; lessons of a teacher that probes for the hidden state start them where probing is already known.

    Args:
        policy: as of EpisodeLearner. env: a native vector environment of rj_gym, in the wrappers of SB3.
        learning_rate: of the optimiser, or a schedule.
        settled_steps: steps at the end of an episode that count most.
        whole_weight: weight of the whole episode.
        force_weight: of the mean over episodes of the peak of the walls' force on a link, in lumens [mm²/N].
        estimate_weight: weight of the error with which a linear readout of the memory estimates the hidden state [mm]:
            it teaches the memory its contents. The readout is not part of the policy.
        lane_gradient: see DifferentiableEpisodes.
        short: the share of training, at its beginning, in which episodes end after `short_steps`. Where the way is
            shorter than that, as many steps of training show more episodes; the rest teaches the policy to stay.
        max_grad_norm: largest norm of the whole gradient; a longer one is scaled down.
        lessons: the share of training, at its beginning, in which the policy imitates the teacher instead: see Distill,
            also for `teacher`, `taught` (a share of the lessons), `delta`, `gradient_steps`, `batch_size`,
            `kept_rollouts`.
        lessons_rate: learning rate of the lessons, or a schedule over them; None: learning_rate.
        stats_window_size: episodes behind the errors in the log. optimizer: "adam" or "muon".
        common: arguments of every EpisodeLearner.
    """

    def __init__(
        self,
        policy: str | type[EpisodePolicy],
        env: GymEnv | str | None,
        learning_rate: float | Schedule = 1e-3,
        settled_steps: int = 10,
        whole_weight: float = 0.1,
        force_weight: float = 1.0,
        estimate_weight: float = 0.0,
        lane_gradient: float | None = 2.0,
        short: float = 0.0,
        short_steps: int = 20,
        max_grad_norm: float = 0.5,
        lessons: float = 0.0,
        lessons_rate: float | Schedule | None = None,
        teacher: Acting | ActingInside | None = None,
        taught: float = 0.05,
        delta: float = 0.3,
        gradient_steps: int = 24,
        batch_size: int = 128,
        kept_rollouts: int = 60,
        stats_window_size: int = 100,
        optimizer: str = "adam",
        **common: Any,
    ) -> None:
        self.settled_steps, self.whole_weight, self.estimate_weight = settled_steps, whole_weight, estimate_weight
        self.lane_gradient, self.lessons_rate, self.force_weight = lane_gradient, lessons_rate, force_weight
        self.short, self.short_steps = short, short_steps
        super().__init__(
            policy, env, learning_rate, teacher, taught, delta, gradient_steps, batch_size, kept_rollouts, lessons,
            max_grad_norm, stats_window_size, optimizer, **common,
        )  # fmt: skip

    def _setup_model(self) -> None:
        task = None if self.env is None else native_env(self.env, among_walls=True).task
        if isinstance(task, SurroundingsTask):
            check_lumen(task)
            for name in ("estimate_weight", "short"):
                if getattr(self, name) > 0.0:
                    raise ConfigError(f"parameters.{name}", getattr(self, name), "0 among walls")
        super()._setup_model()

    def _setup_lr_schedule(self) -> None:
        super()._setup_lr_schedule()
        if self.lessons_rate is not None and self.lessons > 0.0:
            self.lr_schedule = _RateOfLessons(FloatSchedule(self.lessons_rate), self.lessons, self.lr_schedule)

    def _episodes(self) -> EpisodePlayer:
        env = native_env(self.env, among_walls=True)
        own: EpisodePlayer
        if isinstance(env.task, SurroundingsTask):
            own = WalledEpisodes(env, self._normalise, self.lane_gradient)
        else:
            own = DifferentiableEpisodes(
                env, self._normalise, self.lane_gradient, base_of(self.env), self._shortened_to
            )
        return own if self.lessons == 0.0 else _LessonsFirst(super()._episodes(), own, self.has_lessons)

    def _shortened_to(self) -> int | None:
        """How many steps the next episodes have; None: all."""
        return self.short_steps if self.num_timesteps < self.short * self._total_timesteps else None

    def loss(self, played: Played | PlayedAmongWalls) -> torch.Tensor:
        """The loss of an update [mm], in lumens [mm²]."""
        counts = played.running.float()
        errors = played.errors * counts
        settled = errors[-self.settled_steps :]
        whole = self.whole_weight * errors.sum() / counts.sum()
        steps = counts[-self.settled_steps :].sum().clamp(min=1.0)
        if isinstance(played, PlayedAmongWalls):
            forces = (played.forces * counts[..., None]).transpose(1, 2).flatten(0, 1)
            peaks = torch.linalg.vector_norm(forces, _SHARPNESS, 0)
            return 0.5 * settled.square().sum() / steps + whole + self.force_weight * peaks.mean()
        loss = settled.sum() / steps + whole
        if self.estimate_weight > 0.0:
            loss = loss + self.estimate_weight * self._misjudged(played)
        return loss

    def _misjudged(self, played: Played) -> torch.Tensor:
        """The error of the memory's estimates of the hidden numbers, in units of their spread; 0 is exact."""
        hidden, counts = played.hidden, played.running.float()[..., None]
        mean, spread = hidden.mean((0, 1)), hidden.std((0, 1)) + 1e-6
        misses = torch.nn.functional.huber_loss(
            self.policy.readout(played.memories), (hidden - mean) / spread, reduction="none"
        )
        return (misses * counts).sum() / (counts.sum() * hidden.shape[-1])

    def _update(self, played: Any) -> None:
        if isinstance(played, Demonstrations):
            super()._update(played)
            return
        if self.demonstrations:  # lessons are over
            self.demonstrations = []
            self.policy.optimizer.state.clear()
        self._update_learning_rate(self.policy.optimizer)
        loss = self.loss(played)
        norm = self._descend(loss)
        self.logger.record("train/loss", loss.item())
        self.logger.record("train/gradient_norm", norm)
        self.logger.record("train/n_updates", self.n_updates)


@dataclass(frozen=True)
class _RateOfLessons:
    """The schedule `taught` over the first `share` of the training, then `own`; below 0 it is rounding."""

    taught: Schedule
    share: float
    own: Schedule

    def __call__(self, progress_remaining: float) -> float:
        remainder = 1.0 - (1.0 - progress_remaining) / self.share
        return self.taught(max(remainder, 0.0)) if remainder > -1e-9 else self.own(progress_remaining)


@dataclass(frozen=True)
class _LessonsFirst:
    """Episodes with a teacher while there are lessons, then those with gradients."""

    taught: EpisodePlayer
    own: EpisodePlayer
    has_lessons: Callable[[], bool]

    def play(self, actor: Any, watch: Any) -> Any:
        return (self.taught if self.has_lessons() else self.own).play(actor, watch)
