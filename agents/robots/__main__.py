"""Score controllers on robots that nobody modelled: rj robots.

Without --controller all that ship for rj_gym/Instrument-v0 are scored. docs/robots.md says what the robots are.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from agents.runs.checks import integer
from agents.runs.command_line import exit_code
from agents.runs.consent import add_consent, consent_of

NAMED = "an opponent or shipped policy by name, a policy file, a run folder, FILE.py:NAME or MODULE:NAME; repeatable"


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 scored or listed, 2 an error."""
    parser = argparse.ArgumentParser(prog="rj robots", description="Score controllers on robots.")
    parser.add_argument("--controller", action="append", default=[], metavar="NAME", help=NAMED)
    parser.add_argument("--robots", type=int, default=50, help="how many, 1 to 50 (default %(default)s)")
    parser.add_argument("--episodes", type=int, default=4, help="of every robot (default %(default)s)")
    parser.add_argument("--development", action="store_true", help="other robots, on which anything may be tried")
    parser.add_argument("--known", action="store_true", help="score in Instrument-v0 itself, too")
    parser.add_argument("--list", action="store_true", help="list the robots, and drive none")
    add_consent(parser)
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments), consent_of(arguments))


def _command(arguments: argparse.Namespace) -> int:
    from agents.robots.contenders import contender, contenders, marked
    from agents.robots.driving import MOST_EPISODES, WORLD, score_on_robots, score_table
    from agents.robots.robot import DEVELOPMENT, TEST_BED, robot_table, robots

    numbers = DEVELOPMENT if arguments.development else TEST_BED
    integer(1, len(numbers))("--robots", arguments.robots)
    integer(1, MOST_EPISODES)("--episodes", arguments.episodes)
    driven = robots(numbers[: arguments.robots])
    if arguments.list:
        print(robot_table(driven))
        return 0
    chosen = {name: contender(name) for name in arguments.controller} or contenders()
    scores = {
        marked(name, one): score_on_robots(one.controller, driven, arguments.episodes, one.settings, arguments.known)
        for name, one in chosen.items()
    }
    which = "development" if arguments.development else "test"
    print(f"{len(driven)} {which} robots, {arguments.episodes} episodes each, {WORLD} is what controllers know")
    print(f"{score_table(scores)}\nlast 10 steps; intervals over robots")
    return 0


if __name__ == "__main__":
    sys.exit(main())
