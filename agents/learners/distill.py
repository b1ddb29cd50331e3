"""Distillation: a policy imitates a teacher that sees the true state, or one that carries a model along.

The teacher drives some lanes of the first rollouts, the policy all others, so that it is corrected where its own
actions lead (DAgger). A policy's memory has to infer the state that only the teacher knows. Source: Ross
et al., A Reduction of Imitation Learning and Structured Prediction to No-Regret Online Learning, 2011; Lee et al.,
Learning Quadrupedal Locomotion over Challenging Terrain, 2020.
"""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.type_aliases import GymEnv, Schedule

from agents.learners.demonstrations import Acting, ActingInside, Demonstrations, TaughtEpisodes, normalised
from agents.learners.learner import EpisodeLearner, EpisodePlayer, native_env
from agents.learners.policy import EpisodePolicy
from agents.learners.true_state import TrueStateFeedback


class Distill(EpisodeLearner):
    """Imitation of a teacher on a native vector environment of a tracking task, or of one among walls.

    After each episode of all lanes come `gradient_steps` on whole episodes of the last rollouts. The loss is the Huber
    loss between actions of the policy before clipping and the teacher's, over all steps.

    Args:
        policy: as of EpisodeLearner. env: a native vector environment of rj_gym, in the wrappers of SB3.
        learning_rate: of the optimiser, or a schedule.
        teacher: the controller that it imitates; None: TrueStateFeedback, in tracking tasks.
        taught: the share of lanes that the teacher drives falls from 1 to 0 over this share of training.
        delta: where the Huber loss goes from squares to absolute values.
        gradient_steps: per rollout. batch_size: episodes in each of them.
        kept_rollouts: how many rollouts, the newest ones, it learns from.
        lessons: the share of training in which it learns like this: all of it, but for learners built upon this one.
        max_grad_norm: largest norm of the whole gradient; a longer one is scaled down.
        stats_window_size: episodes behind the errors in the log. optimizer: "adam" or "muon".
        common: arguments of every EpisodeLearner.
    Raises:
        ConfigError: an environment of other tasks; without `teacher`, one among walls, or with motors that have a delay
            or a rate limit.
    """

    def __init__(
        self,
        policy: str | type[EpisodePolicy],
        env: GymEnv | str | None,
        learning_rate: float | Schedule = 1e-3,
        teacher: Acting | ActingInside | None = None,
        taught: float = 0.05,
        delta: float = 0.3,
        gradient_steps: int = 24,
        batch_size: int = 128,
        kept_rollouts: int = 60,
        lessons: float = 1.0,
        max_grad_norm: float = 1.0,
        stats_window_size: int = 100,
        optimizer: str = "adam",
        **common: Any,
    ) -> None:
        self.teacher, self.lessons, self.taught, self.delta = teacher, lessons, taught, delta
        self.gradient_steps, self.batch_size, self.kept_rollouts = gradient_steps, batch_size, kept_rollouts
        self.demonstrations: list[Demonstrations] = []
        super().__init__(policy, env, learning_rate, max_grad_norm, stats_window_size, optimizer, **common)

    def _setup_model(self) -> None:
        if self.env is not None and self.teacher is None and self.lessons > 0.0:
            TrueStateFeedback(native_env(self.env).task)  # refuses other tasks, before training begins
        super()._setup_model()

    def _episodes(self) -> EpisodePlayer:
        return TaughtEpisodes(
            native_env(self.env, among_walls=True), self._normalise, self.teachers_share, self.teacher
        )

    def teachers_share(self) -> float:
        """The share of lanes that the teacher drives in the next episodes."""
        done, taught = self.num_timesteps / self._total_timesteps, self.taught * self.lessons
        return max(0.0, 1.0 - done / taught) if taught > 0.0 else 0.0

    def has_lessons(self) -> bool:
        """Whether the next episodes are lessons."""
        return self.num_timesteps < self.lessons * self._total_timesteps

    def imitation_loss(self, batch: Demonstrations) -> torch.Tensor:
        """Mean Huber loss between the policy's actions before clipping and the teacher's."""
        x = normalised(batch.observations.numpy(), *self._statistics(batch.observations.shape[-1]))
        actions, _ = self.policy.actor(x)
        losses = torch.nn.functional.huber_loss(actions, batch.actions, reduction="none", delta=self.delta).mean(-1)
        return (losses * batch.running).sum() / batch.running.sum()

    def _update(self, played: Any) -> None:
        self._update_learning_rate(self.policy.optimizer)
        self.demonstrations = [*self.demonstrations, played][-self.kept_rollouts :]
        losses = [self._gradient_step() for _ in range(self.gradient_steps)]
        self.logger.record("train/imitation_loss", sum(losses) / len(losses))
        self.logger.record("train/teachers_share", self.teachers_share())
        self.logger.record("train/n_updates", self.n_updates)

    def _gradient_step(self) -> float:
        loss = self.imitation_loss(self._batch())
        self._descend(loss)
        return loss.item()

    def _batch(self) -> Demonstrations:
        """Episodes drawn from the rollouts that are kept, by torch."""
        lanes = len(self.demonstrations[0].actions)
        picked = torch.randint(len(self.demonstrations) * lanes, (self.batch_size,)).tolist()
        places = [(self.demonstrations[k // lanes], k % lanes) for k in picked]
        columns = zip(*((d.observations[j], d.actions[j], d.running[j]) for d, j in places), strict=True)
        return Demonstrations(*(torch.stack(column) for column in columns))

    def _excluded_save_params(self) -> list[str]:
        return [*super()._excluded_save_params(), "demonstrations", "teacher"]
