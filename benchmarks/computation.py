"""Tip error against computation, of every controller that is timed and scored: python benchmarks/computation.py.

A row and a point per controller: microseconds of processor time per action of one lane, measured as in opponents.py
with 64 lanes side by side, and the mean error over the last 10 steps in the test episodes of docs/results.json.gz. The
time of a learner is that of the policy which ships for its world. Writes docs/images/error_against_computation.png.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from opponents import microseconds

from agents.controllers.controller import Controller
from agents.controllers.tuned import tuned_controllers
from agents.evaluation.pictures import COLOURS, figure_of, png, tidy
from agents.policies.loading import shipped_policies
from agents.results import read_results
from agents.results.record import POLICY, TEST, BenchmarkRecord
from agents.results.statistics import Bootstrap, Interval
from agents.results.wording import mm, with_interval
from rollingjoint import set_threads
from rollingjoint.tables import markdown_table

RESULTS, PICTURE = Path("docs/results.json.gz"), Path("docs/images/error_against_computation.png")
PLANAR = ("Instrument", "InstrumentShift", "SlowCamera", "LatePose")
WORLDS = (*(f"{world}-v{version}" for version in (0, 1) for world in PLANAR), "ArmInstrument-v0")
COLUMNS = len(PLANAR)  # of panels: a row per version, and the arm below
LEARNER = "policy"
MARKERS = "osD^vPX<>hpd8"


class Point(NamedTuple):
    """A controller's microseconds per action, and its error [mm]."""

    time: float
    error: Interval


def points_of(record: BenchmarkRecord, lanes: int, rounds: int) -> dict[str, Point]:
    """The controllers of a benchmark that can be timed, by name; the best learner is LEARNER."""
    world = record.of_role(TEST)[0]
    bootstrap = Bootstrap(world.episodes)
    return {
        name: Point(
            microseconds(record.env_id, controller, lanes, rounds),
            bootstrap.mean(record.controller(row).errors(world.name)),
        )
        for name, (row, controller) in _timed(record).items()
    }


def _timed(record: BenchmarkRecord) -> dict[str, tuple[str, Controller]]:
    """By name in the picture: the name in the results, and the controller."""
    known = record.names(world=record.of_role(TEST)[0].name)
    timed = {name: (name, each) for name, each in tuned_controllers(record.env_id).items() if name in known}
    learner = record.best(POLICY)
    policies = [policy for policy in shipped_policies() if policy.env_id == record.env_id]
    return timed | ({LEARNER: (learner, policies[0])} if learner and policies else {})


def figure_with(points: Mapping[str, Mapping[str, Point]]) -> Figure:
    """A panel per world, error over time per action, both logarithmic; all with the same times."""
    rows = len(points) // COLUMNS + 1  # the legend has a place of its own
    figure = figure_of(15.0, 3.6 * rows)
    names = list(dict.fromkeys(name for of_world in points.values() for name in of_world))
    handles = {}
    for place, (world, of_world) in enumerate(points.items()):
        axes = figure.add_subplot(rows, COLUMNS, place + 1, sharex=figure.axes[0] if place else None, title=world)
        axes.set(xlabel="processor time per action [µs]", ylabel="mean tip error [mm]" if place % COLUMNS == 0 else "")
        axes.set(xscale="log", yscale="log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(NullFormatter())
        tidy(axes)
        for name, point in of_world.items():
            handles[name] = _draw(axes, point, names.index(name), name == LEARNER)
    figure.legend(handles.values(), handles, loc="lower right", bbox_to_anchor=(0.98, 0.02), ncols=2, frameon=False)
    return figure


def _draw(axes: Axes, point: Point, number: int, is_learner: bool) -> Artist:
    """A point with the interval of its error; the learner's is larger, and black."""
    value, low, high = point.error
    style = {"color": COLOURS[number % len(COLOURS)], "fmt": MARKERS[number % len(MARKERS)], "markersize": 9}
    style |= {"color": "black", "fmt": "*", "markersize": 15} if is_learner else {}
    return axes.errorbar(point.time, value, [[value - low], [high - value]], **style)


def main(argv: Sequence[str] | None = None) -> None:
    """Print a row per world and controller, and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", nargs="+", choices=WORLDS, default=WORLDS)
    parser.add_argument("--lanes", type=int, default=64)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--picture", type=Path, default=PICTURE, help=f"where it goes (default {PICTURE})")
    arguments = parser.parse_args(argv)
    set_threads(1)
    records = {record.env_id: record for record in read_results(RESULTS).benchmarks}
    points = {
        world: points_of(records[f"rj_gym/{world}"], arguments.lanes, arguments.rounds) for world in arguments.worlds
    }
    rows = [
        [world, name, f"{time:.1f}", with_interval(error, mm)]
        for world, of_world in points.items()
        for name, (time, error) in of_world.items()
    ]
    print(markdown_table(("world", "controller", "µs", "error [mm]"), rows))
    arguments.picture.write_bytes(png(figure_with(points)))


if __name__ == "__main__":
    main()
