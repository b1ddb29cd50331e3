"""Adapt controllers to robots outside the training distribution: rj adapt --controller "probing bank" --robots 3.

With --recording FILE the robot is a rig: no score, the adapted policies and the identification go into --policies.

A robot spends some episodes on the bench and is identified; every controller is adapted to it in simulation, and scored
in the robot's episodes before and after: docs/robots.md.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from agents.runs.checks import integer
from agents.runs.command_line import exit_code, note, typed_command
from agents.runs.consent import add_consent, consent_of

if TYPE_CHECKING:
    from agents.adaptation.trial import RobotTrial, TrialPlan

NAMED = "an opponent by name, a run folder or policy file of apg or distill, FILE.py:NAME or MODULE:NAME; repeatable"
VERSION = 1  # of the results file


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 adapted and scored, 2 an error, 130 stopped by Ctrl-C."""
    parser = argparse.ArgumentParser(prog="rj adapt", description="Adapt controllers to robots.")
    parser.add_argument("--controller", action="append", required=True, metavar="NAME", help=NAMED)
    parser.add_argument("--robots", type=int, default=10, help="how many, 1 to 50 (default %(default)s)")
    parser.add_argument("--robot", type=int, action="append", metavar="K", help="only this one; repeatable")
    parser.add_argument(
        "--recording", type=Path, metavar="FILE", help="of a rig, which no robot of the test bed stands for"
    )
    parser.add_argument("--development", action="store_true", help="other robots, on which anything may be tried")
    parser.add_argument("--episodes", type=int, default=20, help="of every robot on the bench (default %(default)s)")
    parser.add_argument("--sees", choices=("tip", "nothing"), default="tip", help="a camera on the bench; default: tip")
    parser.add_argument("--tries", type=int, default=10, help="settings of an opponent tried (default %(default)s)")
    parser.add_argument("--updates", type=int, default=100, help="of a policy in simulation (default %(default)s)")
    parser.add_argument("--scored", type=int, default=20, help="episodes before and after (default %(default)s)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="results, as JSON")
    parser.add_argument("--policies", type=Path, metavar="FOLDER", help="for policies that were adapted")
    add_consent(parser)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments, typed_command("rj adapt", argv)), consent_of(arguments), "train")


def _command(arguments: argparse.Namespace, command: Sequence[str]) -> int:
    from agents.adaptation.robot import robot
    from agents.adaptation.trial import TrialPlan, adaptable, leads, trial_table, tried

    if arguments.recording:
        return _adapt_to_rig(arguments)
    plan = TrialPlan(arguments.episodes, arguments.sees == "tip", arguments.tries, arguments.updates, arguments.scored)
    numbers = _numbers(arguments)
    controllers = {_short(name): adaptable(name) for name in arguments.controller}
    trials: list[RobotTrial] = []
    for number in numbers:
        trials.append(tried(robot(number), controllers, plan, lambda line: print(line, flush=True)))
        _keep(trials, plan, arguments, command)
    print(f"{trial_table(trials)}\nlast 10 steps, {plan.scored} episodes of every robot; intervals over robots")
    if len(controllers) > 1:
        print(f"After adapting:\n{leads(trials)}")
    return 0


def _adapt_to_rig(arguments: argparse.Namespace) -> int:
    """Identify a rig from its recording, adapt policies to it and write them."""
    from agents.adaptation.trial import TrialPlan, adaptable, adapted_to_rig
    from agents.policies.file import SUFFIX
    from agents.policies.loading import list_policies, load_policy
    from agents.policies.shipped import ShippedPolicy
    from agents.runs.files import write_bytes
    from rollingjoint.errors import ConfigError
    from rollingjoint.identify import read_recording, save_rig
    from rollingjoint.identify.rig_files import rig_report

    if arguments.policies is None:
        raise ConfigError("--policies", None, "a folder for what --recording makes", "Add --policies FOLDER.")
    controllers = {_short(name): adaptable(name) for name in arguments.controller}
    for name in set(controllers) & set(list_policies()):  # of these the newest, for motors of rigs
        controllers[name] = replace(controllers[name], controller=load_policy(name))
    for name, candidate in controllers.items():
        if not isinstance(candidate.controller, ShippedPolicy):
            raise ConfigError("--controller", name, "a policy, which can be written, with --recording")
    found, policies = adapted_to_rig(
        read_recording(arguments.recording, note), controllers, TrialPlan(updates=arguments.updates)
    )
    save_rig(found, arguments.policies)
    print(rig_report(found))
    for name, policy in policies.items():
        path = arguments.policies / f"{name.replace('/', '_')}_rig{SUFFIX}"
        write_bytes(path, policy.to_bytes())
        print(f"adapted: {path}")
    return 0


def _numbers(arguments: argparse.Namespace) -> Sequence[int]:
    """Numbers of the robots."""
    from agents.adaptation.robot import DEVELOPMENT, TEST_BED

    bed = DEVELOPMENT if arguments.development else TEST_BED
    for number in arguments.robot or ():
        integer(bed[0], bed[-1])("--robot", number)
    return arguments.robot or bed[: integer(1, len(bed))("--robots", arguments.robots)]


def _short(name: str) -> str:
    """Short name of a controller: CONFIGURATION/seed_K of a run folder, the last part of other paths."""
    path = Path(name)
    return name if not path.exists() else "/".join(path.resolve().parts[-2:]) if path.is_dir() else path.stem


def _keep(trials: Sequence[RobotTrial], plan: TrialPlan, arguments: argparse.Namespace, command: Sequence[str]) -> None:
    """Write the results so far, and the policies of the last robot, where that is wanted."""
    from agents.policies.file import SUFFIX
    from agents.policies.shipped import ShippedPolicy
    from agents.runs.files import write_bytes, write_text

    if arguments.out:
        content: dict[str, Any] = {"version": VERSION, "command": list(command), "plan": vars(plan)}
        content["robots"] = [trial.to_dict() for trial in trials]
        write_text(arguments.out, json.dumps(content, indent=1) + "\n")
    for name, outcome in trials[-1].outcomes.items():
        if arguments.policies and isinstance(outcome.adapted.controller, ShippedPolicy):
            arguments.policies.mkdir(parents=True, exist_ok=True)
            file = f"{name.replace('/', '_')}_robot_{trials[-1].robot.number}{SUFFIX}"
            write_bytes(arguments.policies / file, outcome.adapted.controller.to_bytes())


if __name__ == "__main__":
    sys.exit(main())
