"""When a design is valid, as smooth margins: five numbers that are 0 or more for a design that can be built.

Each is a smooth minimum, from below, over dense samples of every joint or link. docs/design.md says what they mean.
"""

from __future__ import annotations

import torch
from torch import Tensor

from rollingjoint.design.curve import Curve
from rollingjoint.design.faults import LEAST_CURVATURE
from rollingjoint.design.numbers import Numbers

MARGINS = ("rolling", "clearance", "radius", "holes", "thickness")
"""The names of the margins, in order."""

_SHARPNESS = 100.0
_BLOCK = 256
_CONTACT_STEP = 4  # cells between the contacts at which a joint is looked at
_PAIR_STEP = 2  # cells between the points of which all pairs are looked at
_CHORD = 0.15  # least distance of two points over their distance along the surfaces
_CLEARANCE = 0.3  # least distance of the surfaces over that of surfaces with the least curvature


def margins(numbers: Numbers, smallest_radius: float, wall: float) -> Tensor:
    """The margins of designs, (B, len(MARGINS)). Blocks of designs go one after the other: they stay in the cache."""
    blocks = [_block(numbers.rows(i, i + _BLOCK), smallest_radius, wall) for i in range(0, len(numbers.hole), _BLOCK)]
    return torch.cat(blocks) if blocks else torch.empty(0, len(MARGINS), dtype=torch.float64)


def _block(numbers: Numbers, smallest_radius: float, wall: float) -> Tensor:
    sampled = _Sampled(numbers)
    columns = [
        _rolling(sampled),
        _clearance(sampled),
        _radius(sampled, smallest_radius),
        _holes(sampled, wall),
        _thickness(sampled, smallest_radius, wall),
    ]
    return torch.stack([_smallest(column) for column in columns], -1)


def _smallest(values: Tensor) -> Tensor:
    """A smooth minimum from below of all but the first axis."""
    return -torch.logsumexp(-_SHARPNESS * values.flatten(1), -1) / _SHARPNESS


class _Sampled:
    """The distinct surfaces of designs on the grid, as child surfaces at the origin; a parent surface is the mirror."""

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        self.curve: Curve = numbers.curve
        self.width = numbers.half_width  # (B,)
        wide = self.width[:, None].expand(numbers.convexity.shape[:-1])
        self.theta = numbers.angle[..., None] - self.curve.angles(numbers.convexity, wide)  # (B, S, N)
        self.points = self.curve.points(numbers.convexity, numbers.angle, wide)  # (B, S, N)


def _rolling(sampled: _Sampled) -> Tensor:
    numbers = sampled.numbers
    control = numbers.convexity @ sampled.curve.control.T
    child, parent = numbers.structure.joints.T
    relative = control[:, child] + control[:, parent]
    return sampled.width[:, None, None] * (relative - LEAST_CURVATURE)


def _radius(sampled: _Sampled, smallest_radius: float) -> Tensor:
    control = smallest_radius * (sampled.numbers.convexity @ sampled.curve.control.T)
    return torch.stack([1.0 - control, 1.0 + control], 1)


def _clearance(sampled: _Sampled) -> Tensor:
    """Clearance of the surfaces of every joint at contacts all over the range, (B, ...).

    Surfaces that meet, meet either at one arc length or at two. At one: from the child's point to the parent's, along
    the normal of the mean of both tangents, over half the squared distance from the contact; near the contact that is
    the relative curvature. At two: the distance over that of the arc lengths.
    """
    structure, grid = sampled.numbers.structure, sampled.curve.grid
    middle = len(grid) // 2
    contacts = torch.arange(middle if structure.symmetric else middle % _CONTACT_STEP, len(grid), _CONTACT_STEP)
    child, parent = structure.joints.T
    below, above = sampled.points[:, child], sampled.points[:, parent].conj()  # (B, J, N) in their links' frames
    theta, beyond = sampled.theta[:, child], -sampled.theta[:, parent]
    turn = _turned(theta - beyond)[..., contacts]  # from the frame of the link above to that of the link below
    shift = below[..., contacts] - turn * above[..., contacts]
    width = sampled.width[:, None, None]
    normal = _turned(0.5 * (theta + beyond))  # of the mean tangent, for each of the two in its own frame
    back = _turned(0.5 * (beyond - theta))[..., contacts]
    apart = _imaginary(
        torch.stack([turn * back, shift * back, -back], -1),
        torch.stack([normal.conj() * above, normal.conj(), normal.conj() * below], -2),
    )
    near = _over_squares(2.0 * apart / width[..., None], grid[contacts, None] - grid)
    far = _distances(turn[..., ::2], shift[..., ::2], below[..., ::_PAIR_STEP], above[..., ::_PAIR_STEP])
    places = grid[::_PAIR_STEP]
    missed = 0.5 * (places[1] - places[0]).square()  # curves that cross have samples nearer than that
    chords = _over_squares(far / width[..., None, None].square() - missed, places[:, None] - places)
    least = _CLEARANCE * LEAST_CURVATURE * width
    return torch.cat([near.flatten(1) - least[..., 0], chords.flatten(1) - _CHORD**2], -1)


