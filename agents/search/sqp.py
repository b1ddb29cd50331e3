"""Sequential quadratic programming: descents that know the constraints one by one, not as a penalty.

Every step minimises a quadratic model of the worth under linearised constraints, so it follows a limit where L-BFGS on
a penalised cost bounces off it. Steps along a curved limit violate it slightly: constraints have a margin, `reserve`,
which shrinks once designs satisfy them. By scipy's SLSQP. Source: Kraft, "A software package for sequential quadratic
programming" (1988); Nocedal and Wright, Numerical Optimization (2006), chapter 18.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np

from agents.runs.checks import check_fields, integer, number
from agents.search.optimiser import Array, Derivatives, Evaluated, Setup

SMALLEST_GAIN = 1e-6  # of worth over its steepest slope at the start, at which a descent is at rest
RESERVE = 1e-2  # by which constraints are to be satisfied at first
LEFT = 0.1  # of it after a step to a design that keeps all constraints
ROUNDING = 1e-6  # the final reserve: a constraint broken by rounding is broken
MOST_STEPS = 200


@dataclass
class Sqp:
    """SLSQP from several starts, each restarted elsewhere once it has converged.

    Args:
        starts: descents side by side, from random designs.
        share: of the box, around its middle, in which they begin; far out fewer designs have an equilibrium.
    """

    setup: Setup
    starts: Annotated[int, integer(1, 1000)] = 2
    share: Annotated[float, number(1e-3, 1.0)] = 0.5

    wants: ClassVar[Derivatives] = "jacobian"

    def __post_init__(self) -> None:
        check_fields(self)
        self.generator = self.setup.generator
        self.descents = [self._descent() for _ in range(self.starts)]

    def ask(self, most: int) -> Array:
        """The next point of every descent, (B, d)."""
        return np.array([descent.point for descent in self.descents[:most]])

    def tell(self, evaluated: Evaluated) -> None:
        """Advance every descent; those that have converged restart elsewhere."""
        assert evaluated.worth is not None, "this optimiser wants Jacobians"
        assert evaluated.constraints is not None and evaluated.jacobian is not None
        rows = zip(evaluated.worth, evaluated.constraints, evaluated.jacobian, evaluated.ok, strict=True)
        for place, row in enumerate(rows):
            if not self.descents[place].tell(_PointValues(*row)):
                self.descents[place] = self._descent()

    def _descent(self) -> SlsqpDescent:
        return SlsqpDescent(self.generator.uniform(-self.share, self.share, self.setup.dimensions))


class _PointValues(NamedTuple):
    """The evaluation of a point."""

    worth: float
    constraints: Array
    jacobian: Array  # (1 + constraints, d)
    ok: bool

    def tightened(self, reserve: float) -> Array:
        """The constraints minus a reserve; constant ones as they are."""
        return self.constraints - np.where(self.jacobian[1:].any(1), reserve, 0.0)


class SlsqpDescent:
    """One descent; `point` is to be evaluated next. SLSQP runs in a separate thread and waits there for answers."""

    def __init__(self, start: Array) -> None:
        self.point = start
        self.thread = _SlsqpThread()
        threading.Thread(target=self.thread.minimise, args=(start,), daemon=True).start()
        self._wait()

    def __del__(self) -> None:
        self.thread.answers.put(None)  # lets the thread end

    def tell(self, answer: _PointValues) -> bool:
        """Go on to the next point; False where the descent is at rest."""
        self.thread.answers.put(answer)
        return self._wait()

    def _wait(self) -> bool:
        point = self.thread.asked.get()
        if point is not None:
            self.point = np.clip(point, -1.0, 1.0)
        return point is not None


class _GivenUp(Exception):
    """No more answers will come."""


class _SlsqpThread:
    """The thread in which SLSQP runs a descent."""

    def __init__(self) -> None:
        self.asked: SimpleQueue[Array | None] = SimpleQueue()  # None: at rest
        self.answers: SimpleQueue[_PointValues | None] = SimpleQueue()  # None: given up
        self.known: tuple[Array, _PointValues] | None = None
        self.reserve = RESERVE

    def minimise(self, start: Array) -> None:
        """Minimise from a start, asking for every point; at rest at once where it has no equilibrium."""
        try:
            if self.answer(start).ok:
                minimum = self._minimise(start)
                if self.reserve > ROUNDING:
                    self.reserve = ROUNDING
                    self._minimise(minimum)
        except _GivenUp:
            return
        finally:
            self.asked.put(None)

    def _minimise(self, start: Array) -> Array:
        """The point at which SLSQP comes to rest, (d,)."""
        from scipy.optimize import minimize

        steepest = np.abs(self.answer(start).jacobian[0]).max()
        scale = 1.0 / steepest if steepest else 1.0  # SLSQP takes the second derivatives for 1 at first
        constraints = {
            "type": "ineq",
            "fun": lambda x: self.answer(x).tightened(self.reserve),
            "jac": lambda x: self.answer(x).jacobian[1:],
        }
        options: dict[str, Any] = {"ftol": SMALLEST_GAIN, "maxiter": MOST_STEPS}
        solution = minimize(
            lambda x: scale * self.answer(x).worth,
            start,
            jac=lambda x: scale * self.answer(x).jacobian[0],
            bounds=[(-1.0, 1.0)] * len(start),
            constraints=constraints,
            method="SLSQP",
            callback=self.stepped,
            options=options,
        )
        return np.asarray(solution.x)

    def stepped(self, x: Array) -> None:
        """After every step: a smaller reserve, if all constraints are kept."""
        if (self.answer(x).constraints >= 0).all():
            self.reserve = max(LEFT * self.reserve, ROUNDING)

    def answer(self, x: Array) -> _PointValues:
        """The evaluation of a point, asked for once."""
        if self.known is None or not np.array_equal(self.known[0], x):
            self.asked.put(x.copy())
            values = self.answers.get()
            if values is None:
                raise _GivenUp
            self.known = x.copy(), values
        return self.known[1]
