"""The options of `rj` that define an equilibrium: mechanism, actuation, loads, start; and its solve."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Any

from rollingjoint.chain.chain import AnyChain
from rollingjoint.checks import as_number, as_positive
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse import PREFERENCES
from rollingjoint.io import report
from rollingjoint.io.surroundings_file import load_surroundings
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.load import OPTIONS, Gravity, Load, Option
from rollingjoint.statics.inputs import Start
from rollingjoint.statics.least_squares import LARGEST_TENSION
from rollingjoint.statics.solve import solve_lengths, solve_tensions

# Options that have no effect unless an equilibrium is solved
_SOLVING = (
    *(option.name for option in OPTIONS),
    *("gravity", "gravity_direction", "start", "method", "tension_limits", "surroundings", "base"),
)
_STIFFNESS = "K"  # name of the stiffness in options of springs, which must not be negative


def add_case(parser: argparse.ArgumentParser, required: bool) -> None:
    """Adds mechanism, actuation, loads and start."""
    parser.add_argument("mechanism", metavar="MECHANISM", help="preset name or YAML file")
    actuation = parser.add_mutually_exclusive_group(required=required)
    actuation.add_argument("--tensions", nargs="+", type=float, metavar="T", help="tendon tensions [N]")
    actuation.add_argument("--lengths", nargs="+", type=float, metavar="L", help="tendon lengths [mm]")
    parser.add_argument("--method", choices=("elastic", "least_squares"), help="for --lengths (default elastic)")
    add_tension_limits(parser, ", for --lengths")
    add_loads(parser)
    add_surroundings(parser)
    text = "contact points [mm], or hinge angles of an arm [rad], to start from"
    parser.add_argument("--start", nargs="+", type=float, metavar="S", help=text)


def add_tension_limits(parser: argparse.ArgumentParser, use: str = "") -> None:
    """Adds the limits of tensions. use: added to the help, where they have no effect without another option."""
    text = f"minimum and maximum tendon tension [N]{use}"
    parser.add_argument("--tension-limits", nargs=2, type=float, metavar=("LO", "HI"), help=text)


def add_loads(parser: argparse.ArgumentParser) -> None:
    """Adds the loads."""
    loads = parser.add_argument_group("loads at link origins; LINK 0 is the base, -1 the tip; each may be repeated")
    for option in OPTIONS:
        names, text = ("LINK", option.metavar), option.help
        loads.add_argument(
            _option(option.name), nargs="+", type=float, metavar=names, action="append", default=[], help=text
        )
    text = "weight of all links, or of each [N]; without numbers for an arm, whose beads have weights of their own"
    loads.add_argument("--gravity", nargs="*", type=float, metavar="W", help=text)
    text = "default 0 -1, for an arm 0 0 -1 (it stands; 0 0 1 lets it hang)"
    loads.add_argument("--gravity-direction", nargs="+", type=float, metavar="X", help=text)


def add_surroundings(parser: argparse.ArgumentParser) -> None:
    """Adds the walls around a chain, and where its base is among them."""
    walls = parser.add_argument_group("walls around the chain")
    walls.add_argument("--surroundings", metavar="FILE", help="YAML file with the key surroundings")
    text = "pose of the base among them [mm, rad]: X Y ANGLE, in space X Y Z or X Y Z and a rotation vector (default 0)"
    walls.add_argument("--base", nargs="+", type=float, metavar="X", help=text)


def actuated(args: argparse.Namespace) -> bool:
    """Whether tensions or lengths are given.

    Raises:
        InvalidInput: neither, but an option that needs them.
    """
    if args.tensions is not None or args.lengths is not None:
        return True
    for name in _SOLVING:
        if getattr(args, name) not in (None, []) or (name == "gravity" and args.gravity is not None):
            raise InvalidInput(_option(name), getattr(args, name), "--tensions or --lengths beside it")
    return False


def equilibrium(args: argparse.Namespace, mechanism: AnyChain) -> Any:
    """The Equilibrium or HingeEquilibrium that the options define."""
    loads, start, around = loads_of(args, mechanism), _start(args, mechanism), surroundings_of(args, mechanism)
    if args.tensions is not None:
        if args.method or args.tension_limits:
            option = "--method" if args.method else "--tension-limits"
            raise InvalidInput(option, args.method or args.tension_limits, "only beside --lengths")
        tensions = per_tendon("--tensions", args.tensions, mechanism)
        return solve_tensions(mechanism, tensions, loads, start, **around)
    lengths = per_tendon("--lengths", args.lengths, mechanism)
    limits, method = tension_limits_of(args), args.method or "elastic"
    if method == "least_squares" and args.tension_limits:
        checked("--tension-limits LO", args.tension_limits[0], 0.0, LARGEST_TENSION)
    solution = solve_lengths(mechanism, lengths, loads, start, method=method, **limits, **around)
    if solution.ok:
        note(args, report.length_note(solution, lengths))
    return solution


def add_search(parser: argparse.ArgumentParser) -> None:
    """Adds limits of tensions and of wall forces, the preference, loads and walls of commands that look for lengths."""
    add_tension_limits(parser)
    text = f"of many solutions (default {PREFERENCES[0]})"
    parser.add_argument("--prefer", choices=PREFERENCES, default=PREFERENCES[0], help=text)
    add_loads(parser)
    add_surroundings(parser)
    parser.add_argument("--wall-force", type=float, metavar="F", help="largest normal force of a contact [N]")


def search_of(args: argparse.Namespace, mechanism: AnyChain) -> dict[str, Any]:
    """Keyword arguments of searches for the options of `add_search`."""
    search = {"loads": loads_of(args, mechanism), "prefer": args.prefer, **tension_limits_of(args)}
    around = surroundings_of(args, mechanism)
    if args.wall_force is None:
        return search | around
    if not around:
        raise InvalidInput("--wall-force", args.wall_force, "--surroundings beside it")
    return search | around | {"wall_force": as_positive("--wall-force", args.wall_force, "a positive number [N]")}


def surroundings_of(args: argparse.Namespace, mechanism: AnyChain) -> dict[str, Any]:
    """Keyword arguments of solvers for the walls and the base, empty without the option."""
    if args.surroundings is None:
        if args.base is not None:
            raise InvalidInput("--base", args.base, "--surroundings beside it")
        return {}
    if getattr(args, "method", None) == "least_squares":
        raise InvalidInput("--surroundings", args.surroundings, "--method elastic")
    given = args.base or [0.0, 0.0, 0.0]
    if mechanism.dimension == 3 and len(given) not in (3, 6):
        raise InvalidInput("--base", given, "3 numbers X Y Z, or 6 with a rotation vector, for this mechanism")
    base = counted("--base", given, len(given) if mechanism.dimension == 3 else 3)
    return {"surroundings": load_surroundings(args.surroundings), "base": base}


def target_of(values: list[float], mechanism: AnyChain) -> list[float]:
    """The target of --tip: coordinates, or in the plane a pose."""
    if mechanism.dimension == 2 and len(values) not in (2, 3):
        raise InvalidInput("--tip", values, "2 numbers x, y for this mechanism, or 3 with the angle of the last link")
    return counted("--tip", values, len(values) if mechanism.dimension == 2 else 3)


def note(args: argparse.Namespace, text: str) -> None:
    """Print a note on a result to stderr, unless it is empty."""
    if text:
        print(f"rj {args.command}: note: {text}", file=sys.stderr)


def tension_limits_of(args: argparse.Namespace) -> dict[str, Any]:
    """Keyword argument of solvers for the tension limits, empty without the option."""
    if args.tension_limits is None:
        return {}
    low, high = args.tension_limits
    checked("--tension-limits LO", low, 0.0)
    if not low <= high:
        raise InvalidInput("--tension-limits HI", high, f"a number from LO = {low:g}, or inf")
    return {"tension_limits": (low, high)}


def _start(args: argparse.Namespace, mechanism: AnyChain) -> Start:
    if args.start is None:
        return None
    values = counted("--start", args.start, mechanism.n_joints, "of joint")
    return mechanism.start_angles(values)


def loads_of(args: argparse.Namespace, mechanism: AnyChain) -> list[Load]:
    """The loads that the options define."""
    loads = [
        option.make(link, numbers)
        for option in OPTIONS
        for link, numbers in _entries(args, option, option.names(mechanism.dimension), mechanism.n_links)
    ]
    return loads + _gravity(args, mechanism)


def _gravity(args: argparse.Namespace, mechanism: AnyChain) -> list[Load]:
    weights, n_links = args.gravity, mechanism.n_links
    if weights is None:
        if args.gravity_direction:
            raise InvalidInput("--gravity-direction", args.gravity_direction, "--gravity beside it")
        return []
    down = [0.0] * (mechanism.dimension - 1) + [-1.0]
    direction: Any = tuple(counted("--gravity-direction", args.gravity_direction or down, mechanism.dimension))
    own_weight = mechanism.own_weight(direction)
    if own_weight is not None:
        if weights:
            raise InvalidInput("--gravity", weights, "no number", "Its links have weights of their own.")
        return [own_weight]
    weights = weights * n_links if len(weights) == 1 else weights
    if len(weights) != n_links:
        raise InvalidInput("--gravity", weights, f"1 weight for all links, or {n_links}, one per link")
    return [Gravity(counted("--gravity", weights, n_links, "of link"), direction)]


def _entries(
    args: argparse.Namespace, option: Option, numbers: Sequence[str], n_links: int
) -> list[tuple[int, tuple[float, ...]]]:
    """Link and numbers of every load of one option."""
    name, entries = _option(option.name), []
    for link, *values in getattr(args, option.name):
        if not len(numbers) - option.optional <= len(values) <= len(numbers):
            raise InvalidInput(name, [link, *values], f"LINK {_spelled(numbers, option.optional)} for this mechanism")
        if link not in range(-n_links, n_links):
            allowed = f"a link, 0 (base) to {n_links - 1}, or -1 (tip) to {-n_links}"
            raise InvalidInput(f"{name} LINK", link, allowed)
        for number, value in zip(numbers, values, strict=False):  # the last may be left out
            checked(f"{name} {number}", value, 0.0 if number == _STIFFNESS else -LARGEST_INPUT)
        entries.append((int(link), tuple(values)))
    return entries


def _spelled(numbers: Sequence[str], optional: int) -> str:
    """The numbers in the form of usage lines: K [REST [OTHER]]."""
    needed, remaining = numbers[: len(numbers) - optional], numbers[len(numbers) - optional :]
    return " ".join(needed) + "".join(f" [{number}" for number in remaining) + "]" * optional


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def per_tendon(option: str, values: list[float], mechanism: AnyChain, low: float = 0.0) -> list[float]:
    """Tensions or lengths, one per tendon, as `counted`."""
    return counted(option, values, mechanism.n_tendons, "of tendon", low)


def counted(
    option: str, values: list[float], count: int, place: str = "number", low: float = -LARGEST_INPUT
) -> list[float]:
    """The values of an option; InvalidInput unless there are `count`, each a number that solvers take.

    Args:
        place: name of a value in messages, before its number, such as "of tendon".
        low: the smallest number allowed.
    """
    if len(values) != count:
        raise InvalidInput(option, values, f"{count} numbers for this mechanism, not {len(values)}")
    return [checked(f"{option} {place} {i}", value, low) for i, value in enumerate(values)]


def checked(name: str, value: float, low: float = -LARGEST_INPUT, high: float = LARGEST_INPUT) -> float:
    """The value; InvalidInput unless it is a number from low to high, by default the range of solvers."""
    return as_number(name, value, low, high, allowed=f"a number from {low:g} to {high:g}")
