"""Equilibria of the lanes of an episode buffer: their mechanisms, loads and friction, and the solvers bound to them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.tracking.config import FrictionConfig
from rj_gym.tracking.draws import of_lanes
from rj_gym.tracking.kernels import REVISIONS, keep_history
from rj_gym.tracking.task import TrackingTask
from rollingjoint.chain.stacks import Variations, stack
from rollingjoint.compiled import (
    MU,
    N_COEFFICIENTS,
    PENDING,
    PRESLIDING,
    WIDTH,
    Floats,
    FrictionArrays,
    FrictionLaw,
    History,
    Integers,
    PinnedRange,
    TendonLaw,
    begin_range,
    machine_code,
    new_friction_arrays,
    run_in_threads,
    step_range,
)
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]
Range = Callable[[int, int], object]  # works on lanes first to last - 1

_COUNTS, _STATUS = Annotated[Integers, "B", "m"], Annotated[Integers, "B"]
_READINGS = Annotated[Floats, "B", "columns"]


class LaneSolver:
    """Solves lanes of a tracking task in arrays that stay where they are; other mechanisms bind the solvers anew.

    Attributes:
        mechanisms: the mechanisms that occur. designs: which of them each lane has, (B,).
        laws: commands, stiffnesses and tension limits of the tendons.
        loads: load tables, (B, rows, columns); the force that acts only while episodes run is in the last row.
        starts: joint angles to start from, (B, J) [rad]. results: the equilibria.
        friction: coefficients and histories, None without friction.
        alone: the solver without friction. rows: the design of each lane in the stack of mechanisms, (B,).

    Args:
        task: the task.
        readings: of the lanes, (B, columns), in which steps with friction are noted.
    """

    alone: Any  # a PinnedRange, or a LaneByLane
    rows: NDArray[np.int64]

    def __init__(self, task: TrackingTask, readings: Array) -> None:
        capacity, n_joints, m = len(readings), task.mechanism.n_joints, task.mechanism.n_tendons
        self._kernels, self._readings = task.mechanism.kernels, readings
        self._force = slice(task.LOAD_COLUMNS.index("fx"), task.LOAD_COLUMNS.index("fx") + task.dimension)
        self.mechanisms: Sequence[Any] = (task.mechanism,)
        self.designs = np.zeros(capacity, np.int64)
        self.laws = TendonLaw(*(np.zeros((capacity, m)) for _ in range(4)))
        self.loads, self.starts = task.new_loads(capacity), np.zeros((capacity, n_joints))
        self.results = task.new_results(capacity)
        self.friction = no_history(capacity, n_joints, m) if task.has_friction else None
        self._bind()

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name not in {"alone", "_steps"}}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._bind()

    @property
    def entry(self) -> tuple[int, int]:
        """Addresses of the solver's machine code and of its arrays, for kernels; 0 with friction."""
        return (self.alone.entry, self.alone.pins) if self._steps is None else (0, 0)

    def use(self, mechanisms: Sequence[Any], designs: NDArray[np.int64]) -> bool:
        """Have the first lanes use these mechanisms, designs (count,); False where the solvers are bound already."""
        is_bound = mechanisms is self.mechanisms and isinstance(mechanisms, tuple) and self.friction is None
        self.mechanisms = mechanisms
        self.designs[:] = 0
        self.designs[: len(designs)] = designs
        if not is_bound or isinstance(self.alone, LaneByLane):
            self._bind()
            return True
        return False

    def solve_the_rest(self, first: int, last: int, revise: Callable[[int, int], int] | None = None) -> None:
        """Solve the lanes that kernels have left; with friction their steps, which become the history of the next.

        revise: called after each solve of these lanes; the number of those that it has left again.
        """
        if revise is None:
            (self._steps or self.alone).solve_the_rest(first, last)
            return
        solve: Range = self._steps or self.alone.solve_the_rest
        again: Range = self.alone.solve_the_rest if self._steps is None else self._step_pending
        solve(first, last)
        for _ in range(REVISIONS):
            if not revise(first, last):
                break
            again(first, last)
        if self._steps is not None:
            self._steps.keep(first, last)

    def _step_pending(self, first: int, last: int) -> None:
        """Take the steps of the PENDING ones among these lanes anew; others beside them end where they did."""
        assert self._steps is not None
        side_by_side = WIDTH if self.starts.shape[1] <= self._kernels.most_with_friction else 1
        for lane in (first + np.flatnonzero(self.results.status[first:last] == PENDING)).tolist():
            if lane >= first:
                first = min(lane + side_by_side, last)
                self._steps(lane, first)

    def solve_at(self, tensions: Array, forces: Array | float = 0.0) -> None:
        """Solve the first lanes under tensions (count, m) and forces (count, d), from their neutral poses."""
        count = len(tensions)
        self.laws.command[:count] = 0.0
        self.laws.low[:count] = self.laws.high[:count] = tensions
        self.loads[:count, -1, self._force] = forces
        alike = len(self._neutral_angles) == 1
        self.starts[:count] = self._neutral_angles if alike else self._neutral_angles[self.designs[:count]]
        if count == 1:
            self.alone(0, 1)
        else:
            run_in_threads(self.alone, count, self.starts.shape[1])

    def solve_lanes(self, rows: Any, commands: Array, forces: Array, starts: Array) -> None:
        """Solve some lanes under commands [mm] and forces [N], from joint angles [rad], each (len(rows), ...)."""
        self.laws.command[rows], self.starts[rows] = commands, starts
        self.loads[rows, -1, self._force] = forces
        for row in rows.tolist():
            self.alone(row, row + 1)

    def solve_near(self, commands: Array, starts: Array) -> None:
        """Solve the first lanes under commands (count, m) [mm] from angles (count, J) [rad]; with friction, steps."""
        self.laws.command[: len(commands)], self.starts[: len(starts)] = commands, starts
        run_in_threads(self._steps or self.alone, len(starts), starts.shape[1])

    def begin_histories(self, draws: Any, angles: Array) -> None:
        """Histories of the first lanes, at angles (1 or count, J) [rad] without friction: no tendon has slipped."""
        assert self._steps is not None
        self.laws.low[: len(draws)], self.starts[: len(draws)] = draws.start_tensions, angles
        self._steps.begin(0, len(draws))

    def enter_friction(self, draws: Any, config: FrictionConfig | None) -> None:
        """Put coefficients of friction into the first lanes: the drawn ones in place of the mechanisms'."""
        assert self.friction is not None
        law, count, mechanisms = self.friction.law, len(draws), distinct(draws.mechanisms)
        designs = draws.designs if len(mechanisms) > 1 else np.zeros(count, np.int64)
        law.tendons[:count] = of_lanes([mechanism.friction_coefficients for mechanism in mechanisms], designs)
        law.rolling[:count] = of_lanes([mechanism.rolling_coefficients for mechanism in mechanisms], designs)
        if config is not None:
            law.tendons[:count, :, PRESLIDING] = config.presliding
        if draws.friction_mu is not None:
            law.tendons[:count, :, MU] = draws.friction_mu

    def batches(self) -> list[Any]:
        """The batch that is solved, or one per mechanism where their tendons end on different links."""
        arrays = self.laws, self.loads, self.starts, self.results
        try:
            return [self._kernels.batch_arrays(stack(self.mechanisms), self.rows, *arrays)]
        except InvalidInput:
            alone = np.zeros_like(self.designs)
            return [self._kernels.batch_arrays(mechanism.arrays, alone, *arrays) for mechanism in self.mechanisms]

    def _bind(self) -> None:
        """Bind the solvers to the arrays."""
        mechanisms, self.rows = self.mechanisms, self.designs
        if isinstance(mechanisms, Variations):
            self._neutral_angles, self.rows = mechanisms.neutral_angles, mechanisms.designs[self.designs]
        else:
            self._neutral_angles = np.array([mechanism.neutral_angles for mechanism in mechanisms])
        batches = self.batches()
        self.alone = self._on_lanes([PinnedRange(self._kernels, batch) for batch in batches])
        self._steps = None if self.friction is None else self._friction_steps(self.friction, batches)

    def _on_lanes(self, solvers: Sequence[Any]) -> Any:
        """The only solver, or all of them, each for the lanes with its mechanism."""
        return solvers[0] if len(solvers) == 1 else LaneByLane(solvers, self.designs)

    def _friction_steps(self, friction: FrictionArrays, batches: list[Any]) -> FrictionSteps:
        """Steps with friction of these batches."""
        kernels, status = self._kernels, self.results.status
        last_links = np.array([mechanism.last_links for mechanism in distinct(self.mechanisms)], np.int64)
        crossed = last_links[self.designs if len(last_links) > 1 else np.zeros_like(self.designs)]
        code = machine_code(keep_history, FrictionArrays, _COUNTS, _STATUS, _READINGS, int, int)

        def steps_of(batch: Any) -> Range:
            return lambda first, last: step_range(kernels, batch, friction, first, last)

        def begins_of(batch: Any) -> Range:
            return lambda first, last: begin_range(batch, friction, first, last)

        def keep(first: int, last: int) -> None:
            code(friction, crossed, status, self._readings, first, last)

        steps, begins = ([of(batch) for batch in batches] for of in (steps_of, begins_of))
        return FrictionSteps(self._on_lanes(steps), keep, self._on_lanes(begins))


