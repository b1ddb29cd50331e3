"""Could one source serve kernels and tensors? python benchmarks/one_source.py.

The parts of rollingjoint/kernels that evaluate a planar chain of four joints and take a Newton step from there run
unchanged on tensors, (B,) each, which stand where kernels have numbers: poses, gaps, tendons, dead loads, residual,
factor of the stiffness, step. Traced once, they are compiled by torch.compile and compared with the formulas that are
written for tensors (rollingjoint/differentiable), by which both look joints up in the tables. The gate: residuals equal
to 1e-9, no slower, at most 60 s to compile.
"""

from __future__ import annotations

import math
import resource
import time
import types
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.fx.experimental.proxy_tensor import make_fx

from rollingjoint import five_link
from rollingjoint.differentiable.loads import Loads
from rollingjoint.differentiable.side_by_side import TabulatedChain
from rollingjoint.differentiable.statics import Law
from rollingjoint.kernels import lanes, planar_loads, rolling, rolling_lanes, tendons
from rollingjoint.load import LOAD_COLUMNS
from rollingjoint.tables import markdown_table

ROWS = (64, 4096, 65_536)
GATE_SECONDS = 60.0
FORCE = ("px", "py", "fx", "fy")
STATE = {"gap": "J m 5", "pose": "n 5", "contact": "J 4", "sums": "J 4", "length": "m"}
STATE |= {"tension": "m", "elastic": "m", "residual": "J"}
BLOCK = {"L": "J J", "vectors": "6 J"}


class Value:
    """Numbers of all rows where a kernel has one: what it does to numbers happens to the tensor, (B,)."""

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, tensor: Tensor) -> None:
        self.tensor = tensor


def _operator(name: str) -> Callable[[Value, Any], Value]:
    return lambda one, other: Value(getattr(one.tensor, name)(_tensor(other)))


def _tensor(value: Any) -> Any:
    return value.tensor if isinstance(value, Value) else value


_OF_TWO = "eq add radd sub rsub mul rmul truediv rtruediv lt le gt ge and or"
for _name in _OF_TWO.split():
    setattr(Value, f"__{_name}__", _operator(f"__{_name}__"))
for _name in ("neg", "abs", "invert"):
    setattr(Value, f"__{_name}__", lambda value, name=f"__{_name}__": Value(getattr(value.tensor, name)()))


def _where(condition: Any, one: Any, other: Any) -> Any:
    if not isinstance(condition, Value):
        return one if condition else other
    return Value(torch.where(condition.tensor, _tensor(one), _tensor(other)))


# Of rollingjoint/kernels/vectors.py, whose functions select their version where kernels are compiled.
PLANE: dict[str, Callable[..., Any]] = {
    "dot": lambda a, b: a[0] * b[0] + a[1] * b[1],
    "plus_dot": lambda start, a, b: start + a[0] * b[0] + a[1] * b[1],
    "plus": lambda a, b: (a[0] + b[0], a[1] + b[1]),
    "minus": lambda a, b: (a[0] - b[0], a[1] - b[1]),
    "times": lambda a, factor: (a[0] * factor, a[1] * factor),
    "about": lambda axis, arm: (-1.0 * arm[1], arm[0]),
    "choose": lambda condition, yes, no: tuple(_where(condition, *pair) for pair in zip(yes, no, strict=True)),
}


class Grid:
    """An array of values, as kernels index it; parts of it share its values."""

    def __init__(self, shape: Sequence[int], values: dict[Any, Value] | None = None, prefix: Any = ()) -> None:
        self.shape, self.size = tuple(shape), math.prod(shape)
        self.values, self.prefix = {} if values is None else values, prefix

    @classmethod
    def of(cls, tensor: Tensor) -> Grid:
        """The values of a tensor (B, ...)."""
        shape = tensor.shape[1:]
        return cls(shape, {place: Value(tensor[(slice(None), *place)]) for place in np.ndindex(*shape)})

    def __getitem__(self, place: Any) -> Any:
        place = place if isinstance(place, tuple) else (place,)
        if len(place) < len(self.shape):
            return Grid(self.shape[len(place) :], self.values, self.prefix + place)
        return self.values[self.prefix + place]

    def __setitem__(self, place: Any, value: Any) -> None:
        self.values[self.prefix + (place if isinstance(place, tuple) else (place,))] = value


