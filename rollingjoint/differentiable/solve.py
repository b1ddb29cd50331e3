"""Equilibria that can be differentiated by the design, the inputs and the loads: one adjoint solve each.

The equilibrium is found without derivatives; one Newton step on the exact residual then ties it to the parameters.
Source: docs/theory.md, section 5: dphi/dx = -H⁻¹ dr/dx.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable
from torch.nn.functional import pad

from rollingjoint.chain.status import Status
from rollingjoint.checks import as_integer
from rollingjoint.differentiable.compiled import solve_compiled
from rollingjoint.differentiable.design import DifferentiableChain
from rollingjoint.differentiable.equilibria import Equilibria
from rollingjoint.differentiable.friction import HISTORY, DifferentiableFriction, FrictionStates, as_friction
from rollingjoint.differentiable.geometry import Geometry
from rollingjoint.differentiable.loads import AnyLoads
from rollingjoint.differentiable.looking import may_look, seen, without_looking
from rollingjoint.differentiable.newton import freed, minimise
from rollingjoint.differentiable.parameters import ChainTensors
from rollingjoint.differentiable.spatial_equilibria import SpatialEquilibria
from rollingjoint.differentiable.spatial_statics import state_at
from rollingjoint.differentiable.spatial_surroundings import DifferentiableSpatialSurroundings
from rollingjoint.differentiable.spatial_walled import SpatialWalledEquilibria, state_among
from rollingjoint.differentiable.statics import Law
from rollingjoint.differentiable.surroundings import DifferentiableSurroundings, WallTensors
from rollingjoint.differentiable.walled import Among, PinnedWalls, WalledEquilibria
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import CapstanFriction, FrictionState
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.kernels.planar_loads import LINK_COLUMNS
from rollingjoint.load import Load, with_all_columns, wrong_links
from rollingjoint.surroundings import Surroundings

History = Equilibria | FrictionStates | FrictionState | None
"""The equilibria before a step with friction, their friction state, or None for no friction at all."""

ORIGIN = (0.0, 0.0, 0.0)
"""The pose of the base in the world: x, y [mm], angle [rad]."""

_CROSSED = -1e-9  # mm; below it the holes of a gap have changed places


def solve_tensions(
    design: ChainTensors,
    tensions: Tensor,
    loads: Sequence[Load] | Tensor = (),
    starts: Tensor | None = None,
    solver: str = "torch",
    friction: DifferentiableFriction | CapstanFriction | None = None,
    history: History = None,
    steps: int | None = None,
    surroundings: WallTensors | Surroundings | None = None,
    base: Tensor | Sequence[float] = ORIGIN,
) -> Equilibria:
    """Equilibria under given tensions.

    Args:
        design: mechanisms with any leading axes, which broadcast with the other arguments: `design[:, None]`
            and tensions (C, m) make a table of designs and load cases.
        tensions: (..., m) [N].
        loads: loads shared by all rows, or load tables (..., rows, columns), columns load.LOAD_COLUMNS, in space
            load.SPATIAL_LOAD_COLUMNS.
        starts: joint angles to start from, (..., n - 1) [rad]; default: the angles of the history, or s = 0.
        solver: "torch" builds no tables: for new designs. "compiled" builds each mechanism, tens of milliseconds, and
            keeps the last 256: for many solves of one mechanism.
        friction: of the tendons; default: the friction of the design. It acts where there is a history.
        history: the equilibria before this step, or their `friction_state`; gradients flow through it. Without it the
            result is the pose without friction, before any slip.
        steps: exact number of Newton's steps of all rows, in which the host never waits for the device; None: until
            each row has arrived. With `steps`, a row that has not arrived is NOT_CONVERGED, where it would otherwise
            go to the compiled solver; a piece of a surface that turns by more than 11 rad is INVALID_INPUT, and so is
            a wrong link in a load table.
        surroundings: walls, DifferentiableSurroundings or DifferentiableSpatialSurroundings, with leading axes of the
            batch or none; None: none. Rows then go to the compiled solver, whichever is named. Friction of walls acts
            where the history is among walls, too.
        base: pose of the base among them, (..., 3) x, y [mm], angle [rad]; in space (..., 3) x, y, z, or (..., 6), with
            a rotation vector.
    Returns:
        Equilibria, WalledEquilibria among walls, in space SpatialEquilibria and SpatialWalledEquilibria; look at `ok`.
        A design that cannot be built, like numbers that are not finite, is INVALID_INPUT.
    Raises:
        InvalidInput: wrong shapes, an unknown solver, a load on a link that does not exist, walls of the plane
            around chains in space, or the other way round.
    """
    tau = _numbers(design, "tensions", tensions, design.n_tendons)
    with without_looking(_fixed(steps, solver)):
        around = _around(design, surroundings, base, history, steps)
        return _solve(design, Law.constant(tau), loads, starts, solver, friction, history, steps, around)


def solve_lengths(
    design: ChainTensors,
    lengths: Tensor,
    loads: Sequence[Load] | Tensor = (),
    starts: Tensor | None = None,
    solver: str = "torch",
    tension_limits: tuple[Tensor | float, Tensor | float] = (0.0, torch.inf),
    friction: DifferentiableFriction | CapstanFriction | None = None,
    history: History = None,
    steps: int | None = None,
    surroundings: WallTensors | Surroundings | None = None,
    base: Tensor | Sequence[float] = ORIGIN,
) -> Equilibria:
    """Equilibria under given lengths, elastic tendons.

    Args:
        design, loads, starts, solver, friction, history, steps, surroundings, base: as for `solve_tensions`.
        lengths: (..., m) unstretched lengths [mm].
        tension_limits: minimum and maximum tendon tension, numbers or (..., m) [N].
    Returns:
        Equilibria; look at `ok`.
    Raises:
        InvalidInput: wrong shapes, an unknown solver, a load on a link that does not exist, walls of the plane
            around chains in space, or the other way round.
    """
    command = _numbers(design, "lengths", lengths, design.n_tendons)
    limits = [_on_device(design, limit) for limit in tension_limits]
    low, high = (
        _numbers(design, "tension_limits", t.expand(design.n_tendons) if t.ndim == 0 else t, design.n_tendons)
        for t in limits
    )
    law = Law(command, design.stiffnesses, low, high)
    with without_looking(_fixed(steps, solver)):
        around = _around(design, surroundings, base, history, steps)
        return _solve(design, law, loads, starts, solver, friction, history, steps, around)


def _fixed(steps: int | None, solver: str) -> bool:
    """Whether a number of steps is given; raises InvalidInput for an unusable number."""
    if steps is None:
        return False
    if solver != "torch":
        raise InvalidInput("solver", solver, '"torch", where steps are given')
    as_integer("steps", steps, 1, 1000)
    return True


def _solve(
    design: ChainTensors,
    law: Law,
    loads: Sequence[Load] | Tensor,
    starts: Tensor | None,
    solver: str,
    friction: DifferentiableFriction | CapstanFriction | None,
    history: History,
    steps: int | None,
    among: Among | None,
) -> Equilibria:
    if solver not in ("torch", "compiled"):
        raise InvalidInput("solver", solver, '"torch" or "compiled"')
    table = _table(design, loads)
    applied_friction = design.friction if friction is None else as_friction(friction, design.n_tendons, design.starts)
    before = None if history is None else _history(design, applied_friction, history)
    law = replace(law, friction=applied_friction, history=None if applied_friction is None else before)
    starts = before.angles if starts is None and before is not None else starts
    begin = None if starts is None else _numbers(design, "starts", starts, design.n_links - 1).detach()
    shapes = [design.batch, table.shape[:-2], *law.leading, *([] if begin is None else [begin.shape[:-1]])]
    shapes += [] if among is None else among.leading
    try:
        batch = np.broadcast_shapes(*map(tuple, shapes))
    except ValueError:
        raise InvalidInput("leading axes", [tuple(shape) for shape in shapes], "axes that broadcast") from None
    law = law.each(lambda tensor, axes: tensor.expand(*batch, *tensor.shape[tensor.ndim - axes :]))
    table = table[(None,) * (len(batch) + 2 - table.ndim)]
    expanded = design.over(len(batch))
    rolls = expanded.valid()
    good = rolls & _usable(law, table, design) & (True if begin is None else torch.isfinite(begin).all(-1))
    good = good.expand(batch)
    if among is not None:
        among = among.expanded(batch)
        good = good & among.usable()
    law, table = _where(good, law, table)
    expanded = expanded.where(rolls)
    geometry = expanded.geometry()
    with torch.no_grad():
        if among is None:
            s, held, status = _search(expanded, geometry.detach(), law, table, begin, good, solver, steps)
        else:
            s, held, status, among = _search_among(expanded, geometry.detach(), law, table, begin, good, among)
    among = None if among is None else among.tied()
    return tied(geometry, law, acting(expanded, table), s, held, status, among)


def _around(
    design: ChainTensors,
    surroundings: WallTensors | Surroundings | None,
    base: Tensor | Sequence[float],
    history: History,
    steps: int | None,
) -> Among | None:
    """The checked walls; None without."""
    if surroundings is None:
        return None
    if steps is not None or design.device.type != "cpu":
        raise InvalidInput("surroundings", surroundings, "None beside steps and on devices")
    planar = isinstance(design, DifferentiableChain)
    kind: type[WallTensors] = DifferentiableSurroundings if planar else DifferentiableSpatialSurroundings
    given: Any = surroundings
    walls = given if isinstance(given, kind) else kind.of(given, design.mechanism(0))
    place = torch.as_tensor(base, dtype=torch.float64)
    if not planar and place.ndim and place.shape[-1] == 3:
        place = pad(place, (0, 3))
    place = _numbers(design, "base", place, kind.base_size)
    if history is None or not walls.rubs:
        return Among(walls, place)
    if not isinstance(history, WalledEquilibria):
        raise InvalidInput("history", type(history).__name__, "equilibria among walls, for friction of walls")
    return Among(walls, place, history.wall_memory, history.walled)


def _search_among(
    design: ChainTensors,
    geometry: Geometry,
    law: Law,
    loads: Tensor,
    starts: Tensor | None,
    good: Tensor,
    among: Among,
) -> tuple[Tensor, Tensor, Tensor, Among]:
    """`_search` among walls, by the compiled solver, and the walls with the contacts that press."""
    begin = torch.zeros(*good.shape, design.n_links - 1, dtype=torch.float64)
    angles = geometry.contact(begin).angles if starts is None else torch.nan_to_num(starts).expand_as(begin)
    phi, held, status, found = solve_compiled(design, law, loads, angles, good, among)
    assert found is not None
    return geometry.contacts(phi, begin), held, status, found


def _search(
    design: ChainTensors,
    geometry: Geometry,
    law: Law,
    loads: Tensor,
    starts: Tensor | None,
    good: Tensor,
    solver: str,
    steps: int | None,
) -> tuple[Tensor, Tensor, Tensor]:
    """Contacts at the equilibria, whether joints are held at the ends of their surfaces, and the status of each row."""
    begin = torch.zeros(*good.shape, design.n_links - 1, dtype=torch.float64, device=design.device)
    if starts is not None:
        begin = geometry.contacts(torch.nan_to_num(starts).expand_as(begin), begin)
    status = torch.full(good.shape, int(Status.INVALID_INPUT), device=design.device)
    s, held = begin, torch.zeros_like(begin, dtype=torch.bool)
    unsolved = good
    if solver == "torch":
        all_loads = acting(design, loads)
        s, held, arrived = minimise(geometry, law, all_loads, begin, steps)
        s = torch.where(arrived[..., None], s, begin)
        contact = geometry.contact(s)
        state = state_at(geometry, law, all_loads, contact.angles, contact)
        crossed = state.crossing < _CROSSED
        outcome = torch.where(held.any(-1), int(Status.AT_LIMIT), int(Status.CONVERGED))
        status = torch.where(good & arrived & ~crossed, outcome, status)
        unsolved = good & ~arrived
    if not may_look():
        status = torch.where(unsolved, int(Status.NOT_CONVERGED), status)
    elif bool(unsolved.any()):
        phi, stops, ends, _ = solve_compiled(design, law, loads, geometry.contact(begin).angles, unsolved)
        s = torch.where(unsolved[..., None], geometry.contacts(phi, begin), s)
        held, status = torch.where(unsolved[..., None], stops, held), torch.where(unsolved, ends, status)
    return s, held, status


def acting(design: ChainTensors, table: Tensor) -> AnyLoads:
    """The loads of a table and the springs of the mechanisms."""
    if design.springs:
        springs = torch.as_tensor(design.load_table(design.springs)).to(table)
        table = torch.cat([springs.expand(*table.shape[:-2], *springs.shape), table], -2)
    return design.loads(table, design.n_links - 1)


def tied(
    geometry: Geometry,
    law: Law,
    loads: AnyLoads,
    s: Tensor,
    held: Tensor,
    status: Tensor,
    among: Among | PinnedWalls | None = None,
) -> Equilibria:
    """The equilibria at contacts s as functions of all parameters behind the geometry, the law and the loads."""
    first, last = geometry.limits
    s = torch.where(held, torch.where(2.0 * s > first + last, last, first), s)
    contact = geometry.contact(s)
    angle, kappa = contact.angles, contact.kappa.detach()
    near = torch.where(held, angle, angle.detach())
    at = contact.moved((near - angle) / kappa)
    before = state_among(state_at(geometry, law, loads, near, at), among)
    residual = before.residual
    with torch.no_grad():
        H = before.stiffness.expand(*residual.shape, residual.shape[-1])
    fixed = held | (status > Status.AT_LIMIT)[..., None]
    phi = _NewtonStep.apply(near, residual, H, fixed)
    moved = contact.moved((phi - angle) / kappa)
    in_space = geometry.planes is not None
    if among is None:
        kind = SpatialEquilibria if in_space else Equilibria
    else:
        kind = SpatialWalledEquilibria if in_space else WalledEquilibria
    return kind(status, ~held, moved.s, state_among(state_at(geometry, law, loads, phi, moved), among))


class _NewtonStep(torch.autograd.Function):
    """phi - H⁻¹ r on the joints that are not held; backwards it is the adjoint solve with the transpose of H.

    First derivatives are exact at r = 0. Second derivatives, which would need dH, are refused.
    """

    @staticmethod
    def forward(ctx: Any, phi: Tensor, residual: Tensor, H: Tensor, held: Tensor) -> Tensor:
        """The angles after the step, (..., J)."""
        ctx.save_for_backward(H, held)
        return phi - _solved(freed(H, held), torch.where(held, 0.0, residual))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients by phi (held joints) and by the residual (free joints)."""
        H, held = ctx.saved_tensors
        adjoint = _solved(freed(H, held).mT, torch.where(held, 0.0, gradient))
        return torch.where(held, gradient, 0.0), torch.where(held, 0.0, -adjoint), None, None


