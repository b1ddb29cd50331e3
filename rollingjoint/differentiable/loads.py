"""Loads on the differentiable chain: the columns of load tables, and their energy, forces and stiffness at a pose.

The plane is the complex plane: x + iy. Everything has leading axes and is differentiable by everything.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from rollingjoint.differentiable.looking import seen
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.load import LOAD_COLUMNS

_COLUMN = {name: i for i, name in enumerate(LOAD_COLUMNS)}
_BESIDES_DEAD = ("bx", "by"), ("k",), ("torsion",)  # what follows its link, pulls, twists: 0 where nothing does


class Loads:
    """Load tables, (..., rows, columns), by columns; complex where they are points or forces.

    Args:
        table: columns load.LOAD_COLUMNS.
        n_joints: of the chain.
        only_dead: nothing but dead forces and moments is to act, whatever else the table has.
    """

    def __init__(self, table: Tensor, n_joints: int, only_dead: bool = False) -> None:
        self.table = table
        self.joints = torch.arange(n_joints, device=table.device)
        self.later = torch.maximum(self.joints[:, None], self.joints)  # of every two joints
        self.links, self.beyond = self._link("link")
        self.points, self.dead, self.body, self.anchors = map(self._pair, ("p", "f", "b", "a"))
        self.moments, self.springs = map(self._number, ("moment", "k"))
        self.torsions, self.rests = map(self._number, ("torsion", "rest"))
        self.others, beyond_other = self._link("other")
        self.between = self.beyond - beyond_other  # the turns of which joints a torsion spring sees, and their signs
        self.any = table.shape[-2] > 0
        self.follow, self.pull, self.twist = (not only_dead and self._acts(*names) for names in _BESIDES_DEAD)

    def of_links(self, values: Tensor, links: Tensor | None = None) -> Tensor:
        """What the loaded links, or others (..., rows), have, (..., rows), of values (..., n)."""
        return values.gather(-1, (self.links if links is None else links).expand(*values.shape[:-1], -1))

    def sums(self, values: Tensor) -> Tensor:
        """Sum of values (..., rows) over the loads beyond every joint, (..., J)."""
        return (values[..., None] * self.beyond).sum(-2)

    @property
    def symmetric(self) -> bool:
        """Whether the stiffness is symmetric: no force turns with its link."""
        return bool((self.body == 0).all())

    def without_potential(self) -> Tensor:
        """Where a force turns with its link, (...)."""
        return (self.body != 0).any(-1)

    def dead_alone(self) -> Tensor:
        """Where nothing but dead forces and moments acts, and all numbers are in range, (...)."""
        others = torch.stack([self._number(name) == 0.0 for names in _BESIDES_DEAD for name in names]).all(0)
        return (others & (self.table.abs() <= LARGEST_INPUT).all(-1)).all(-1)

    def _number(self, name: str) -> Tensor:
        return self.table[..., _COLUMN[name]]

    def _pair(self, letter: str) -> Tensor:
        return torch.complex(self._number(f"{letter}x"), self._number(f"{letter}y"))

    def _link(self, name: str) -> tuple[Tensor, Tensor]:
        """Links of a column, (..., rows), and whether they lie beyond every joint, (..., rows, J) of 0 and 1."""
        links = self._number(name).detach().long()
        return links, (links[..., None] > self.joints).to(self.table.dtype)

    def _acts(self, *names: str) -> bool:
        """Whether a column is not zero, or may be differentiated by."""
        if self.table.requires_grad:
            return True
        return any(seen((self._number(name) != 0).any(), True) for name in names)


@dataclass(frozen=True)
class LoadsAtPose:
    """Loads on a chain at one pose.

    Args:
        loads: what acts.
        positions, rotations: origin of every link, and exp(i angle), complex (..., n).
        link_angles: (..., n) [rad].
        contacts: contact points, complex (..., J) [mm].
    """

    loads: Loads
    positions: Tensor
    rotations: Tensor
    link_angles: Tensor
    contacts: Tensor

    @cached_property
    def _acting(self) -> tuple[Tensor, Tensor, Tensor]:
        """Of every row of the load table where it acts, its force, its part that follows, if any does; (..., rows)."""
        loads, turn = self.loads, self.loads.of_links(self.rotations)
        x = loads.of_links(self.positions) + turn * loads.points
        force, follower = loads.dead.expand_as(x), x
        if loads.follow:
            follower = turn * loads.body
            force = force + follower
        return x, force + loads.springs * (loads.anchors - x) if loads.pull else force, follower

    @cached_property
    def _twists(self) -> Tensor:
        """By how much the torsion spring of every row is turned from rest, (..., rows) [rad]."""
        loads, angles = self.loads, self.link_angles
        return loads.of_links(angles) - loads.of_links(angles, loads.others) - loads.rests

    @cached_property
    def forces(self) -> Tensor:
        """Sums of the forces beyond every joint, complex (..., J)."""
        return self.loads.sums(self._acting[1])

    @cached_property
    def moments(self) -> Tensor:
        """M: moment of the loads beyond every joint about its contact, (..., J) [N·mm]."""
        x, force, _ = self._acting
        about_base = self.loads.sums(cross(x, force) + self.loads.moments)
        moments = about_base - cross(self.contacts, self.forces)
        if not self.loads.twist:
            return moments
        return moments - ((self.loads.torsions * self._twists)[..., None] * self.loads.between).sum(-2)

    def stiffness(self) -> Tensor:
        """What the loads add to H, (..., J, J), the moving contact of each joint itself left out."""
        (x, f, follower), c, loads = self._acting, self.contacts, self.loads
        later, ci, cm = loads.later, c[..., :, None], c[..., None, :]
        H = (loads.sums(dot(x, f)) - dot(c, self.forces))[..., later]
        if loads.follow:
            H = H - loads.sums(dot(x, follower))[..., later] + dot(ci, loads.sums(follower)[..., later])
        if loads.pull:
            k = loads.springs
            zeroth, first, second = (loads.sums(k * v)[..., later] for v in (torch.ones_like(k), x, dot(x, x)))
            H = H + second - dot(first, ci + cm) + zeroth * dot(ci, cm)
        if loads.twist:
            H = H + (loads.torsions[..., None] * loads.between).mT @ loads.between
        return H

    def energies(self) -> Tensor:
        """Potential energy of every row, (..., rows) [N·mm]; follower forces have none."""
        loads, x = self.loads, self._acting[0]
        work = -dot(loads.dead, x) - loads.moments * loads.of_links(self.link_angles)
        if loads.pull:
            away = loads.anchors - x
            work = work + 0.5 * loads.springs * dot(away, away)
        if loads.twist:
            work = work + 0.5 * loads.torsions * self._twists.square()
        return work


def dot(a: Tensor, b: Tensor) -> Tensor:
    """Scalar product of vectors in the complex plane."""
    return a.real * b.real + a.imag * b.imag


def cross(a: Tensor, b: Tensor) -> Tensor:
    """Cross product of vectors in the complex plane."""
    return a.real * b.imag - a.imag * b.real
