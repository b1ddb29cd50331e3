"""A policy without memory as a torch module: agents.policies.network.Network, or GainNetwork, with gradients."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from agents.learners.gain import Combined, GainHead
from agents.learners.tape import LinearTape, StepTape, Tape, tanh_, tanh_slope
from rj_gym.core.task import ObservedError


class FeedForwardActor(nn.Module):
    """Hidden layers and a head, from normalised observations to actions, which are clipped to [-1, 1].

    Its methods are those of a RecurrentActor, with a memory of no entries.

    Args:
        entries: of the observation. actions: m. layers: widths of the hidden layers. activation: between all layers.
        error: where the observation has the tip error, for a GainHead; None: the head is linear.
    """

    def __init__(
        self,
        entries: int,
        actions: int,
        layers: Sequence[int],
        activation: type[nn.Module] = nn.Tanh,
        error: ObservedError | None = None,
    ) -> None:
        super().__init__()
        self.activation = activation
        linear = (nn.Linear(before, after) for before, after in pairwise([entries, *layers]))
        self.hidden = nn.Sequential(*(part for layer in linear for part in (layer, activation())))
        self.head: nn.Module = nn.Linear(layers[-1], actions) if error is None else GainHead(layers[-1], actions, error)

    def forward(self, x: torch.Tensor, memory: torch.Tensor | None = None) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions before clipping (..., m) for normalised observations x (..., entries), and the memory (..., 0)."""
        hidden = self.hidden(x)
        seen = self.head.seen(hidden, x) if isinstance(self.head, GainHead) else hidden
        return self.head(seen), x[..., :0]

    def step(self, x: torch.Tensor, memory: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        """The same of one step: actions before clipping (B, m) and memory (B, 0), for x (B, entries)."""
        return self(x)

    def tape(self, steps: int, lanes: int) -> Tape:
        """A record of T = `steps` steps of B = `lanes` episodes, which begin now, for their gradients."""
        return FeedForwardTape(self, steps, lanes) if self.activation is nn.Tanh else StepTape(self)

    def predict(
        self, observation: NDArray[Any], state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[NDArray[np.float32], None]:
        """One step, as models of Stable-Baselines3 take it: the actions for normalised observations, and no memory."""
        with torch.no_grad():
            actions, _ = self(torch.as_tensor(np.asarray(observation, np.float32)))
        return actions.clamp(-1, 1).numpy(), None


class FeedForwardTape:
    """The Tape of a FeedForwardActor whose activation is tanh, by formulas written by hand."""

    @torch.no_grad()
    def __init__(self, actor: FeedForwardActor, steps: int, lanes: int) -> None:
        self.parameters = tuple(actor.parameters())
        self._gain = actor.head if isinstance(actor.head, GainHead) else None
        parts = *actor.hidden, self._gain.layer if self._gain else actor.head
        self._layers = [LinearTape(part, steps, lanes) for part in parts if isinstance(part, nn.Linear)]
        self._combined, self._now = list[Combined](), 0

    @property
    def memories(self) -> torch.Tensor:
        """The memory after every step, of no entries, (T, B, 0)."""
        return self._layers[0].inputs[..., :0]

    @torch.no_grad()
    def step(self, x: torch.Tensor) -> torch.Tensor:
        """Actions before clipping (B, m) of the next step, for normalised observations x (B, entries)."""
        t = self._now
        self._layers[0].inputs[t] = x
        for layer, following in pairwise(self._layers):
            tanh_(layer.outputs(t, out=following.inputs[t]))
        self._now += 1
        outputs = self._layers[-1].outputs(t)
        if self._gain is None:
            return outputs
        actions, combined = self._gain.combined(outputs, x[:, list(self._gain.error.places)])
        self._combined.append(combined)
        return actions

    def begin_back(self) -> None:
        """Before the gradients by the last step."""

    @torch.no_grad()
    def back(self, by_actions: torch.Tensor, by_memory: torch.Tensor | None = None) -> torch.Tensor:
        """Gradient by x (B, entries) of the last step of which there is none yet: see Tape."""
        self._now -= 1
        t, by_outputs, by_entries = self._now, by_actions, None
        if self._gain is not None:
            by_outputs, by_entries = self._gain.back(by_actions, self._combined[t])
        for layer in reversed(self._layers):
            by_outputs = layer.back(t, by_outputs)
            if layer is not self._layers[0]:
                by_outputs *= tanh_slope(layer.inputs[t])
        if self._gain is not None and by_entries is not None:
            by_outputs[:, list(self._gain.error.places)] += by_entries
        return by_outputs

    @torch.no_grad()
    def gradients(self) -> tuple[torch.Tensor, ...]:
        """Gradients by the actor's parameters, in the order of `parameters()`, after all steps back."""
        return tuple(gradient for layer in self._layers for gradient in layer.gradients())
