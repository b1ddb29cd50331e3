"""Equilibria of spatial hinge chains: what a solve returns, and the lanes of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from rollingjoint._numba.jit import direct, machine_code
from rollingjoint.errors import InvalidInput
from rollingjoint.kernels.shared.arrays import TendonLaw
from rollingjoint.kernels.spatial.arrays import HingeResults, Hinges, new_hinge_results
from rollingjoint.kernels.spatial.batch import hinge_stiffness_of, solve_hinge_lanes
from rollingjoint.solution import Solution, Status
from rollingjoint.spatial.chain import HingeChain
from rollingjoint.threads import run_lanes

Array = NDArray[np.float64]
Mechanism = HingeChain | tuple[HingeChain, ...]


@dataclass(frozen=True, eq=False, repr=False)
class HingeEquilibrium(Solution):
    """One equilibrium, or many with a leading axis B on every array.

    Attributes:
        mechanism: the chain that was solved, or a tuple of them, one per lane.
        loads: load table, (rows, columns), columns load.SPATIAL_LOAD_COLUMNS.
        joint_angles: (n - 1,) angle of every hinge [rad].
        poses: (n, 4, 4) link frames in the base frame [mm].
        tensions: (m,) [N]. lengths: (m,) tendon lengths [mm].
        tendon_rates: (n - 1, m) d length / d joint angle [mm/rad].
        tendon_torques: (n - 1, m) d residual / d tension; tendon_rates unless the tendons are end couples [mm].
        tendon_stiffness: (m,) d tension / d length [N/mm]: zero for a prescribed tension, a slack or a yielding tendon.
        residual: largest hinge moment that is not balanced, hinges at their limit left out [N·mm].
        iterations: Newton steps. status: Status, or (B,) integers.
        escapes: unstable equilibria that the solver met and left downhill. Not 0: the arm has buckled, and where it
            buckled to is one of several.
    """

    mechanism: Mechanism
    loads: Array
    joint_angles: Array
    poses: Array
    tensions: Array
    lengths: Array
    tendon_rates: Array
    tendon_torques: Array
    tendon_stiffness: Array
    residual: float | Array
    iterations: int | NDArray[np.int64]
    status: Status | NDArray[np.int64]
    escapes: int | NDArray[np.int64]

    @property
    def tip(self) -> Array:
        """Origin of the last link: the middle of the last distal face, (3,) [mm]."""
        return self.poses[..., -1, :3, 3]

    @property
    def positions(self) -> Array:
        """Origins of the links, (n, 3) [mm]; hinge i is at the origin of link i."""
        return self.poses[..., :3, 3]

    @property
    def rotations(self) -> Array:
        """Rotation matrices of the links, (n, 3, 3)."""
        return self.poses[..., :3, :3]

    @property
    def torques_per_tension(self) -> Array:
        """(n - 1, m) d residual / d tension [mm]."""
        return self.tendon_torques

    @property
    def pose_jacobian(self) -> Array:
        """(n, 6, n - 1) d link poses (x, y, z, rotation vector), base frame, / d joint angles [mm/rad, 1]."""
        n = self.poses.shape[-3]
        arm = self.positions[..., :, None, :] - self.positions[..., None, :-1, :]
        return self._twists(arm) * np.tri(n, n - 1, -1)[:, None]  # hinge i moves link k > i

    def point_jacobian(self, link: int, point: Sequence[float] | None = None) -> Array:
        """(6, n - 1) d (x, y, z, rotation vector) of a body point [mm], default the link's origin, / d joint angles."""
        body = np.zeros(3) if point is None else np.asarray(point, float)
        at = self.positions[..., link, :] + self.rotations[..., link, :, :] @ body
        jacobian = self._twists(at[..., None, :] - self.positions[..., :-1, :])
        return jacobian * (np.arange(jacobian.shape[-1]) < link)

    def _twists(self, arm: Array) -> Array:
        """Velocity at the end of an arm from every hinge, (..., n - 1, 3), and angular velocity, (..., 6, n - 1)."""
        chain, designs = self._designs
        axes = chain.axes[designs].reshape(*self.joint_angles.shape, 3)
        axes = (self.rotations[..., :-1, :, :] @ axes[..., None])[..., 0]
        axes = np.broadcast_to(axes[..., None, :, :] if arm.ndim > axes.ndim else axes, arm.shape)
        return np.swapaxes(np.concatenate([np.cross(axes, arm), axes], axis=-1), -1, -2)

    @cached_property
    def _designs(self) -> tuple[Hinges, NDArray[np.int64]]:
        return hinge_designs_of(self.mechanism, np.size(self.status))

    _fill_stiffness = staticmethod(hinge_stiffness_of)


