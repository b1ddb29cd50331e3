"""The command `rj`: solve and draw a mechanism from the shell; documented in docs/cli.md.

Exit codes: 0 a usable result, 2 wrong input (one line on stderr), 3 the solver gave no usable result
(rj warmup: kernels that do not compile), 130 Ctrl-C (one line on stderr).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Sequence
from importlib import metadata
from pathlib import Path
from typing import NoReturn

from rollingjoint.cad import command
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.presets import PRESETS
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.checks import suggestion
from rollingjoint.cli import (
    camera_command,
    loop_command,
    mjcf,
    plan_command,
    reach_command,
    trace_command,
    warmup_command,
    workspace_command,
)
from rollingjoint.cli.case_options import actuated, add_case, equilibrium
from rollingjoint.cli.extensions import extensions, listed, run_extension
from rollingjoint.cli.identify import add_identify, run_identify
from rollingjoint.errors import InvalidInput, MissingPackage, SolverError, one_line
from rollingjoint.interrupts import interrupted, interruptible
from rollingjoint.io import report
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.tables import print_any_character, readers_may_leave

OK, WRONG_INPUT, NOT_USABLE = 0, 2, 3
_LARGEST_FRICTION = 100.0
_MOST_OPTIONS = 2_000  # parsed in a tenth of a second; the time of argparse grows with their square


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command line argv (default: the arguments of the process)."""
    return interruptible(lambda: _main(argv))


def _main(argv: Sequence[str] | None) -> int:
    print_any_character()
    argv = sys.argv[1:] if argv is None else argv
    command = f"rj {argv[0]}" if argv else "rj"
    try:
        with readers_may_leave():
            return _run(argv)
        return OK
    except (InvalidInput, MissingPackage, OSError) as error:
        print(f"{command}: error: {one_line(str(error))}", file=sys.stderr)
        return WRONG_INPUT
    except SolverError as error:
        print(f"{command}: {error}", file=sys.stderr)
        return NOT_USABLE


def _run(argv: Sequence[str]) -> int:
    """Exit code of the command, of this package or of another."""
    count = sum(word.startswith("--") for word in argv)
    if count > _MOST_OPTIONS:
        raise InvalidInput("number of options", count, f"at most {_MOST_OPTIONS:,}", "In Python there may be more.")
    parser, commands = _parser()
    if not argv or argv[0] not in commands:
        others = extensions()
        if argv and argv[0] in others:
            return run_extension(others[argv[0]], argv[1:])
        if argv and not argv[0].startswith("-"):
            known = sorted({*commands, *others})
            raise InvalidInput("command", argv[0], ", ".join(known), suggestion(argv[0], known))
        parser.epilog = listed({name: entry for name, entry in others.items() if name not in commands})
    args = parser.parse_args(_with_negative_numbers(argv))
    code: int = args.run(args)
    return code


def _solve(args: argparse.Namespace) -> int:
    _check_picture(args.plot)
    mechanism = load_mechanism(args.mechanism)
    friction = _friction(args.friction, mechanism)
    solution = equilibrium(args, mechanism)
    print(report.as_json(solution, friction) if args.json else report.as_table(solution, friction))
    if args.plot:
        _draw(solution, args.plot, friction)
    return OK if solution.ok else NOT_USABLE


def _friction(option: float | None, mechanism: AnyChain) -> float:
    if option is not None and not mechanism.slips:
        raise InvalidInput("--friction", option, "a chain of links that roll on each other", "Hinges do not slip.")
    friction = report.FRICTION if option is None else option
    if not 0 <= friction <= _LARGEST_FRICTION:
        raise InvalidInput("--friction", friction, f"a number from 0 to {_LARGEST_FRICTION:g}")
    return friction


def _plot(args: argparse.Namespace) -> int:
    _check_picture(args.out)
    mechanism = load_mechanism(args.mechanism)
    solution = equilibrium(args, mechanism) if actuated(args) else None
    friction = _friction(args.friction, mechanism)
    if args.friction is not None and (solution is None or not isinstance(mechanism, SpatialChain)):
        allowed = "rolling joints in space, in equilibrium (--tensions or --lengths)"
        raise InvalidInput("--friction", friction, allowed, "Other pictures show nothing that depends on it.")
    _draw(solution or mechanism, args.out, friction)
    return OK if solution is None or solution.ok else _unusable(args, solution)


def _reach(args: argparse.Namespace) -> int:
    _check_picture(args.plot)
    result = reach_command.run(args)
    if args.plot:
        target = args.tip[: result.equilibrium.mechanism.dimension]
        _draw(result.equilibrium, args.plot, report.FRICTION, target)
    return OK if result.ok else NOT_USABLE


def _plan(args: argparse.Namespace) -> int:
    _check_picture(args.plot)
    return OK if plan_command.run(args).ok else NOT_USABLE


def _workspace(args: argparse.Namespace) -> int:
    _check_picture(args.out)
    workspace_command.run(args)
    return OK


def _camera(args: argparse.Namespace) -> int:
    camera_command.run(args)
    return OK


def _loop(args: argparse.Namespace) -> int:
    return OK if loop_command.run(args) else NOT_USABLE


def _trace(args: argparse.Namespace) -> int:
    return OK if trace_command.run(args) else NOT_USABLE


def _export(args: argparse.Namespace) -> int:
    mechanism = load_mechanism(args.mechanism)
    model = None if args.mjcf is None else mjcf.model(mechanism, args.mjcf, args.overwrite)
    if args.out is None and model is None:
        raise InvalidInput("--out", None, "a folder for manufacturing files; or --mjcf FILE.xml")
    files: list[Path] = []
    if args.out is not None:
        solution = equilibrium(args, mechanism) if actuated(args) else None
        if solution is not None and not solution.ok:
            return _unusable(args, solution)
        files = command.export_files(solution or mechanism, args)
    if model is not None:
        model.write()
        print(model.line)
    print(*files, sep="\n", end="\n" if files else "")
    return OK


