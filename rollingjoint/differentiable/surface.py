"""Contact surfaces in torch: curvature coefficients to tangent angles and points, and knot values to coefficients.

The plane is the complex plane: x + iy; a turn by an angle is a product with exp(i angle). Points are integrals by
Gauss-Legendre quadrature over each piece of the curvature, with enough nodes for an error within rounding.
Source: docs/theory.md, section 1.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache

import numpy as np
import torch
from torch import Tensor

from rollingjoint.differentiable.looking import may_look

MOST_UNSEEN_TURN = 11.0  # rad; largest turn of a piece where the host does not look at its turn

# Columns of a piece: its first arc length, the point at it; coefficients of the tangent angle from _TANGENT on
_FIRST, _X, _Y, _TANGENT = range(4)


@dataclass(frozen=True)
class Place:
    """Arc lengths on their surfaces, with the pieces and quadrature to evaluate the surfaces there: (...)."""

    s: Tensor
    piece: Tensor  # (..., 3 + k)
    nodes: Tensor
    weights: Tensor

    @property
    def step(self) -> Tensor:
        """Arc length from the beginning of the piece [mm]."""
        return self.s - self.piece[..., _FIRST]

    def moved(self, by: Tensor) -> Place:
        """The places moved by this arc length, on the same pieces."""
        return replace(self, s=self.s + by)

    def tangent_angle(self) -> Tensor:
        """Tangent angle in the link frame [rad]."""
        return _horner(self.piece[..., _TANGENT:], self.step)

    def curvature(self) -> Tensor:
        """Curvature, at a jump the value to its right [1/mm]."""
        degrees = _degrees(1, self.piece.shape[-1] - _TANGENT, self.piece)
        return _horner(self.piece[..., _TANGENT + 1 :] * degrees, self.step)

    def point(self) -> Tensor:
        """Point in the link frame, complex [mm]."""
        begin = torch.complex(self.piece[..., _X], self.piece[..., _Y])
        return begin + _chord(self.piece[..., _TANGENT:], self.step, self.nodes, self.weights)


@dataclass(frozen=True)
class Surfaces:
    """Surfaces of links, placed in their frames, with any leading axes.

    Attributes:
        limits: first and last arc length, (..., 2) [mm].
        borders: between the pieces, (..., p - 1) [mm]; inf where no piece follows.
        pieces: (..., p, 3 + k) where each begins, the point there, ascending coefficients of the tangent angle.
        nodes, weights: of the quadrature over [0, 1].
    """

    limits: Tensor
    borders: Tensor
    pieces: Tensor
    nodes: Tensor
    weights: Tensor

    @classmethod
    def of(cls, breaks: Tensor, coefficients: Tensor, starts: Tensor, angles: Tensor) -> Surfaces:
        """The surfaces with these curvatures (..., p, k), starts (..., 2) and angles (...) at arc length 0."""
        lengths = breaks.diff(dim=-1)
        turning = turning_coefficients(coefficients)
        inner, last = breaks.detach()[..., 1:-1], breaks.detach()[..., -1:]
        borders = torch.where(inner < last, inner, torch.inf)
        limits = torch.stack([breaks[..., 0], breaks[..., -1]], -1)
        zero = torch.zeros_like(breaks[..., 0])
        quadrature = _quadrature(turning, lengths)

        def placed(points: Tensor, tangent: Tensor) -> Surfaces:
            shape = np.broadcast_shapes(tuple(points.shape), tuple(tangent.shape[:-1]), tuple(lengths.shape))
            columns = breaks[..., :-1, None], as_pairs(points), tangent
            return cls(limits, borders, torch.cat([c.expand(*shape, c.shape[-1]) for c in columns], -1), *quadrature)

        nowhere = torch.zeros_like(lengths).to(torch.complex128)
        tangent = _raised(turning, _begun(_horner(turning, lengths)))
        tangent = _raised(tangent, (angles - placed(nowhere, tangent).at(zero).tangent_angle())[..., None])
        points = _begun(_chord(tangent, lengths, *quadrature))
        start = as_complex(starts) - placed(points, tangent).at(zero).point()
        return placed(points + start[..., None], tangent)

    @cached_property
    def _rows(self) -> tuple[Tensor, Tensor]:
        """All pieces of all surfaces one below the other; the row where each surface begins."""
        shape = self.pieces.shape[:-2]
        begins = torch.arange(shape.numel(), device=self.pieces.device).reshape(shape) * self.pieces.shape[-2]
        return self.pieces.flatten(0, -2), begins

    def at(self, s: Tensor) -> Place:
        """The places of arc lengths on the surfaces, one each, (...)."""
        if self.pieces.shape[-2] == 1:
            return Place(s, self.pieces[..., 0, :], self.nodes, self.weights)
        rows, begins = self._rows
        index = begins + (s.detach()[..., None] >= self.borders).sum(-1)
        return Place(s, rows.index_select(0, index.flatten()).view(*index.shape, -1), self.nodes, self.weights)

    def detach(self) -> Surfaces:
        """The surfaces as constants."""
        return Surfaces(*(getattr(self, field.name).detach() for field in fields(self)))

    def several(self) -> Surfaces:
        """The surfaces with an axis before the last two, to look up several arc lengths on each."""
        limits, borders, pieces = self.limits.unsqueeze(-4), self.borders.unsqueeze(-4), self.pieces.unsqueeze(-5)
        return Surfaces(limits, borders, pieces, self.nodes, self.weights)

    def repeated(self, count: int) -> Surfaces:
        """The surfaces of one link (..., 1, 2), repeated for `count` equal links, (..., count, 2)."""
        limits, borders = (
            table.expand(*table.shape[:-3], count, *table.shape[-2:]) for table in (self.limits, self.borders)
        )
        pieces = self.pieces.expand(*self.pieces.shape[:-4], count, *self.pieces.shape[-3:])
        return Surfaces(limits, borders, pieces, self.nodes, self.weights)

    def joints(self) -> Surfaces:
        """The two surfaces of every joint, (..., n - 1, 2), child below and parent above, from links (..., n, 2)."""

        def pair(table: Tensor, axes: int) -> Tensor:
            trailing = (slice(None),) * axes
            below, above = table[(..., slice(None, -1), 1, *trailing)], table[(..., slice(1, None), 0, *trailing)]
            return torch.stack([below, above], -1 - axes)

        tables = pair(self.limits, 1), pair(self.borders, 1), pair(self.pieces, 2)
        return Surfaces(*tables, self.nodes, self.weights)

    def common_range(self) -> tuple[Tensor, Tensor]:
        """Arc lengths that lie on both surfaces of every joint, (..., J) each [mm]."""
        return self.limits[..., 0].amax(-1), self.limits[..., 1].amin(-1)


def linear_pieces(knots: Tensor, values: Tensor) -> Tensor:
    """Coefficients (..., p, 2) of the straight lines between knot values, (..., p + 1) both [mm, 1/mm].

    With the knots as breaks they are the curvature of `Profile.samples`.
    """
    slopes = values.diff(dim=-1) / knots.diff(dim=-1)
    return torch.stack(torch.broadcast_tensors(values[..., :-1], slopes), -1)


def spline_pieces(knots: Tensor, values: Tensor) -> Tensor:
    """Coefficients (..., p, 4) of the natural cubic spline through knot values, (..., p + 1) both [mm, 1/mm].

    With the knots as breaks they are the curvature of `Profile.spline`.
    """
    h = knots.diff(dim=-1)
    slopes = values.diff(dim=-1) / h
    ends = torch.ones_like(knots[..., :1])
    none = torch.zeros_like(ends)
    matrix = torch.diag_embed(torch.cat([ends, 2.0 * (h[..., :-1] + h[..., 1:]), ends], -1))
    matrix = matrix + torch.diag_embed(torch.cat([h[..., :-1], none], -1), -1)
    matrix = matrix + torch.diag_embed(torch.cat([none, h[..., 1:]], -1), 1)
    flat = torch.zeros_like(slopes[..., :1])
    right = torch.cat([flat, 6.0 * slopes.diff(dim=-1), flat], -1)
    second = torch.linalg.solve(matrix, right[..., None])[..., 0]  # second derivatives at the knots
    low, high = second[..., :-1], second[..., 1:]
    columns = values[..., :-1], slopes - h * (2.0 * low + high) / 6.0, low / 2.0, (high - low) / (6.0 * h)
    return torch.stack(torch.broadcast_tensors(*columns), -1)


def as_complex(pairs: Tensor) -> Tensor:
    """Points (..., 2) as complex numbers (...)."""
    return torch.complex(pairs[..., 0], pairs[..., 1])


def as_pairs(numbers: Tensor) -> Tensor:
    """Complex numbers (...) as points (..., 2)."""
    return torch.stack([numbers.real, numbers.imag], -1)


def turning_bound(coefficients: Tensor, lengths: Tensor) -> Tensor:
    """Upper bound of the turn of each piece, (...) [rad]; coefficients (..., k) of the tangent angle."""
    return _horner(coefficients.detach().abs(), lengths.detach())


def turning_coefficients(coefficients: Tensor) -> Tensor:
    """Ascending coefficients of ∫u from the beginning of a piece, (..., p, k + 1)."""
    degrees = _degrees(1, coefficients.shape[-1] + 1, coefficients)
    return torch.cat([torch.zeros_like(coefficients[..., :1]), coefficients / degrees], -1)


def _begun(gains: Tensor) -> Tensor:
    """Sum of the gains before each piece, (..., p)."""
    return torch.cumsum(gains, -1) - gains


def _quadrature(turning: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
    """Nodes and weights over [0, 1]: an error below 1e-13 of a piece (measured with random polynomials to degree 4)."""
    bound = float(turning_bound(turning, lengths).max()) if may_look() else MOST_UNSEEN_TURN
    return _gauss(4 * int(np.ceil((12.0 + 1.05 * bound) / 4)), lengths.device)


@lru_cache(maxsize=64)
def _gauss(count: int, device: torch.device) -> tuple[Tensor, Tensor]:
    """Nodes and weights of Gauss-Legendre quadrature over [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return torch.tensor(0.5 + 0.5 * nodes, device=device), torch.tensor(0.5 * weights, device=device)


def _degrees(first: int, stop: int, like: Tensor) -> Tensor:
    return torch.arange(first, stop, dtype=like.dtype, device=like.device)


def _chord(tangent: Tensor, step: Tensor, nodes: Tensor, weights: Tensor) -> Tensor:
    """From the beginning of a piece to `step` beyond it, complex [mm]."""
    angle = _horner(tangent[..., None, :], step[..., None] * nodes)
    return step * torch.complex(torch.cos(angle) @ weights, torch.sin(angle) @ weights)


def _horner(coefficients: Tensor, x: Tensor) -> Tensor:
    value = coefficients[..., -1]
    for k in range(coefficients.shape[-1] - 2, -1, -1):
        value = torch.addcmul(coefficients[..., k], value, x)
    return value


def _raised(coefficients: Tensor, by: Tensor) -> Tensor:
    """The polynomials plus a constant."""
    return torch.cat([(coefficients[..., 0] + by)[..., None], coefficients[..., 1:]], -1)
