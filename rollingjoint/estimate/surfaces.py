"""What displaced contact surfaces change at a joint: lengths of tendons and the place of the next link, in tables.

Every joint i has six numbers s: x, y and angle of the surface below it, in the frame of link i, and of the one above
it, in the frame of link i + 1. At a fixed angle of the joint they change the lengths of the tendons, those of channels
included, and where the next link lies; both rates depend on the angle of that joint alone.
"""

from __future__ import annotations

import functools
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.variations import varied_chain
from rollingjoint.compiled import Floats
from rollingjoint.estimate.hidden import PER_JOINT, PER_SURFACE, HiddenLayout
from rollingjoint.statics.solve import solve_tensions_batch

Array = NDArray[np.float64]

POINTS = 257  # of a table, evenly spaced: profiles are smooth by parts only, so polynomials do not fit
_TURN = 1e-4  # rad: of the central differences by joint angles
_STEPS = np.array([1e-3, 1e-3, 1e-4])  # mm, mm, rad: of the central differences


class SurfaceTables(NamedTuple):
    """Rates by the surfaces of every joint, at angles between which they are linear.

    A row has for each of the six numbers the m lengths [mm] and x, y of the next link [mm].
    """

    lowest: Annotated[Floats, "J"]  # angles, rad
    per_radian: Annotated[Floats, "J"]  # points of the table
    values: Annotated[Floats, "J", "points", "rates"]
    slopes: Annotated[Floats, "J", "points", "rates"]  # derivatives of the values by the joint's angle
    start_lengths: Annotated[Floats, "m"]  # of the unloaded nominal chain under the start tension, mm
    start_rates: Annotated[Floats, "m", "surfaces"]  # their rates by the surfaces


@functools.lru_cache(maxsize=16)
def surface_tables(chain: RollingChain, layout: HiddenLayout, start_tension: float) -> SurfaceTables:
    """The tables of a chain; without rates where the layout has exact surfaces."""
    m = chain.n_tendons
    ends = np.moveaxis(chain.arrays.joints[0, :, :2], -1, 0)
    low, high = ends[0] + _TURN, ends[1] - _TURN
    shape = _n_joints(layout), POINTS, PER_JOINT * (m + 2)
    values, slopes = np.zeros(shape), np.zeros(shape)
    for i in range(_n_joints(layout)):
        angles = np.repeat(chain.neutral_angles[None], POINTS, axis=0)
        angles[:, i] = np.linspace(low[i], high[i], POINTS)
        turn = _TURN * np.eye(chain.n_joints)[i]
        less, rates, more = (
            np.hstack([_rates(chain, i, number, angles + way * turn) for number in range(PER_JOINT)])
            for way in (-1.0, 0.0, 1.0)
        )
        values[i], slopes[i] = rates, (more - less) / (2.0 * _TURN)
    return SurfaceTables(low, (POINTS - 1) / (high - low), values, slopes, *_start(chain, layout, start_tension))


def _n_joints(layout: HiddenLayout) -> int:
    return (layout.total - layout.surfaces) // PER_JOINT


def _displaced(chain: RollingChain, joint: int, number: int, way: float) -> RollingChain:
    """The chain with one of the six numbers of a joint changed by a small step."""
    offsets = np.zeros((chain.n_links, 2, PER_SURFACE))
    above, axis = divmod(number, PER_SURFACE)
    offsets[joint + above, 1 - above, axis] = way * _STEPS[axis]
    return varied_chain(chain, offsets, np.ones(chain.n_tendons))


def _rates(chain: RollingChain, joint: int, number: int, angles: Array) -> Array:
    """Rates of the lengths and of the next link's place in the frame of the one below, (B, m + 2)."""
    values = []
    for way in (1.0, -1.0):
        displaced = _displaced(chain, joint, number, way)
        poses = displaced.poses(angles)
        below, above = poses[:, joint], poses[:, joint + 1]
        cos, sin = np.cos(below[:, 2]), np.sin(below[:, 2])
        x, y = above[:, 0] - below[:, 0], above[:, 1] - below[:, 1]
        place = np.stack([cos * x + sin * y, cos * y - sin * x], axis=1)
        values.append(np.hstack([displaced.tendon_lengths(angles), place]))
    rates: Array = (values[0] - values[1]) / (2.0 * _STEPS[number % PER_SURFACE])
    return rates


def _start(chain: RollingChain, layout: HiddenLayout, tension: float) -> tuple[Array, Array]:
    """Lengths of the unloaded chain under the start tension, (m,), and their rates by the surfaces, (m, 6 J)."""
    pairs = [(i, number) for i in range(_n_joints(layout)) for number in range(PER_JOINT)]
    chains = [chain, *(_displaced(chain, *pair, way) for pair in pairs for way in (1.0, -1.0))]
    lengths = solve_tensions_batch(chains, np.full((len(chains), chain.n_tendons), tension)).lengths
    steps = np.array([_STEPS[number % PER_SURFACE] for _, number in pairs])
    rates = (lengths[1::2] - lengths[2::2]).T / (2.0 * steps)
    return np.ascontiguousarray(lengths[0]), np.ascontiguousarray(rates)
