"""Differentiable equilibria among walls: the compiled solver finds them, contact in tensors ties them to the walls."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.chain.wall_step import WallStep, new_wall_arrays
from rollingjoint.differentiable.contact import ContactsAtPose, PlanarWallProblem
from rollingjoint.differentiable.equilibria import Equilibria
from rollingjoint.differentiable.geometry import turned
from rollingjoint.differentiable.loads import cross, dot
from rollingjoint.differentiable.pairs import FIRM, WallProblem
from rollingjoint.differentiable.statics import ChainState
from rollingjoint.differentiable.surroundings import WallTensors, numeric
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.kernels.wall_contacts import PENALTY

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Among:
    """The walls around a batch, whose rows are flattened to B, and where its bases are.

    Args:
        surroundings: with leading axes of the batch, or none. base: poses, (..., 3), in space (..., 6) [mm, rad].
        before: the memory of contacts, with one axis of B, for a step with friction of walls.
        past: the state before such a step.
        after: the memory after it; problem: the contacts at the equilibria; None before the solve.
    """

    surroundings: WallTensors
    base: Tensor
    before: Any = None
    past: Any = None
    after: Any = None
    problem: WallProblem | None = None

    @property
    def leading(self) -> list[torch.Size]:
        """The leading axes of every tensor."""
        return [*self.surroundings.leading, self.base.shape[:-1]]

    @property
    def rows(self) -> int:
        """B."""
        return self.base.shape[:-1].numel()

    @property
    def single(self) -> bool:
        """Whether the walls have no leading axes."""
        return not any(len(axes) for axes in self.surroundings.leading)

    def usable(self) -> Tensor:
        """Whether the numbers of a row are valid, (...)."""
        return self.surroundings.usable() & (self.base.detach().abs() <= LARGEST_INPUT).all(-1)

    def expanded(self, batch: tuple[int, ...]) -> Among:
        """With the axes of a batch; raises InvalidInput for a history of other rows."""
        around, rows = self.surroundings, int(np.prod(batch))
        if self.before is not None and len(self.before.normals) != rows:
            expected = f"{rows}, as of this batch, for friction of walls"
            raise InvalidInput("rows of the history", len(self.before.normals), expected)
        if not self.single:
            around = around.each(lambda tensor, axes: tensor.expand(*batch, *tensor.shape[tensor.ndim - axes :]))
        return replace(self, surroundings=around, base=self.base.expand(*batch, self.base.shape[-1]))

    def arrays(self, rows: Indices, n_joints: int) -> Any:
        """The walls of some rows of the batch, as kernels take them, with what they remember."""
        walls = numeric(self.surroundings.tables(), self.surroundings.rigid)
        which = np.zeros(len(rows), np.int64) if self.single else rows
        base = np.ascontiguousarray(self.base.detach().reshape(self.rows, -1).numpy()[rows])
        arrays = new_wall_arrays(walls, which, base, n_joints)
        for values, mine in zip(arrays.before, self.before or (), strict=False):
            values[:] = mine.detach().numpy()[rows]
        return arrays

    def solved(
        self,
        n_joints: int,
        rows: Indices,
        good: NDArray[np.bool_],
        step: WallStep | None = None,
        touched: Sequence[Array] = (),
    ) -> Among:
        """With the contacts at the equilibria.

        Args:
            rows: of the batch that were solved. good: those of the batch with an equilibrium, (B,).
            step: their results. touched: what contact remembers after it.
        """
        kind = self.surroundings.problem
        blank = self.arrays(np.zeros(self.rows, np.int64), n_joints).after
        for whole, values in zip(blank, touched, strict=False):
            whole[rows] = values
        gaps = np.zeros_like(blank.normals)
        normals = np.zeros_like(gaps)
        if step is not None:
            normals[rows], gaps[rows] = step.normals, step.gaps
        presses = normals > 0.0
        remembered = np.zeros_like(presses) if self.before is None else self.before.normals.detach().numpy() > 0.0
        nothing = [torch.zeros(values.shape, dtype=torch.float64) for values in blank]
        problem = kind(
            tables=self.surroundings.tables(),
            which=np.zeros(self.rows, np.int64) if self.single else np.arange(self.rows),
            rigid=self.surroundings.rigid,
            rubs=self.before is not None,
            chosen=(presses | remembered) & good[:, None],
            before=self.before or kind.memory_class(*nothing),
            multipliers=torch.as_tensor(normals + PENALTY * FIRM * np.where(presses, gaps, 0.0)),
        )
        return replace(self, after=kind.memory_class(*map(torch.as_tensor, blank)), problem=problem)

    def tied(self) -> Among:
        """With tensors that depend on the parameters of the walls, and on the steps before."""
        assert self.problem is not None
        problem = replace(self.problem, tables=self.surroundings.tables())
        if self.before is not None and self.past is not None:
            problem = replace(problem, before=self.past.recalled(problem.chosen, self.before))
        return replace(self, problem=problem)


@dataclass(frozen=True)
class LinearContact:
    """Contact of B chains as a linear law of the motion of their links, about poses (B, n, 3) [mm, rad].

    Fields: forces (B, n, 4) and rates (B, n, 3, 3) there, as ContactsAtPose has them.
    """

    forces: Tensor
    rates: Tensor
    poses: Tensor

    def at(self, positions: Tensor, angles: Tensor) -> ContactsAtPose:
        """Contact at poses nearby: origins (B, n, 2) [mm] and angles (B, n) [rad]; nothing of single candidates."""
        place = self.poses[..., :2]
        turn, (dx, dy) = angles - self.poses[..., 2], (positions - place).unbind(-1)
        motion = torch.stack([dx + turn * place[..., 1], dy - turn * place[..., 0], turn], -1)
        changed = self.forces[..., :3] - (self.rates * motion[..., None, :]).sum(-1)
        fx, fy, _, along = self.forces.unbind(-1)
        levers = motion[..., 0] * fy - motion[..., 1] * fx - turn * along  # the forces move with the links
        changed = changed + torch.nn.functional.pad(levers[..., None], (2, 0))
        none = self.forces.new_zeros(len(self.forces), 0)
        return ContactsAtPose(torch.cat([changed, self.forces[..., 3:]], -1), self.rates, *[none] * 5)


@dataclass(frozen=True)
class PinnedWalls:
    """Walls around a batch of B as forces on its links, in the frame of the base: base is (B, 3) zeros."""

    base: Tensor
    problem: LinearContact


@dataclass(frozen=True)
class WalledState(ChainState):
    """The chain among walls at joint angles phi; among: the walls, with the candidates that press."""

    among: Among | PinnedWalls

    @cached_property
    def contact(self) -> ContactsAtPose:
        """Contact with the walls, rows flattened."""
        assert self.among.problem is not None
        return self._contact_in(self.among.problem)

    def _contact_in(self, problem: Any) -> ContactsAtPose:
        batch, n = self.among.base.shape[:-1], self.link_angles.shape[-1]
        places, angles = self.in_world(self.positions), self.link_angles + self.among.base[..., 2:]
        return problem.at(
            torch.view_as_real(places).expand(*batch, n, 2).reshape(-1, n, 2), angles.expand(*batch, n).reshape(-1, n)
        )

    def in_world(self, points: Tensor) -> Tensor:
        """Points in the frame of the base, complex (..., k), in the frame of the walls."""
        x, y, angle = self.among.base[..., None].unbind(-2)
        return torch.complex(x, y) + turned(angle) * points

    def recalled(self, chosen: NDArray[np.bool_], memory: Any) -> Any:
        """A memory of this pose with the gradients of the ways, where candidates are chosen."""
        assert isinstance(self.among.problem, PlanarWallProblem)
        there = self._contact_in(replace(self.among.problem, chosen=chosen)).slips
        return memory._replace(slips=memory.slips + there - there.detach())

    def rows(self, values: Tensor) -> Tensor:
        """Values (B, ...) with the axes of the batch."""
        return values.reshape((*self.among.base.shape[:-1], *values.shape[1:]))

    @cached_property
    def wall_forces(self) -> Tensor:
        """On every link, x, y, moment about its origin, base frame, (..., n, 3) [N, N·mm]."""
        fx, fy, moment, _ = self.rows(self.contact.forces).unbind(-1)
        force, places = torch.complex(fx, fy), self.in_world(self.positions)
        turned_back = force * turned(-self.among.base[..., 2:])
        return torch.stack([turned_back.real, turned_back.imag, moment - cross(places, force)], -1)

    @cached_property
    def _beyond(self) -> Tensor:
        """Sums of ContactsAtPose.forces on the links beyond every joint, (..., J, 4)."""
        return self.rows(self.contact.forces).flip(-2).cumsum(-2).flip(-2)[..., 1:, :]

    @cached_property
    def residual(self) -> Tensor:
        """r, (..., J) [N·mm]."""
        fx, fy, moment, _ = self._beyond.unbind(-1)
        own = super().residual
        return own - (moment - cross(self.in_world(self.contacts), torch.complex(fx, fy)))

    @property
    def outer_forces(self) -> Tensor:
        """Forces of loads and walls beyond every joint, complex (..., J) [N]."""
        fx, fy, *_ = self._beyond.unbind(-1)
        return super().outer_forces + torch.complex(fx, fy) * turned(-self.among.base[..., 2:])

    @cached_property
    def stiffness(self) -> Tensor:
        """H = dr/dphi, (..., J, J) [N·mm/rad]."""
        rates = self.rows(self.contact.rates)
        beyond = rates.flip(-3).cumsum(-3).flip(-3)[..., 1:, :, :]
        contacts = self.in_world(self.contacts)
        turn = torch.stack([contacts.imag, -contacts.real, torch.ones_like(contacts.real)], -1)
        joints, (fx, fy, _, along) = torch.arange(turn.shape[-2]), self._beyond.unbind(-1)
        later = torch.maximum(joints[:, None], joints)
        dead = (along - dot(contacts, torch.complex(fx, fy)))[..., later]  # as of loads of constant direction
        return (
            super().stiffness + dead + torch.einsum("...ia,...imab,...mb->...im", turn, beyond[..., later, :, :], turn)
        )


class WalledEquilibria(Equilibria):
    """Equilibria of a batch among walls; as `Equilibria`, with contact as `rollingjoint.Equilibrium` has it.

    Gradients flow to the walls, to the base, and through the history. Poses are in the frame of the base.
    """

    @property
    def walled(self) -> Any:
        """The chains among their walls."""
        return self._state

    @property
    def wall_memory(self) -> Any:
        """What contact remembers, for the next step, with one axis of all rows."""
        after, contact = self.walled.among.after, self.walled.contact
        tied = {name: getattr(contact, name) for name in ("states", "normals")}
        return after._replace(**{name: getattr(after, name) + t - t.detach() for name, t in tied.items()})

    @cached_property
    def wall_forces(self) -> Tensor:
        """(..., n, 3) force of the walls on every link, x, y, and moment about its origin, base frame [N, N·mm]."""
        return self._shown(self.walled.wall_forces)

    @property
    def insertion_force(self) -> Tensor:
        """(...) force that drives the base forwards against the walls, along its y axis [N]."""
        return -self.wall_forces[..., 1].sum(-1)

    @property
    def wall_gaps(self) -> Tensor:
        """(..., candidates) gaps of the contacts that press, 0 of others [mm]."""
        return self._of_candidates("gaps") * (self.wall_normals.detach() > 0.0)

    @property
    def wall_normals(self) -> Tensor:
        """(..., candidates) normal forces [N]."""
        return self._of_candidates("normals")

    @property
    def wall_states(self) -> Tensor:
        """(..., candidates) friction states, -1 to 1: a contact between both sticks."""
        return self._of_candidates("states") * (self.wall_normals.detach() > 0.0)

    @property
    def dissipated_work(self) -> Tensor:
        """(...) energy that friction dissipated in the step since the history, at walls and in holes [N·mm]."""
        walled = self.walled
        before = walled.among.problem.before
        work = 0.5 * (walled.contact.normals + before.normals) * walled.contact.works
        return super().dissipated_work + self._shown(walled.rows(work.sum(-1))) * self.ok

    def _of_candidates(self, name: str) -> Tensor:
        return self._shown(self.walled.rows(getattr(self.walled.contact, name)))
