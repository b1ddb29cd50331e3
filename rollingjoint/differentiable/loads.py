"""Loads on the differentiable chain: the columns of load tables, and their energy, forces and stiffness at a pose.

The plane is the complex plane: x + iy. All tensors have leading axes, and all results have derivatives by all inputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import torch
from torch import Tensor

from rollingjoint.differentiable.looking import seen
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.load import LOAD_COLUMNS


class AnyLoads:
    """Load tables, (..., rows, columns), by columns: all that the plane and space have in common.

    Args:
        table: with the columns of the class.
        n_joints: of the chain.

    Attributes of its class:
        columns: names of the columns.
        turning: columns of the forces that turn with a link.
    """

    columns: ClassVar[tuple[str, ...]]
    turning: ClassVar[tuple[str, ...]]

    def __init__(self, table: Tensor, n_joints: int) -> None:
        self.table = table
        self.joints = torch.arange(n_joints, device=table.device)
        self.later = torch.maximum(self.joints[:, None], self.joints)  # of every two joints
        self.links, self.beyond = self._link("link")
        self.springs, self.torsions, self.rests = map(self._number, ("k", "torsion", "rest"))
        self.others, beyond_other = self._link("other")
        self.between = self.beyond - beyond_other  # signs with which joint angles turn a torsion spring
        self.any = table.shape[-2] > 0
        self.follow, self.pull, self.twist = map(self._acts, (self.turning, ("k",), ("torsion",)))

    def of_links(self, values: Tensor, links: Tensor | None = None) -> Tensor:
        """Values (..., n) of the loaded links, or of other links (..., rows): (..., rows)."""
        return values.gather(-1, (self.links if links is None else links).expand(*values.shape[:-1], -1))

    def sums(self, values: Tensor) -> Tensor:
        """Sum of values (..., rows) over the loads beyond every joint, (..., J)."""
        return (values[..., None] * self.beyond).sum(-2)

    def twists(self, link_angles: Tensor) -> Tensor:
        """Turn of the torsion spring of every row from rest, (..., rows) [rad]; angles (..., n)."""
        return self.of_links(link_angles) - self.of_links(link_angles, self.others) - self.rests

    def twisting(self, twists: Tensor) -> Tensor:
        """Sum of the moments of the torsion springs that turn every joint back, (..., J) [N·mm]."""
        return ((self.torsions * twists)[..., None] * self.between).sum(-2)

    def twisting_stiffness(self) -> Tensor:
        """Contribution of the torsion springs to H, (..., J, J)."""
        return (self.torsions[..., None] * self.between).mT @ self.between

    @property
    def symmetric(self) -> bool:
        """Whether the stiffness is symmetric."""
        return not bool(self.without_potential().any())

    def without_potential(self) -> Tensor:
        """Where a load has no potential, since it turns with its link, (...)."""
        return torch.stack([self._number(name) != 0 for name in self.turning]).any(0).any(-1)

    def _number(self, name: str) -> Tensor:
        return self.table[..., self.columns.index(name)]

    def _link(self, name: str) -> tuple[Tensor, Tensor]:
        """Links of a column, (..., rows), and whether they lie beyond every joint, (..., rows, J) of 0 and 1."""
        links = self._number(name).detach().long()
        return links, (links[..., None] > self.joints).to(self.table.dtype)

    def _acts(self, names: Sequence[str]) -> bool:
        """Whether a column is not zero, or may be differentiated by."""
        if self.table.requires_grad:
            return True
        return any(seen((self._number(name) != 0).any(), True) for name in names)


class Loads(AnyLoads):
    """Load tables in the plane; complex where they are points or forces.

    Args:
        table: columns load.LOAD_COLUMNS.
        n_joints: of the chain.
        only_dead: let dead forces and moments alone act, whatever else the table has.
    """

    columns = LOAD_COLUMNS
    turning = ("bx", "by")

    def __init__(self, table: Tensor, n_joints: int, only_dead: bool = False) -> None:
        self._only_dead = only_dead
        super().__init__(table, n_joints)
        self.points, self.dead, self.body, self.anchors = map(self._pair, ("p", "f", "b", "a"))
        self.moments = self._number("moment")

    def dead_alone(self) -> Tensor:
        """Where dead forces and moments act alone, and all numbers are in range, (...)."""
        others = torch.stack([self._number(name) == 0.0 for name in (*self.turning, "k", "torsion")]).all(0)
        return (others & (self.table.abs() <= LARGEST_INPUT).all(-1)).all(-1)

    def _pair(self, letter: str) -> Tensor:
        return torch.complex(self._number(f"{letter}x"), self._number(f"{letter}y"))

    def _acts(self, names: Sequence[str]) -> bool:
        return not self._only_dead and super()._acts(names)


@dataclass(frozen=True)
class LoadsAtPose:
    """Loads on a chain at one pose.

    Args:
        loads: load tables.
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
        """Point, force and follower part of the force of every row of the load table, (..., rows)."""
        loads, turn = self.loads, self.loads.of_links(self.rotations)
        x = loads.of_links(self.positions) + turn * loads.points
        force, follower = loads.dead.expand_as(x), x
        if loads.follow:
            follower = turn * loads.body
            force = force + follower
        return x, force + loads.springs * (loads.anchors - x) if loads.pull else force, follower

    @cached_property
    def _twists(self) -> Tensor:
        return self.loads.twists(self.link_angles)

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
        return moments - self.loads.twisting(self._twists)

    def stiffness(self) -> Tensor:
        """Contribution of the loads to H, (..., J, J), without the moving contact of each joint itself."""
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
            H = H + loads.twisting_stiffness()
        return H

    def energies(self) -> Tensor:
        """Potential energy of every row, (..., rows) [N·mm]; follower forces have none."""
        loads, x = self.loads, self._acting[0]
        work = -dot(loads.dead, x) - loads.moments * loads.of_links(self.link_angles)
        if loads.pull:
            offset = loads.anchors - x
            work = work + 0.5 * loads.springs * dot(offset, offset)
        if loads.twist:
            work = work + 0.5 * loads.torsions * self._twists.square()
        return work


def dot(a: Tensor, b: Tensor) -> Tensor:
    """Scalar product of vectors in the complex plane."""
    return a.real * b.real + a.imag * b.imag


def cross(a: Tensor, b: Tensor) -> Tensor:
    """Cross product of vectors in the complex plane."""
    return a.real * b.imag - a.imag * b.real
