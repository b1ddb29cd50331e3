"""`rj reach`: the tendon lengths, or tensions, that bring a mechanism's tip to a target."""

from __future__ import annotations

import argparse
import json
from typing import Any

import numpy as np

from rollingjoint.chain.chain import AnyChain
from rollingjoint.checks import as_integer
from rollingjoint.cli.case_options import add_search, counted, search_of, target_of
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse import Reach, ReachStatus, reach
from rollingjoint.inverse.search import STARTS
from rollingjoint.inverse.searches import INPUTS
from rollingjoint.inverse.starts import SAMPLES
from rollingjoint.io import report
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.tables import number_table


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds mechanism, target, limits and loads."""
    parser.add_argument("mechanism", metavar="MECHANISM", help="preset name or YAML file")
    text = "where the tip should be [mm]; in the plane a third number is its angle [rad]"
    parser.add_argument("--tip", nargs="+", type=float, required=True, metavar="X", help=text)
    parser.add_argument("--inputs", choices=INPUTS, default=INPUTS[0], help="what holds the pose (default lengths)")
    text = f"that are tried, at most {SAMPLES} (default {STARTS})"
    parser.add_argument("--starts", type=int, default=STARTS, metavar="N", help=text)
    add_search(parser)
    text = "lowest and highest angle of all joints [rad]"
    parser.add_argument("--joint-limits", nargs=2, type=float, metavar=("LO", "HI"), help=text)
    text = "stiffness that the tip is to have [N/mm] in the direction X Y, in space X Y Z"
    parser.add_argument("--stiffness", nargs="+", type=float, metavar=("K", "X"), help=text)
    text = "with which the last link is to press on the walls [N]; the place of the tip then counts along the wall"
    parser.add_argument("--contact-force", type=float, metavar="F", help=text)
    parser.add_argument("--json", action="store_true", help="print JSON, units in the key names")
    parser.add_argument(
        "--plot", metavar="FILE", help="also draw it, the target as a cross; the suffix sets the format"
    )


def run(args: argparse.Namespace) -> Reach:
    """Print the result; returns it."""
    mechanism = load_mechanism(args.mechanism)
    result = reach(
        mechanism,
        target_of(args.tip, mechanism),
        inputs=args.inputs,
        starts=as_integer("--starts", args.starts, 1, SAMPLES),
        **_aims_of(args, mechanism),
        **search_of(args, mechanism),
    )
    stiffness = result.tip_stiffness(args.stiffness[1:]) if args.stiffness else None
    if args.json:
        print(json.dumps(_as_dict(result) | {"tip_stiffness_N_mm": stiffness}, indent=2, allow_nan=False))
    else:
        print(_as_text(result, stiffness))
    return result


def _aims_of(args: argparse.Namespace, mechanism: AnyChain) -> dict[str, Any]:
    """Keyword arguments of `reach` for joint limits, a stiffness and a force."""
    aims: dict[str, Any] = {"joint_limits": args.joint_limits, "contact_force": args.contact_force}
    if args.stiffness is not None:
        value, *direction = args.stiffness
        aims["stiffness"] = counted("--stiffness", direction, mechanism.dimension, "direction"), value
    if args.contact_force is not None and args.surroundings is None:
        raise InvalidInput("--contact-force", args.contact_force, "--surroundings beside it")
    return aims


def _as_text(result: Reach, stiffness: float | None) -> str:
    """Lengths and tensions, the tip, and how the search ended."""
    rows = zip(range(len(result.lengths)), result.lengths, result.tensions, strict=True)
    point = ", ".join(f"{x:.4f}" for x in result.tip)
    lines = [
        number_table(("tendon", "command [mm]", "tension [N]"), rows, (4, 4)),
        "",
        f"tip at ({point}) mm, {_off(result)}",
        *([] if stiffness is None else [f"stiffness {stiffness:.4f} N/mm"]),
        *([f"the tip presses on walls with {result.contact_force:.4f} N"] if result.equilibrium.wall_contacts else []),
        *([f"limits that bind: {result.binding}"] if result.binding else []),
        *([] if result.from_rest else ["a solve has to start near this pose: from rest it ends at another one"]),
        _status_line(result),
    ]
    return "\n".join(lines)


def _off(result: Reach) -> str:
    distance = float(result.distance)
    return f"{distance:.2g} mm from the target" if np.isfinite(distance) else "not compared with the target"


def _status_line(result: Reach) -> str:
    status = ReachStatus(int(result.status))
    return f"{status.name}: {status.message} ({result.iterations} steps)"


def _as_dict(result: Reach) -> dict[str, Any]:
    status, distance = ReachStatus(int(result.status)), float(result.distance)
    return {
        "status": status.name,
        "message": status.message,
        "commands_mm": result.lengths.tolist(),
        "tensions_N": result.tensions.tolist(),
        "tip_mm": result.tip.tolist(),
        "distance_mm": distance if np.isfinite(distance) else None,
        "binding": result.binding,
        "contact_force_N": result.contact_force,
        "from_rest": bool(result.from_rest),
        "equilibrium": report.as_dict(result.equilibrium),
    }