class Parts:
    """Parts of kernels as functions of values: their own code, with parts in their globals made so, too."""

    def __init__(self, instead: Mapping[str, Any]) -> None:
        self.instead, self.made = instead, {}

    def __call__(self, part: Any) -> Any:
        """A part as such a function."""
        function = getattr(part, "py_func", part)
        if function not in self.made:
            names = dict(function.__globals__)
            self.made[function] = types.FunctionType(function.__code__, names, function.__name__)
            for name in function.__code__.co_names:
                if name in self.instead:
                    names[name] = self.instead[name]
                elif hasattr(names.get(name), "py_func"):
                    names[name] = self(names[name])
        return self.made[function]


class SharedSource:
    """Energy, residual and Newton step of a chain by the kernels' own source, of tensors."""

    def __init__(self) -> None:
        self.chain = five_link()
        formulas = SimpleNamespace()
        roots = types.SimpleNamespace(sqrt=lambda value: Value(value.tensor.sqrt()))
        instead = {"where": _where, "any_lane": lambda mask: True, "math": roots, "formulas": formulas}
        self.parts = Parts(PLANE | instead)
        formulas.fill_row_of_loads = self.parts(rolling_lanes.fill_row_of_loads)
        formulas.own_terms = self.parts(rolling_lanes.own_terms)

    def __call__(
        self, joints: Tensor, angles: Tensor, commands: Tensor, stiffnesses: Tensor, highest: Tensor, force: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Energies (B,), residuals (B, J) and Newton steps (B, J)."""
        arrays, zero = self.chain.arrays, torch.zeros_like(angles[:, 0])
        sizes = {"J": self.chain.n_joints, "m": self.chain.n_tendons, "n": self.chain.n_links}
        state, block = (
            SimpleNamespace(
                **{name: Grid([sizes.get(axis) or int(axis) for axis in axes.split()]) for name, axes in shapes.items()}
            )
            for shapes in (STATE, BLOCK)
        )
        state.angle, state.joint = Grid.of(angles), Grid.of(joints)
        law = SimpleNamespace(command=Grid.of(commands), stiffness=Grid.of(stiffnesses), high=Grid.of(highest))
        law.low = Grid.of(0.0 * commands)
        table = {(row, column): Value(zero) for row in range(2) for column in range(planar_loads.N_DEAD)}
        table |= {(0, column): Value(force[:, column]) for column in range(5)}
        block.state, block.loads = state, Grid((2, planar_loads.N_DEAD), table)
        for joint in range(sizes["J"]):
            block.vectors[5, joint] = Value(zero + 1.0)  # all joints are free
        holes, channels = (torch.tensor(values[0])[None] for values in (arrays.holes, arrays.channels))
        self.parts(rolling.evaluate_poses)(Grid.of(holes), Grid.of(channels), arrays.tendon_joints, state)
        energy, _ = self.parts(tendons.evaluate_tendons)(law, state)
        more, _ = self.parts(planar_loads.evaluate_dead_loads)(block.loads, state)
        self.parts(rolling.evaluate_residual)(arrays.tendon_joints, state)
        self.parts(lanes.factor_stiffness)(block, arrays.tendon_joints)
        self.parts(lanes.newton_step)(block.L, block.vectors[2], state.residual, block.vectors[5], block.vectors[0])
        residuals, steps = (
            torch.stack([values[joint].tensor for joint in range(sizes["J"])], -1)
            for values in (state.residual, block.vectors[0])
        )
        return (energy + more).tensor, residuals, steps


class Case:
    """B random poses, commands and forces on a link of the chain, and both ways to evaluate them."""

    def __init__(self, rows: int) -> None:
        rng, chain = np.random.default_rng(1), five_link()
        limits, m = chain.arrays.joints[0, :, :2], chain.n_tendons
        width = limits[:, 1] - limits[:, 0]
        self.angles = torch.tensor(limits.mean(1) + 0.3 * width * rng.uniform(-1, 1, (rows, chain.n_joints)))
        commands = torch.tensor(chain.neutral_lengths + rng.uniform(-2, 1, (rows, m)))
        loads = np.zeros((rows, 1, len(LOAD_COLUMNS)))
        loads[:, 0, 0] = rng.integers(1, chain.n_joints + 1, rows)
        for name in FORCE:
            loads[:, 0, LOAD_COLUMNS.index(name)] = rng.uniform(-2, 2, rows)
        stiffnesses, highest = torch.tensor(chain.stiffnesses).expand(rows, m), torch.full((rows, m), 1e9).double()
        self.tables = TabulatedChain.of(chain.arrays, np.zeros(rows, np.int64), "cpu")
        self.law = Law(commands, stiffnesses, torch.zeros(m).double(), highest)
        self.loads = Loads(torch.tensor(loads), chain.n_joints, only_dead=True)
        self.inputs = self.angles, commands, stiffnesses, highest, torch.tensor(loads[:, 0, :5])

    def shared_inputs(self) -> tuple[Tensor, ...]:
        """The arguments of SharedSource."""
        return self.joints(), *self.inputs

    def shared_by(self, source: Callable[..., Any]) -> Any:
        """Energies, residuals and Newton steps by a SharedSource, or by what is compiled from one."""
        return source(*self.shared_inputs())

    def joints(self) -> Tensor:
        """The eight numbers of every joint's table, (B, J, 8); both ways need them."""
        found = self.tables._joints(self.angles)
        parts = found.turn, found.touching, found.origin, found.pole
        return torch.view_as_real(torch.stack(parts, -1)).flatten(-2)

    def written_for_tensors(self) -> tuple[Tensor, Tensor, Tensor]:
        """Energies, residuals and Newton steps by the formulas of rollingjoint.differentiable."""
        state = self.tables.at(self.angles, self.law, self.loads)
        factor, _ = torch.linalg.cholesky_ex(state.stiffness)
        return state.energy[0], state.residual, -torch.cholesky_solve(state.residual[..., None], factor)[..., 0]


def processor_time() -> float:
    """Processor time of this process and of the compilers that it has started [s]."""
    return time.process_time() + sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])