class FrictionSteps:
    """In place of PinnedRange where steps have friction: a step that stands becomes the history of the next one."""

    def __init__(self, step: Range, keep: Range, begin: Range) -> None:
        self._step, self.keep, self.begin = step, keep, begin

    def __call__(self, first: int, last: int) -> None:
        """The steps of lanes first to last - 1, without an effect on their histories."""
        self._step(first, last)

    def solve_the_rest(self, first: int, last: int) -> None:
        """The steps of lanes first to last - 1."""
        self._step(first, last)
        self.keep(first, last)


class LaneByLane:
    """In place of PinnedRange where mechanisms cannot be stacked: one solver per mechanism."""

    entry = pins = 0

    def __init__(self, solvers: Sequence[Range], designs: NDArray[np.int64]) -> None:
        self._solvers, self._designs = solvers, designs

    def __call__(self, first: int, last: int) -> None:
        """Solve lanes first to last - 1."""
        for lane in range(first, last):
            self._solvers[self._designs[lane]](lane, lane + 1)

    solve_the_rest = __call__


def distinct(mechanisms: Sequence[Any]) -> Sequence[Any]:
    """The mechanisms; of variations, which share friction, names and last links, the nominal one."""
    return (mechanisms.nominal,) if isinstance(mechanisms, Variations) else mechanisms


def no_history(capacity: int, n_joints: int, n_tendons: int) -> FrictionArrays:
    """Friction of this number of lanes, still to be filled."""
    law = FrictionLaw(np.ones((capacity, n_tendons, N_COEFFICIENTS)), np.ones((capacity, 2)))
    states, slips, grips = (np.zeros((capacity, n_joints, n_tendons)) for _ in range(3))
    angles, rolling = (np.zeros((capacity, n_joints)) for _ in range(2))
    return new_friction_arrays(law, History(states, slips, grips, angles, rolling))
