"""The interface of a family of mechanisms: code that serves all families uses it, and no concrete class.

A new family is a folder whose `family.py` makes a Family, which `statics.families.FAMILIES` lists.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rollingjoint.friction import FrictionState
from rollingjoint.friction_step import FrictionStep, friction_laws
from rollingjoint.kernels.shared.arrays import TendonLaw
from rollingjoint.kernels.shared.friction import FrictionArrays, FrictionLaw, History, new_friction_arrays
from rollingjoint.load import Gravity, Load
from rollingjoint.mechanism import AnyMechanism
from rollingjoint.threads import run_in_threads

Array = NDArray[np.float64]

_FIRST = np.zeros(1, np.int64)  # the only design of a mechanism's own arrays


class BatchModule(Protocol):
    """`batch.py` of a family: the solver behind the checks of its inputs."""

    @property
    def BatchArrays(self) -> Callable[..., Any]:  # noqa: N802
        """Equilibria to be solved as a batch, and where they go: chain, designs, laws, loads, starts, results.

        chain: from `mechanism.stack`; designs: which of the stacked mechanisms each row has, (B,); laws: (B, m) each;
        loads: load tables, (B, rows, columns); starts: joint angles, (B, J) [rad]; results: from `new_results`. All
        arrays are contiguous.
        """

    def new_results(self, n_rows: int, n_joints: int, n_tendons: int, /) -> Any:
        """Empty outputs of a batch."""

    def step_range(self, arrays: Any, friction: FrictionArrays, first: int, last: int, /) -> None:
        """Solve the steps with friction of rows first to last - 1; Python's lock is released meanwhile."""

    def begin_range(self, arrays: Any, friction: FrictionArrays, first: int, last: int, /) -> None:
        """Fill the histories of rows first to last - 1: at `starts` under the lowest tensions, nothing has slipped."""

    def pack(self, mechanism: Any, tables: Array, results: Any, friction: FrictionStep | None = None, /) -> Any:
        """The equilibria in the outputs; mechanism: one, or one per row."""

    @property
    def pack_outputs(self) -> Callable[..., Any]:
        """One equilibrium of (mechanism, table, outputs, *numbers), the numbers in the order of its results."""

    @property
    def PinnedRange(self) -> Callable[[Any], Callable[[int, int], None]]:  # noqa: N802
        """Solves ranges of rows of arrays, (first, last - 1); Python's lock is released meanwhile."""


class FileModule(Protocol):
    """`file.py` of a family: the content of its mechanism files."""

    HEADER: str  # the comment that a file begins with
    PARTS: str  # the key that identifies such a file, such as that of its links
    KEYS: tuple[str, ...]  # all keys at the top level of a file

    def from_dict(self, content: object, source: str, name: str, /) -> Any:
        """The mechanism that the content of a file describes; raises ConfigError."""

    def to_dict(self, mechanism: Any, /) -> dict[str, Any]:
        """The content that makes the same mechanism exactly."""


class ReportModule(Protocol):
    """`report.py` of a family: its mechanisms and equilibria in words, tables and JSON."""

    def travel(self, mechanism: Any, /) -> str:
        """Range of the joints, in words."""

    def remark(self, found: Any, /) -> str:
        """What the status line adds, with a leading comma, or an empty text."""

    def tables(self, found: Any, friction: float, /) -> tuple[str, str]:
        """Links and joints of an equilibrium as aligned columns."""

    def as_dict(self, found: Any, friction: float, /) -> dict[str, Any]:
        """Links and joints of an equilibrium for JSON; units are in the key names."""


@dataclass(frozen=True, eq=False)
class Family:
    """Everything that differs between families.

    Attributes:
        kind: class of its mechanisms.
        title: what messages call such a mechanism.
        dimension: coordinates of a point, 2 or 3.
        presets: its named mechanisms.
        load_columns: columns of its load tables.
        load_table: rows of these columns for loads and a number of links; InvalidInput for other loads.
        batch, file, report: its modules of these names.
        start_angles: joint angles [rad] of joints at places given in the unit of `joint_limits`.
        own_weight: the weight of a mechanism along a direction; None where its parts have no weights of their own.
        length_methods: methods of `solve_lengths` that it supports.
        slips: whether its joints are contacts, which may slip.
    """

    kind: type[AnyMechanism]
    title: str
    dimension: int
    presets: Mapping[str, Callable[[], AnyMechanism]]
    load_columns: tuple[str, ...]
    load_table: Callable[[Sequence[Load], int], Array]
    batch: BatchModule
    file: FileModule
    report: ReportModule
    start_angles: Callable[[Any, Sequence[float]], Array]
    own_weight: Callable[[Any, Any], Gravity] | None = None
    length_methods: tuple[str, ...] = ("elastic",)
    slips: bool = False

    def solve_batch(
        self, mechanism: Any, chain: Any, designs: NDArray[np.int64], laws: TendonLaw, tables: Array, starts: Array
    ) -> Any:
        """The equilibria of a batch, unchecked; arguments as of BatchArrays, mechanism: one, or one per row."""
        results = self.batch.new_results(len(starts), starts.shape[1], laws.low.shape[1])
        arrays = self.batch.BatchArrays(chain, designs, laws, tables, starts, results)
        run_in_threads(self.batch.PinnedRange(arrays), len(starts), starts.shape[1], abandon=True)
        return self.batch.pack(mechanism, tables, results)

    def solve_one(
        self, mechanism: Any, law: TendonLaw, table: Array, start: Array, before: FrictionState | None = None
    ) -> Any:
        """The equilibrium of one mechanism, unchecked; `before` makes it a step with friction.

        law: (m,) each; table: (rows, columns); start: (n - 1,) [rad].
        """
        laws = TendonLaw(*(values[None] for values in law))
        inputs = mechanism, mechanism.arrays, _FIRST, laws, table[None], start[None]
        if before is None:
            return self.solve_batch(*inputs).row(0)
        return self.step_batch(*inputs, FrictionState(*(array[None] for array in before))).row(0)

    def step_batch(
        self,
        mechanism: Any,
        chain: Any,
        designs: NDArray[np.int64],
        laws: TendonLaw,
        tables: Array,
        starts: Array,
        before: FrictionState,
        friction: FrictionLaw | None = None,
    ) -> Any:
        """The equilibria of a batch of steps with friction; the first arguments are those of `solve_batch`.

        before: histories of all rows; friction: their coefficients, default those of the mechanisms.
        """
        results = self.batch.new_results(len(starts), starts.shape[1], laws.low.shape[1])
        arrays = self.batch.BatchArrays(chain, designs, laws, tables, starts, results)
        steps = new_friction_arrays(friction or friction_laws(mechanism, len(starts)), History(*before))
        run_in_threads(partial(self.batch.step_range, arrays, steps), len(starts), starts.shape[1], abandon=True)
        return self.batch.pack(mechanism, tables, results, FrictionStep.of(steps))