def _solved(matrix: Tensor, right: Tensor) -> Tensor:
    solution, _ = torch.linalg.solve_ex(matrix, right[..., None])
    return solution[..., 0]


def _usable(law: Law, table: Tensor, design: ChainTensors) -> Tensor:
    """Whether the inputs of a row are valid: finite, in range, on links that exist, no pushing spring."""
    command, stiffness, low, high = (row.detach() for row in law.rows)
    numbers = torch.stack([command, stiffness, low]).abs().amax((0, -1)) <= LARGEST_INPUT
    limits = ((low >= 0) & (high >= low)).all(-1)
    values = table.detach()
    in_range = values.abs() <= LARGEST_INPUT
    columns = design.loads.columns
    pushing = torch.stack([values[..., columns.index(name)] < 0 for name in ("k", "torsion")], -1)
    for link in (values[..., columns.index(name)] for name in LINK_COLUMNS):
        limits = limits & ((link >= 0) & (link < design.n_links) & (link % 1 == 0)).all(-1)
    good = numbers & limits & in_range.flatten(-2).all(-1) & ~pushing.flatten(-2).any(-1)
    for part in (law.friction, law.history):
        good = good if part is None else good & part.usable()
    return good


def _where(good: Tensor, law: Law, table: Tensor) -> tuple[Law, Tensor]:
    """Law and loads; in rows that are not good, valid constants."""
    if seen(good.all(), False):
        return law, table
    return law.where(good), torch.where(good[..., None, None], table, 0.0)


