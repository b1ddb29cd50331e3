"""The curves of a design space: curvature, turning and points of surfaces, linear in their knot values.

Knots lie at equal distances over [-1, 1] times the half width of the surface, so that one constant matrix per kind of
curve serves every design.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.profile import Profile

Array = NDArray[np.float64]

_CELLS = 32  # at least this many over a surface
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, eq=False)
class Curve:
    """Matrices that take the free knot values (f,) of a surface to its curvature and turning, at half width 1.

    Attributes:
        symmetric: whether the curvature is even in s; then control, turning and turning_inside begin at s = 0.
        places: of the free knots, (f,), within [-1, 1].
        breaks: all knots, (p + 1,).
        pieces: to the coefficients of the curvature, (p, k, f).
        grid: borders of equal cells, all knots among them, 0 in the middle, (cells + 1,).
        control: to Bernstein coefficients of the curvature in every cell, which enclose it, (r, f).
        turning: to the turning from 0 to the grid, (cells + 1, f).
        turning_inside: to the turning from 0 to quadrature nodes inside the cells, (cells, 3, f).
        values: to the curvature on the grid, (cells + 1, f).
    """

    symmetric: bool
    places: Tensor
    breaks: Tensor
    pieces: Tensor
    grid: Tensor
    control: Tensor
    turning: Tensor
    turning_inside: Tensor
    values: Tensor

    def angles(self, knot_values: Tensor, half_width: Tensor) -> Tensor:
        """Turning from s = 0 to the grid, (..., cells + 1) [rad]; half width (...)."""
        turned = half_width[..., None] * (knot_values @ self.turning.T)
        return torch.cat([-turned[..., 1:].flip(-1), turned], -1) if self.symmetric else turned

    def points(self, knot_values: Tensor, angle: Tensor, half_width: Tensor) -> Tensor:
        """Grid points of child surfaces that start at 0 with a tangent angle (...), complex (..., cells + 1) [mm].

        Args:
            knot_values: convexities, (..., f) [1/mm]: the curvature is their negative.
            angle, half_width: (...) [rad, mm]; the angle is 0 if symmetric.
        """
        turning = half_width[..., None] * (knot_values @ self.turning_inside.flatten(0, 1).T)
        theta = (angle[..., None] - turning).unflatten(-1, (-1, len(_NODES)))
        weights = torch.as_tensor(0.5 * _WEIGHTS) * (self.grid[1] - self.grid[0])
        chords = half_width[..., None] * torch.complex(torch.cos(theta) @ weights, torch.sin(theta) @ weights)
        reached = torch.cat([torch.zeros_like(chords[..., :1]), chords.cumsum(-1)], -1)
        if self.symmetric:
            return torch.cat([-reached[..., 1:].conj().flip(-1), reached], -1)
        return reached - reached[..., len(self.grid) // 2, None]


@functools.lru_cache
def curve(knots: int, kind: str, symmetric: bool) -> Curve:
    """The curve through `knots` knots; if symmetric, the knots at s >= 0 are free."""
    breaks = np.linspace(-1.0, 1.0, knots)
    half = knots // 2
    free = np.abs(np.arange(knots)[:, None] - half) == np.arange(half + 1) if symmetric else np.eye(knots)
    make = Profile.spline if kind == "cubic" else Profile.samples
    profiles = [make(breaks, row) for row in np.asarray(free, float).T]
    degree = 3 if kind == "cubic" else 1
    cells = (knots - 1) * int(np.ceil(_CELLS / (knots - 1)))
    grid = np.linspace(-1.0, 1.0, cells + 1)
    grid[cells // 2] = 0.0
    nodes = 0.5 * (grid[:-1] + grid[1:])[:, None] + 0.5 * np.diff(grid)[:, None] * _NODES

    first = cells // 2 if symmetric else 0  # of the sampled cells

    def matrix(values: list[Array]) -> Tensor:
        return torch.as_tensor(np.stack(values, -1))

    return Curve(
        symmetric,
        torch.as_tensor(breaks[half:] if symmetric else breaks),
        torch.as_tensor(breaks),
        matrix([profile.coefficients for profile in profiles]),
        torch.as_tensor(grid),
        matrix([_bernstein(profile, grid[first:], degree) for profile in profiles]),
        matrix([profile.turning(grid[first:]) for profile in profiles]),
        matrix([profile.turning(nodes[first:]) for profile in profiles]),
        matrix([profile.curvature(grid) for profile in profiles]),
    )


def _bernstein(profile: Profile, grid: Array, degree: int) -> Array:
    """Bernstein coefficients of a curvature in every cell of the grid; coefficients on the borders once."""
    t = np.linspace(0.0, 1.0, degree + 1)
    binomials = np.array([1.0, 3.0, 3.0, 1.0]) if degree == 3 else np.ones(2)
    powers = np.arange(degree + 1)
    collocation = binomials * t[:, None] ** powers * (1.0 - t[:, None]) ** (degree - powers)
    values = profile.curvature(grid[:-1, None] + np.diff(grid)[:, None] * t)
    coefficients = values @ np.linalg.inv(collocation).T
    return np.concatenate([coefficients[:, :-1].ravel(), coefficients[-1:, -1]])
