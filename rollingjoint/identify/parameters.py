"""Parameters that can be identified: their kinds, their coefficients, and a mechanism with other values."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import RollingChain, planar
from rollingjoint.checks import as_choice
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import LARGEST_MU, SMALLEST_PRESLIDING, CapstanFriction
from rollingjoint.identify.measurements import Measurements
from rollingjoint.profile import Surface

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Kind:
    """A kind of parameter.

    Args:
        meaning: description, one line.
        unit: for tables; empty for a pure number.
        nominal: the value of the mechanism as designed.
        start: where a fit starts.
        low, high: the range that is searched.
        step: a small change, for pictures and numerical derivatives.
        per_tendon: whether every tendon has a separate number.
        planar: whether only planar chains have it.
    """

    meaning: str
    unit: str
    nominal: float
    start: float
    low: float
    high: float
    step: float
    per_tendon: bool = False
    planar: bool = False


KINDS = {
    "mu": Kind("coefficient of friction of the tendons", "", 0.0, 0.05, 0.0, LARGEST_MU, 1e-5),
    "presliding": Kind(
        "slip over which friction builds up",
        "mm",
        CapstanFriction(0.0).presliding,
        0.05,
        SMALLEST_PRESLIDING,
        1.0,
        1e-4,
    ),
    "constant": Kind("friction force that every link adds", "N", 0.0, 0.02, 0.0, 10.0, 1e-4),
    "rolling": Kind("arm of the rolling resistance", "mm", 0.0, 0.05, 0.0, 2.0, 1e-4, planar=True),
    "stiffness": Kind("factor on the stiffness of all tendons", "", 1.0, 1.0, 0.05, 20.0, 1e-4),
    "offsets": Kind("what each tendon's true length is above its reading", "mm", 0.0, 0.0, -20.0, 20.0, 1e-3, True),
    "base_angle": Kind(
        "turn of the measured frame: what was read lies turned by this", "rad", 0.0, 0.0, -0.5, 0.5, 1e-4, planar=True
    ),
    "surface_height": Kind(
        "excess height of every link, half of it on each surface", "mm", 0.0, 0.0, -2.0, 2.0, 1e-3, planar=True
    ),
    "surface_shift": Kind(
        "sideways shift of every child surface, half of it on each surface",
        "mm",
        0.0,
        0.0,
        -2.0,
        2.0,
        1e-3,
        planar=True,
    ),
    "surface_turn": Kind(
        "turn of every child surface, half of it on each surface", "rad", 0.0, 0.0, -0.2, 0.2, 1e-4, planar=True
    ),
}
"""All kinds, by name."""

FRICTION = ("mu", "presliding", "constant", "rolling")
"""The kinds that are fields of CapstanFriction."""

PER_RUN = ":run"
"""Suffix of a name: every run has a separate value."""


@dataclass(frozen=True)
class Coefficient:
    """One unknown number of a kind, of one tendon or run; None: of all."""

    name: str
    tendon: int | None = None
    run: str | None = None

    @property
    def kind(self) -> Kind:
        """Range, unit and meaning."""
        return KINDS[self.name]

    @property
    def label(self) -> str:
        """Name for tables, such as "offsets[0] in A"."""
        tendon = "" if self.tendon is None else f"[{self.tendon}]"
        return f"{self.name}{tendon}" + ("" if self.run is None else f" in {self.run}")

    def nominal(self, mechanism: AnyChain) -> float:
        """The value of the mechanism as designed."""
        if self.name in FRICTION and mechanism.friction is not None:
            return float(getattr(mechanism.friction, self.name))
        return self.kind.nominal

    @property
    def bounds(self) -> tuple[float, float]:
        """The range that is searched."""
        return self.kind.low, self.kind.high


def coefficients_of(parameters: Sequence[str], measurements: Measurements) -> tuple[Coefficient, ...]:
    """The unknown numbers behind names such as "offsets" or "base_angle:run".

    Raises:
        InvalidInput: no or unknown names, a name given twice, a parameter that the mechanism lacks.
    """
    if not parameters:
        raise InvalidInput("parameters", parameters, f"at least one of {', '.join(KINDS)}")
    coefficients: list[Coefficient] = []
    for word in parameters:
        name, colon, scope = word.partition(":")
        as_choice("parameters", name, tuple(KINDS))
        if colon and colon + scope != PER_RUN:
            raise InvalidInput("parameters", word, f"{name}, or {name}{PER_RUN} for one value per run")
        if any(coefficient.name == name for coefficient in coefficients):
            raise InvalidInput("parameters", word, "every name once")
        if name in FRICTION and any(tendon.friction for tendon in measurements.mechanism.tendons):
            hint = "Give the mechanism a friction, and its tendons none."
            raise InvalidInput("parameters", word, "a mechanism whose tendons have no friction of their own", hint)
        if not _has(measurements.mechanism, name):
            raise InvalidInput("parameters", word, "parameters of arms, without " + name, "Only planar chains have it.")
        tendons = range(measurements.mechanism.n_tendons) if KINDS[name].per_tendon else (None,)
        runs = [run.name for run in measurements.runs] if colon else [None]
        coefficients += [Coefficient(name, tendon, run) for run in runs for tendon in tendons]
    return tuple(coefficients)


def _has(mechanism: AnyChain, name: str) -> bool:
    """Whether a mechanism has a parameter; all chains with contacts have rolling resistance."""
    rolls = name == "rolling" and mechanism.slips
    return rolls or not KINDS[name].planar or isinstance(mechanism, RollingChain)


def values_in_run(coefficients: Sequence[Coefficient], values: Array, run: str, mechanism: AnyChain) -> dict[str, Any]:
    """Value of every kind in a run, a number or (m,), one per tendon; nominal where it is not sought."""
    parameters: dict[str, Any] = {
        name: np.full(mechanism.n_tendons, kind.nominal) if kind.per_tendon else Coefficient(name).nominal(mechanism)
        for name, kind in KINDS.items()
    }
    for coefficient, value in zip(coefficients, values, strict=True):
        if coefficient.run in (None, run):
            if coefficient.tendon is None:
                parameters[coefficient.name] = float(value)
            else:
                parameters[coefficient.name][coefficient.tendon] = value
    return parameters


def varied(mechanism: AnyChain, values: Mapping[str, Any]) -> AnyChain:
    """The mechanism with these values; offsets and the base angle do not change it."""
    changes: dict[str, Any] = {}
    friction = mechanism.friction or CapstanFriction(0.0)
    rubbing = dataclasses.replace(friction, **{name: values[name] for name in FRICTION})
    if rubbing != friction:
        changes["friction"] = rubbing
    if values["stiffness"] != 1.0:
        changes["tendons"] = [
            dataclasses.replace(tendon, stiffness=values["stiffness"] * tendon.stiffness)
            for tendon in mechanism.tendons
        ]
    move = values["surface_shift"] / 2, values["surface_height"] / 2, values["surface_turn"] / 2
    if any(move):
        changes["links"] = [
            dataclasses.replace(link, parent=_moved(link.parent, move, -1), child=_moved(link.child, move, 1))
            for link in planar(mechanism).links
        ]
    return mechanism.replace(**changes) if changes else mechanism


def _moved(surface: Surface, move: tuple[float, float, float], sign: int) -> Surface:
    """The surface shifted on its link and turned about its start."""
    (x, y), (dx, dy, turn) = surface.start, move
    return dataclasses.replace(surface, start=(x + sign * dx, y + sign * dy), angle=surface.angle + sign * turn)
