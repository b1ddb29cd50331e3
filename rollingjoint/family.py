"""What a family of mechanisms brings; everything that serves all families asks this interface and no class.

A new family is a folder that ends in one subclass of Family, and that subclass in `statics.families.FAMILIES`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from rollingjoint.kernels.shared.arrays import TendonLaw
from rollingjoint.load import Gravity, Load
from rollingjoint.mechanism import AnyMechanism
from rollingjoint.solution import Solution
from rollingjoint.threads import run_in_threads

Array = NDArray[np.float64]
M = TypeVar("M", bound=AnyMechanism)
S = TypeVar("S", bound=Solution)


class Family(ABC, Generic[M, S]):
    """Everything that differs between families of mechanisms.

    Attributes:
        kind: class of its mechanisms.
        title: what such a mechanism is, in messages.
        dimension: coordinates of a point, 2 or 3.
        load_columns: columns of its load tables.
        batch_arrays: its NamedTuple of a batch: chain, designs, laws, loads, starts, results.
        length_methods: methods of `solve_lengths` that it has.
        slips: whether its joints are contacts that could slip.
        presets: its named mechanisms.
        file_parts: the key that lists the links, or the like, in mechanism files.
        file_keys: all keys at the top of its mechanism files.
        file_header: the comment that such a file begins with.
    """

    kind: type[M]
    title: ClassVar[str]
    dimension: ClassVar[int]
    load_columns: ClassVar[tuple[str, ...]]
    batch_arrays: ClassVar[type[Any]]
    length_methods: ClassVar[tuple[str, ...]] = ("elastic",)
    slips: ClassVar[bool] = False
    presets: Mapping[str, Callable[[], M]]
    file_parts: ClassVar[str]
    file_keys: ClassVar[tuple[str, ...]]
    file_header: ClassVar[str]

    # Statics; nothing is checked here

    @staticmethod
    @abstractmethod
    def load_table(loads: Sequence[Load], n_links: int, /) -> Array:
        """Rows of `load_columns` for the loads; InvalidInput for loads that the family cannot have."""

    @staticmethod
    @abstractmethod
    def solve_one(mechanism: M, law: TendonLaw, table: Array, start: Array, /) -> S:
        """The equilibrium of one mechanism. law: (m,) each; table: (rows, columns); start: (n - 1,) [rad]."""

    @staticmethod
    @abstractmethod
    def new_results(n_rows: int, n_joints: int, n_tendons: int, /) -> Any:
        """Empty outputs of a batch."""

    @staticmethod
    @abstractmethod
    def solve_range(batch: Any, first: int, last: int, /) -> None:
        """Solve rows first to last - 1; Python's lock is released meanwhile."""

    @staticmethod
    @abstractmethod
    def pack(mechanism: M | tuple[M, ...], tables: Array, results: Any, /) -> S:
        """The equilibria in the outputs."""

    def solve_batch(
        self,
        mechanism: M | tuple[M, ...],
        chain: Any,
        designs: NDArray[np.int64],
        laws: TendonLaw,
        tables: Array,
        starts: Array,
    ) -> S:
        """The equilibria of a batch; arguments as of `batch_arrays`, `mechanism` one or one per row."""
        results = self.new_results(len(starts), starts.shape[1], laws.low.shape[1])
        batch = self.batch_arrays(chain, designs, laws, tables, starts, results)
        run_in_threads(partial(self.solve_range, batch), len(starts), starts.shape[1])
        return self.pack(mechanism, tables, results)

    # Mechanism files

    @staticmethod
    @abstractmethod
    def from_dict(content: object, source: str, name: str, /) -> M:
        """The mechanism that the content of a mechanism file describes; raises ConfigError."""

    @staticmethod
    @abstractmethod
    def to_dict(mechanism: M, /) -> dict[str, Any]:
        """The content that makes the same mechanism exactly."""

    # Reports

    @staticmethod
    @abstractmethod
    def travel(mechanism: M, /) -> str:
        """How far its joints move, in words."""

    @staticmethod
    @abstractmethod
    def tables(found: S, friction: float, /) -> tuple[str, str]:
        """Links and joints of an equilibrium as aligned columns."""

    @staticmethod
    @abstractmethod
    def to_json(found: S, friction: float, /) -> dict[str, Any]:
        """Links and joints of an equilibrium as plain dicts, lists and numbers; units stand in the key names."""

    @staticmethod
    def remark(found: S, /) -> str:
        """What else the status line says of an equilibrium, with a leading comma."""
        return ""

    # What users give

    @staticmethod
    @abstractmethod
    def start_angles(mechanism: M, places: Sequence[float], /) -> Array | Sequence[float]:
        """Joint angles [rad] of the joints at places given in the unit of `joint_limits`."""

    @staticmethod
    def own_weight(mechanism: M, direction: tuple[float, float, float], /) -> Gravity | None:
        """The weight of the mechanism's parts along a direction; None where parts have none of their own."""
        return None
