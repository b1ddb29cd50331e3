"""Count the files on the journeys of docs/architecture.md: those of which some function runs between call and formula.

    python benchmarks/journeys.py                    # the table and the files of every journey
    python benchmarks/journeys.py --only lengths     # one of them
    python benchmarks/journeys.py --json

A call is made twice, and watched the second time. In Python every function of the packages that is entered counts. In
compiled code those count that the entered kernels are made of: functions, parts and formulas that a kernel names, and
those that these name. A formula stands for the parts of those classes that are named on the way, since numba chooses
them by the class. Types and constants do not count. The journey from a configuration to a report takes several
processes, and is not counted.
"""

from __future__ import annotations

import argparse
import dis
import inspect
import json
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numba.core.typing.templates import builtin_registry
from numba.extending import _Intrinsic

from rollingjoint._numba import jit
from rollingjoint._numba.layout import is_layout
from rollingjoint._numba.pins import call_range

Functions = dict[str, set[str]]
"""Names of functions by the file that they are in."""

REPOSITORY = Path(jit.__file__).resolve().parents[2]
PACKAGES = ("rollingjoint", "rj_gym", "agents")


def main(argv: Sequence[str] | None = None) -> None:
    """Print the journeys."""
    arguments = _arguments(argv)
    watch = KernelWatch()
    counted = {name: counted_files(JOURNEYS[name].prepare, watch) for name in arguments.only or JOURNEYS}
    if arguments.json:
        print(json.dumps({name: files._asdict() for name, files in counted.items()}, default=sorted, indent=1))
        return
    print(table(counted))
    for name, files in counted.items():
        for title, functions in zip(("in Python", "compiled"), files, strict=True):
            print(f"\n{JOURNEYS[name].title}, {title}")
            print(*(f"  {file:44} {', '.join(sorted(names))}" for file, names in functions.items()), sep="\n")


class Counted(NamedTuple):
    """Functions on a journey by their files: those that Python entered, and those that entered kernels are made of."""

    python: Functions
    compiled: Functions


def table(counted: dict[str, Counted]) -> str:
    """The journeys in Markdown: files in Python, of kernels, and both with their lines; and files of `_numba`."""
    rows = ["| journey | Python | kernels | files | lines | goal | of `_numba` |", "|---|---|---|---|---|---|---|"]
    for name, (python, compiled) in counted.items():
        formulas = [file for file in compiled if "/_numba/" not in file]
        every = {*python, *formulas}
        lines = sum(len((REPOSITORY / file).read_text("utf-8").splitlines()) for file in every)
        (title, _, goal), tools = JOURNEYS[name], len(compiled) - len(formulas)
        rows.append(f"| {title} | {len(python)} | {len(formulas)} | {len(every)} | {lines:,} | {goal} | {tools} |")
    return "\n".join(rows)


def counted_files(prepare: Callable[[], Callable[[], object]], watch: KernelWatch) -> Counted:
    """Functions that run in the call that `prepare` makes, by their files in alphabetical order."""
    watch.addressed.clear()
    call = prepare()
    call()
    watch.entered.clear()
    python = python_functions(call)
    parts = Parts(watch)
    for kernel in watch.entered:
        parts.follow(kernel)
    return Counted(*(dict(sorted(functions.items())) for functions in (python, parts.functions)))


