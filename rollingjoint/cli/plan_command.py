"""`rj plan`: the tendon lengths over time that lead a mechanism's tip along a path."""

from __future__ import annotations

import argparse
import json
from typing import Any

import numpy as np

from rollingjoint.cli.case_options import add_search, search_of, target_of
from rollingjoint.errors import InvalidInput
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.plan import Plan, PlanStatus, plan_path
from rollingjoint.plan.follow import RATE, STARTS
from rollingjoint.tables import csv_text, number_table


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds mechanism, path, limits and loads."""
    parser.add_argument("mechanism", metavar="MECHANISM", help="preset name or YAML file")
    text = "where the tip should be [mm], repeated for each target; in the plane a third number is its angle [rad]"
    parser.add_argument("--tip", nargs="+", type=float, action="append", required=True, metavar="X", help=text)
    parser.add_argument("--times", nargs="+", type=float, metavar="S", help="when each is due [s] (default: soonest)")
    text = f"largest rate of the lengths [mm/s] (default {RATE:g})"
    parser.add_argument("--rate", type=float, default=RATE, metavar="V", help=text)
    text = "largest distance of steps [mm] (default a hundredth of the mechanism)"
    parser.add_argument("--step", type=float, metavar="D", help=text)
    parser.add_argument("--starts", type=int, default=STARTS, metavar="N", help=f"plans tried (default {STARTS})")
    add_search(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print all steps as JSON, units in the key names")
    form.add_argument("--csv", action="store_true", help="print all steps as CSV")
    parser.add_argument("--plot", metavar="FILE", help="also draw it; the suffix sets the format")


def run(args: argparse.Namespace) -> Plan:
    """Print the plan; returns it."""
    mechanism = load_mechanism(args.mechanism)
    targets = [target_of(tip, mechanism) for tip in args.tip]
    if len({*map(len, targets)}) > 1:
        raise InvalidInput("--tip", args.tip, "2 numbers each, or 3 each")
    plan = plan_path(
        mechanism,
        targets,
        times=args.times,
        rate=args.rate,
        step=args.step,
        starts=args.starts,
        **search_of(args, mechanism),
    )
    print(_as_json(plan) if args.json else _as_csv(plan) if args.csv else _as_table(plan))
    if args.plot:
        from rollingjoint.plotting import plot_plan, save_figure

        save_figure(plot_plan(plan), args.plot)
    return plan


def _as_table(plan: Plan) -> str:
    """A line per target, how the steps ended, and the limits that bind."""
    m = plan.lengths.shape[1]
    head = "target", "time [s]", *(f"command {j} [mm]" for j in range(m)), "distance [mm]", "stability [N·mm/rad]"
    rows = [
        (number, plan.times[step], *plan.lengths[step], plan.distance[step], plan.stability[step])
        for number, step in enumerate(plan.waypoints)
    ]
    values, counts = np.unique(plan.status, return_counts=True)
    counted_steps = [f"{count} of {len(plan.times)} steps {PlanStatus(code).name}: {PlanStatus(code).message}"
                     for code, count in zip(values, counts, strict=True)]  # fmt: skip
    lines = [number_table(head, rows, (3, *[4] * m, 4, 1)), ""]
    if plan.equilibria.walls is not None:
        lines.append(f"largest normal force of a wall {plan.wall_force.max():.4f} N")
    binding = [f"limits that bind: {plan.binding}"] if plan.binding else []
    return "\n".join([*lines, *binding, *counted_steps])


def _columns(plan: Plan) -> dict[str, Any]:
    """Quantities of every step."""
    return {
        "time_s": plan.times,
        "command_mm": plan.lengths,
        "tension_N": plan.tensions,
        "tip_mm": plan.tip,
        "distance_mm": plan.distance,
        "wall_force_N": plan.wall_force,
        "status": np.array([PlanStatus(code).name for code in plan.status]),
    }


def _as_json(plan: Plan) -> str:
    content = {name: values.tolist() for name, values in _columns(plan).items()}
    return json.dumps({"ok": plan.ok, "binding": plan.binding, **content}, indent=2, allow_nan=False)


def _as_csv(plan: Plan) -> str:
    columns: dict[str, list[Any]] = {}
    for name, values in _columns(plan).items():
        if values.ndim == 1:
            columns[name] = values.tolist()
        else:
            columns |= {name.replace("_", f"_{place}_", 1): part.tolist() for place, part in enumerate(values.T)}
    return csv_text(columns, zip(*columns.values(), strict=True))
