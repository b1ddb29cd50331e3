"""Torsion springs between two links, in the plane and in space: their energy, moment and stiffness.

A spring acts on the sum of the joint angles between its links. Its stiffness, its angle at rest and its other link are
the last three columns of every load table.
"""

from __future__ import annotations

from rollingjoint._numba.jit import part

_LINK = 0  # the column of a load table


@part(inline=True)
def row_of(standing, loads, place):
    """A row of the two tables, the standing one first."""
    return standing[place] if place < standing.shape[0] else loads[place - standing.shape[0]]


@part(inline=True)
def twisted(theta, partner, k, rest_angle):
    """(energy, magnitude of its terms, moment on the first link) of a torsion spring between two links."""
    twist = theta - partner - rest_angle
    energy, moment = 0.5 * k * twist * twist, -(k * twist)
    return energy, energy + abs(moment) * (abs(theta) + abs(partner) + abs(rest_angle)), moment


@part(inline=True)
def _spring(row):
    """Stiffness of a torsion spring, the first joint between its links, and the joint after the last."""
    link, partner = int(row[_LINK]), int(row[row.size - 1])
    return row[row.size - 3], min(link, partner), max(link, partner)


@part
def add_torsion_springs(standing, loads, H):
    """Add the torsion springs of two tables to H."""
    for place in range(standing.shape[0] + loads.shape[0]):
        k, low, high = _spring(row_of(standing, loads, place))
        if k != 0.0:
            for i in range(low, high):
                for m in range(low, high):
                    H[i, m] += k


@part(inline=True)
def _needs_column(low, high, ones):
    return high - low > 1 and not (ones and low == 0)


@part
def torsion_columns(standing, loads, ones):
    """Number of columns of a Sweep for torsion springs, one for each over two joints or more.

    ones: whether the first column of V is ones, which serves the springs to the base.
    """
    columns = 0
    for place in range(standing.shape[0] + loads.shape[0]):
        k, low, high = _spring(row_of(standing, loads, place))
        if k != 0.0 and _needs_column(low, high, ones):
            columns += 1
    return columns


@part
def fill_torsion_generators(standing, loads, ones, column, sweep):
    """Add torsion springs to the diagonal of a Sweep, and fill its columns from `column` on."""
    for place in range(standing.shape[0] + loads.shape[0]):
        k, low, high = _spring(row_of(standing, loads, place))
        if k == 0.0:
            continue
        for i in range(low, high):
            sweep.diagonal[i] += k
            if ones and low == 0:
                sweep.U[i, 0] += k
        if _needs_column(low, high, ones):
            for i in range(sweep.diagonal.size):
                spanned = low <= i < high
                sweep.U[i, column], sweep.V[i, column] = k if spanned else 0.0, 1.0 if spanned else 0.0
            column += 1
