"""Controllers on robots before and after they were adapted to them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from agents.adaptation.bench import record
from agents.adaptation.controllers import InstrumentController, instrument_controller
from agents.adaptation.driving import WORLD, rig_settings, score_on_robots
from agents.adaptation.identify import Identified, identify, identify_recording
from agents.adaptation.informed import Informed
from agents.adaptation.robot import Robot
from agents.adaptation.tuning import tuned
from agents.controllers.controller import Array
from agents.controllers.tuned import tunable_in
from agents.policies.export import export_run
from agents.policies.shipped import ShippedPolicy
from agents.results.roster import is_privileged
from agents.results.statistics import Bootstrap, Interval
from agents.results.wording import mm, with_interval
from agents.runs.command_line import progress_bar
from agents.runs.folder import RunFolder
from rollingjoint.checks import as_integer
from rollingjoint.errors import ConfigError
from rollingjoint.identify import IdentifiedRig, RigRecording
from rollingjoint.identify.rig import EVALUATIONS
from rollingjoint.tables import text_table

Say = Callable[[str], object]


@dataclass(frozen=True)
class TrialPlan:
    """The effort of adapting to a robot, and the episodes that judge it.

    Args:
        episodes: on the bench. sees_tip: whether a camera measures the tip there.
        tries: settings of an opponent that are tried in simulation. updates: of a policy, in simulation.
        scored: episodes of the robot that are driven before and after.
    """

    episodes: int = 20
    sees_tip: bool = True
    tries: int = 10
    updates: int = 100
    scored: int = 20

    def __post_init__(self) -> None:
        for name, low, high in (("episodes", 1, 500), ("tries", 0, 10**6), ("updates", 0, 10**6), ("scored", 1, 1000)):
            as_integer(f"--{name}", getattr(self, name), low, high, error=ConfigError)


@dataclass(frozen=True)
class TrialOutcome:
    """One controller on one robot: errors before and after, (E,) [mm]; seconds that adapting it took in simulation."""

    before: Array
    after: Array
    seconds: float
    adapted: InstrumentController

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        errors = {"before_mm": self.before, "after_mm": self.after}
        return {name: [float(f"{e:.4g}") for e in values] for name, values in errors.items()} | {
            "seconds": round(self.seconds, 1)
        }


@dataclass(frozen=True)
class RobotTrial:
    """One robot: its identification, the seconds that took, and the outcomes by name of the controller."""

    robot: Robot
    identified: Identified
    seconds: float
    outcomes: Mapping[str, TrialOutcome] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        twin, sd, surfaces = self.identified.twin, self.identified.sd, "surface_errors"
        estimates = {
            name: {"value": _plain(getattr(twin, name)), "sd": _plain(sd[name])} for name in sd if name != surfaces
        }
        residuals = {"residual": self.identified.residual, "residual_before": self.identified.before}
        outcomes = {name: outcome.to_dict() for name, outcome in self.outcomes.items()}
        seconds = {"seconds": round(self.seconds, 1)}
        return {"robot": self.robot.number, **seconds, "identified": estimates | residuals, "controllers": outcomes}


def adaptable(name: str) -> InstrumentController:
    """The controller of that name, by `instrument_controller`; policies of run folders in the form that is shipped.

    Raises:
        ConfigError, PolicyError, RunFolderError: no such controller, or one that cannot be adapted.
    """
    candidate = instrument_controller(name)
    if Path(name).is_dir():
        candidate = replace(candidate, controller=export_run(RunFolder.open(Path(name)), "best", Path(name).name))
    if isinstance(candidate.controller, ShippedPolicy):
        from agents.adaptation.fine_tuning import trainable

        trainable(candidate.controller)
    if is_privileged(candidate.controller):
        raise ConfigError("--controller", name, "a controller that sees what Instrument-v0 shows", "It knows all.")
    return candidate


def adapted(
    name: str, candidate: InstrumentController, identified: Identified, plan: TrialPlan
) -> InstrumentController:
    """A controller after adapting to a robot.

    Policies are trained on; opponents are told the identified parameters, and their settings are searched; other
    controllers are told the parameters.
    """
    if isinstance(candidate.controller, ShippedPolicy):
        from agents.adaptation.fine_tuning import FineTuning, fine_tuned

        settings, policy = FineTuning(updates=plan.updates), candidate.controller
        with progress_bar(plan.updates, " updates", leave=False) as bar:
            trained = fine_tuned(policy, candidate.settings, identified, settings, lambda loss: bar.update())
        return replace(candidate, controller=trained)
    if name in tunable_in(WORLD):
        with progress_bar(plan.tries, " tries", leave=False) as bar:
            return replace(candidate, controller=tuned(name, identified, plan.tries, lambda error: bar.update()))
    return replace(candidate, controller=Informed(candidate.controller, identified))


def adapted_to_rig(
    recording: RigRecording, policies: Mapping[str, InstrumentController], plan: TrialPlan
) -> tuple[IdentifiedRig, dict[str, ShippedPolicy]]:
    """The identified rig, and policies that were trained on with the motors and sensors of rigs as it may be."""
    with progress_bar(EVALUATIONS, " evaluations", leave=False) as bar:
        identified, found = identify_recording(recording, bar.update)
    results = {}
    for name, candidate in policies.items():
        in_rig_world = replace(candidate, settings={**rig_settings(), **candidate.settings})
        result = adapted(name, in_rig_world, identified, plan).controller
        assert isinstance(result, ShippedPolicy)
        results[name] = result
    return found, results


def tried(
    robot: Robot, contestants: Mapping[str, InstrumentController], plan: TrialPlan, say: Say = lambda line: None
) -> RobotTrial:
    """Identify a robot, adapt the controllers to it, and score them in its episodes before and after.

    say: called with a line about everything that was done.
    """
    start = time.process_time()
    with progress_bar(EVALUATIONS, " evaluations", leave=False) as bar:
        identified = identify(record(robot, plan.episodes, plan.sees_tip), robot.number, say=bar.update)
    seconds = time.process_time() - start
    residuals = f"{identified.before:.2f} -> {identified.residual:.2f} standard deviations left"
    say(f"robot {robot.number}: identified in {seconds:.0f} s of processor time, {residuals}")
    outcomes = {}
    for name, contestant in contestants.items():
        outcomes[name] = outcome = _tried(name, contestant, robot, identified, plan)
        errors = f"{mm(outcome.before.mean())} -> {mm(outcome.after.mean())} mm"
        say(f"robot {robot.number}: {name} {errors}, adapted in {outcome.seconds:.0f} s")
    return RobotTrial(robot, identified, seconds, outcomes)


def _tried(
    name: str, contestant: InstrumentController, robot: Robot, identified: Identified, plan: TrialPlan
) -> TrialOutcome:
    start = time.process_time()
    after = adapted(name, contestant, identified, plan)
    seconds = time.process_time() - start
    before, now = (
        score_on_robots(x.controller, [robot], plan.scored, x.settings).errors[0] for x in (contestant, after)
    )
    return TrialOutcome(before, now, seconds, after)


def gains(trials: Sequence[RobotTrial], name: str) -> tuple[Interval, Interval, Interval]:
    """Means over robots before, after, and after minus before, with intervals from a bootstrap of robots [mm]."""
    before, after = (np.array([getattr(t.outcomes[name], when).mean() for t in trials]) for when in ("before", "after"))
    resampled = Bootstrap(len(trials))
    return resampled.mean(before), resampled.mean(after), resampled.compare(after, before).difference


def _ranked(trials: Sequence[RobotTrial]) -> list[str]:
    """The controllers, the best adapted one first."""
    return sorted(trials[0].outcomes, key=lambda name: gains(trials, name)[1].value)


def trial_table(trials: Sequence[RobotTrial]) -> str:
    """One row per controller, for a terminal: means over robots, the best adapted one first."""
    rows = []
    for name in _ranked(trials):
        better = sum(trial.outcomes[name].after.mean() < trial.outcomes[name].before.mean() for trial in trials)
        seconds = np.mean([trial.outcomes[name].seconds for trial in trials])
        cells = [with_interval(interval, mm) for interval in gains(trials, name)]
        rows.append([name, *cells, f"{better} of {len(trials)}", f"{seconds:.0f} s"])
    head = ["controller", "before [mm]", "after [mm]", "change [mm]", "better on", "adapting"]
    return text_table(head, rows, ruled=True)


def leads(trials: Sequence[RobotTrial]) -> str:
    """A line per adapted controller that the best one is compared with, on the same robots."""
    best, *others = _ranked(trials)
    best_errors = np.array([trial.outcomes[best].after.mean() for trial in trials])
    lines = []
    for name in others:
        errors = np.array([trial.outcomes[name].after.mean() for trial in trials])
        difference = with_interval(Bootstrap(len(trials)).compare(best_errors, errors).difference, mm)
        lines.append(f"{best} minus {name}: {difference} mm, better on {(best_errors < errors).sum()} of {len(trials)}")
    return "\n".join(lines)


def _plain(values: Array) -> list[float]:
    return [float(f"{value:.4g}") for value in values]
