"""Fine-tuning: analytic policy gradients on robots as they may be after identification."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch

from agents.adaptation.identify import Identified
from agents.adaptation.world import LikelyRobots, likely
from agents.learners.episodes import DifferentiableEpisodes, Played
from agents.learners.recurrent import RecurrentActor
from agents.policies.conversion import actor_of, with_actor
from agents.policies.recurrent import RecurrentNetwork
from agents.policies.shipped import ShippedPolicy
from rollingjoint.checks import as_integer, as_number
from rollingjoint.errors import ConfigError


@dataclass(frozen=True)
class FineTuning:
    """How a policy is trained on.

    Args:
        updates: gradient steps, each after one episode of all lanes. lanes: episodes side by side.
        learning_rate: of Adam at the first update; it falls to a tenth of that, linearly.
        settled_steps, whole_weight: the loss is the mean error over the last `settled_steps` steps plus
            `whole_weight` times the mean over all.
        lane_gradient, max_grad_norm: as of APG.
    """

    updates: int = 100
    lanes: int = 64
    learning_rate: float = 3e-4
    settled_steps: int = 10
    whole_weight: float = 0.1
    lane_gradient: float = 2.0
    max_grad_norm: float = 0.5

    def __post_init__(self) -> None:
        as_integer("updates", self.updates, 0, error=ConfigError)
        as_integer("lanes", self.lanes, 1, 1024, error=ConfigError)
        as_integer("settled_steps", self.settled_steps, 1, error=ConfigError)
        as_number("learning_rate", self.learning_rate, 0.0, 1.0, error=ConfigError)
        as_number("whole_weight", self.whole_weight, 0.0, 100.0, error=ConfigError)


def fine_tuned(
    policy: ShippedPolicy,
    settings: Mapping[str, Any],
    identified: Identified,
    plan: FineTuning | None = None,
    say: Callable[[float], object] = lambda loss: None,
) -> ShippedPolicy:
    """The policy after training on robots as this one may be.

    Args:
        policy: with a memory, of agents.learners. settings: of Instrument-v0, such as observe_history.
        identified: beliefs about the robot. plan: of the training. say: called with the loss of every update.
    Raises:
        ConfigError: a policy of another kind.
    """
    plan, network = plan or FineTuning(), trainable(policy)
    torch.manual_seed(identified.number)
    env, actor = LikelyRobots(plan.lanes, likely(identified), settings), actor_of(network)
    env.reset(seed=identified.number)
    episodes = DifferentiableEpisodes(env, lambda _: (network.mean, network.scale), plan.lane_gradient)
    optimizer = torch.optim.Adam(actor.parameters(), plan.learning_rate)
    falling = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.1, max(plan.updates, 1))
    for _ in range(plan.updates):
        played = episodes.play(actor)
        assert played is not None
        say(_update(actor, optimizer, loss_of(played, plan), plan.max_grad_norm))
        falling.step()
    env.close()
    return replace(policy, network=with_actor(network, actor))


def trainable(policy: ShippedPolicy) -> RecurrentNetwork:
    """Its network; raises ConfigError unless it is one of agents.learners."""
    network = policy.network
    if not isinstance(network, RecurrentNetwork) or network.cell.KIND != "gru" or not network.shortcut:
        hint = f"{policy.name!r} was trained with {policy.algorithm}."
        raise ConfigError("--controller", policy.name, "a policy with memory that apg or distill trained", hint)
    return network


def loss_of(played: Played, plan: FineTuning) -> torch.Tensor:
    """Mean tip error over the last steps, and over all of them, weighted [mm]."""
    counts = played.running.float()
    errors, last = played.errors * counts, slice(-plan.settled_steps, None)
    settled = errors[last].sum() / counts[last].sum().clamp(min=1.0)
    return settled + plan.whole_weight * errors.sum() / counts.sum()


def _update(actor: RecurrentActor, optimizer: torch.optim.Optimizer, loss: torch.Tensor, largest_norm: float) -> float:
    optimizer.zero_grad()
    loss.backward()
    norm = torch.nn.utils.clip_grad_norm_(actor.parameters(), largest_norm)
    if bool(torch.isfinite(norm)):
        optimizer.step()
    return loss.item()
