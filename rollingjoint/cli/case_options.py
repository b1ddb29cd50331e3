"""The options of `rj` that define an equilibrium: mechanism, actuation, loads, start; and that equilibrium."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from rollingjoint.errors import InvalidInput
from rollingjoint.family import Family
from rollingjoint.load import BodyWrench, Gravity, Load, Spring, WorldForce
from rollingjoint.mechanism import AnyMechanism
from rollingjoint.statics.batch import Start
from rollingjoint.statics.families import family_of
from rollingjoint.statics.solve import solve_lengths, solve_tensions

_IDLE = ("force", "body_force", "moment", "spring", "gravity", "gravity_direction", "start", "method", "tension_limits")
_LOADS = {
    "force": ("F", "force of fixed direction FX FY, on an arm FX FY FZ [N]"),
    "body_force": ("F", "force that turns with the link, as above"),
    "moment": ("M", "moment, on an arm MX MY MZ [N·mm]"),
    "spring": ("K", "spring K [N/mm] to the anchor AX AY, on an arm AX AY AZ [mm]"),
}


def add_case(parser: argparse.ArgumentParser, required: bool) -> None:
    """Adds mechanism, actuation, loads and start."""
    parser.add_argument("mechanism", metavar="MECHANISM", help="preset name or YAML file")
    actuation = parser.add_mutually_exclusive_group(required=required)
    actuation.add_argument("--tensions", nargs="+", type=float, metavar="T", help="tendon tensions [N]")
    actuation.add_argument("--lengths", nargs="+", type=float, metavar="L", help="tendon lengths [mm]")
    parser.add_argument("--method", choices=("elastic", "least_squares"), help="for --lengths (default elastic)")
    parser.add_argument(
        "--tension-limits", nargs=2, type=float, metavar=("LO", "HI"), help="range a motor holds [N], for --lengths"
    )
    loads = parser.add_argument_group("loads at link origins; LINK 0 is the base, -1 the tip; each may be repeated")
    for name, (number, text) in _LOADS.items():
        loads.add_argument(
            _option(name), nargs="+", type=float, metavar=("LINK", number), action="append", default=[], help=text
        )
    text = "weight of all links, or of each [N]; of an arm no number: beads have weights of their own"
    loads.add_argument("--gravity", nargs="*", type=float, metavar="W", help=text)
    text = "default 0 -1, of an arm 0 0 -1: it stands; it hangs with 0 0 1"
    loads.add_argument("--gravity-direction", nargs="+", type=float, metavar="X", help=text)
    text = "contact points [mm], or hinge angles of an arm [rad], to start from"
    parser.add_argument("--start", nargs="+", type=float, metavar="S", help=text)


def actuated(args: argparse.Namespace) -> bool:
    """Whether tensions or lengths are given.

    Raises:
        InvalidInput: none are, beside an option that needs them and must not be dropped in silence.
    """
    if args.tensions is not None or args.lengths is not None:
        return True
    for name in _IDLE:
        if getattr(args, name) not in (None, []) or (name == "gravity" and args.gravity is not None):
            raise InvalidInput(_option(name), getattr(args, name), "--tensions or --lengths beside it")
    return False


def equilibrium(args: argparse.Namespace, mechanism: AnyMechanism) -> Any:
    """The Equilibrium or HingeEquilibrium that the options ask for."""
    loads, start = _loads(args, mechanism), _start(args, mechanism)
    if args.tensions is not None:
        if args.method or args.tension_limits:
            option = "--method" if args.method else "--tension-limits"
            raise InvalidInput(option, args.method or args.tension_limits, "only beside --lengths")
        return solve_tensions(mechanism, _counted("--tensions", args.tensions, mechanism.n_tendons), loads, start)
    options: dict[str, Any] = {} if args.tension_limits is None else {"tension_limits": tuple(args.tension_limits)}
    lengths = _counted("--lengths", args.lengths, mechanism.n_tendons)
    return solve_lengths(mechanism, lengths, loads, start, method=args.method or "elastic", **options)


def _start(args: argparse.Namespace, mechanism: AnyMechanism) -> Start:
    if args.start is None:
        return None
    values = _counted("--start", args.start, mechanism.n_joints)
    return family_of(mechanism).start_angles(mechanism, values)


def _loads(args: argparse.Namespace, mechanism: AnyMechanism) -> list[Load]:
    family, n_links = family_of(mechanism), mechanism.n_links
    forces, moments, spring = _numbers(family)
    none: Any = (0.0,) * family.dimension
    loads: list[Load] = [
        WorldForce(link, none, moment=m if len(m) > 1 else m[0]) for link, m in _each(args, "moment", moments, n_links)
    ]
    loads += [Spring(link, k, anchor) for link, (k, *anchor) in _each(args, "spring", spring, n_links)]
    loads += [WorldForce(link, f) for link, f in _each(args, "force", forces, n_links)]
    loads += [BodyWrench(link, f) for link, f in _each(args, "body_force", forces, n_links)]
    return loads + _gravity(args, mechanism, family)


def _numbers(family: Family) -> tuple[list[str], list[str], list[str]]:
    """The numbers of a force, a moment and a spring, by name."""
    axes = "XYZ"[: family.dimension]
    forces, moments, anchor = ([letter + axis for axis in axes] for letter in "FMA")
    return forces, moments if family.dimension == 3 else ["M"], ["K", *anchor]


def _gravity(args: argparse.Namespace, mechanism: AnyMechanism, family: Family) -> list[Load]:
    weights, n_links = args.gravity, mechanism.n_links
    if weights is None:
        if args.gravity_direction:
            raise InvalidInput("--gravity-direction", args.gravity_direction, "--gravity beside it")
        return []
    down = [0.0] * (family.dimension - 1) + [-1.0]
    direction: Any = tuple(_counted("--gravity-direction", args.gravity_direction or down, family.dimension))
    if family.own_weight is not None:
        if weights:
            raise InvalidInput("--gravity", weights, "no number", "Beads have weights of their own.")
        return [family.own_weight(mechanism, direction)]
    weights = weights * n_links if len(weights) == 1 else weights
    if len(weights) != n_links:
        raise InvalidInput("--gravity", weights, f"1 weight for all links, or {n_links}, one per link")
    return [Gravity(weights, direction)]


def _each(args: argparse.Namespace, name: str, numbers: Sequence[str], n_links: int) -> list[tuple[int, Any]]:
    """Link and numbers of every load of one option."""
    option, found = _option(name), []
    for link, *values in getattr(args, name):
        if len(values) != len(numbers):
            raise InvalidInput(option, [link, *values], f"LINK {' '.join(numbers)} for this mechanism")
        if link not in range(-n_links, n_links):
            allowed = f"a link, 0 (base) to {n_links - 1}, or -1 (tip) to {-n_links}"
            raise InvalidInput(f"{option} LINK", link, allowed)
        found.append((int(link), tuple(values)))
    return found


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")


def _counted(option: str, values: list[float], count: int) -> list[float]:
    if len(values) != count:
        raise InvalidInput(option, values, f"{count} numbers for this mechanism, not {len(values)}")
    return values
