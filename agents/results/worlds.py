"""The worlds that a benchmark is scored in: its own episodes, and episodes under settings unknown to training."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from agents.results.description import load_range
from agents.results.environment import changed, setting
from agents.results.record import SHIFT, SWEEP, TEST, VALIDATION, BenchmarkRecord, World
from agents.runs.environment import EnvConfig
from rj_gym.tracking.config import FrictionConfig, TrackingConfig
from rollingjoint.errors import RollingJointError

HEAVIER = 1.5  # times the largest load of training
POINTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.25)  # of most curves, times the largest value of training

RUBBING = FrictionConfig()
WITH_FRICTION = {
    f"With capstan friction in the chain, by a hidden coefficient of {RUBBING.mu[0]:g} to {RUBBING.mu[1]:g}": {
        "friction": {"mu": list(RUBBING.mu)}
    }
}

WORN: Mapping[str, Mapping[str, Any]] = {
    "More play than in training, 2 to 3 mm": {"actuation": {"play_mm": [2.0, 3.0]}},
    "More sheath friction than in training, 0 to 0.6": {"actuation": {"sheath_friction": [0.0, 0.6]}},
}
STRONGER: Mapping[str, Mapping[str, Any]] = {
    "Stronger motors than in training, 30 to 45 N": {"actuation": {"tension_limit": [30.0, 45.0]}}
}

SHIFTS: Mapping[str, Mapping[str, Mapping[str, Any]]] = {
    "rj_gym/Instrument-v0": WITH_FRICTION,
    "rj_gym/InstrumentShift-v0": {**WORN, **WITH_FRICTION},
    "rj_gym/SlowCamera-v0": WITH_FRICTION,
    "rj_gym/LatePose-v0": WITH_FRICTION,
    "rj_gym/Instrument-v1": {**STRONGER, **WITH_FRICTION},
    "rj_gym/InstrumentShift-v1": {**WORN, **STRONGER, **WITH_FRICTION},
    "rj_gym/SlowCamera-v1": {**STRONGER, **WITH_FRICTION},
    "rj_gym/LatePose-v1": {**STRONGER, **WITH_FRICTION},
    "rj_gym/ArmInstrument-v1": STRONGER,
}
"""What a task is about beyond its own episodes: changes of its settings by their heading, by id."""

NOTES: Mapping[str, str] = dict.fromkeys(
    WITH_FRICTION,
    "Tendons rub in every hole of the chain. No filter here has a state for that: it takes what tendons lose there "
    "for play, load or stiffness. No learner was trained with it, and opponents keep settings that were tuned without.",
)
"""What has to be known to read the table under such a heading."""

_IDEAL_LIMIT = (
    "Motors give way here exactly where the tension of a tendon, behind play and sheath, reaches 15 N, as no real "
    "motor does. The policy of version 0 relies on it. With that number alone moved it ends at {}, and the probing "
    "bank at {}: see [the ideal limit of tension](policies.md#the-ideal-limit-of-tension)."
)
TASK_NOTES: Mapping[str, str] = {
    "rj_gym/Instrument-v0": _IDEAL_LIMIT.format(
        "1.03 mm at 17 N and 4.12 mm at 60 N, which no tendon reaches", "0.759 and 0.797 mm"
    ),
    "rj_gym/InstrumentShift-v0": _IDEAL_LIMIT.format(
        "0.784 mm at 16 N and 5.73 mm at 60 N, which no tendon reaches", "0.458 and 0.613 mm"
    ),
}
"""What has to be known to read the tables of a task, by id; figures of benchmarks/tension_limit.py."""


KNOWN_MM: Mapping[str, float] = {
    "rj_gym/Instrument-v0": 0.47,
    "rj_gym/InstrumentShift-v0": 0.16,
    "rj_gym/ArmInstrument-v0": 1.26,
    "rj_gym/SlowCamera-v0": 0.39,
    "rj_gym/LatePose-v0": 0.67,
    "rj_gym/Instrument-v1": 0.54,
    "rj_gym/InstrumentShift-v1": 0.13,
    "rj_gym/SlowCamera-v1": 0.39,
    "rj_gym/LatePose-v1": 0.71,
    "rj_gym/ArmInstrument-v1": 4.65,
}
"""What can be known of the tip, by id [mm]: the least of benchmarks/information.py."""


def task_note(record: BenchmarkRecord) -> str:
    """The note on a task; empty where there is none, or where the task has another limit of tension."""
    ideal = list(record.settings.get("tension_range", ())) == list(TrackingConfig().tension_range)
    return TASK_NOTES.get(record.env_id, "") if ideal else ""


@dataclass(frozen=True)
class SweepAxis:
    """A setting that episodes draw from a range, and the label of its curve.

    Args:
        largest: for tasks that lack the setting, but are shifted to it: where the curve ends.
        points: of the curve, times the largest value of training; none: POINTS.
    """

    name: str
    label: str
    keys: tuple[str, str]
    largest: float = 0.0
    points: Sequence[float] = ()

    def trained(self, env: EnvConfig) -> tuple[float, float]:
        """The range of the setting in a task."""
        low, high = setting(env, *self.keys) or (0.0, 0.0)
        return low, high

    def end(self, env: EnvConfig) -> float:
        """The value that shares of POINTS are of; 0: no curve."""
        shifted = any(self.keys[0] in changes for changes in SHIFTS.get(env.id, {}).values())
        return self.trained(env)[1] or (self.largest if shifted else 0.0)


AXES = (
    SweepAxis("play", "play of every tendon [mm]", ("actuation", "play_mm")),
    SweepAxis("sheath friction", "sheath friction of every tendon", ("actuation", "sheath_friction")),
    SweepAxis("friction", "coefficient of friction in the holes", ("friction", "mu"), RUBBING.mu[1]),
    SweepAxis("load", "load [N]", ("load", "magnitude")),
    SweepAxis(
        "limit", "limit of tension [N]", ("actuation", "tension_limit"), points=(1 / 3, 0.5, 2 / 3, 1.0, 1.5, 2.0)
    ),
)


@dataclass(frozen=True)
class ScoringPlan:
    """Which episodes a page is made of.

    Args:
        test, validation: their seeds. per_point: number of episodes of every point of a curve, the first of `test`.
    """

    test: range
    validation: range
    per_point: int


def worlds_of(env: EnvConfig, plan: ScoringPlan) -> list[World]:
    """The worlds of a benchmark with this environment, without floors."""
    worlds = [World(TEST, TEST, plan.test.start, len(plan.test))]
    if plan.validation:
        worlds.append(World(VALIDATION, VALIDATION, plan.validation.start, len(plan.validation)))
    shifts = [
        World(heading, SHIFT, plan.test.start, len(plan.test), changes, heading)
        for heading, changes in _shifts(env).items()
    ]
    return [*worlds, *shifts, *(_points(env, plan) if plan.per_point else [])]


def _shifts(env: EnvConfig) -> dict[str, Mapping[str, Any]]:
    shifts = dict(SHIFTS.get(env.id, {}))
    if _load_varies(env):
        high = setting(env, "load", "magnitude")[1]
        heading = f"Heavier loads than in training, {load_range(setting(env, 'load'), high, HEAVIER * high)}"
        shifts[heading] = {"load": {"magnitude": [high, HEAVIER * high]}}
    return shifts


def _load_varies(env: EnvConfig) -> bool:
    """Whether other loads tell something; not where loads are observed, in units of the largest."""
    return bool(setting(env, "load", "magnitude")[1] > 0 and not setting(env, "observe_load"))


def _points(env: EnvConfig, plan: ScoringPlan) -> Iterator[World]:
    """A world for every point of every curve; values that the environment refuses are left out."""
    for axis in AXES:
        end = axis.end(env)
        if end <= 0 or (axis.name == "load" and not _load_varies(env)):
            continue
        section, key = axis.keys
        for share in axis.points or POINTS:
            value = round(share * end, 6)
            changes = {section: {key: [value, value]}}
            try:
                changed(env, changes)
            except RollingJointError:
                continue
            episodes = min(plan.per_point, len(plan.test))
            name = f"{axis.name} {value:g}"
            yield World(name, SWEEP, plan.test.start, episodes, changes, "", axis.label, value, axis.trained(env))
