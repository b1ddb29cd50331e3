"""Sweeps of tensions, solved once for all objectives of a design."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import numpy as np
import torch
from numpy.typing import NDArray

from rollingjoint.differentiable import DifferentiableChain, solve_tensions
from rollingjoint.differentiable.equilibria import Equilibria

_solved: ContextVar[dict[object, Equilibria] | None] = ContextVar("solved", default=None)


@contextmanager
def shared_sweeps() -> Iterator[None]:
    """A context, of one thread, in which a sweep of a chain is solved once for all objectives.

    They then share one graph: differentiate their sum, or use `retain_graph`. The context keeps no results.
    """
    token = _solved.set({})
    try:
        yield
    finally:
        _solved.reset(token)


def swept(chain: DifferentiableChain, tensions: NDArray[np.float64]) -> Equilibria:
    """Equilibria of every design without loads under every row of tensions (cases, m) [N], (B, cases)."""
    solved = _solved.get()
    if solved is None:
        solved = {}
    key = chain, tensions.tobytes(), torch.is_grad_enabled()
    if key not in solved:
        solved[key] = solve_tensions(chain[:, None], torch.as_tensor(tensions, device=chain.device))
    return solved[key]
