"""One equilibrium of a hinge chain from one start: the Newton iteration of every family on hinges, and its way on.

Long chains whose loads all have a potential take the steps in O(n) of long_chain.py, with generators of their own.
Where the energy decides, an unstable equilibrium is left downhill and counted. Where something has no potential, or
Newton ends nowhere, the overdamped motion from the start follows, then loads and tendons grow from nothing.
"""

from __future__ import annotations

import numpy as np

from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import part
from rollingjoint.kernels.planar import solve as planar
from rollingjoint.kernels.planar.arrays import UNSTABLE, TendonLaw
from rollingjoint.kernels.planar.solve import begin
from rollingjoint.kernels.shared import newton
from rollingjoint.kernels.shared.family import rebound
from rollingjoint.kernels.shared.long_chain import DENSE_JOINTS, Sweep
from rollingjoint.kernels.shared.newton import mark_free, move
from rollingjoint.kernels.spatial.arrays import ANCHOR, END_COUPLE, FORCE, LINK, MOMENT, N_COLUMNS, SPRING
from rollingjoint.kernels.spatial.chain import evaluate, fill_generators, stiffness
from rollingjoint.kernels.spatial.springs import has_springs

_MAX_ESCAPES = 8
_MAX_STAGES = 200
_SHORTEST_STAGE = 1e-4  # of the whole load

_line_search = rebound(newton._line_search, evaluate=evaluate)
_iterate = rebound(
    newton._minimise,
    evaluate=evaluate,
    stiffness=stiffness,
    fill_generators=fill_generators,
    _line_search=_line_search,
    _MAX_ESCAPES=0,  # left below, where it is counted
)
_minimise = rebound(newton.minimise, _minimise=_iterate)
_relax = rebound(planar._relax, evaluate=evaluate, stiffness=stiffness)


@part
def _has_potential(chain, loads):
    if chain.model == END_COUPLE:
        return False
    for row in range(loads.shape[0]):
        for column in range(MOMENT, SPRING):
            if loads[row, LINK] > 0.0 and loads[row, column] != 0.0:
                return False
    return True


@part
def new_sweep(n_joints, n_tendons, springs):
    """An empty Sweep; springs need three columns more."""
    shape = (n_joints, 3 + n_tendons + (3 if springs else 0))
    return Sweep(np.zeros(n_joints), np.zeros(shape), np.zeros(shape), np.zeros(shape), np.zeros(n_joints))


@part
def _escape(chain, law, loads, state, free, step, before):
    """Leave a saddle along the most negative curvature, so far that the energy falls; returns whether it did."""
    n = state.angle.size
    energy, _, _ = evaluate(chain, law, loads, state)
    mark_free(chain, state, 0.0, state.angle, free)
    H = np.empty((n, n))
    stiffness(chain, state, H)
    newton._escape_direction(H, free, step)
    for i in range(n):
        before[i] = state.angle[i]
    t = 1.0
    for _ in range(30):
        move(chain, before, step, t, state.angle)
        lower, _, _ = evaluate(chain, law, loads, state)
        if lower < energy:
            return True
        t *= 0.5
    move(chain, before, step, 0.0, state.angle)
    return False


@part
def _descend(chain, law, loads, conservative, state, H, sweep):
    """Newton from the state's angles, leaving unstable equilibria; (status, iterations, residual, escapes)."""
    n = state.angle.size
    anchor = np.zeros(n)
    free, step = np.ones(n, np.bool_), np.empty(n)
    count, escapes = 0, 0
    while True:
        status, iterations, worst = _minimise(chain, law, loads, conservative, 0.0, anchor, state, H, sweep)
        count += iterations
        if status != UNSTABLE or not conservative or escapes == _MAX_ESCAPES:
            break
        if not _escape(chain, law, loads, state, free, step, anchor):
            break
        escapes += 1
    return status, count, worst, escapes


@part
def _grow(chain, law, loads, conservative, rest, state, H, sweep, share_of_law, share_of_loads):
    """Equilibrium by letting loads and tendons grow from nothing at the rest pose, each stage from the one before.

    Without a potential an unstable equilibrium is followed too. The last two arguments are scratch space.
    """
    n, m = state.angle.size, state.length.size
    last, slack = np.empty(n), np.empty(m)
    part_loads = borrow(share_of_loads)
    scratch = borrow(share_of_law)
    part_law = TendonLaw(scratch[0], law.stiffness, scratch[1], scratch[2])
    begin(chain, rest, state.angle)
    evaluate(chain, law, loads, state)
    for j in range(m):
        slack[j] = state.length[j]
    done, stage, count, status, worst, escapes = 0.0, 0.125, 0, UNSTABLE, np.inf, 0
    for _ in range(_MAX_STAGES):
        share = min(1.0, done + stage)
        for j in range(m):
            part_law.command[j] = slack[j] + share * (law.command[j] - slack[j])
            part_law.low[j] = share * law.low[j]
            part_law.high[j] = share * law.high[j] if law.low[j] == law.high[j] else law.high[j]
        for row in range(loads.shape[0]):
            for column in range(N_COLUMNS):
                part_loads[row, column] = loads[row, column] * (share if FORCE <= column < ANCHOR else 1.0)
        for i in range(n):
            last[i] = state.angle[i]
        status, iterations, worst, left = _descend(chain, part_law, part_loads, conservative, state, H, sweep)
        count += iterations
        if status < UNSTABLE or (status == UNSTABLE and not conservative):
            done, stage, escapes = share, 2.0 * stage, escapes + left
            if share == 1.0:
                break
        elif stage > _SHORTEST_STAGE:
            stage *= 0.25
            for i in range(n):
                state.angle[i] = last[i]
        else:
            break
    if done < 1.0:
        status, iterations, worst, left = _descend(chain, law, loads, conservative, state, H, sweep)
        count, escapes = count + iterations, escapes + left
    return status, count, worst, escapes


@part
def solve_hinges(chain, law, loads, start, rest, state):
    """Equilibrium from joint angles `start`; fills the state; returns (status, iterations, residual, escapes)."""
    conservative = _has_potential(chain, loads)
    n = start.size if conservative and start.size > DENSE_JOINTS else 0
    sweep = new_sweep(n, law.low.size, has_springs(loads))
    H = np.empty((start.size - n, start.size - n))
    begin(chain, start, state.angle)
    status, count, worst, escapes = _descend(chain, law, loads, conservative, state, H, sweep)
    if status >= UNSTABLE and not conservative:
        begin(chain, start, state.angle)
        count += _relax(chain, law, loads, state, H, sweep)
        status, more, worst, escapes = _descend(chain, law, loads, conservative, state, H, sweep)
        count += more
    if status >= UNSTABLE:
        scratch = np.empty((3, law.low.size)), np.empty(loads.shape)
        status, more, worst, escapes = _grow(chain, law, loads, conservative, rest, state, H, sweep, *scratch)
        count += more
    return status, count, worst, escapes