def hinge_designs_of(mechanism: Mechanism, n_lanes: int) -> tuple[Hinges, NDArray[np.int64]]:
    """The arrays of the distinct mechanisms as one stack, and which of them each lane has, (B,).

    Raises:
        InvalidInput: more or fewer than one mechanism per lane; numbers of beads, tendons or crossed hinges differ.
    """
    if isinstance(mechanism, HingeChain):
        return mechanism.arrays, np.zeros(n_lanes, np.int64)
    if len(mechanism) != n_lanes:
        raise InvalidInput("number of mechanisms", len(mechanism), f"{n_lanes}, one per lane")
    places = {each: place for place, each in enumerate(dict.fromkeys(mechanism))}
    parts = [each.arrays for each in places]
    for each, part in zip(places, parts, strict=True):
        same = part.gaps.shape == parts[0].gaps.shape and np.array_equal(part.tendon_joints, parts[0].tendon_joints)
        if not same:
            raise InvalidInput("mechanism", each, "as many beads and tendons, crossing as many hinges, as the first")
    joined = Hinges(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    return joined._replace(tendon_joints=parts[0].tendon_joints), np.array([places[each] for each in mechanism])


def solve_hinge_batch(
    mechanism: Mechanism, chain: Hinges, designs: NDArray[np.int64], laws: TendonLaw, tables: Array, starts: Array
) -> HingeEquilibrium:
    """The equilibria of lanes; nothing is checked here.

    Args:
        mechanism: the chain, or one per lane.
        chain, designs: from `hinge_designs_of`.
        laws: tendon laws, (B, m) each.
        tables: load tables, (B, rows, 20).
        starts: joint angles, (B, n - 1) [rad].
    """
    results = new_hinge_results(len(starts), starts.shape[1], laws.low.shape[1])

    def work(first: int, last: int) -> None:
        direct(solve_hinge_lanes, chain, designs, laws, tables, starts, results, first, last)

    run_lanes(work, len(starts), starts.shape[1])
    return HingeEquilibrium(mechanism, tables, *results)


class HingeRange:
    """Solves of ranges of lanes on arrays that stay where they are; the interface of lanes.PinnedRange.

    Arguments as for `solve_hinge_batch`, and results from `new_results`. No kernel calls it (`entry` is 0): Python's
    way there costs a fiftieth of a solve.
    """

    entry = pins = 0
    new_results = staticmethod(new_hinge_results)

    def __init__(
        self,
        chain: Hinges,
        designs: NDArray[np.int64],
        laws: TendonLaw,
        tables: Array,
        starts: Array,
        results: HingeResults,
    ) -> None:
        arrays = chain, designs, laws, tables, starts, results
        self._solve = partial(machine_code(solve_hinge_lanes, *arrays, 0, 0), *arrays)

    def __call__(self, first: int, last: int) -> None:
        """Solve lanes first to last - 1; Python's lock is released meanwhile."""
        self._solve(first, last)

    solve_the_rest = __call__


def solve_hinge_lane(mechanism: HingeChain, law: TendonLaw, table: Array, start: Array) -> HingeEquilibrium:
    """The equilibrium of one mechanism; nothing is checked here. law: (m,) each; table: (rows, 20); start: (n - 1,)."""
    laws = TendonLaw(law.command[None], law.stiffness[None], law.low[None], law.high[None])
    results = new_hinge_results(1, len(start), len(law.low))
    designs = np.zeros(1, np.int64)
    direct(solve_hinge_lanes, mechanism.arrays, designs, laws, table[None], start[None], results, 0, 1)
    *arrays, residual, iterations, status, escapes = results
    numbers = residual.item(), iterations.item(), Status(status.item()), escapes.item()
    return HingeEquilibrium(mechanism, table, *HingeResults._make([*[array[0] for array in arrays], *numbers]))
