"""Records of an actor's steps, and their gradients: the interface, one of any module, and parts of those by hand."""

from __future__ import annotations

from typing import Any, Protocol

import torch
from torch import nn


class Tape(Protocol):
    """T steps of B episodes, recorded by `step`, and then, last step first, their gradients.

    Attributes:
        parameters: of the actor; they must not change until the gradients are taken.
    """

    parameters: tuple[torch.Tensor, ...]

    @property
    def memories(self) -> torch.Tensor:
        """The memory after every step, (T, B, width)."""

    def step(self, x: torch.Tensor) -> torch.Tensor:
        """Actions before clipping (B, m) of the next step, for normalised observations x (B, entries)."""

    def begin_back(self) -> None:
        """Before the gradients by the last step."""

    def back(self, by_actions: torch.Tensor, by_memory: torch.Tensor | None = None) -> torch.Tensor:
        """Gradient by x (B, entries) of the last step of which there is none yet.

        Args:
            by_actions: gradient by its actions (B, m).
            by_memory: gradient by the memory after it (B, width), but for its effect on later steps; None: 0.
        """

    def gradients(self) -> tuple[torch.Tensor, ...]:
        """Gradients by the parameters, after all steps back."""


class Taped(Protocol):
    """An actor, or a policy with one."""

    def tape(self, steps: int, lanes: int) -> Tape:
        """A record of T = `steps` steps of B = `lanes` episodes, which begin now."""


class StepTape:
    """A Tape of any module: each step is a graph of torch.

    Args:
        actor: a module whose `step(x, memory)` gives actions before clipping and memory; a memory of None begins.
    """

    def __init__(self, actor: Any) -> None:
        self.parameters = tuple(actor.parameters())
        self._actor, self._steps, self._memory = actor, list[tuple[torch.Tensor, ...]](), None

    @property
    def memories(self) -> torch.Tensor:
        """The memory after every step, (T, B, width)."""
        return torch.stack([memory.detach() for *_, memory in self._steps])

    def step(self, x: torch.Tensor) -> torch.Tensor:
        """Actions before clipping (B, m) of the next step, for normalised observations x (B, entries)."""
        before = self._memory
        with torch.enable_grad():
            x = x.detach().requires_grad_()
            actions, memory = self._actor.step(x, before)
        self._steps.append((x, x.new_zeros(0) if before is None else before, actions, memory))
        self._memory = memory.detach().requires_grad_()
        return actions.detach()

    def begin_back(self) -> None:
        """Before the gradients by the last step."""
        self._now = len(self._steps)
        self._carried = torch.zeros_like(self._steps[-1][-1])
        self._gradients = [torch.zeros_like(parameter) for parameter in self.parameters]

    def back(self, by_actions: torch.Tensor, by_memory: torch.Tensor | None = None) -> torch.Tensor:
        """Gradient by x (B, entries) of the last step of which there is none yet: see Tape."""
        self._now -= 1
        x, before, actions, memory = self._steps[self._now]
        total = self._carried if by_memory is None else self._carried + by_memory
        outputs, by_outputs = [actions], [by_actions]
        if memory.requires_grad and memory.numel():
            outputs, by_outputs = [actions, memory], [by_actions, total]
        inputs = (x, before.requires_grad_(), *self.parameters)
        by_x, by_before, *by_parameters = torch.autograd.grad(
            outputs, inputs, by_outputs, retain_graph=True, allow_unused=True, materialize_grads=True
        )
        self._carried = by_before
        for gradient, change in zip(self._gradients, by_parameters, strict=True):
            gradient += change
        return by_x

    def gradients(self) -> tuple[torch.Tensor, ...]:
        """Gradients by the parameters, after all steps back."""
        return tuple(self._gradients)


class LinearTape:
    """T = `steps` steps of B = `lanes` episodes through a linear layer of weight (k, n), and their gradients.

    Attributes:
        inputs: (T, B, n). by_outputs: gradients by the outputs, (T, B, k).
    """

    def __init__(self, layer: nn.Linear, steps: int, lanes: int) -> None:
        self.weight, self.bias = layer.weight, layer.bias
        self.inputs = torch.empty(steps, lanes, layer.in_features)
        self.by_outputs = torch.empty(steps, lanes, layer.out_features)

    def outputs(self, t: int, out: torch.Tensor | None = None) -> torch.Tensor:
        """Of step t, (B, k), into `out` where it is given."""
        return torch.addmm(self.bias, self.inputs[t], self.weight.T, out=out)

    def back(self, t: int, by_outputs: torch.Tensor) -> torch.Tensor:
        """Gradient by the inputs of step t, (B, n), for that by its outputs (B, k), which is kept."""
        self.by_outputs[t] = by_outputs
        return by_outputs @ self.weight

    def gradients(self) -> tuple[torch.Tensor, torch.Tensor]:
        """By the weight (k, n) and the bias (k,), over all steps: one matrix product."""
        return layer_gradients(self.by_outputs, self.inputs)


def layer_gradients(by_output: torch.Tensor, inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Gradients by the weights (k, n) and the bias (k,) of a layer, over all steps (T, B, k) and (T, B, n)."""
    rows = by_output.flatten(0, 1)
    return rows.T @ inputs.flatten(0, 1), rows.sum(0)


def tanh_(x: torch.Tensor) -> torch.Tensor:
    """tanh of x, in its place: 2 / (1 + exp(-2 x)) - 1, a third of the time of torch's."""
    return x.mul_(2.0).sigmoid_().mul_(2.0).sub_(1.0)


def tanh_slope(tanh: torch.Tensor) -> torch.Tensor:
    """The derivative where tanh is this."""
    return 1.0 - tanh * tanh
