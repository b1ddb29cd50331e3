"""Measurements: runs of steps, each with its inputs, the inputs on the way to it, and its readings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.checks import as_choice, as_floats, as_positive, as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.load import WorldForce

Array = NDArray[np.float64]

GIVEN = ("tensions", "lengths")
"""Kinds of inputs to the motors."""

METHODS = ("elastic", "least_squares")
"""Meanings of given lengths, see solve_lengths."""

QUANTITIES = {"position": "mm", "angle": "rad", "length": "mm", "tension": "N"}
"""Quantities that can be measured, with units."""


@dataclass(frozen=True)
class Input:
    """Input of the motors: `given` is "tensions" [N] or "lengths" [mm], with one number per tendon."""

    given: str
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        as_choice("given", self.given, GIVEN)
        values = as_floats(self.given, self.values, "numbers, one per tendon")
        if values.ndim != 1 or not np.all(np.isfinite(values)) or (self.given == "tensions" and np.any(values < 0)):
            raise InvalidInput(self.given, self.values, "finite numbers, one per tendon; no negative tension")
        object.__setattr__(self, "values", tuple(values.tolist()))


@dataclass(frozen=True)
class Step:
    """One step of a run, with its readings; None and NaN: not measured.

    Args:
        tensions: (m,) [N]. lengths: (m,) [mm]. One is the input (Measurements.given), the other is measured.
        approach: inputs passed through since the step before, in order; only a mechanism with friction remembers them.
        positions: origins of the links, base first, (n, 2 or 3) [mm].
        angles: of the links of a planar chain, (n,) [rad].
        forces: known forces at the origins of links [N], base frame.
        weight: number of equal steps that the step counts for.
    """

    tensions: ArrayLike | None = None
    lengths: ArrayLike | None = None
    approach: Sequence[Input] = ()
    positions: ArrayLike | None = None
    angles: ArrayLike | None = None
    forces: Sequence[WorldForce] = ()
    weight: float = 1.0

    def input(self, given: str) -> Input:
        """The input of the motors of one kind, "tensions" or "lengths"."""
        values = getattr(self, given)
        if values is None:
            raise InvalidInput(f"{given} of a step", None, f"{given}, which were given", "Or change `given`.")
        return Input(given, values)


@dataclass(frozen=True)
class Run:
    """Steps in the order of measurement, with the name of the run."""

    name: str
    steps: Sequence[Step]


@dataclass(frozen=True)
class Measurements:
    """Runs of one mechanism.

    Args:
        mechanism: the mechanism as designed.
        runs: at least one.
        deviations: standard deviation of each measured quantity that is fitted: "position" [mm] per coordinate,
            "angle" [rad], "length" [mm], "tension" [N].
        given: "tensions" or "lengths": the input of the motors in every step.
        method: for lengths: "elastic", the unstretched length that the motors leave, or "least_squares", lengths
            measured along the mechanism.
        tension_limits: minimum and maximum tension [N], for elastic tendons.
        absolute: whether the deviations are true values. False: only their ratios count, and the scale of the errors is
            estimated from the residuals.
        about, source: for the report.
    Raises:
        InvalidInput: wrong shapes, names or numbers, with the run and the step.
    """

    mechanism: AnyChain
    runs: Sequence[Run]
    deviations: Mapping[str, float] = field(default_factory=lambda: {"position": 1.0})
    given: str = "tensions"
    method: str = "elastic"
    tension_limits: tuple[float, float] = (0.0, np.inf)
    absolute: bool = False
    about: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        as_choice("given", self.given, GIVEN)
        as_choice("method", self.method, METHODS)
        for name, value in self.deviations.items():
            as_choice("deviations", name, tuple(QUANTITIES))
            as_positive(f"deviation of {name}", value, f"a positive number [{QUANTITIES[name]}]")
        names = [run.name for run in self.runs]
        if not names or len(set(names)) < len(names):
            raise InvalidInput("runs", names, "at least one run, each with a name of its own")
        for run in self.runs:
            for number, step in enumerate(run.steps):
                self._check(f"run {run.name}, step {number}", step)
        if not np.any(np.isfinite(self.readings(self.runs)) & np.isfinite(self.scales)):
            raise InvalidInput("deviations", list(self.deviations), "at least one quantity that was measured")

    @property
    def dimension(self) -> int:
        """2 in the plane, 3 in space."""
        return self.mechanism.dimension

    @property
    def scales(self) -> Array:
        """Standard deviation of every number of a reading, (M,); infinite where it is not fitted."""
        n, m = self.mechanism.n_links, self.mechanism.n_tendons
        counts = {"position": n * self.dimension, "angle": n, "length": m, "tension": m}
        return np.concatenate([np.full(count, self.deviations.get(name, np.inf)) for name, count in counts.items()])

    def columns(self, quantity: str) -> slice:
        """The columns of a quantity in a reading."""
        n, m = self.mechanism.n_links, self.mechanism.n_tendons
        stops = np.cumsum([0, n * self.dimension, n, m, m])
        place = list(QUANTITIES).index(quantity)
        return slice(int(stops[place]), int(stops[place + 1]))

    def readings(self, runs: Sequence[Run]) -> Array:
        """Readings in every step of the runs, (steps, M): positions, angles, lengths, tensions; NaN: not read."""
        steps = [step for run in runs for step in run.steps]
        table = np.full((len(steps), self.columns("tension").stop), np.nan)
        for row, step in zip(table, steps, strict=True):
            for quantity, values in (
                ("position", step.positions),
                ("angle", step.angles),
                ("length", step.lengths if self.given == "tensions" else None),
                ("tension", step.tensions if self.given == "lengths" else None),
            ):
                if values is not None:
                    row[self.columns(quantity)] = np.asarray(values, float).ravel()
        first = np.r_[0 : self.dimension, self.columns("angle").start]
        table[:, first] = np.nan  # the base defines the frame
        return table

    def input_given(self, given: str, method: str | None = None) -> Measurements:
        """The same measurements with `given` as the input of the motors."""
        return replace(self, given=given, method=method or self.method)

    def select(self, names: Sequence[str]) -> Measurements:
        """The measurements of some runs."""
        return replace(self, runs=tuple(run for run in self.runs if run.name in names))

    def _check(self, where: str, step: Step) -> None:
        n, m = self.mechanism.n_links, self.mechanism.n_tendons
        try:
            for entry in [step.input(self.given), *step.approach]:
                as_vector(entry.given, entry.values, m, "one per tendon")
            for name in GIVEN:
                if getattr(step, name) is not None:
                    as_vector(name, getattr(step, name), m, "one per tendon")
            as_positive("weight", step.weight, "a positive number")
            if step.angles is not None:
                as_vector("angles", step.angles, n, "one per link")
                if not isinstance(self.mechanism, RollingChain):
                    raise InvalidInput("angles", step.angles, "no angles for an arm", "Give positions.")
            if step.positions is not None:
                positions = as_floats("positions", step.positions, f"{n} rows of {self.dimension} numbers")
                if positions.shape != (n, self.dimension):
                    raise InvalidInput("shape of positions", positions.shape, f"({n}, {self.dimension}), base first")
        except InvalidInput as error:
            raise InvalidInput(f"{where}: {error.what}", error.value, error.allowed, error.hint) from None
