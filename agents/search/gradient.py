"""Descent along the gradient from many starts side by side: L-BFGS in the box.

Descents are independent; one batch holds the next point of each. A descent that has converged restarts
elsewhere. Source: Nocedal and Wright, Numerical Optimization (2006), algorithm 7.4 (two loops); projection onto the box
and Armijo's condition along it: Bertsekas, SIAM J. Control Optim. 20 (1982).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from agents.runs.checks import check_fields, integer, number
from agents.search.optimiser import Array, Derivatives, Evaluated, Setup

ARMIJO = 1e-4  # share of the decrease promised by the slope that a step has to keep
SMALLEST_STEP = 1e-6  # largest entry of a step below which a start is at rest
FIRST_STEP = 0.1  # largest entry of a step along the bare gradient


@dataclass
class Gradient:
    """L-BFGS from several starts.

    Args:
        starts: descents side by side, from random designs.
        memory: pairs of steps and gradient changes that stand for the second derivatives.
        longest_step: largest change of any coordinate in a step.
    """

    setup: Setup
    starts: Annotated[int, integer(1, 1000)] = 8
    memory: Annotated[int, integer(1, 1000)] = 10
    longest_step: Annotated[float, number(1e-3, 2.0)] = 0.5

    wants: ClassVar[Derivatives] = "gradient"

    def __post_init__(self) -> None:
        check_fields(self)
        self.generator = self.setup.generator
        self.descents = [self._descent() for _ in range(self.starts)]

    def ask(self, most: int) -> Array:
        """The next point of every descent, (B, d)."""
        return np.array([descent.point for descent in self.descents[:most]])

    def tell(self, evaluated: Evaluated) -> None:
        """Advance every descent; those that have converged restart elsewhere."""
        assert evaluated.gradient is not None, "this optimiser wants gradients"
        gradients = np.where(np.isfinite(evaluated.gradient), evaluated.gradient, 0.0)
        for place, (cost, gradient) in enumerate(zip(evaluated.cost, gradients, strict=True)):
            self.descents[place].tell(float(cost), gradient)
            if self.descents[place].at_rest:
                self.descents[place] = self._descent()

    def _descent(self) -> Descent:
        start = self.generator.uniform(-1.0, 1.0, self.setup.dimensions)
        return Descent(start, self.memory, self.longest_step)


class Descent:
    """One descent: `point` is to be evaluated next; `at_rest` once no step leads further down."""

    def __init__(self, start: Array, memory: int, longest_step: float) -> None:
        self.point, self.longest_step = start, longest_step
        self.pairs: deque[tuple[Array, Array]] = deque(maxlen=memory)
        self.x, self.cost, self.gradient = start, np.inf, np.zeros_like(start)
        self.direction, self.length, self.at_rest = np.zeros_like(start), 0.0, False

    def tell(self, cost: float, gradient: Array) -> None:
        """Go to the point if it is low enough, else try a shorter step."""
        step = self.point - self.x
        if cost <= self.cost + ARMIJO * (self.gradient @ step):
            change = gradient - self.gradient
            if np.isfinite(self.cost) and step @ change > 1e-10 * np.linalg.norm(step) * np.linalg.norm(change):
                self.pairs.append((step, change))
            self.x, self.cost, self.gradient = self.point, cost, gradient
            self._aim()
        else:
            self.length *= self._shorter(cost, step)
        self.point = np.clip(self.x + self.length * self.direction, -1.0, 1.0)
        self.at_rest = bool(np.abs(self.point - self.x).max() < SMALLEST_STEP)

    def _shorter(self, cost: float, step: Array) -> float:
        """Where the parabola through both costs and the slope is lowest, as a share of the step from 0.1 to 0.5."""
        slope = float(np.dot(self.gradient, step))
        return float(np.clip(-0.5 * slope / max(cost - self.cost - slope, 1e-300), 0.1, 0.5))

    def _aim(self) -> None:
        """Set direction and length of the next step; coordinates that a bound holds back stay."""
        bound = np.where(self.gradient > 0.0, -1.0, 1.0)
        slope = np.where(self.x == bound, 0.0, self.gradient)
        self.direction = np.where(self.x == bound, 0.0, -self._without_curvature(slope))
        if self.direction @ slope > -1e-10 * np.linalg.norm(self.direction) * np.linalg.norm(slope):
            self.pairs.clear()
            self.direction = -slope
        largest = max(float(np.abs(self.direction).max()), 1e-300)
        first = 1.0 if self.pairs else FIRST_STEP / largest
        self.length = min(first, self.longest_step / largest)

    def _without_curvature(self, slope: Array) -> Array:
        """The slope times the inverse of the second derivatives that the pairs stand for."""
        product, shares = slope.copy(), list[float]()
        for step, change in reversed(self.pairs):
            shares.append((step @ product).item() / (step @ change).item())
            product -= shares[-1] * change
        if self.pairs:
            step, change = self.pairs[-1]
            product *= (step @ change) / (change @ change)
        for (step, change), share in zip(self.pairs, reversed(shares), strict=True):
            product += (share - (change @ product) / (step @ change)) * step
        return product
