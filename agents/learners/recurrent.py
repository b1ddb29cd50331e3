"""A policy with memory as a torch module: agents.policies.recurrent.RecurrentNetwork with gradients."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from agents.learners.tape import LinearTape, layer_gradients, tanh_, tanh_slope

WIDTH = 128


class RecurrentActor(nn.Module):
    """Encoder, gated recurrent unit and head, from normalised observations to actions.

    z = tanh(W_e x + b_e), h' = GRU(z, h), y = W_2 tanh(W_1 [h'; z] + b_1) + b_2; the action is y clipped to [-1, 1].

    Args:
        entries: of the observation. actions: m. width: of the encoder, the memory h and the hidden layer of the head.
    """

    def __init__(self, entries: int, actions: int, width: int = WIDTH) -> None:
        super().__init__()
        self.encoder = nn.Sequential(nn.Linear(entries, width), nn.Tanh())
        self.cell = nn.GRU(width, width, batch_first=True)
        self.head = nn.Sequential(nn.Linear(2 * width, width), nn.Tanh(), nn.Linear(width, actions))

    def forward(self, x: torch.Tensor, memory: torch.Tensor | None = None) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions before clipping (B, T, m) for T steps x (B, T, entries), and the memory (1, B, width) after them.

        Args:
            memory: before the first step, (1, B, width); None where episodes begin.
        """
        z = self.encoder(x)
        output, memory = self.cell(z, memory)
        return self.head(torch.cat([output, z], -1)), memory

    def step(self, x: torch.Tensor, memory: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        """One step of `forward`: actions before clipping (B, m) and memory (B, width), for x (B, entries)."""
        actions, after = self(x[:, None], None if memory is None else memory[None])
        return actions[:, 0], after[0]

    def tape(self, steps: int, lanes: int) -> RecurrentTape:
        """A record of T = `steps` steps of B = `lanes` episodes, which begin now, for their gradients."""
        return RecurrentTape(self, steps, lanes)

    def predict(
        self,
        observation: NDArray[Any],
        state: NDArray[Any] | None = None,
        episode_start: NDArray[Any] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """One step, as models of Stable-Baselines3 take it: the actions and the memory after it.

        Args:
            observation: normalised, (entries,) or (B, entries).
            state: the memory before, (B, width); None where all episodes begin.
            episode_start: (B,), where an episode begins, and forgets its memory.
            deterministic: has no effect; the policy is deterministic.
        """
        rows = np.asarray(observation, np.float32).reshape(-1, np.shape(observation)[-1])
        if state is not None and episode_start is not None:
            state = np.where(np.asarray(episode_start, bool)[:, None], np.float32(0), state)
        memory = None if state is None else torch.as_tensor(state)[None]
        with torch.no_grad():
            actions, memory = self(torch.as_tensor(rows)[:, None], memory)
        clipped = actions[:, 0].clamp(-1, 1).numpy()
        return clipped.reshape(*np.shape(observation)[:-1], -1), memory[0].numpy()


class RecurrentTape:
    """The Tape of a RecurrentActor, by formulas written by hand.

    Layers with a common input are one matrix: z goes into the three gates and the head, the memory into the gates of
    the next step and the head. Gradients by weights are one matrix product over all steps and episodes.
    """

    @torch.no_grad()
    def __init__(self, actor: RecurrentActor, steps: int, lanes: int) -> None:
        cell, width = actor.cell, actor.cell.hidden_size
        (encoder, _), (hidden, _, last) = actor.encoder, actor.head
        self.parameters = tuple(actor.parameters())
        self._width, self._now = width, 0
        self._encoder, self._last = LinearTape(encoder, steps, lanes), LinearTape(last, steps, lanes)
        self._by_z = torch.cat([cell.weight_ih_l0, hidden.weight[:, width:]])
        self._by_memory = torch.cat([cell.weight_hh_l0, hidden.weight[:, :width]])
        self._z_bias = torch.cat([cell.bias_ih_l0, hidden.bias])
        self._memory_bias = torch.cat([cell.bias_hh_l0, torch.zeros(width)])
        self._z, self._new, self._fed = torch.empty(3, steps, lanes, width)
        self._gates = torch.empty(steps, lanes, 2 * width)  # r and u
        self._memories = torch.empty(steps + 1, lanes, width)  # before the first step, and after each
        self._memories[0] = 0.0
        self._recalled = self._memory_bias.expand(lanes, -1)

    @property
    def memories(self) -> torch.Tensor:
        """The memory after every step, (T, B, width)."""
        return self._memories[1:]

    @torch.no_grad()
    def step(self, x: torch.Tensor) -> torch.Tensor:
        """Actions before clipping (B, m) of the next step, for x (B, entries)."""
        t, w, before = self._now, self._width, self._memories[self._now]
        self._encoder.inputs[t] = x
        z = tanh_(self._encoder.outputs(t, out=self._z[t]))
        seen, recalled = torch.addmm(self._z_bias, z, self._by_z.T), self._recalled
        gates = torch.add(seen[:, : 2 * w], recalled[:, : 2 * w], out=self._gates[t]).sigmoid_()
        r, u, fed = gates[:, :w], gates[:, w:], self._fed[t]
        fed[:] = recalled[:, 2 * w : 3 * w]
        new = tanh_(torch.addcmul(seen[:, 2 * w : 3 * w], r, fed, out=self._new[t]))
        memory = torch.lerp(new, before, u, out=self._memories[t + 1])
        self._recalled = torch.addmm(self._memory_bias, memory, self._by_memory.T)
        tanh_(torch.add(seen[:, 3 * w :], self._recalled[:, 3 * w :], out=self._last.inputs[t]))
        self._now += 1
        return self._last.outputs(t)

    @torch.no_grad()
    def begin_back(self) -> None:
        """Before the gradients by the last step."""
        steps, lanes, w = self._z.shape
        self._now = steps
        self._by_seen = torch.empty(steps, lanes, 4 * w)
        self._by_recalled = torch.empty(steps + 1, lanes, 4 * w)  # from each memory, that before the first step too
        self._by_recalled[0, :, 3 * w :] = self._by_recalled[steps, :, : 3 * w] = 0.0
        self._carried = torch.zeros(lanes, w)

    @torch.no_grad()
    def back(self, by_actions: torch.Tensor, by_memory: torch.Tensor | None = None) -> torch.Tensor:
        """Gradient by x (B, entries) of the last step of which there is none yet: see Tape."""
        self._now -= 1
        t, w = self._now, self._width
        (r, u), new, fed = self._gates[t].split(w, 1), self._new[t], self._fed[t]
        seen, recalled, earlier = self._by_seen[t], self._by_recalled[t + 1], self._by_recalled[t]
        by_hidden = self._last.back(t, by_actions)
        by_hidden = torch.mul(by_hidden, tanh_slope(self._last.inputs[t]), out=seen[:, 3 * w :])
        recalled[:, 3 * w :] = by_hidden
        total = torch.addmm(self._carried, recalled, self._by_memory)
        if by_memory is not None:
            total += by_memory
        by_new = torch.mul(total - total * u, tanh_slope(new), out=seen[:, 2 * w : 3 * w])
        by_u = torch.mul(total * (self._memories[t] - new), u - u * u, out=seen[:, w : 2 * w])
        by_r = torch.mul(by_new * fed, r - r * r, out=seen[:, :w])
        earlier[:, :w], earlier[:, w : 2 * w] = by_r, by_u
        torch.mul(by_new, r, out=earlier[:, 2 * w : 3 * w])
        self._carried = total * u
        return self._encoder.back(t, (seen @ self._by_z) * tanh_slope(self._z[t]))

    @torch.no_grad()
    def gradients(self) -> tuple[torch.Tensor, ...]:
        """Gradients by the actor's parameters, in the order of `parameters()`, after all steps back."""
        w = self._width
        by_z, z_bias = layer_gradients(self._by_seen, self._z)
        by_memory, memory_bias = layer_gradients(self._by_recalled, self._memories)
        hidden = torch.cat([by_memory[3 * w :], by_z[3 * w :]], 1)
        gates = by_z[: 3 * w], by_memory[: 3 * w], z_bias[: 3 * w], memory_bias[: 3 * w]
        return *self._encoder.gradients(), *gates, hidden, z_bias[3 * w :], *self._last.gradients()