def python_functions(call: Callable[[], object]) -> Functions:
    """Functions of the packages that Python enters in a call."""
    found: Functions = defaultdict(set)

    def entered(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and (file := file_of(frame.f_code)):
            found[file].add(frame.f_code.co_qualname)

    sys.setprofile(entered)
    try:
        call()
    finally:
        sys.setprofile(None)
    return found


def file_of(code: CodeType) -> str:
    """The file of a function, seen from the repository; "" outside the packages."""
    path = Path(code.co_filename)
    inside = REPOSITORY in path.parents and path.relative_to(REPOSITORY).parts[0] in PACKAGES
    return path.relative_to(REPOSITORY).as_posix() if inside else ""


class KernelWatch:
    """Notes which kernels Python enters, and which others can be entered by their address.

    Attributes:
        entered: kernels that Python called. addressed: kernels whose addresses were asked for.
    """

    def __init__(self) -> None:
        self.entered: set[Any] = set()
        self.addressed: set[Any] = set()
        compiled_for = jit._compiled_for
        jit._compiled_for = lambda kernel, kinds: _Watched(kernel, compiled_for(kernel, kinds), self)


class _Watched:
    """Compiled code that notes when it is called, or its address asked for."""

    def __init__(self, kernel: Any, compiled: Any, watch: KernelWatch) -> None:
        self._kernel, self._compiled, self._watch, self.fndesc = kernel, compiled, watch, compiled.fndesc

    def entry_point(self, *arguments: Any) -> Any:
        """Call the machine code."""
        self._watch.entered.add(self._kernel)
        return self._compiled.entry_point(*arguments)

    @property
    def library(self) -> Any:
        """Where numba has the machine code and its address."""
        self._watch.addressed.add(self._kernel)
        return self._compiled.library


class Parts:
    """What kernels are made of: the functions that they name, and those that these name."""

    def __init__(self, watch: KernelWatch) -> None:
        self.functions: Functions = defaultdict(set)
        self._watch, self._formulas = watch, registered_formulas()
        self._seen: set[Any] = set()
        self._classes: set[type] = set()
        self._chosen: set[Any] = set()  # formulas that were named

    def follow(self, value: Any, name: str = "") -> None:
        """Note a function, kernel or part, and all that it is made of; name: of an intrinsic, where it is called."""
        function = getattr(value, "py_func", value)
        if isinstance(value, _Intrinsic):
            self.functions[file_of(value._defn.__code__)].add(name)
            if value is call_range:
                for kernel in self._watch.addressed:
                    self.follow(kernel)
        elif isinstance(value, type):
            if is_layout(value) and value not in self._classes:
                self._classes.add(value)
                self._choose()
        elif isinstance(function, FunctionType) and function not in self._seen and file_of(function.__code__):
            self._seen.add(function)
            if function in self._formulas:
                self._chosen.add(function)
                self._choose()
            else:
                self.functions[file_of(function.__code__)].add(function.__name__)
                for called, named in named_values(function.__code__, function.__globals__):
                    self.follow(named, called)

    def _choose(self) -> None:
        """Follow the parts that stand for the formulas that were named, of the classes that were."""
        for formula in list(self._chosen):
            for kind, function in self._formulas[formula]:
                if kind in self._classes:
                    self.follow(function)


def registered_formulas() -> dict[Any, list[tuple[type, FunctionType]]]:
    """The parts that stand for every formula, with the classes of which they are (kernels.formulas.formula)."""
    found = defaultdict(list)
    for generic, kind in builtin_registry.globals:
        for template in kind.templates if isinstance(kind, types.Function) else ():
            if choose := getattr(template, "_overload_func", None):
                chosen = inspect.getclosurevars(choose).nonlocals
                if chosen.keys() >= {"kinds", "function"}:
                    part = getattr(chosen["function"], "py_func", chosen["function"])
                    found[generic] += [(kind, part) for kind in chosen["kinds"]]
    return dict(found)


def named_values(code: CodeType, known: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    """Names and values of the globals that code loads, and of what it loads from modules; known: its globals."""
    module: ModuleType | None = None
    for instruction in dis.get_instructions(code):
        if instruction.opname == "LOAD_GLOBAL" and instruction.argval in known:
            value = known[instruction.argval]
            module = value if isinstance(value, ModuleType) else None
            yield instruction.argval, value
        elif instruction.opname in ("LOAD_ATTR", "LOAD_METHOD") and hasattr(module, instruction.argval):
            yield instruction.argval, getattr(module, instruction.argval)
        else:
            module = None
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from named_values(constant, known)


class Journey(NamedTuple):
    """A call to be watched: `prepare` makes it; goal: most files, "" for none."""

    title: str
    prepare: Callable[[], Callable[[], object]]
    goal: str = ""


def _lengths() -> Callable[[], object]:
    from rollingjoint import WorldForce, five_link, solve_lengths

    chain, loads = five_link(), [WorldForce(-1, (0.3, 0.0))]
    before = solve_lengths(chain, (88.0, 98.0), loads)
    return lambda: solve_lengths(chain, (88.5, 97.5), loads, start=before)


def _arm_lengths() -> Callable[[], object]:
    from rollingjoint import WorldForce, small_arm, solve_lengths

    arm, loads = small_arm(), [WorldForce(-1, (0.0, 0.1, 0.0))]
    shorter = arm.neutral_lengths - 0.5
    before = solve_lengths(arm, shorter, loads)
    return lambda: solve_lengths(arm, shorter, loads, start=before)


def _env_step(env_id: str) -> Callable[[], object]:
    import gymnasium

    import rj_gym

    assert rj_gym.__name__ in sys.modules  # it registers the ids
    env = gymnasium.make(env_id).unwrapped
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, np.float32)
    return lambda: env.step(action)


def _gradient() -> Callable[[], object]:
    from rollingjoint.design import DesignSpace, LateralStiffness, Problem, Term

    problem = Problem(DesignSpace(), [Term(LateralStiffness())])
    x = problem.space.sample(2, np.random.default_rng(0))
    return lambda: problem.with_gradient(x)


JOURNEYS = {
    "lengths": Journey("lengths to equilibrium, a rolling chain", _lengths, "12"),
    "arm_lengths": Journey("lengths to equilibrium, an arm", _arm_lengths),
    "step": Journey("displacement to reward, `RollingJoint`", lambda: _env_step("rj_gym/RollingJoint-v0"), "15"),
    "arm_step": Journey("displacement to reward, `FlexibleArm`", lambda: _env_step("rj_gym/FlexibleArm-v0")),
    "gradient": Journey("curvature to gradient", _gradient),
}


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=JOURNEYS, metavar="NAME", help=", ".join(JOURNEYS))
    parser.add_argument("--json", action="store_true", help="print the functions of every file as JSON")
    return parser.parse_args(argv)


if __name__ == "__main__":
    main()