def seconds_of(call: Callable[[], object], rounds: int = 5) -> float:
    """The shortest processor time of some calls, after one that is not counted [s]."""
    call()
    times = []
    for _ in range(rounds):
        begun = time.process_time()
        call()
        times.append(time.process_time() - begun)
    return min(times)


@torch.no_grad()
def main() -> None:
    """Print differences, the time to compile, and the times of one evaluation with its Newton step."""
    torch.set_num_threads(1)
    source, case = SharedSource(), Case(ROWS[0])
    begun = processor_time()
    traced = make_fx(source)(*case.shared_inputs())
    compiled = torch.compile(traced, dynamic=True, fullgraph=True)
    shared = case.shared_by(compiled)
    compiling = processor_time() - begun
    pairs = zip(shared, case.written_for_tensors(), strict=True)
    differences = [float((one - other).abs().max()) for one, other in pairs]
    parts, operations = len(source.parts.made), len(traced.graph.nodes)
    print(f"{parts} parts, {operations} operations; {compiling:.0f} s to trace and compile")
    print("largest differences: energy {:.1e} N·mm, residual {:.1e} N·mm, step {:.1e} rad".format(*differences))
    rows = []
    for count in ROWS:
        case = Case(count)
        calls = partial(case.shared_by, compiled), partial(case.shared_by, source), case.written_for_tensors
        ours, eager, theirs = (1e3 * seconds_of(call) for call in calls)
        rows.append([f"{count:,}", f"{ours:.2f}", f"{eager:.2f}", f"{theirs:.2f}", f"{ours / theirs:.2f}"])
    head = ["rows", "shared, compiled [ms]", "shared, as it is [ms]", "written for tensors [ms]", "compiled / written"]
    print(markdown_table(head, rows))
    print(f"Gate of {GATE_SECONDS:.0f} s: {'passed' if compiling <= GATE_SECONDS else 'missed'}")


if __name__ == "__main__":
    main()
