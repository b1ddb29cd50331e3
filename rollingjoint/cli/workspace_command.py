"""`rj workspace`: where a mechanism's tip can be, and how well it moves, presses and holds there."""

from __future__ import annotations

import argparse

import numpy as np

from rollingjoint.cli.case_options import add_loads, add_tension_limits, loads_of, tension_limits_of
from rollingjoint.inverse import PREFERENCES, Workspace, workspace
from rollingjoint.inverse.reachable import CELLS
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.tables import csv_text, text_table

_QUANTILES = (0.0, 0.5, 1.0)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds mechanism, limits and loads."""
    parser.add_argument("mechanism", metavar="MECHANISM", help="preset name or YAML file")
    text = f"along the longest side (default {CELLS[2]}, in space {CELLS[3]})"
    parser.add_argument("--cells", type=int, metavar="N", help=text)
    add_tension_limits(parser, " (default 0.5 20)")
    text = "of many solutions for a tip (default margins)"
    parser.add_argument("--prefer", choices=PREFERENCES, default="margins", help=text)
    add_loads(parser)
    parser.add_argument("--csv", action="store_true", help="print all cells as CSV, units in the head")
    parser.add_argument("--out", metavar="FILE", help="picture; the suffix sets the format")


def run(args: argparse.Namespace) -> None:
    """Print the workspace, and draw it."""
    mechanism = load_mechanism(args.mechanism)
    limits = tension_limits_of(args)
    space = workspace(mechanism, loads_of(args, mechanism), cells=args.cells, prefer=args.prefer, **limits)
    print(_as_csv(space) if args.csv else _as_table(space))
    if args.out:
        from rollingjoint.plotting import plot_workspace, save_figure

        save_figure(plot_workspace(space), args.out)


def _columns(space: Workspace) -> dict[str, np.ndarray]:
    """Numbers of every cell, by their names with units."""
    stiffnesses, _ = space.principal_stiffness
    return {
        "dexterity": space.dexterity,
        "force_N": space.force,
        "softest_N_per_mm": stiffnesses[:, 0],
        "stiffest_N_per_mm": stiffnesses[:, -1],
    }


def _as_table(space: Workspace) -> str:
    """Size, and least, median and largest numbers."""
    unit = "mm²" if space.cells.shape[1] == 2 else "mm³"
    rows = [
        (name, *(f"{value:.4g}" for value in np.quantile(values, _QUANTILES, method="nearest")))
        for name, values in _columns(space).items()
    ]
    table = text_table(("of the cells", "least", "median", "largest"), rows)
    return f"{table}\n\n{len(space.cells)} cells with a side of {space.cell:.4g} mm: {space.size:.4g} {unit}"


def _as_csv(space: Workspace) -> str:
    axes = "xyz"[: space.cells.shape[1]]
    numbers = {f"tip_{axis}_mm": values for axis, values in zip(axes, space.equilibria.tip.T, strict=True)}
    numbers |= _columns(space)
    numbers |= {f"tension_{j}_N": values for j, values in enumerate(space.equilibria.tensions.T)}
    return csv_text(numbers, np.column_stack(list(numbers.values())).tolist())
