"""A flat wall that hides: its numbers and their ranges, its effects on a chain, and histories beside it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.batch import PinnedAmongWalls
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.wall_step import WallStep, new_wall_arrays
from rollingjoint.checks import as_range
from rollingjoint.estimate import contact_kernels
from rollingjoint.estimate.arrays import MeasurementLaw, MotorHistory, Track
from rollingjoint.estimate.hidden import HiddenPrior, Range
from rollingjoint.estimate.smoother import FollowedChain
from rollingjoint.estimate.surfaces import surface_tables
from rollingjoint.kernels.walled_solve import WallArrays
from rollingjoint.kernels.walls import STIFFNESS, Walls
from rollingjoint.surroundings import HalfPlane, Outline, Sleeve, Surroundings
from rollingjoint.surroundings.walls import STIFFNESSES

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

DIRECTION, OFFSET, COMPLIANCE, N_WALL = range(4)
"""The numbers of a wall: angle of its normal [rad], offset along that [mm], compliance [mm/N]."""

COMPLIANCES = 1.0 / STIFFNESSES[1], 1.0 / STIFFNESSES[0]  # mm/N
HELD = 1  # index of the prior with a given direction
_NARROW = 1e-9  # width of a range of one number
_FIRST_COLUMN = 3  # of the law of a plane, behind normal and offset


@dataclass(frozen=True)
class WallRanges:
    """Ranges of a flat wall that a chain may touch; each number in them is as likely before any measurement.

    Args:
        direction: angles of the normal, which points to the free side, from the x axis [rad].
        offset_mm: where the wall is along the normal, from the tip of the straight chain: points x are free where
            normal · (x - tip) >= offset [mm].
        compliance: depth per normal force, of every point of the outline [mm/N].
    Raises:
        InvalidInput: a range that is none.
    """

    direction: Range = (-math.pi, math.pi)
    offset_mm: Range = (-50.0, 0.0)
    compliance: Range = (0.2, 2.0)

    def __post_init__(self) -> None:
        for name, low, high in (
            ("direction", -2.0 * math.pi, 2.0 * math.pi),
            ("offset_mm", -1e6, 1e6),
            ("compliance", *COMPLIANCES),
        ):
            as_range(name, getattr(self, name), low=low, high=high)

    @property
    def ends(self) -> tuple[Array, Array]:
        """Lowest and highest numbers, (3,) each."""
        low, high = np.transpose([self.direction, self.offset_mm, self.compliance])
        return low, np.maximum(high, low + _NARROW)

    def prior(self, chain: HiddenPrior) -> HiddenPrior:
        """The prior of a chain, with the numbers of the wall behind it."""
        low, high = self.ends
        return replace(
            chain,
            layout=chain.layout._replace(total=chain.layout.surfaces + N_WALL),
            means=np.concatenate([chain.means, 0.5 * (low + high)]),
            sds=np.concatenate([chain.sds, (high - low) / math.sqrt(12.0)]),
            low=np.concatenate([chain.low, low]),
            high=np.concatenate([chain.high, high]),
        )


class Touching(NamedTuple):
    """How a wall presses on R chains: the sum of all contacts, at its mean place."""

    force: Array  # (R, 2) N
    place: Array  # on the wall, (R, 2) mm; NaN without contact
    link: NDArray[np.int64]  # that is pressed most; 0: none


class WallAround:
    """A wall around a chain, and how the chain meets it: for rows of numbers of the wall."""

    def __init__(self, chain: RollingChain, outline: Outline | None = None) -> None:
        self.chain = chain
        self._one = Surroundings([HalfPlane((1.0, 0.0))], outline or Sleeve()).arrays(chain)
        self.rest: Array = chain.poses(chain.neutral_angles)[-1, :2]  # about it walls of other directions are turned

    def arrays(self, numbers: Array, acts: Array | float = 1.0) -> WallArrays:
        """The walls of rows, (R, 3); they act where `acts`, (R,) or a number, is not 0."""
        rows = len(numbers)
        walls = Walls(*(np.repeat(array, rows, axis=0) for array in self._one))
        normals = np.stack([np.cos(numbers[:, DIRECTION]), np.sin(numbers[:, DIRECTION])], axis=1)
        walls.planes[:, 0, :2], walls.planes[:, 0, 2] = normals, numbers[:, OFFSET] + normals @ self.rest
        walls.planes[:, 0, _FIRST_COLUMN + STIFFNESS] = acts / numbers[:, COMPLIANCE]
        return new_wall_arrays(walls, np.arange(rows), np.zeros((rows, 3)), self.chain.n_joints)

    def torques(self, numbers: Array, results: Any, walls: WallArrays) -> Array:
        """Derivatives of the wall's torques at the joints by its numbers, (R, J, 3), at equilibria.

        A point x presses with N = (offset + radius - n · (x - rest)) / c, and with torque N n · dx/dφ.
        """
        points = self._one.points[0]
        links, normals = points[:, 0].astype(int), walls.after.normals
        poses = results.poses[:, links]
        cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
        x = poses[..., 0] + cos * points[:, 1] - sin * points[:, 2]
        y = poses[..., 1] + sin * points[:, 1] + cos * points[:, 2]
        n = np.stack([np.cos(numbers[:, DIRECTION]), np.sin(numbers[:, DIRECTION])])[..., None, None]
        below = np.arange(self.chain.n_joints) < links[:, None]
        dx = np.where(below, results.contacts[:, None, :, 1] - y[..., None], 0.0)
        dy = np.where(below, x[..., None] - results.contacts[:, None, :, 0], 0.0)
        across, along = n[0] * dx + n[1] * dy, n[0] * dy - n[1] * dx
        compliance = numbers[:, None, None, COMPLIANCE]
        stiffness = np.where(normals > 0.0, 1.0, 0.0)[..., None] / compliance
        nearer = n[1] * (x - self.rest[0])[..., None] - n[0] * (y - self.rest[1])[..., None]  # d(-n · x) / d direction
        force = normals[..., None]
        by_direction = stiffness * nearer * across + force * along
        parts = by_direction, stiffness * across, -force / compliance * across
        return np.stack([part.sum(axis=1) for part in parts], axis=-1)

    def touching(self, equilibria: Any) -> Touching:
        """How the wall presses at equilibria of a batch."""
        links = self._one.points[0, :, 0].astype(int)
        normals = equilibria.walls.normals
        _, places = equilibria.walls.touched(equilibria._designs, equilibria.joint_angles)
        total, pressed = normals.sum(axis=1), np.zeros((len(normals), self.chain.n_links))
        np.add.at(pressed.T, links, normals.T)
        with np.errstate(invalid="ignore"):
            place = (normals[..., None] * places[..., :2]).sum(axis=1) / total[:, None]
        return Touching(equilibria.wall_forces[..., :2].sum(axis=1), place, pressed.argmax(axis=1))


class FollowedAmongWall(FollowedChain):
    """A chain beside a wall, along whose rows histories are followed; the prior has the wall's numbers last.

    Attributes:
        pivots: of the rows that were followed last, where the tip was when the wall pressed, on average, from where it
            is at rest, (R, 2) [mm].
    """

    def __init__(self, around: WallAround, prior: HiddenPrior, law: MeasurementLaw, steps: int) -> None:
        chain, bare = around.chain, prior.layout._replace(total=prior.layout.surfaces)
        held = replace(prior, sds=prior.sds.copy())
        held.sds[prior.layout.surfaces + DIRECTION] = 0.0
        super().__init__(chain, [prior, held], law, surface_tables(chain, bare, law.start_tension), steps)
        self.around, self.pivots = around, np.zeros((0, 2))

    def follow(self, track: Track, history: MotorHistory) -> None:
        """Follow rows to the last step of their histories; `pivots` are where the wall has pressed, on average."""
        rows, at = len(track.steps), self.model.at
        pressed = np.zeros((rows, 3))
        shown = self.model.law.shown_sd < math.inf
        while rows:
            batch: Any = self._solver(rows)[0]
            if not contact_kernels.prepare_rows(self.model, history, track, batch):
                break
            numbers = track.numbers[:, at.surfaces :]
            walls = self.around.arrays(numbers, np.where(shown & (track.steps == 0), 0.0, 1.0))
            PinnedAmongWalls(batch, walls)(0, rows)
            stiffnesses = self._stiffnesses(batch, walls)
            by_wall = self.around.torques(numbers, batch.results, walls)
            total = walls.after.normals.sum(axis=1)
            pressed += total[:, None] * np.insert(batch.results.poses[:, -1, :2], 2, 1.0, axis=1)
            contact_kernels.take_in_rows(self.model, history, track, batch, stiffnesses, by_wall)

        away = pressed[:, :2] - pressed[:, 2:] * self.around.rest
        self.pivots = np.divide(away, pressed[:, 2:], out=np.zeros((rows, 2)), where=pressed[:, 2:] > 0.0)

    def _stiffnesses(self, batch: Any, walls: WallArrays) -> Array:
        """d residual / d joint angle, (R, J, J) [N·mm/rad]."""
        results = type(batch.results)(*(values.view() for values in batch.results))
        step = WallStep.of(walls, False)
        solution = type(self.chain).equilibrium.of_results(self.chain, batch.loads.view(), results, walls=step)
        return np.ascontiguousarray(solution.stiffness)
