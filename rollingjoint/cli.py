"""The command `rj`: solve and draw a mechanism from the shell; documented in docs/cli.md.

Exit codes: 0 a usable result, 2 wrong input (one line on stderr), 3 the solver gave no usable result.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from importlib import metadata
from typing import NoReturn

from rollingjoint import report
from rollingjoint._jit import cache_directory
from rollingjoint.cad import command
from rollingjoint.equilibrium import Equilibrium
from rollingjoint.errors import InvalidInput
from rollingjoint.load import BodyWrench, Gravity, Load, Spring, WorldForce
from rollingjoint.mechanism_file import load_mechanism
from rollingjoint.presets import PRESETS, five_link
from rollingjoint.rolling_chain import RollingChain
from rollingjoint.solve import solve_lengths, solve_tensions

OK, WRONG_INPUT, NOT_USABLE = 0, 2, 3
_LARGEST_FRICTION = 100.0


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command line argv (default: that of the process)."""
    args = _parser().parse_args(_with_negative_numbers(sys.argv[1:] if argv is None else argv))
    try:
        code = args.run(args)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader, such as head, has seen enough: say nothing
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except (InvalidInput, OSError) as error:
        print(f"rj {args.command}: error: {error}", file=sys.stderr)
        return WRONG_INPUT


def _solve(args: argparse.Namespace) -> int:
    if not 0 <= args.friction <= _LARGEST_FRICTION:
        raise InvalidInput("--friction", args.friction, f"a number from 0 to {_LARGEST_FRICTION:g}")
    _check_picture(args.plot)
    equilibrium = _equilibrium(args, load_mechanism(args.mechanism, RollingChain))
    text = report.as_json(equilibrium, args.friction) if args.json else report.as_table(equilibrium, args.friction)
    print(text)
    if args.plot:
        _draw(equilibrium, args.plot)
    return OK if equilibrium.ok else NOT_USABLE


def _plot(args: argparse.Namespace) -> int:
    _check_picture(args.out)
    mechanism = load_mechanism(args.mechanism, RollingChain)
    if args.tensions is None and args.lengths is None:
        _refuse_idle_options(args)
        _draw(mechanism, args.out)
        return OK
    equilibrium = _equilibrium(args, mechanism)
    _draw(equilibrium, args.out)
    if not equilibrium.ok:
        print(f"rj plot: {report.status_line(equilibrium)}", file=sys.stderr)
        return NOT_USABLE
    return OK


def _export(args: argparse.Namespace) -> int:
    mechanism = load_mechanism(args.mechanism, RollingChain)
    if args.tensions is None and args.lengths is None:
        _refuse_idle_options(args)
        print(*command.export_files(mechanism, args), sep="\n")
        return OK
    equilibrium = _equilibrium(args, mechanism)
    if not equilibrium.ok:
        print(f"rj export: {report.status_line(equilibrium)}", file=sys.stderr)
        return NOT_USABLE
    print(*command.export_files(equilibrium, args), sep="\n")
    return OK


def _mechanisms(args: argparse.Namespace) -> int:
    width = max(len(name) for name in PRESETS)
    for name, build in PRESETS.items():
        print(f"{name:<{width}}  {report.mechanism_line(build())}")
    return OK


def _warmup(args: argparse.Namespace) -> int:
    begin = time.perf_counter()
    mechanism = five_link()
    taut = solve_tensions(mechanism, [1.0, 1.0])
    slack = solve_lengths(mechanism, mechanism.neutral_lengths + 10.0)  # the solver for all cases
    assert taut.stiffness.shape == (mechanism.n_joints,) * 2 and slack.arc_lengths.shape == (mechanism.n_joints,)
    print(f"kernels ready after {time.perf_counter() - begin:.1f} s, kept in {cache_directory()}")
    return OK


def _check(args: argparse.Namespace) -> int:
    code = OK
    for file in args.file:
        try:
            print(f"{file}: ok: {report.mechanism_line(load_mechanism(file))}")
        except InvalidInput as error:
            print(f"rj check: error: {error}", file=sys.stderr)
            code = WRONG_INPUT
    return code


def _equilibrium(args: argparse.Namespace, mechanism: RollingChain) -> Equilibrium:
    loads = _loads(args, mechanism.n_links)
    start = None if args.start is None else mechanism.joint_angles(_counted("--start", args.start, mechanism.n_joints))
    if args.tensions is not None:
        if args.method or args.tension_limits:
            option = "--method" if args.method else "--tension-limits"
            raise InvalidInput(option, args.method or args.tension_limits, "only beside --lengths")
        return solve_tensions(mechanism, _counted("--tensions", args.tensions, mechanism.n_tendons), loads, start)
    options = {} if args.tension_limits is None else {"tension_limits": tuple(args.tension_limits)}
    lengths = _counted("--lengths", args.lengths, mechanism.n_tendons)
    return solve_lengths(mechanism, lengths, loads, start, method=args.method or "elastic", **options)


def _loads(args: argparse.Namespace, n_links: int) -> list[Load]:
    loads: list[Load] = [WorldForce(_link("--force", v, n_links), tuple(v[1:])) for v in args.force]
    loads += [BodyWrench(_link("--body-force", v, n_links), tuple(v[1:])) for v in args.body_force]
    loads += [WorldForce(_link("--moment", v, n_links), (0.0, 0.0), moment=v[1]) for v in args.moment]
    loads += [Spring(_link("--spring", v, n_links), v[1], tuple(v[2:])) for v in args.spring]
    if args.gravity is not None:
        weights = args.gravity * n_links if len(args.gravity) == 1 else args.gravity
        if len(weights) != n_links:
            raise InvalidInput("--gravity", weights, f"1 weight for all links, or {n_links}, one per link")
        loads.append(Gravity(weights, tuple(args.gravity_direction or (0.0, -1.0))))
    elif args.gravity_direction:
        raise InvalidInput("--gravity-direction", args.gravity_direction, "--gravity beside it")
    return loads


