"""Rigid walls without friction in a MuJoCo model: half planes, planes, discs, spheres, capsules, polygons."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain import outline, se3
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.errors import InvalidInput
from rollingjoint.mujoco.arm import numbers
from rollingjoint.statics.among import bases_of, walls_of
from rollingjoint.surroundings import Lumen, Surroundings, Tube

Array = NDArray[np.float64]

# Contacts as stiff as the time step allows; a wall meets points (bit 1) or bars (bit 2) of an outline
_STIFF = 'condim="1" solref="0.002 1" solimp="0.9999 0.9999 0.001" mass="0"'
_POINTS, _BARS = 1, 2


def walls_text(surroundings: Surroundings, base: ArrayLike, chain: AnyChain) -> tuple[str, dict[int, str]]:
    """The walls as geometry of the world, as seen from the base, and the outline of every link, by its number.

    Raises:
        InvalidInput: walls for other chains; compliant walls, friction, or a lumen, which the model would leave out.
    """
    arrays, d = walls_of(surroundings, chain), chain.dimension
    if not surroundings.rigid or surroundings.has_friction:
        raise InvalidInput("surroundings", surroundings, "rigid walls without friction", "MuJoCo's walls are such.")
    for wall in surroundings.walls:
        if isinstance(wall, Lumen | Tube):
            raise InvalidInput("surroundings", wall, f"flat and round walls, no {type(wall).__name__}")
    place = bases_of(base, 1, d)[0]
    turn = outline.rotation(place[2]) if d == 2 else se3.rotation(place[3:])

    def seen(point: Array) -> Array:
        return (point - place[:d]) @ turn

    world = ""
    for row in arrays.planes[0]:
        normal = row[:d]
        world += f'<geom type="plane" size="1 1 1" pos="{_metres(seen(row[d] * normal))}" '
        world += f'zaxis="{numbers(_in_space(normal @ turn))}" {_met(_POINTS)}/>'
    discs = arrays.discs[0][:, :3] if d == 2 else np.zeros((0, 3))
    for first, second, radius in [
        *((row[:d], row[:d], row[d]) for row in discs),
        *((row[:d], row[d : 2 * d], row[2 * d]) for row in arrays.capsules[0]),
    ]:
        world += _rounded(seen(first), seen(second), radius, _met(_BARS))
    bodies = np.zeros((chain.n_links, d))  # origins of the links in the frames of MuJoCo's bodies
    if isinstance(chain, HingeChain):  # there at the hinge below
        bodies[1:, 2] = [bead.spacing for bead in chain.beads]
    links = dict.fromkeys(range(1, chain.n_links), "")
    for row in arrays.points[0]:
        link = int(row[0])
        point = bodies[link] + row[1 : 1 + d]
        links[link] += _rounded(point, point, row[1 + d], _meets(_POINTS))
    for row in arrays.bars[0]:
        link = int(row[0])
        first, second = bodies[link] + row[1 : 1 + 2 * d].reshape(2, d)
        links[link] += _rounded(first, second, row[1 + 2 * d], _meets(_BARS))
    return world, links


def _rounded(first: Array, second: Array, radius: float, how: str) -> str:
    """A capsule, or a sphere where both ends are in one place; MuJoCo knows no radius of 0."""
    size = f'size="{max(1e-3 * float(radius), 1e-9)!r}"'
    if np.array_equal(first, second):
        return f'<geom type="sphere" {size} pos="{_metres(first)}" {how}/>'
    return f'<geom type="capsule" {size} fromto="{_metres(first)} {_metres(second)}" {how}/>'


def _met(kind: int) -> str:
    """A wall that outlines of this kind meet."""
    return f'contype="0" conaffinity="{kind}" {_STIFF}'


def _meets(kind: int) -> str:
    """A part of an outline that meets walls of this kind, and no other part."""
    return f'contype="{kind}" conaffinity="0" {_STIFF}'


def _in_space(vector: Array) -> Array:
    return np.pad(vector, (0, 3 - len(vector)))


def _metres(point: Array) -> str:
    return numbers(1e-3 * _in_space(point))
