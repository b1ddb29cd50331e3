"""The options of `rj` that define an equilibrium: mechanism, actuation, loads, start; and that equilibrium."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from rollingjoint.errors import InvalidInput
from rollingjoint.family import Family
from rollingjoint.load import OPTIONS, Gravity, Load, Option
from rollingjoint.mechanism import AnyMechanism
from rollingjoint.statics.families import family_of
from rollingjoint.statics.history import Start
from rollingjoint.statics.solve import solve_lengths, solve_tensions

# Options that have no effect unless an equilibrium is solved
_SOLVING = *(option.name for option in OPTIONS), "gravity", "gravity_direction", "start", "method", "tension_limits"


def add_case(parser: argparse.ArgumentParser, required: bool) -> None:
    """Adds mechanism, actuation, loads and start."""
    parser.add_argument("mechanism", metavar="MECHANISM", help="preset name or YAML file")
    actuation = parser.add_mutually_exclusive_group(required=required)
    actuation.add_argument("--tensions", nargs="+", type=float, metavar="T", help="tendon tensions [N]")
    actuation.add_argument("--lengths", nargs="+", type=float, metavar="L", help="tendon lengths [mm]")
    parser.add_argument("--method", choices=("elastic", "least_squares"), help="for --lengths (default elastic)")
    add_tension_limits(parser)
    add_loads(parser)
    text = "contact points [mm], or hinge angles of an arm [rad], to start from"
    parser.add_argument("--start", nargs="+", type=float, metavar="S", help=text)


def add_tension_limits(parser: argparse.ArgumentParser) -> None:
    """Adds the limits of tensions."""
    text = "minimum and maximum tendon tension [N], for --lengths"
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


def actuated(args: argparse.Namespace) -> bool:
    """Whether tensions or lengths are given.

    Raises:
        InvalidInput: neither is, but an option that needs one of them is.
    """
    if args.tensions is not None or args.lengths is not None:
        return True
    for name in _SOLVING:
        if getattr(args, name) not in (None, []) or (name == "gravity" and args.gravity is not None):
            raise InvalidInput(_option(name), getattr(args, name), "--tensions or --lengths beside it")
    return False


def equilibrium(args: argparse.Namespace, mechanism: AnyMechanism) -> Any:
    """The Equilibrium or HingeEquilibrium that the options define."""
    loads, start = loads_of(args, mechanism), _start(args, mechanism)
    if args.tensions is not None:
        if args.method or args.tension_limits:
            option = "--method" if args.method else "--tension-limits"
            raise InvalidInput(option, args.method or args.tension_limits, "only beside --lengths")
        return solve_tensions(mechanism, counted("--tensions", args.tensions, mechanism.n_tendons), loads, start)
    options: dict[str, Any] = {} if args.tension_limits is None else {"tension_limits": tuple(args.tension_limits)}
    lengths = counted("--lengths", args.lengths, mechanism.n_tendons)
    return solve_lengths(mechanism, lengths, loads, start, method=args.method or "elastic", **options)


def _start(args: argparse.Namespace, mechanism: AnyMechanism) -> Start:
    if args.start is None:
        return None
    values = counted("--start", args.start, mechanism.n_joints)
    return family_of(mechanism).start_angles(mechanism, values)


def loads_of(args: argparse.Namespace, mechanism: AnyMechanism) -> list[Load]:
    """The loads that the options define."""
    family = family_of(mechanism)
    loads = [
        option.make(link, numbers)
        for option in OPTIONS
        for link, numbers in _each(args, option, option.names(family.dimension), mechanism.n_links)
    ]
    return loads + _gravity(args, mechanism, family)


def _gravity(args: argparse.Namespace, mechanism: AnyMechanism, family: Family) -> list[Load]:
    weights, n_links = args.gravity, mechanism.n_links
    if weights is None:
        if args.gravity_direction:
            raise InvalidInput("--gravity-direction", args.gravity_direction, "--gravity beside it")
        return []
    down = [0.0] * (family.dimension - 1) + [-1.0]
    direction: Any = tuple(counted("--gravity-direction", args.gravity_direction or down, family.dimension))
    if family.own_weight is not None:
        if weights:
            raise InvalidInput("--gravity", weights, "no number", "Beads have weights of their own.")
        return [family.own_weight(mechanism, direction)]
    weights = weights * n_links if len(weights) == 1 else weights
    if len(weights) != n_links:
        raise InvalidInput("--gravity", weights, f"1 weight for all links, or {n_links}, one per link")
    return [Gravity(weights, direction)]


def _each(
    args: argparse.Namespace, option: Option, numbers: Sequence[str], n_links: int
) -> list[tuple[int, tuple[float, ...]]]:
    """Link and numbers of every load of one option."""
    name, found = _option(option.name), []
    for link, *values in getattr(args, option.name):
        if not numbers:
            raise InvalidInput(name, [link, *values], "a planar chain", "Arms take no such load.")
        if not len(numbers) - option.optional <= len(values) <= len(numbers):
            raise InvalidInput(name, [link, *values], f"LINK {_spelled(numbers, option.optional)} for this mechanism")
        if link not in range(-n_links, n_links):
            allowed = f"a link, 0 (base) to {n_links - 1}, or -1 (tip) to {-n_links}"
            raise InvalidInput(f"{name} LINK", link, allowed)
        found.append((int(link), tuple(values)))
    return found


def _spelled(numbers: Sequence[str], optional: int) -> str:
    """The numbers as usage lines have them: K [REST [OTHER]]."""
    needed, left = numbers[: len(numbers) - optional], numbers[len(numbers) - optional :]
    return " ".join(needed) + "".join(f" [{number}" for number in left) + "]" * optional


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def counted(option: str, values: list[float], count: int) -> list[float]:
    """The values of an option; InvalidInput unless there are so many."""
    if len(values) != count:
        raise InvalidInput(option, values, f"{count} numbers for this mechanism, not {len(values)}")
    return values
