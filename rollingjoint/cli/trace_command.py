"""The command `rj trace`: a mechanism along a path of inputs, with friction that remembers, among walls."""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.se3 import rotation
from rollingjoint.cli.case_options import (
    add_loads,
    add_surroundings,
    add_tension_limits,
    checked,
    loads_of,
    note,
    per_tendon,
    surroundings_of,
    tension_limits_of,
)
from rollingjoint.errors import InvalidInput
from rollingjoint.io import report
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.io.path_file import BASE, FEED, MOST_STEPS, UNITS, given_of, load_columns
from rollingjoint.io.trace_report import TracedPath
from rollingjoint.statics.trace import trace

Array = NDArray[np.float64]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.add_argument("mechanism", metavar="MECHANISM", help="preset name or YAML file")
    text = "CSV or YAML file with inputs of every step: length_0_mm ... or tension_0_N ..., feed_mm or base_x_mm ..."
    parser.add_argument("--path", metavar="FILE", help=text)
    given = parser.add_mutually_exclusive_group()
    given.add_argument("--lengths", nargs="+", type=float, metavar="L", help="commanded lengths of all steps [mm]")
    given.add_argument("--tensions", nargs="+", type=float, metavar="T", help="tensions of all steps [N]")
    text = "push the base in along its y axis, in space its z axis, from the first number to the next, and so on [mm]"
    parser.add_argument("--feed", nargs="+", type=float, metavar="F", help=text)
    text = "largest way of the base in a step of --feed [mm] (default 1)"
    parser.add_argument("--feed-step", type=float, metavar="D", help=text)
    add_tension_limits(parser, ", for lengths")
    add_loads(parser)
    add_surroundings(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print every step as JSON, units in the key names")
    form.add_argument("--csv", action="store_true", help="print every step as CSV")
    text = "also draw it among walls: stick and slip over the path; .gif: a film of it"
    parser.add_argument("--plot", metavar="FILE", help=text)


def run(args: argparse.Namespace) -> bool:
    """Print the path that the options define, and draw it; returns whether all its steps are usable."""
    mechanism = load_mechanism(args.mechanism)
    _check_picture(args)
    traced = _traced(args, mechanism)
    print(traced.as_json() if args.json else traced.as_csv() if args.csv else traced.as_table())
    if args.plot:
        _draw(traced, args.plot)
    if traced.given == "lengths":
        note(args, report.length_note(traced.path, traced.inputs))
    if traced.failure:
        print(f"rj trace: {traced.failure}", file=sys.stderr)
    return not traced.failure


def _traced(args: argparse.Namespace, mechanism: AnyChain) -> TracedPath:
    columns = {} if args.path is None else load_columns(args.path, mechanism.n_tendons)
    around, feeds = surroundings_of(args, mechanism), _feeds(args, columns)
    if not around and (feeds is not None or BASE[0] in columns):
        raise InvalidInput("--surroundings", None, "a file of walls, among which the base moves")
    count = len(next(iter(columns.values()))) if columns else 1 if feeds is None else len(feeds)
    given, inputs = _inputs(args, mechanism, columns, count)
    if given == "tensions" and args.tension_limits is not None:
        raise InvalidInput("--tension-limits", args.tension_limits, "only with lengths")
    bases = None
    if around:
        bases = _bases(around.pop("base"), columns, feeds, count, mechanism.dimension)
        around["base"] = bases
    path = trace(mechanism, inputs, loads_of(args, mechanism), given, **tension_limits_of(args), **around)
    return TracedPath(path, given, inputs, bases, feeds)


def _inputs(
    args: argparse.Namespace, mechanism: AnyChain, columns: Mapping[str, Array], count: int
) -> tuple[str, Array]:
    """What is given, lengths or tensions, and its numbers at every step, (K, m)."""
    options = {name: values for name in UNITS if (values := getattr(args, name)) is not None}
    in_file = {name: values for name in UNITS if (values := given_of(columns, name)) is not None}
    if len(options) + len(in_file) != 1:
        allowed = "lengths or tensions, in the file or by an option"
        raise InvalidInput(
            "inputs", [*options, *in_file], allowed, "Give --lengths or --tensions, or a --path with either."
        )
    if in_file:
        ((given, table),) = in_file.items()
        for step, row in enumerate(table.tolist()):
            per_tendon(f"{args.path}: step {step}, {given}", row, mechanism)
        return given, table
    ((given, values),) = options.items()
    return given, np.tile(per_tendon(f"--{given}", values, mechanism), (count, 1))


def _feeds(args: argparse.Namespace, columns: Mapping[str, Array]) -> Array | None:
    """The way of the base at every step, if it moves along a line."""
    if args.feed is None:
        if args.feed_step is not None:
            raise InvalidInput("--feed-step", args.feed_step, "--feed beside it")
        return columns.get(FEED)
    if columns:
        raise InvalidInput("--feed", args.feed, "a column feed_mm in the file in place of it")
    if len(args.feed) < 2:
        raise InvalidInput("--feed", args.feed, "two numbers or more [mm]", "The base moves from one to the next.")
    turns = [checked("--feed", value) for value in args.feed]
    step = checked("--feed-step", 1.0 if args.feed_step is None else args.feed_step, 1e-6)
    legs = list(itertools.pairwise(turns))
    counts = [max(1.0, np.ceil(abs(b - a) / step)) for a, b in legs]
    if sum(counts) >= MOST_STEPS:
        raise InvalidInput("steps of --feed", f"{sum(counts):.0f}", f"less than {MOST_STEPS:,}", "Raise --feed-step.")
    ways = [np.linspace(a, b, int(n) + 1)[1:] for (a, b), n in zip(legs, counts, strict=True)]
    return np.concatenate([turns[:1], *ways])


def _bases(base: Any, columns: Mapping[str, Array], feeds: Array | None, count: int, dimension: int) -> Array:
    """The pose of the base at every step, (K, 3), in space (K, 6)."""
    ways = np.zeros(count) if feeds is None else feeds
    if dimension == 3:
        if BASE[0] in columns:
            raise InvalidInput("columns of the base", list(BASE), "a planar chain", "In space give --base and feed_mm.")
        poses = np.zeros((count, 6))
        poses[:, : len(base)] = base
        poses[:, :3] += ways[:, None] * rotation(poses[:, 3:])[:, :, 2]
        return poses
    if BASE[0] in columns:
        return np.stack([columns[name] for name in BASE], axis=1)
    x, y, angle = base
    return np.stack([x - ways * np.sin(angle), y + ways * np.cos(angle), np.full(count, angle)], axis=1)


def _check_picture(args: argparse.Namespace) -> None:
    if args.plot:
        from rollingjoint.plotting.figure import check_figure_path
        from rollingjoint.plotting.film import ANIMATED

        check_figure_path(args.plot, more=(ANIMATED,))
        if args.surroundings is None:
            raise InvalidInput("--plot", args.plot, "--surroundings beside it", "rj loop draws paths without walls.")


def _draw(traced: TracedPath, path: str) -> None:
    from rollingjoint.plotting.figure import save_figure
    from rollingjoint.plotting.film import ANIMATED, save_wall_film
    from rollingjoint.plotting.walls import plot_wall_contacts

    steps, (label, values) = [traced.path.row(step) for step in range(len(traced.inputs))], traced.driver
    if path.lower().endswith(f".{ANIMATED}"):
        save_wall_film(steps, values, path, label)
    else:
        save_figure(plot_wall_contacts(steps, values.tolist(), label), path)
