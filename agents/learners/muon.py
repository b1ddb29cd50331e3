"""Muon: momentum with every matrix made orthogonal, so that all directions of a layer learn at one pace.

In gradients of whole recurrent episodes a few directions are much larger than the rest, which Adam, entry by entry,
learns slowly; docs/training.md has its effect. Source: Jordan et al., Muon: An Optimizer for Hidden Layers in
Neural Networks, 2024; the scale, by which Adam's learning rates apply: Liu et al., Muon is Scalable for LLM
Training, 2025.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import torch

SMALLEST = 8  # rows and columns from which on a matrix is made orthogonal
STEPS, COEFFICIENTS = 5, (3.4445, -4.7750, 2.0315)  # of the iteration, chosen by Jordan et al.
ADAMS = 0.2  # root mean square of Adam's updates, over the learning rate


class Muon(torch.optim.Optimizer):
    """Muon for matrices, Adam for biases and for matrices with fewer than SMALLEST rows or columns.

    Args:
        parameters: to be changed, or groups of them. lr: of both.
        blocks: how many matrices a matrix consists of, one above the other: 3 for the gates of a recurrent unit.
        momentum: of matrices, after Nesterov. betas, eps: of Adam.
    """

    def __init__(
        self,
        parameters: Iterable[torch.Tensor] | Iterable[dict[str, Any]],
        lr: float,
        blocks: int = 1,
        momentum: float = 0.95,
        betas: tuple[float, float] = (0.9, 0.999),
        eps: float = 1e-8,
    ) -> None:
        defaults = {"lr": lr, "blocks": blocks, "momentum": momentum, "betas": betas, "eps": eps}
        super().__init__(parameters, defaults)

    @torch.no_grad()
    def step(self, closure: Callable[[], Any] | None = None) -> Any:
        """Change the parameters by their gradients, which a closure takes anew; the closure's value, or None."""
        with torch.enable_grad():
            loss = None if closure is None else closure()
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter.grad is not None:
                    update = self._orthogonal if _is_matrix(parameter) else self._adam
                    update(parameter, parameter.grad, group)
        return loss

    def _orthogonal(self, parameter: torch.Tensor, gradient: torch.Tensor, group: dict[str, Any]) -> None:
        state, rate = self.state[parameter], 1.0 - group["momentum"]
        if not state:
            state["mean"] = torch.zeros_like(parameter)
        mean = state["mean"].lerp_(gradient, rate)
        blocks = gradient.lerp(mean, group["momentum"]).reshape(group["blocks"], -1, parameter.shape[1])
        scale = ADAMS * max(blocks.shape[1:]) ** 0.5
        parameter.add_(orthogonal(blocks).reshape(parameter.shape), alpha=-group["lr"] * scale)

    def _adam(self, parameter: torch.Tensor, gradient: torch.Tensor, group: dict[str, Any]) -> None:
        state, (first, second) = self.state[parameter], group["betas"]
        if not state:
            state |= {"mean": torch.zeros_like(parameter), "square": torch.zeros_like(parameter), "step": 0}
        state["step"] += 1
        mean = state["mean"].lerp_(gradient, 1.0 - first) / (1.0 - first ** state["step"])
        square = state["square"].lerp_(gradient * gradient, 1.0 - second) / (1.0 - second ** state["step"])
        parameter.addcdiv_(mean, square.sqrt() + group["eps"], value=-group["lr"])


def orthogonal(matrices: torch.Tensor) -> torch.Tensor:
    """About U Vᵀ of matrices U S Vᵀ, (k, rows, columns): their singular values come between 0.7 and 1.2.

    Newton's method of Schulz with a polynomial of fifth degree. A matrix of zeros stays one.
    """
    a, b, c = COEFFICIENTS
    x = matrices / (matrices.norm(dim=(1, 2), keepdim=True) + 1e-30)
    tall = x.shape[1] > x.shape[2]
    x = x.mT if tall else x
    for _ in range(STEPS):
        square = x @ x.mT
        x = torch.baddbmm(x, torch.baddbmm(square, square, square, beta=b, alpha=c), x, beta=a)
    return x.mT if tall else x


def _is_matrix(parameter: torch.Tensor) -> bool:
    return parameter.ndim == 2 and min(parameter.shape) >= SMALLEST
