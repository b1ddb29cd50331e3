"""Validity of designs as smooth margins: five numbers that are 0 or more for a design that can be built.

Each is a smooth minimum, from below, over dense samples of every joint or link. docs/design.md explains them.
Samples are computed as exponents, -100 times their values, so that a matrix product includes all constants. Surfaces
that are even in s are sampled on one side only, and these samples count twice.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import torch
from torch import Tensor

from rollingjoint.design.curve import Curve
from rollingjoint.design.faults import LEAST_CURVATURE
from rollingjoint.design.numbers import Numbers

MARGINS = ("rolling", "clearance", "radius", "holes", "thickness")
"""The names of the margins, in order."""

_SHARPNESS = 100.0
_BLOCK = 512
_CONTACT_STEP = 4  # cells between the sampled contacts of a joint
_PAIR_STEP = 2  # cells between the sampled points of pairs
CHORD = 0.15  # least distance of two points over their distance along the surfaces
_ROUNDING = 1e-9  # of places
CLEARANCE = 0.3  # least distance of the surfaces, relative to surfaces with the least curvature


def margins(numbers: Numbers, smallest_radius: float, wall: float) -> Tensor:
    """The margins of designs, (B, len(MARGINS)). Designs are processed in blocks that fit into the cache."""
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
    return torch.stack(columns, -1) / -_SHARPNESS


def _summed(powers: Tensor) -> Tensor:
    """The logarithm of the sum of the exponentials of all but the first axis."""
    return torch.logsumexp(powers.flatten(1), -1)


class _Sampled:
    """The distinct surfaces of designs on the grid, as child surfaces at the origin; a parent surface is the mirror.

    Attributes:
        points: complex (B, S, N) [mm].
        half_turns: exp(i tangent angle / 2), (B, S, N).
        values: convexities, (B, S, N) [1/mm].
        control_counts: logarithm of the weight of each Bernstein coefficient of a curvature, (r,).
    """

    def __init__(self, numbers: Numbers) -> None:
        self.numbers = numbers
        self.curve: Curve = numbers.curve
        self.width = numbers.half_width  # (B,)
        widths = self.width[:, None].expand(numbers.convexity.shape[:-1])
        angles = 0.5 * (numbers.angle[..., None] - self.curve.angles(numbers.convexity, widths))
        self.half_turns = torch.complex(torch.cos(angles), torch.sin(angles))
        self.points = self.curve.points(numbers.convexity, numbers.angle, widths)
        self.values = numbers.convexity @ self.curve.values.T
        self.control_counts = _counts(torch.arange(len(self.curve.control)), self.curve.symmetric)


def _counts(places: Tensor, symmetric: bool) -> Tensor:
    """Logarithm of the weight of each sample: 2 at s > 0 if symmetric, as s < 0 is not sampled; else 1."""
    return torch.log(1.0 + (places > _ROUNDING).to(torch.float64) * symmetric)


def _rolling(sampled: _Sampled) -> Tensor:
    numbers, scale = sampled.numbers, _SHARPNESS * sampled.width
    child, parent = numbers.structure.joints.T
    relative = numbers.convexity[:, child] + numbers.convexity[:, parent]
    powers = -scale[:, None, None] * relative @ sampled.curve.control.T
    return _summed(powers + sampled.control_counts) + scale * LEAST_CURVATURE


def _radius(sampled: _Sampled, smallest_radius: float) -> Tensor:
    control = _SHARPNESS * smallest_radius * sampled.numbers.convexity @ sampled.curve.control.T
    return _summed(torch.stack([control, -control], 1) + sampled.control_counts) - _SHARPNESS


class _SamplePlaces(NamedTuple):
    """The contacts and places at which joints are sampled.

    Attributes:
        contacts: on the grid, (C,).
        nearness: 1 / squared arc length from every contact to the grid, 0 at the contact, (C, N).
        apart: power of the pair at the contact, which removes it from the sum; 0 elsewhere, (C, N).
        far: index of the contact of every row of pairs of points, (R,).
        moved: index of the point above of every row, among every second point, (R,).
        closeness: 1 / squared arc length from that point to every second point below, 0 at itself, (R, P).
        weights: of the pairs, (R × P).
    """

    contacts: Tensor
    nearness: Tensor
    apart: Tensor
    far: Tensor
    moved: Tensor
    closeness: Tensor
    weights: Tensor


@functools.lru_cache
def _places(cells: int, symmetric: bool) -> _SamplePlaces:
    middle, grid = cells // 2, torch.linspace(-1.0, 1.0, cells + 1, dtype=torch.float64)
    contacts = torch.arange(middle if symmetric else middle % _CONTACT_STEP, cells + 1, _CONTACT_STEP)
    nearness = _inverse_squares(grid[contacts, None] - grid)
    places = grid[::_PAIR_STEP]
    far, moved = torch.cartesian_prod(torch.arange(0, len(contacts), 2), torch.arange(len(places))).T
    unique = (far > 0) | (places[moved] > -_ROUNDING) | (not symmetric)  # at s = 0 the halves mirror each other
    far, moved = far[unique], moved[unique]
    counts = _counts(torch.where(far > 0, 0.0, places[moved]), symmetric)[:, None]
    closeness = _inverse_squares(places[moved, None] - places)
    missed = 0.5 * (places[1] - places[0]).square()  # curves that cross have samples nearer than that
    weights = torch.where(closeness > 0, torch.exp(_SHARPNESS * (missed * closeness + CHORD**2) + counts), 0.0)
    apart = torch.where(nearness > 0, 0.0, -10.0 * _SHARPNESS)
    return _SamplePlaces(contacts, nearness, apart, far, moved, closeness, weights.flatten())


def _inverse_squares(distances: Tensor) -> Tensor:
    """1 / squared distances; 0 for a distance of 0."""
    return torch.where(distances == 0, 0.0, 1.0 / distances.square())


def _clearance(sampled: _Sampled) -> Tensor:
    """Clearance of the surfaces of every joint at contacts all over the range, (B,).

    Surfaces that meet, meet either at one arc length or at two. At one: from the child's point to the parent's, along
    the normal of the mean of both tangents, over half the squared distance from the contact; near the contact this is
    the relative curvature. At two: the distance over the distance in arc length.
    """
    places = _places(len(sampled.curve.grid) - 1, sampled.curve.symmetric)
    child, parent = sampled.numbers.structure.joints.T
    below, above = sampled.points[:, child], sampled.points[:, parent].conj()  # (B, J, N) in their links' frames
    first, second = sampled.half_turns[:, child], sampled.half_turns[:, parent].conj()
    half_turn = (first * second.conj())[..., places.contacts]  # half the turn from the frame above to the frame below
    turn = half_turn.square()
    shift = below[..., places.contacts] - turn * above[..., places.contacts]
    near = _near(sampled.width, places, half_turn, shift, first * second, below, above)
    below, above = below[..., ::_PAIR_STEP], above[..., ::_PAIR_STEP]
    moved = turn[..., places.far] * above[..., places.moved] + shift[..., places.far]
    return torch.logaddexp(near, _far(sampled.width, places, moved, below))


def _near(
    width: Tensor, places: _SamplePlaces, half_turn: Tensor, shift: Tensor, normal: Tensor, below: Tensor, above: Tensor
) -> Tensor:
    """At one arc length: the imaginary part of a product of complex matrices, (..., C, 3) and (..., 3, N)."""
    scale = (-2.0 * _SHARPNESS / width)[:, None, None, None]
    inverse = half_turn.conj()
    factors = scale * _flat(torch.stack([half_turn, shift * inverse, -inverse], -1))
    columns = _flat(1j * torch.stack([normal * above.conj(), normal, normal * below.conj()], -1))
    powers = torch.addcmul(places.apart, factors @ columns.mT, places.nearness)
    return _summed(powers) + _SHARPNESS * CLEARANCE * LEAST_CURVATURE * width


def _far(width: Tensor, places: _SamplePlaces, moved: Tensor, below: Tensor) -> Tensor:
    """At two: squared distances of points above, (..., R), and below, (..., P)."""
    scale = (-_SHARPNESS / width.square())[:, None, None, None]
    ones = torch.ones_like(below.real)
    factors = torch.stack([_square(moved), torch.ones_like(moved.real), moved.real, moved.imag], -1)
    columns = scale * torch.stack([ones, _square(below), -2.0 * below.real, -2.0 * below.imag], -1)
    powers = (factors @ columns.mT).mul_(places.closeness)
    return (powers.exp_().flatten(-2) @ places.weights).sum(-1).log()


def _flat(values: Tensor) -> Tensor:
    """Complex numbers (..., k) as real pairs, (..., 2 k)."""
    return torch.view_as_real(values).flatten(-2)


def _square(values: Tensor) -> Tensor:
    return values.real.square() + values.imag.square()


def _holes(sampled: _Sampled, wall: float) -> Tensor:
    numbers, width = sampled.numbers, sampled.width[:, None]
    sides = slice(1, 2) if sampled.curve.symmetric else slice(0, 2)
    hole = numbers.hole[:, sides]
    edge = 1.0 - (hole + wall) / width  # (B, H)
    places = hole / width * torch.tensor([-1.0, 1.0])[sides]
    child, parent = numbers.structure.joints.T
    at = _interpolated(sampled, places)  # (B, S, H)
    offset = at[:, :, None] - sampled.points[..., None]  # (B, S, N, H)
    turned = sampled.half_turns.square()[..., None]
    local = offset.imag * turned.real - offset.real * turned.imag
    kappa = sampled.values[:, child] + sampled.values[:, parent]  # (B, J, N)
    square = ((places[:, None, :] - sampled.curve.grid[:, None]) * width[..., None]).square()
    soft = 0.01
    gap = (soft * kappa[..., None] - 2.0 * (local[:, child] + local[:, parent])) / (square[:, None] + soft)
    crossing = width[..., None, None] * (gap - CLEARANCE * LEAST_CURVATURE)
    powers = -_SHARPNESS * torch.cat([edge, crossing.flatten(1)], -1)
    return _summed(powers) + torch.log(torch.tensor(2.0 / hole.shape[1], dtype=torch.float64))


def _interpolated(sampled: _Sampled, places: Tensor) -> Tensor:
    """Points of every surface at places (B, H) in half widths, (B, S, H): quintic Hermite polynomials in the cells."""
    grid = sampled.curve.grid
    step = grid[1] - grid[0]
    cell = ((places.detach() - grid[0]) / step).long().clamp(0, len(grid) - 2)
    t = ((places - grid[cell]) / step)[:, None, :]
    index = cell[:, None, :].expand(-1, sampled.points.shape[1], -1)
    length = step * sampled.width[:, None, None]

    def end(index: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        tangent = sampled.half_turns.gather(-1, index).square() * length
        return sampled.points.gather(-1, index), tangent, -1j * tangent * sampled.values.gather(-1, index) * length

    (p, a, c), (q, b, d) = end(index), end(index + 1)
    chord = q - p
    cubic = 10 * chord - 6 * a - 4 * b - 1.5 * c + 0.5 * d
    quartic = -15 * chord + 8 * a + 7 * b + 1.5 * c - d
    quintic = 6 * chord - 3 * (a + b) - 0.5 * (c - d)
    return p + t * (a + t * (0.5 * c + t * (cubic + t * (quartic + t * quintic))))


def _thickness(sampled: _Sampled, smallest_radius: float, wall: float) -> Tensor:
    numbers, width = sampled.numbers, sampled.width
    step = _PAIR_STEP * (sampled.curve.grid[1] - sampled.curve.grid[0]) * width
    reach = wall + 1.0
    missed = step.square() / 8.0 * (1.0 / reach + 2.0 / smallest_radius)  # between the samples
    parent, child = numbers.structure.links.T
    bottom, top = (sampled.points[:, side, ::_PAIR_STEP] for side in (parent, child))
    half = slice(bottom.shape[-1] // 2 if sampled.curve.symmetric else 0, None)
    counts = _counts(sampled.curve.grid[::_PAIR_STEP][half], sampled.curve.symmetric)
    top = top[..., half]
    scale = (-_SHARPNESS / numbers.height)[..., None, None]  # (B, L, 1, 1)
    clearance = top.imag + (numbers.height - wall - missed[:, None])[..., None]
    factors = torch.stack([torch.ones_like(clearance), top.real.square() / (2.0 * reach) + clearance, top.real], -1)
    across = bottom.real.square() / (2.0 * reach) + bottom.imag
    columns = torch.stack([across, torch.ones_like(across), bottom.real / -reach], -1)
    return _summed(factors @ (scale * columns).mT + counts[:, None])
