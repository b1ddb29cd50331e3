"""Settings of the design task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self

import numpy as np

from rj_gym.core.settings import LONGEST_EPISODE, Range, Settings
from rollingjoint.checks import as_choice, as_floats, as_integer, as_number, as_range
from rollingjoint.design import DesignBox, DesignSpace, space_of_settings
from rollingjoint.errors import ConfigError

Rows = tuple[tuple[float, ...], ...]

PAIRS: Rows = ((4.0, 4.0), (6.0, 3.0), (3.0, 6.0))
"""Tensions of two tendons by default [N]."""


def _default_space() -> DesignSpace:
    return DesignSpace(symmetric=False)


def _checked_space(space: object) -> DesignBox:
    """A space, or that of a dictionary; raises ConfigError for others."""
    checked = space_of_settings(space, _default_space()) if isinstance(space, Mapping) else space
    if not isinstance(checked, DesignBox):
        raise ConfigError("space", checked, "a DesignSpace, SpatialDesignSpace or MechanismSpace, or its fields")
    return checked


@dataclass(frozen=True)
class DesignRewardConfig(Settings):
    """Weights of improvement and of the penalties of a bad design.

    Args:
        improvement: "log": log((error before + offset_mm) / (error after + offset_mm)), the same for halving a large
            error and a small one; or "linear": (error before - error after) / error_scale_mm.
        offset_mm: error below which "log" gains little more [mm].
        error_scale_mm: improvement that "linear" counts as 1 [mm].
        violation: weight of the sum of the margins' shortfalls below 0.
        failure: subtracted where a valid design has no equilibrium in some case.
    """

    _SECTION: ClassVar[str] = "reward."
    improvement: str = "log"
    offset_mm: float = 0.5
    error_scale_mm: float = 10.0
    violation: float = 1.0
    failure: float = 1.0

    def __post_init__(self) -> None:
        self._check(as_choice, "improvement", choices=("log", "linear"))
        self._check(as_number, "offset_mm", "error_scale_mm", low=1e-3)
        self._check(as_number, "violation", "failure", low=0.0)


@dataclass(frozen=True)
class DesignConfig(Settings):
    """Everything that defines the design task.

    Args:
        space: the designs: a DesignSpace, a SpatialDesignSpace or a MechanismSpace, or a dictionary: fields of
            DesignSpace, with `kind: space` of SpatialDesignSpace, with `mechanism` of MechanismSpace.
        tensions: tensions of the m tendons in every case, (K, m) [N]. By default for other than two tendons: all 4 N,
            then one after the other 6 N, the rest 3 N.
        force: range of the uniform magnitude of the force at the tip, drawn for every case; uniform direction [N].
        start: "random" valid designs, or the "reference" of the space.
        episode_steps: steps until the episode is truncated.
        action_scale: change of the design vector, in the box [-1, 1], by an action of 1.
        largest_error_mm: error of a design that is not valid or has no equilibrium, and the largest of any [mm].
        reward: nested settings, also a dictionary.
    Raises:
        ConfigError: a value out of range, with the range.
    """

    space: DesignBox = field(default_factory=_default_space)
    tensions: Rows = PAIRS
    force: Range = (0.0, 0.3)
    start: str = "random"
    episode_steps: int = 20
    action_scale: float = 0.25
    largest_error_mm: float = 50.0
    reward: DesignRewardConfig = field(default_factory=DesignRewardConfig)

    def __post_init__(self) -> None:
        self._set("space", _checked_space(self.space))
        tendons = self.space.plain.n_tendons
        if self.tensions == PAIRS and tendons != 2:
            self._set("tensions", [[4.0] * tendons, *(3.0 * (1.0 + np.eye(tendons))).tolist()])
        self._set("tensions", tension_rows("tensions", self.tensions, tendons))
        self._check(as_range, "force", low=0.0, unit="N")
        self._check(as_choice, "start", choices=("random", "reference"))
        self._check(as_integer, "episode_steps", low=1, high=LONGEST_EPISODE)
        self._check(as_number, "action_scale", low=1e-6, high=2.0)
        self._check(as_number, "largest_error_mm", low=1e-3)
        self._check_nested({"reward": DesignRewardConfig})

    def updated(self, values: Mapping[str, Any]) -> Self:
        """These settings with `values` on top; a nested dictionary changes only the keys that it names."""
        if isinstance(values, Mapping) and isinstance(values.get("space"), Mapping):
            space = space_of_settings(values["space"], self.space)
            values = {**values, "space": space}
            if space.plain.n_tendons != self.space.plain.n_tendons and "tensions" not in values:
                values["tensions"] = PAIRS
        return super().updated(values)

    @property
    def cases(self) -> int:
        """K, the number of tension pairs."""
        return len(self.tensions)


def tension_rows(what: str, values: Rows | Sequence[Sequence[float]], tendons: int) -> Rows:
    """Tensions of m tendons in one case or more, (K, m) [N], as tuples; ConfigError unless all are above 0."""
    allowed = f"one or more {'pairs' if tendons == 2 else f'rows of {tendons}'} of tensions above 0 [N]"
    rows = as_floats(what, values, allowed, ConfigError)
    if rows.ndim != 2 or rows.shape[1] != tendons or len(rows) == 0 or not np.all(np.isfinite(rows) & (rows > 0)):
        raise ConfigError(what, values, allowed)
    return tuple(tuple(row) for row in rows.tolist())


@dataclass(frozen=True)
class CoDesignRewardConfig(Settings):
    """Weights of the error in the control phase and of the penalties of both phases.

    Args:
        error_scale_mm: error that costs 1 in a step of the control phase [mm].
        effort: of the mean tension, per N.
        violation: of the sum of the margins' shortfalls below 0, in the design phase.
        failure: subtracted where a valid design has no equilibrium at rest, or a command none that is near.
    """

    _SECTION: ClassVar[str] = "reward."
    error_scale_mm: float = 10.0
    effort: float = 0.0
    violation: float = 1.0
    failure: float = 1.0

    def __post_init__(self) -> None:
        self._check(as_number, "error_scale_mm", low=1e-3)
        self._check(as_number, "effort", "violation", "failure", low=0.0)


@dataclass(frozen=True)
class CoDesignConfig(Settings):
    """Everything that defines the task of designing a mechanism and then controlling it.

    Args:
        space: the designs, as in DesignConfig.
        design_steps, control_steps: steps of the two phases of an episode.
        start: "random" valid designs, or the "reference" of the space.
        design_scale: change of the design vector, in the box [-1, 1], by an action of 1.
        step_mm: change of a motor's position by an action of 1 [mm].
        command_range_mm: largest change of a motor's position from where it stands at rest, either way [mm].
        pretension: of every tendon at rest [N].
        targets: number of targets, which follow each other in the control phase.
        target_tensions: range of the tensions under which the tip of the space's reference is at a target [N].
        force: range of the uniform magnitude of the force at the tip in the control phase; uniform direction [N].
        largest_error_mm: largest error [mm].
        reward: nested settings, also a dictionary.
    Raises:
        ConfigError: a value out of range, with the range.
    """

    space: DesignBox = field(default_factory=_default_space)
    design_steps: int = 5
    control_steps: int = 30
    start: str = "random"
    design_scale: float = 0.5
    step_mm: float = 1.0
    command_range_mm: float = 15.0
    pretension: float = 4.0
    targets: int = 3
    target_tensions: Range = (3.0, 6.0)
    force: Range = (0.0, 0.1)
    largest_error_mm: float = 50.0
    reward: CoDesignRewardConfig = field(default_factory=CoDesignRewardConfig)

    def __post_init__(self) -> None:
        self._set("space", _checked_space(self.space))
        self._check(as_integer, "design_steps", "control_steps", low=1, high=LONGEST_EPISODE)
        self._check(as_integer, "targets", low=1, high=self.control_steps)
        self._check(as_choice, "start", choices=("random", "reference"))
        self._check(as_number, "design_scale", low=1e-6, high=2.0)
        self._check(as_number, "step_mm", "command_range_mm", "pretension", low=1e-3, high=1e3)
        self._check(as_range, "target_tensions", low=1e-3, high=1e3, unit="N")
        self._check(as_range, "force", low=0.0, unit="N")
        self._check(as_number, "largest_error_mm", low=1e-3)
        self._check_nested({"reward": CoDesignRewardConfig})

    def updated(self, values: Mapping[str, Any]) -> Self:
        """These settings with `values` on top; a nested dictionary changes only the keys that it names."""
        if isinstance(values, Mapping) and isinstance(values.get("space"), Mapping):
            values = {**values, "space": space_of_settings(values["space"], self.space)}
        return super().updated(values)

    @property
    def episode_steps(self) -> int:
        """Steps until the episode is truncated."""
        return self.design_steps + self.control_steps