def _identify(args: argparse.Namespace) -> int:
    run_identify(args)
    return OK


def _unusable(args: argparse.Namespace, solution: Solution) -> int:
    print(f"rj {args.command}: {report.status_line(solution)}", file=sys.stderr)
    return NOT_USABLE


def _mechanisms(args: argparse.Namespace) -> int:
    width = max(len(name) for name in PRESETS)
    for name, build in PRESETS.items():
        print(f"{name:<{width}}  {report.mechanism_line(build())}")
    return OK


def _warmup(args: argparse.Namespace) -> int:
    try:
        return OK if warmup_command.run(args.families, not args.without_walls) else NOT_USABLE
    except KeyboardInterrupt:
        return interrupted("rj warmup: interrupted; what is compiled is kept")


def _check(args: argparse.Namespace) -> int:
    code = OK
    for file in args.file:
        try:
            mechanism = load_mechanism(file)
            print(f"{file}: ok: {report.mechanism_line(mechanism)}\n{file}: {report.neutral_line(mechanism)}")
        except InvalidInput as error:
            print(f"rj check: error: {error}", file=sys.stderr)
            code = WRONG_INPUT
    return code


def _check_picture(path: str | None) -> None:
    if path:
        from rollingjoint.plotting.figure import check_figure_path

        check_figure_path(path)


def _draw(what: AnyChain | Solution, path: str, friction: float, target: Sequence[float] = ()) -> None:
    """Draw a mechanism or an equilibrium into a file, with a cross at a target of the tip."""
    from rollingjoint.plotting.figure import figure_of, save_figure

    figure = figure_of(what, friction)
    if target:
        figure.axes[0].plot(*([x] for x in target), "x", color="#D55E00", markersize=9, markeredgewidth=2, zorder=9)
    save_figure(figure, path)


class _Parser(argparse.ArgumentParser):
    """A parser that reports an error in one line."""

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


def _parser() -> tuple[argparse.ArgumentParser, Collection[str]]:
    """The parser, and the names of its commands."""
    text = "Statics and control of tendon-driven mechanisms. mm, N, N·mm, rad. rj COMMAND --help lists options."
    parser = _Parser(prog="rj", description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version", version=f"rj {_version()}")
    commands = parser.add_subparsers(title="mechanisms", dest="command", required=True, metavar="COMMAND")
    solve = commands.add_parser("solve", help="equilibrium under given tensions or lengths, as a table")
    add_case(solve, required=True)
    of_links = f"of links on links (default {report.FRICTION:g})"
    solve.add_argument("--friction", type=float, metavar="MU", help=of_links)
    solve.add_argument("--json", action="store_true", help="print JSON, units in the key names")
    solve.add_argument("--plot", metavar="FILE", help="also draw it; the suffix sets the format")
    solve.set_defaults(run=_solve)
    reach = commands.add_parser("reach", help="lengths or tensions that bring the tip to a target")
    reach_command.add_options(reach)
    reach.set_defaults(run=_reach)
    plan = commands.add_parser("plan", help="lengths over time that lead the tip along a path")
    plan_command.add_options(plan)
    plan.set_defaults(run=_plan)
    space = commands.add_parser("workspace", help="where the tip can be; dexterity, force and stiffness there")
    workspace_command.add_options(space)
    space.set_defaults(run=_workspace)
    plot = commands.add_parser("plot", help="picture of a mechanism, at rest or in equilibrium")
    add_case(plot, required=False)
    plot.add_argument("--out", required=True, metavar="FILE", help="picture; the suffix sets the format")
    plot.add_argument(
        "--friction", type=float, metavar="MU", help=f"{of_links}, where teeth hold rolling joints in space"
    )
    plot.set_defaults(run=_plot)
    camera = commands.add_parser("camera", help="the view of a camera from a picture of a board of dots")
    camera_command.add_options(camera)
    camera.set_defaults(run=_camera)
    loop = commands.add_parser("loop", help="hysteresis: drive it back and forth with friction in the tendons' holes")
    loop_command.add_options(loop)
    loop.set_defaults(run=_loop)
    path = commands.add_parser("trace", help="one step after another, with friction that remembers, among walls")
    trace_command.add_options(path)
    path.set_defaults(run=_trace)
    export = commands.add_parser("export", help="manufacturing files: DXF, SVG, STL, a drawing; MuJoCo model")
    add_case(export, required=False)
    command.add_options(export)
    mjcf.add_option(export)
    export.set_defaults(run=_export)
    identify = commands.add_parser("identify", help="parameters from measurements: friction, stiffness, offsets ...")
    add_identify(identify)
    identify.set_defaults(run=_identify)
    commands.add_parser("mechanisms", help="list the presets").set_defaults(run=_mechanisms)
    warmup = commands.add_parser("warmup", help="compile the kernels now, not at the first solve")
    warmup_command.add_options(warmup)
    warmup.set_defaults(run=_warmup)
    check = commands.add_parser("check", help="validate mechanism files; lengths of their tendons at rest")
    check.add_argument("file", nargs="+", metavar="FILE", help="YAML file, or a preset")
    check.set_defaults(run=_check)
    return parser, commands.choices


def _version() -> str:
    try:
        return metadata.version("rollingjoint")
    except metadata.PackageNotFoundError:
        return "(not installed)"
