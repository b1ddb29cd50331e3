"""The command `rj loop`: a mechanism driven back and forth with friction in its tendons' holes."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace

from rollingjoint.chain.chain import AnyChain
from rollingjoint.cli.case_options import (
    add_loads,
    add_tension_limits,
    checked,
    loads_of,
    note,
    per_tendon,
    tension_limits_of,
)
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import NO_FRICTION, CapstanFriction
from rollingjoint.io import loop_report, report
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.statics.loop import MIDDLE_TENSION, MOST_STEPS, Loop, trace_loop

_SWING = (-5.0, 5.0)  # mm: of two tendons unless another is given


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of the command."""
    parser.add_argument("mechanism", metavar="MECHANISM", help="preset name or YAML file")
    middle = parser.add_mutually_exclusive_group()
    text = f"commanded lengths in the middle of the loop [mm]; default: {MIDDLE_TENSION:g} N in every tendon"
    middle.add_argument("--lengths", nargs="+", type=float, metavar="L", help=text)
    text = "drive tensions, with these in the middle [N]"
    middle.add_argument("--tensions", nargs="+", type=float, metavar="T", help=text)
    text = "change of every length or tension from the middle to the first end; default for two lengths: -5 5"
    parser.add_argument("--swing", nargs="+", type=float, metavar="D", help=text)
    text = "coefficients of friction in the tendons' holes, one loop each; default: those of the mechanism"
    parser.add_argument("--friction", nargs="+", type=float, metavar="MU", help=text)
    text = "slip over which friction builds up [mm]; default: that of the mechanism, or 0.02"
    parser.add_argument("--presliding", type=float, metavar="D", help=text)
    parser.add_argument("--cycles", type=int, default=2, metavar="N", help="figures are of the last (default 2)")
    parser.add_argument("--steps", type=int, default=200, metavar="N", help="from end to end (default 200)")
    add_tension_limits(parser)
    add_loads(parser)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print figures and steps as JSON, units in the key names")
    form.add_argument("--csv", action="store_true", help="print every step as CSV")
    text = "also draw tip path and loop; the suffix sets the format; .gif: an animation of one loop"
    parser.add_argument("--plot", metavar="FILE", help=text)


def run(args: argparse.Namespace) -> bool:
    """Print the loops that the options define, and draw them; returns whether all their steps are usable."""
    _check_picture(args)
    count = len(args.friction or ()) * args.cycles * args.steps
    if len(args.friction or ()) > 1 and count > MOST_STEPS:
        raise InvalidInput("coefficients x cycles x steps", count, f"at most {MOST_STEPS:,}", "Run fewer at a time.")
    mechanisms = _with_friction(args, load_mechanism(args.mechanism))
    loops = [_loop(args, mechanism) for mechanism in mechanisms]
    form = loop_report.as_json if args.json else loop_report.as_csv if args.csv else loop_report.as_table
    print(form(loops))
    if args.plot:
        _draw(loops, args.plot)
    if args.tensions is None:
        for loop in loops:
            note(args, report.length_note(loop.path, loop.inputs))
    failures = [text for text in map(loop_report.failure, loops) if text]
    for text in failures:
        print(f"rj loop: {text}", file=sys.stderr)
    return not failures


def _with_friction(args: argparse.Namespace, mechanism: AnyChain) -> list[AnyChain]:
    """The mechanism with each of the coefficients of friction in turn."""
    if args.friction is None and not mechanism.has_friction:
        hint = "Add a coefficient, such as --friction 0.1."
        raise InvalidInput("--friction", None, f"a number, since {mechanism.name} has no friction", hint)
    changes = [{"mu": mu} for mu in args.friction] if args.friction is not None else [{}]
    if args.presliding is not None:
        changes = [{**change, "presliding": args.presliding} for change in changes]
    return [_changed(mechanism, change) for change in changes]


def _changed(mechanism: AnyChain, numbers: dict[str, float]) -> AnyChain:
    """The mechanism with other numbers in its friction and in the friction of its tendons."""

    def changed(friction: CapstanFriction | None) -> CapstanFriction | None:
        return None if friction is None else replace(friction, **numbers)

    tendons = [replace(tendon, friction=changed(tendon.friction)) for tendon in mechanism.tendons]
    return mechanism.replace(tendons=tendons, friction=changed(mechanism.friction or NO_FRICTION))


def _loop(args: argparse.Namespace, mechanism: AnyChain) -> Loop:
    quantity = "tensions" if args.tensions is not None else "lengths"
    if args.tensions is not None and args.tension_limits is not None:
        raise InvalidInput("--tension-limits", args.tension_limits, "only with lengths")
    middle, swing = _middle(args, mechanism), _swing(args, mechanism)
    limits, loads = tension_limits_of(args), loads_of(args, mechanism)
    return trace_loop(mechanism, swing, middle, loads, quantity, cycles=args.cycles, steps=args.steps, **limits)


def _middle(args: argparse.Namespace, mechanism: AnyChain) -> list[float] | None:
    """Tensions or lengths in the middle, if they are given."""
    if args.tensions is not None:
        return per_tendon("--tensions", args.tensions, mechanism)
    return None if args.lengths is None else per_tendon("--lengths", args.lengths, mechanism)


def _swing(args: argparse.Namespace, mechanism: AnyChain) -> list[float]:
    """The change from the middle to the first end; no tendon may push at either end."""
    swing, m = args.swing, mechanism.n_tendons
    if swing is None and args.tensions is None and m == len(_SWING):
        swing = list(_SWING)
    if swing is None:
        raise InvalidInput("--swing", None, f"{m} numbers, one per tendon", "Add the change of each from the middle.")
    per_tendon("--swing", swing, mechanism, low=-LARGEST_INPUT)
    for j, (change, middle) in enumerate(zip(swing, args.tensions or (), strict=False)):
        checked(f"--swing of tendon {j}", change, -middle, middle)
    return swing


def _check_picture(args: argparse.Namespace) -> None:
    if args.plot:
        from rollingjoint.plotting.figure import check_figure_path
        from rollingjoint.plotting.film import ANIMATED

        check_figure_path(args.plot, more=(ANIMATED,))
        if args.plot.lower().endswith(f".{ANIMATED}") and len(args.friction or [0]) > 1:
            raise InvalidInput("--friction", args.friction, "one number beside a .gif", "An animation shows one loop.")


def _draw(loops: Sequence[Loop], path: str) -> None:
    from rollingjoint.plotting.figure import save_figure
    from rollingjoint.plotting.film import ANIMATED
    from rollingjoint.plotting.loops import plot_loops, save_animation

    if path.lower().endswith(f".{ANIMATED}"):
        save_animation(loops[0], path)
    else:
        save_figure(plot_loops(loops, [f"friction {loop_report.friction_name(loop)}" for loop in loops]), path)