def _over_squares(values: Tensor, distances: Tensor) -> Tensor:
    """Values over squared distances; where the distance is 0 a harmless 10."""
    square = distances.square()
    return torch.addcmul(10.0 * (square == 0), values, torch.where(square > 0, 1.0 / square, 0.0))


def _distances(turn: Tensor, shift: Tensor, below: Tensor, above: Tensor) -> Tensor:
    """Squared distances of points (..., N) of two links posed by turn and shift (..., C), (..., C, N, N) [mm²]."""
    moved = turn[..., None] * above[..., None, :] + shift[..., None]  # (..., C, N)
    left = torch.stack([torch.ones_like(moved.real), moved.abs().square(), -2.0 * moved.real, -2.0 * moved.imag], -1)
    right = torch.stack([below.abs().square(), torch.ones_like(below.real), below.real, below.imag], -2)
    return left @ right[..., None, :, :]


def _imaginary(left: Tensor, right: Tensor) -> Tensor:
    """Imaginary part of a product of complex matrices."""
    return torch.cat([left.imag, left.real], -1) @ torch.cat([right.real, right.imag], -2)


def _holes(sampled: _Sampled, wall: float) -> Tensor:
    numbers, width = sampled.numbers, sampled.width
    edge = 1.0 - (numbers.hole + wall) / width[:, None]  # (B, 2)
    places = numbers.hole / width[:, None] * torch.tensor([-1.0, 1.0])
    child, parent = numbers.structure.joints.T
    values = numbers.convexity @ sampled.curve.values.T
    at = _interpolated(sampled, values, places)  # (B, S, 2)
    local = (at[:, :, None] - sampled.points[..., None]) * _turned(-sampled.theta)[..., None]  # (B, S, N, 2)
    height = -(local[:, child] + local[:, parent]).imag  # (B, J, N, 2)
    kappa = (values[:, child] + values[:, parent])[..., None]
    square = (places[:, None, :] - sampled.curve.grid[:, None]).square()[:, None] * width[:, None, None, None].square()
    soft = 0.01
    gap = (2.0 * height + kappa * soft) / (square + soft)
    crossing = width[:, None, None, None] * (gap - _CLEARANCE * LEAST_CURVATURE)
    return torch.cat([edge, crossing.flatten(1)], -1)


def _interpolated(sampled: _Sampled, values: Tensor, places: Tensor) -> Tensor:
    """Points of every surface at places (B, 2) in half widths, (B, S, 2): quintic Hermite polynomials in the cells."""
    grid = sampled.curve.grid
    step = grid[1] - grid[0]
    cell = ((places.detach() - grid[0]) / step).long().clamp(0, len(grid) - 2)
    t = ((places - grid[cell]) / step)[:, None, :]
    index = cell[:, None, :].expand(-1, sampled.points.shape[1], -1)
    length = step * sampled.width[:, None, None]
    tangents = _turned(sampled.theta) * length
    bends = -1j * tangents * values * length
    (p, q), (a, b), (c, d) = (
        (table.gather(-1, index), table.gather(-1, index + 1)) for table in (sampled.points, tangents, bends)
    )
    chord = q - p
    cubic = 10 * chord - 6 * a - 4 * b - 1.5 * c + 0.5 * d
    quartic = -15 * chord + 8 * a + 7 * b + 1.5 * c - d
    quintic = 6 * chord - 3 * (a + b) - 0.5 * (c - d)
    return p + t * (a + t * (0.5 * c + t * (cubic + t * (quartic + t * quintic))))


def _thickness(sampled: _Sampled, smallest_radius: float, wall: float) -> Tensor:
    numbers, width = sampled.numbers, sampled.width
    points = sampled.points[..., ::_PAIR_STEP]
    step = _PAIR_STEP * (sampled.curve.grid[1] - sampled.curve.grid[0]) * width
    parent, child = numbers.structure.links.T
    top, bottom = points[:, child], points[:, parent]
    height = numbers.height[..., None, None]
    reach = wall + 1.0
    across = (top.real[..., None] - bottom.real[..., None, :]).square() / (2.0 * reach)
    apart = height + top.imag[..., None] + bottom.imag[..., None, :] + across
    missed = step.square() / 8.0 * (1.0 / reach + 2.0 / smallest_radius)  # between the samples
    return (apart - wall - missed[:, None, None, None]) / height


def _turned(angle: Tensor) -> Tensor:
    return torch.complex(torch.cos(angle), torch.sin(angle))
