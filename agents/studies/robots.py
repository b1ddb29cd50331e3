"""Score controllers on robots outside the training distribution: rj robots.

Without --controller all that ship for rj_gym/Instrument-v0 are scored. docs/robots.md describes the robots.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence

import numpy as np

from agents.adaptation.driving import MOST_EPISODES, WORLD, RobotScore, score_on_robots
from agents.adaptation.robot import DEVELOPMENT, GENERATIONS, TEST_BED, Robot, robots
from agents.results.wording import mm, with_interval
from agents.runs.checks import integer
from agents.runs.command_line import exit_code
from agents.runs.consent import add_consent, consent_of
from rollingjoint.tables import text_table

NAMED = "an opponent or shipped policy by name, a policy file, a run folder, FILE.py:NAME or MODULE:NAME; repeatable"


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 scored or listed, 2 an error."""
    parser = argparse.ArgumentParser(prog="rj robots", description="Score controllers on robots.")
    parser.add_argument("--controller", action="append", default=[], metavar="NAME", help=NAMED)
    parser.add_argument("--robots", type=int, default=50, help="how many, 1 to 50 (default %(default)s)")
    parser.add_argument("--episodes", type=int, default=4, help="of every robot (default %(default)s)")
    parser.add_argument("--development", action="store_true", help="other robots, on which anything may be tried")
    parser.add_argument(
        "--generation", type=int, choices=GENERATIONS, default=0, help="1: motors with limits of their own (default 0)"
    )
    parser.add_argument("--known", action="store_true", help="score in Instrument-v0 itself, too")
    parser.add_argument("--list", action="store_true", help="list the robots, and drive none")
    add_consent(parser)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments), consent_of(arguments))


def _command(arguments: argparse.Namespace) -> int:
    from agents.adaptation.controllers import instrument_controller, instrument_controllers, marked

    numbers = DEVELOPMENT if arguments.development else TEST_BED
    integer(1, len(numbers))("--robots", arguments.robots)
    integer(1, MOST_EPISODES)("--episodes", arguments.episodes)
    driven = robots(numbers[: arguments.robots], arguments.generation)
    if arguments.list:
        print(robot_table(driven))
        return 0
    candidates = {name: instrument_controller(name) for name in arguments.controller} or instrument_controllers()
    scores = {
        marked(name, candidate): score_on_robots(
            candidate.controller, driven, arguments.episodes, candidate.settings, arguments.known
        )
        for name, candidate in candidates.items()
    }
    which = "development" if arguments.development else "test"
    known = f"{WORLD}, with the motors of version 1," if arguments.generation else WORLD
    print(f"{len(driven)} {which} robots, {arguments.episodes} episodes each, {known} is what controllers know")
    print(f"{score_table(scores)}\nlast 10 steps; intervals over robots")
    return 0


def robot_table(listed: Sequence[Robot]) -> str:
    """One row per robot, for a terminal: both tendons' numbers, and the largest errors of its surfaces."""
    head = ["robot", "mu", "play [mm]", "sheath friction", "stiffness", "motors [mm]", "surfaces [mm]", "[mrad]"]
    limited = any(robot.tension_limits is not None for robot in listed)
    rows = []
    for robot in listed:
        of_tendons = (robot.mu, robot.play_mm, robot.sheath_friction, robot.stiffness, robot.motor_offsets)
        largest = np.abs(robot.surface_errors).max(axis=(0, 1))
        cells = [" ".join(f"{value:.3f}" for value in values) for values in of_tendons]
        rows.append([f"{robot.number}", *cells, f"{largest[:2].max():.3f}", f"{1000 * largest[2]:.1f}"])
        if robot.tension_limits is not None:
            rows[-1].append(" ".join(f"{limit:.1f}" for limit in robot.tension_limits))
    return text_table([*head, "limits [N]"] if limited else head, rows, ruled=True)


def score_table(scores: Mapping[str, RobotScore]) -> str:
    """One row per controller, for a terminal, the best first: mean over robots, best, median and worst robot."""
    rows = []
    for name, score in sorted(scores.items(), key=lambda item: item[1].mean.value):
        spread = [mm(value) for value in np.percentile(score.of_robots, (0, 50, 100))]
        column = [] if score.known_mean is None else [with_interval(score.known_mean, mm)]
        rows.append([name, with_interval(score.mean, mm), *spread, *column])
    column = ["Instrument-v0 [mm]"] if any(score.known is not None for score in scores.values()) else []
    head = ["controller", "mean [mm]", "best robot", "median", "worst", *column]
    return text_table(head, rows, ruled=True)