def _link(option: str, values: Sequence[float], n_links: int) -> int:
    if values[0] not in range(-n_links, n_links):
        raise InvalidInput(f"{option} LINK", values[0], f"a link, 0 (base) to {n_links - 1}, or -1 (tip) to {-n_links}")
    return int(values[0])


def _counted(option: str, values: list[float], count: int) -> list[float]:
    if len(values) != count:
        raise InvalidInput(option, values, f"{count} numbers for this mechanism, not {len(values)}")
    return values


def _refuse_idle_options(args: argparse.Namespace) -> None:
    """An option that needs an equilibrium must not be dropped in silence."""
    for name in (
        "force",
        "body_force",
        "moment",
        "spring",
        "gravity",
        "gravity_direction",
        "start",
        "method",
        "tension_limits",
    ):
        if getattr(args, name):
            option = "--" + name.replace("_", "-")
            raise InvalidInput(option, getattr(args, name), "--tensions or --lengths beside it")


def _check_picture(path: str | None) -> None:
    if path:
        from rollingjoint.plot import check_figure_path

        check_figure_path(path)


def _draw(mechanism: RollingChain | Equilibrium, path: str) -> None:
    from matplotlib.figure import Figure

    from rollingjoint.plot import plot_mechanism, save_figure

    figure = Figure(figsize=(6.4, 6.4))
    plot_mechanism(mechanism, figure.subplots()).set_title(report.title(mechanism))
    save_figure(figure, path)


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(WRONG_INPUT, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def _with_negative_numbers(argv: Sequence[str]) -> list[str]:
    """A leading space keeps argparse from reading a number such as -1e-3 as an option."""
    return [f" {word}" if word.startswith("-") and _is_number(word) else word for word in argv]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="rj", description="Statics of tendon-driven rolling-contact mechanisms. mm, N, N·mm, rad.")
    parser.add_argument("--version", action="version", version=f"rj {_version()}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    solve = commands.add_parser("solve", help="equilibrium under given tensions or lengths, as a table")
    _add_case(solve, required=True)
    solve.add_argument("--friction", type=float, default=0.3, metavar="MU", help="for slip margins (default 0.3)")
    solve.add_argument("--json", action="store_true", help="print JSON, units in the key names")
    solve.add_argument("--plot", metavar="FILE", help="also draw it; the suffix says the format")
    solve.set_defaults(run=_solve)
    plot = commands.add_parser("plot", help="picture of a mechanism, at s = 0 or in equilibrium")
    _add_case(plot, required=False)
    plot.add_argument("--out", required=True, metavar="FILE", help="picture; the suffix says the format")
    plot.set_defaults(run=_plot)
    export = commands.add_parser("export", help="files for the workshop: DXF, SVG, STL and an assembly drawing")
    _add_case(export, required=False)
    command.add_options(export)
    export.set_defaults(run=_export)
    commands.add_parser("mechanisms", help="list the presets").set_defaults(run=_mechanisms)
    commands.add_parser("warmup", help="compile the kernels now, not at the first solve").set_defaults(run=_warmup)
    check = commands.add_parser("check", help="validate mechanism files")
    check.add_argument("file", nargs="+", metavar="FILE", help="YAML file")
    check.set_defaults(run=_check)
    return parser


def _add_case(parser: argparse.ArgumentParser, required: bool) -> None:
    """Mechanism, actuation, loads and start: what defines an equilibrium."""
    parser.add_argument("mechanism", metavar="MECHANISM", help="preset name or YAML file")
    actuation = parser.add_mutually_exclusive_group(required=required)
    actuation.add_argument("--tensions", nargs="+", type=float, metavar="T", help="tendon tensions [N]")
    actuation.add_argument("--lengths", nargs="+", type=float, metavar="L", help="tendon lengths [mm]")
    parser.add_argument("--method", choices=("elastic", "least_squares"), help="for --lengths (default elastic)")
    parser.add_argument(
        "--tension-limits",
        nargs=2,
        type=float,
        metavar=("LO", "HI"),
        help="range a motor holds [N], for --lengths",
    )
    loads = parser.add_argument_group("loads at link origins; LINK 0 is the base, -1 the tip; each may be repeated")
    for option, names, text in (
        ("--force", ("LINK", "FX", "FY"), "force of fixed direction [N]"),
        ("--body-force", ("LINK", "FX", "FY"), "force that turns with the link [N]"),
        ("--moment", ("LINK", "M"), "moment [N·mm]"),
        ("--spring", ("LINK", "K", "AX", "AY"), "spring [N/mm] to the anchor point [mm]"),
    ):
        loads.add_argument(option, nargs=len(names), type=float, metavar=names, action="append", default=[], help=text)
    loads.add_argument("--gravity", nargs="+", type=float, metavar="W", help="weight of all links, or of each [N]")
    loads.add_argument(
        "--gravity-direction",
        nargs=2,
        type=float,
        metavar=("X", "Y"),
        help="default 0 -1",
    )
    parser.add_argument("--start", nargs="+", type=float, metavar="S", help="arc lengths to start from [mm]")


def _version() -> str:
    try:
        return metadata.version("rollingjoint")
    except metadata.PackageNotFoundError:
        return "(not installed)"


if __name__ == "__main__":
    sys.exit(main())
