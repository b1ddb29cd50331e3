"""Rigid walls without friction in a MuJoCo model: half planes, discs, capsules, polygons."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.outline import rotation
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.checks import as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.mujoco.arm import numbers
from rollingjoint.surroundings import Lumen, Surroundings

Array = NDArray[np.float64]

# Contacts as stiff as the time step allows; a wall meets points (bit 1) or bars (bit 2) of an outline
_STIFF = 'condim="1" solref="0.002 1" solimp="0.9999 0.9999 0.001" mass="0"'
_POINTS, _BARS = 1, 2


def walls_text(surroundings: Surroundings, base: ArrayLike, chain: RollingChain) -> tuple[str, dict[int, str]]:
    """The walls as geometry of the world, as seen from the base, and the outline of every link, by its number.

    Raises:
        InvalidInput: compliant walls, friction, or a lumen, which the model would leave out.
    """
    if not surroundings.rigid or surroundings.has_friction:
        raise InvalidInput("surroundings", surroundings, "rigid walls without friction", "MuJoCo's walls are such.")
    if any(isinstance(wall, Lumen) for wall in surroundings.walls):
        raise InvalidInput("surroundings", surroundings, "half planes, discs, capsules and polygons, no Lumen")
    arrays, (x, y, angle) = surroundings.arrays(chain), as_vector("base", base, 3, "x, y [mm] and angle [rad]")
    turn = rotation(angle)

    def seen(point: Array) -> Array:
        return (point - np.array([x, y])) @ turn

    world = ""
    for nx, ny, d, *_ in arrays.planes[0]:
        normal = np.array([nx, ny])
        world += f'<geom type="plane" size="1 1 1" pos="{_metres(seen(d * normal))}" '
        world += f'zaxis="{numbers(np.append(normal @ turn, 0.0))}" {_met(_POINTS)}/>'
    for cx, cy, radius, *_ in arrays.discs[0]:
        place = _metres(seen(np.array([cx, cy])))
        world += f'<geom type="sphere" size="{_size(radius)}" pos="{place}" {_met(_BARS)}/>'
    for ax, ay, bx, by, radius, *_ in arrays.capsules[0]:
        world += _capsule(seen(np.array([ax, ay])), seen(np.array([bx, by])), radius, _met(_BARS))
    links = dict.fromkeys(range(1, chain.n_links), "")
    for link, px, py, radius, _ in arrays.points[0]:
        place = _metres(np.array([px, py]))
        links[int(link)] += f'<geom type="sphere" size="{_size(radius)}" pos="{place}" {_meets(_POINTS)}/>'
    for link, ax, ay, bx, by, radius in arrays.bars[0]:
        links[int(link)] += _capsule(np.array([ax, ay]), np.array([bx, by]), radius, _meets(_BARS))
    return world, links


def _capsule(first: Array, second: Array, radius: float, how: str) -> str:
    ends = f"{_metres(first)} {_metres(second)}"
    return f'<geom type="capsule" size="{_size(radius)}" fromto="{ends}" {how}/>'


def _met(kind: int) -> str:
    """A wall that outlines of this kind meet."""
    return f'contype="0" conaffinity="{kind}" {_STIFF}'


def _meets(kind: int) -> str:
    """A part of an outline that meets walls of this kind, and no other part."""
    return f'contype="{kind}" conaffinity="0" {_STIFF}'


def _size(radius: float) -> str:
    """A radius; MuJoCo knows none of 0."""
    return repr(max(1e-3 * float(radius), 1e-9))


def _metres(point: Array) -> str:
    return numbers(1e-3 * np.append(point, 0.0))
