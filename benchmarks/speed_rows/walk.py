"""The warm solve that everything is timed on: tendon lengths and a dead force at the tip that change step by step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rollingjoint import Equilibrium, RollingChain, WorldForce, five_link, solve_lengths
from rollingjoint.compiled import BatchArrays, PinnedRange, TendonLaw
from rollingjoint.kernels.rolling import new_results
from rollingjoint.kernels.rolling_lanes import memory_alone
from rollingjoint.load import load_table

Array = NDArray[np.float64]

TENSION_LIMITS = (0.5, 15.0)  # N: what the environments' motors hold
BEND_STEP, BEND_RANGE = 1.0, 10.0  # of one tendon against the other [mm]
PULL_STEP, PULL_RANGE = 0.2, 0.8  # of both together [mm]
FORCE_STEP, FORCE_RANGE = 0.05, 0.5  # in each direction [N]


@dataclass(frozen=True)
class Walk:
    """K solves that follow each other, and their answers.

    commands: (K, 2) tendon lengths [mm]. forces: (K, 2) at the tip [N]. starts: (K, 4) the equilibrium before [rad].
    """

    mechanism: RollingChain
    commands: Array
    forces: Array
    starts: Array
    equilibria: tuple[Equilibrium, ...]

    def __len__(self) -> int:
        return len(self.commands)

    def loads(self, step: int) -> list[WorldForce]:
        """The load of one step."""
        return [WorldForce(-1, tuple(self.forces[step]))]

    def load_tables(self) -> Array:
        """The loads of all steps, (K, 1, 11)."""
        return np.array([load_table(self.loads(step), self.mechanism.n_links) for step in range(len(self))])

    def tiled(self, count: int) -> tuple[Array, Array, Array]:
        """Commands, load tables and starts of `count` lanes: the walk over and over."""
        steps = np.arange(count) % len(self)
        return self.commands[steps], self.load_tables()[steps], self.starts[steps]


def random_walk(count: int, seed: int = 0) -> Walk:
    """A walk of the five-link prototype in which every step is a stable equilibrium."""
    mechanism, rng = five_link(), np.random.default_rng(seed)
    bend, pull = _wander(rng, count, (BEND_STEP, PULL_STEP), (BEND_RANGE, PULL_RANGE)).T
    commands = mechanism.neutral_lengths + np.stack([bend, -bend], axis=1) - (PULL_RANGE + pull)[:, None]
    forces = _wander(rng, count, (FORCE_STEP, FORCE_STEP), (FORCE_RANGE, FORCE_RANGE))
    equilibrium, starts, equilibria = None, [], []
    for command, force in zip(commands, forces, strict=True):
        starts.append(mechanism.neutral_angles if equilibrium is None else equilibrium.joint_angles)
        equilibrium = solve_lengths(
            mechanism, command, [WorldForce(-1, tuple(force))], start=equilibrium, tension_limits=TENSION_LIMITS
        ).require()
        equilibria.append(equilibrium)
    return Walk(mechanism, commands, forces, np.array(starts), tuple(equilibria))


def _wander(rng: np.random.Generator, count: int, steps: tuple[float, float], reach: tuple[float, float]) -> Array:
    """Two independent random walks of at most these steps, kept within ± reach, (count, 2)."""
    place, places = np.zeros(2), np.empty((count, 2))
    for k in range(count):
        place = np.clip(place + rng.uniform(-1.0, 1.0, 2) * steps, np.negative(reach), reach)
        places[k] = place
    return places


def batch_arrays(walk: Walk) -> BatchArrays:
    """The steps of the walk as the kernels take them, and where their answers go."""
    count, mechanism = len(walk), walk.mechanism
    low, high = (np.full((count, mechanism.n_tendons), limit) for limit in TENSION_LIMITS)
    laws = TendonLaw(walk.commands, np.tile(mechanism.stiffnesses, (count, 1)), low, high)
    results = new_results(count, mechanism.n_joints, mechanism.n_tendons)
    designs = np.zeros(count, np.int64)
    return BatchArrays(mechanism.arrays, designs, laws, walk.load_tables(), walk.starts, results)


def _row(problem: BatchArrays, row: int) -> BatchArrays:
    """A batch of one of the rows, in the same memory."""
    mechanism, designs, laws, loads, starts, results = problem
    laws, results = (type(arrays)(*(array[row : row + 1] for array in arrays)) for arrays in (laws, results))
    return BatchArrays(mechanism, designs[:1], laws, loads[row : row + 1], starts[row : row + 1], results)


class CompiledWalk:
    """The walk as the kernels take it, prepared once; every step is solved on this thread, into `results`."""

    def __init__(self, walk: Walk) -> None:
        problem = batch_arrays(walk)
        self._count, self.results = len(walk), problem.results
        self._solve = PinnedRange(RollingChain.kernels, problem)
        rows = [_row(problem, step) for step in range(len(walk))]
        memory = memory_alone(rows[0])
        self._steps = [PinnedRange(RollingChain.kernels, row, memory) for row in rows]

    def one_by_one(self) -> None:
        """Solve the steps one after the other, a call each, as single solves are."""
        for solve in self._steps:
            solve(0, 1)

    def side_by_side(self) -> None:
        """Solve all steps in one call."""
        self._solve(0, self._count)
