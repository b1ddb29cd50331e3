"""Sweeps of tensions that several objectives of one design need, solved once."""

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

    They then share one graph: differentiate their sum, or use `retain_graph`. Nothing is kept after the context.
    """
    token = _solved.set({})
    try:
        yield
    finally:
        _solved.reset(token)


def swept(chain: DifferentiableChain, tensions: NDArray[np.float64]) -> Equilibria:
    """Equilibria of every design without loads under every row of tensions (cases, m) [N], (B, cases)."""
    known = _solved.get()
    if known is None:
        known = {}
    key = chain, tensions.tobytes(), torch.is_grad_enabled()
    if key not in known:
        known[key] = solve_tensions(chain[:, None], torch.as_tensor(tensions, device=chain.device))
    return known[key]