def _table(design: ChainTensors, loads: Sequence[Load] | Tensor) -> Tensor:
    """Load tables, (..., rows, columns)."""
    if not isinstance(loads, Tensor):
        return torch.as_tensor(design.load_table(loads), device=design.device)
    columns = design.loads.columns
    table = with_all_columns(loads, columns, lambda table, n: pad(table, (0, n))) if loads.ndim >= 2 else None
    if table is None:
        raise InvalidInput("shape of the load table", tuple(loads.shape), f"(..., rows, {len(columns)})")
    links = wrong_links(table.detach(), columns, design.n_links) if may_look() else None
    if links is not None:
        raise InvalidInput("links of the load table", links, f"integers from 0 to {design.n_links - 1}")
    return torch.as_tensor(table).to(design.device, torch.float64)


def _history(design: ChainTensors, friction: DifferentiableFriction | None, history: object) -> FrictionStates:
    """The friction states from which a step with this friction starts."""
    before: Any = history.remembered(friction) if isinstance(history, Equilibria) else history
    if not isinstance(before, FrictionStates | FrictionState):
        raise InvalidInput("history", history, "Equilibria of rollingjoint.differentiable, or a friction_state")
    shapes = {"angles": (design.n_links - 1,)} | dict.fromkeys(
        ("states", "slips", "grips"), (design.n_links - 1, design.n_tendons)
    )
    fields = {name: getattr(before, name) for name in HISTORY}
    copied = {name: values if isinstance(values, Tensor) else torch.tensor(values) for name, values in fields.items()}
    tensors = {name: tensor.to(design.starts) for name, tensor in copied.items()}
    for name, tensor in tensors.items():
        if tuple(tensor.shape[-HISTORY[name] :]) != shapes[name]:
            expected = f"(..., {str(shapes[name])[1:-1].rstrip(',')}), as of this mechanism"
            raise InvalidInput(f"shape of the history's {name}", tuple(tensor.shape), expected)
    return FrictionStates(**tensors)


def _on_device(design: ChainTensors, limit: Tensor | float) -> Tensor:
    """A limit on the device of the design; a number is filled in there, without a copy from the host."""
    if isinstance(limit, int | float):
        return torch.full((), limit, dtype=torch.float64, device=design.device)
    return torch.as_tensor(limit, dtype=torch.float64, device=design.device)


def _numbers(design: ChainTensors, name: str, values: Tensor, size: int) -> Tensor:
    tensor = torch.as_tensor(values, dtype=torch.float64, device=design.device)  # a list would become single precision
    if tensor.ndim == 0 or tensor.shape[-1] != size:
        raise InvalidInput(f"shape of {name}", tuple(tensor.shape), f"(..., {size})")
    return tensor
