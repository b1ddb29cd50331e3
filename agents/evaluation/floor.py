"""The floor of an episode: the smallest tip error that any command reaches against its true load and mechanism.

A command is an unstretched length per tendon; motors keep the tensions within a range. A command can reach every
stable equilibrium of elastic tendons with tensions in that range. Poses that are unstable under constant tensions
can be stable under constant lengths, so the search is over commands, and the range is a constraint on its result. An
error minus its floor is the regret: the possible gain of a better controller; it is negative by rounding at most.

With friction there is no floor: the equilibrium under a command then depends on the way to it. A bound for every path
would have to let every hole hold or slip as it likes; then too many tips are within reach for it to be of use.
`why_no_floor` gives the reason, `episode_floor` refuses.

Quasi-static: the floor is the best equilibrium of one step, whether or not there was time to reach it, and errors of
a step that ended an episode without an equilibrium (`terminated`) are no equilibrium's. The search is local, from
several starts; that it finds the global minimum is tested on samples, not proven: with four times the starts and eight
times the candidates, `pytest -m slow -s tests/agents/evaluation/test_floor.py` finds no floor lower by over 5e-7 mm in
eight planar tasks of 500 episodes, but 0.013 mm in two of 500 episodes where tensions may go down to zero. For the
flexible arm, three times the starts find no floor lower by 1e-8 mm in three hard tasks of 200 episodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from agents.runs.environment import EnvConfig
from rj_gym.registry import task_of
from rj_gym.tracking.task import TrackingTask
from rollingjoint import Status, solve_lengths_batch, solve_tensions_batch
from rollingjoint.chain.chain import AnyChain, Chain
from rollingjoint.errors import ConfigError, InvalidInput, SolverError
from rollingjoint.statics.sensitivity import tip_and_tensions_dlengths
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]

STARTS = 16  # per episode, each the best of CANDIDATES at its level of tension
CANDIDATES = 8
JOINTS_AT_A_TIME = 256_000  # of candidates solved together, which bounds the memory

WITH_FRICTION = (
    "With friction the tip under a command depends on the moves before it: no floor is known that holds for every path."
)

WITH_TERMS = "Own targets have no floor, which is searched for from the tensions of a target: target_tensions have one."

_MAX_ITERATIONS = 300
_GOAL = 1e-10  # mm that the next step would still gain
_LARGEST_DAMPING = 1e6  # beyond it no step improves anything
_SMALLEST_DAMPING = 1e-10
_ROUNDING = 1e-15  # of a hessian's trace, added to its diagonal: of many tendons, few move the tip
_TENSION_TOLERANCE = 1e-8  # N
_OUTSIDE = 0.01  # mm of tip error that 1 N outside the tension range costs, beyond its gain


@dataclass(frozen=True)
class Floor:
    """The best equilibria of E episodes, or of steps of them: (E, ...) or (E, steps, ...).

    Attributes:
        errors: tip error [mm], (...); infinite where the search ended outside the tension range.
        tips: (..., 2 or 3) [mm].
        tensions: (..., m) [N]. commands: (..., m) unstretched tendon lengths that hold it [mm].
        joint_angles: (..., n - 1) [rad]; with many mechanisms 0 where one has no more joints.
        status: Status codes (...): CONVERGED, AT_LIMIT (as of a solve), or NOT_CONVERGED: the search had not ended.
    """

    errors: Array
    tips: Array
    tensions: Array
    commands: Array
    joint_angles: Array
    status: NDArray[np.int64]


def why_no_floor(env: EnvConfig) -> str:
    """Why the episodes of a tracking environment have no floor, one line; empty where they have one."""
    config = env.arguments()["config"]
    if config.terms.targets is not None:
        return WITH_TERMS
    return WITH_FRICTION if task_of(config).friction_acts else ""


def episode_floor(
    env: EnvConfig,
    seeds: Sequence[int],
    steps: Sequence[int] | None = None,
    starts: int = STARTS,
    candidates: int = CANDIDATES,
) -> Floor:
    """The floor of the episodes that reset(seed=...) begins, arrays (E, ...) at their last step.

    Args:
        env: an environment of rj_gym that tracks a target.
        seeds: one per episode.
        steps: steps to look at, from 0 (after reset) to episode_steps: arrays (E, len(steps), ...).
        starts, candidates: as for `floor`.
    Raises:
        ConfigError: another environment, or one with friction, own targets.
        InvalidInput: a step that does not exist.
    """
    if not env.is_tracking:
        raise ConfigError("env.id", env.id, "a tracking environment of rj_gym", "Only these have a floor.")
    if why := why_no_floor(env):
        cause = "friction" if why == WITH_FRICTION else "own targets"
        raise ConfigError("env.settings", cause, f"an environment without {cause}", why)
    config = env.arguments()["config"]
    moments = [config.episode_steps] if steps is None else list(steps)
    if not all(0 <= step <= config.episode_steps for step in moments):
        raise InvalidInput("steps", moments, f"whole numbers from 0 to {config.episode_steps}")
    task: Any = task_of(config)
    generators = [seeding.np_random(seed)[0] for seed in seeds]
    if hasattr(task, "episodes_by_links"):  # with many mechanisms
        parts = task.episodes_by_links(generators)
    else:
        parts = [(np.arange(len(seeds)), task, task.sample(generators))]
    floors = [_floor_of(own, episodes, moments, starts, candidates) for _, own, episodes in parts]
    order = np.argsort(np.concatenate([rows for rows, _, _ in parts]))
    if len({each.joint_angles.shape[-1] for each in floors}) > 1:
        floors = _with_all_joints(floors)
    joined = _joined(floors, lambda values: np.concatenate(values)[order])
    return joined if steps is not None else _joined([joined], lambda values: values[0][:, 0])


def _floor_of(task: TrackingTask, episodes: Any, moments: Sequence[int], starts: int, candidates: int) -> Floor:
    """The floor of episodes of one task at these steps, arrays (E, steps, ...)."""
    config: Any = task.config
    chains = [episodes.mechanisms[design] for design in episodes.designs]
    tensions, base = episodes.target_tensions, task.base_load_tables(episodes)
    pulled = task.load_tables(episodes, config.episode_steps) if config.target.loaded else base
    (low, high), limit = config.tension_range, config.actuation.tension_limit
    usable = low, high if limit is None else limit[1]
    varies = max(tensions.shape[1], episodes.forces.shape[1]) > 1

    def at(step: int) -> Floor:
        start_tensions = tensions[:, min(step, tensions.shape[1] - 1)]
        equilibria = solve_tensions_batch(chains, start_tensions, pulled)
        lost = equilibria.status > int(Status.AT_LIMIT)
        targets = (
            equilibria.tip
            if not lost.any()
            else np.where(lost[:, None], solve_tensions_batch(chains, start_tensions, base).tip, equilibria.tip)
        )
        loads = task.load_tables(episodes, step)
        return floor(chains, targets, loads, usable, base, starts, candidates)

    floors = [at(step) for step in (moments if varies else moments[:1])]
    return _joined(floors if varies else floors * len(moments), lambda parts: np.stack(parts, axis=1))


def _with_all_joints(floors: Sequence[Floor]) -> list[Floor]:
    """The floors with as many joint angles each as the longest mechanism has; 0 where it has none."""
    most = max(each.joint_angles.shape[-1] for each in floors)
    missing = [(0, most - each.joint_angles.shape[-1]) for each in floors]
    return [
        replace(each, joint_angles=np.pad(each.joint_angles, ((0, 0), (0, 0), more)))
        for each, more in zip(floors, missing, strict=True)
    ]


def floor(
    mechanism: AnyChain | Sequence[AnyChain],
    targets: Array,
    loads: Array,
    tension_range: tuple[float, float],
    base_loads: Array | None = None,
    starts: int = STARTS,
    candidates: int = CANDIDATES,
) -> Floor:
    """The smallest distances from tip to target, arrays (E, ...).

    Damped Gauss-Newton steps on the commands, within the linearised limits of tension, from several starts.

    Args:
        mechanism: a RollingChain or a HingeChain, or one per episode.
        targets: (E, 2 or 3) [mm].
        loads: load tables, (E, rows, columns), columns rollingjoint.load.LOAD_COLUMNS or SPATIAL_LOAD_COLUMNS.
        tension_range: lowest and highest tension of every tendon [N].
        base_loads: the ones among them that act when the tendons are locked, such as weights; None: no loads.
        starts: starts per episode, each at another level of tension.
        candidates: equilibria per level of which the one nearest to the target is the start.
    Raises:
        SolverError: a load under which no start has an equilibrium.
    Source: bounds as in Nocedal and Wright, Numerical Optimization, 2006, ch. 16 (active sets).
    """
    chains = [mechanism] * len(targets) if isinstance(mechanism, Chain) else list(mechanism)
    base = loads[:, :0] if base_loads is None else base_loads
    every = _FloorBatch(np.array(chains, dtype=object), targets, loads, base, tension_range)
    parts, together = [], max(1, JOINTS_AT_A_TIME // (chains[0].n_joints * starts * candidates))
    for first in range(0, len(targets), together):
        parts.append(_search(every[first : first + together], starts, candidates))
    return _joined(parts, np.concatenate)


def _joined(parts: Sequence[Floor], join: Callable[..., Any]) -> Floor:
    return Floor(**{field.name: join([getattr(part, field.name) for part in parts]) for field in fields(Floor)})


@dataclass(frozen=True)
class _FloorBatch:
    """A batch of searches: mechanisms (B,), targets (B, d), load tables (B, rows, columns), at the start too."""

    chains: NDArray[np.object_]
    targets: Array
    loads: Array
    base_loads: Array
    tension_range: tuple[float, float]

    def __getitem__(self, rows: NDArray[np.int64] | slice) -> _FloorBatch:
        names = ("chains", "targets", "loads", "base_loads")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    @property
    def mechanism(self) -> Any:
        """The mechanism in the form that the solvers take: one, or one per search."""
        is_uniform = bool(np.all(self.chains == self.chains[0]))
        return self.chains[0] if is_uniform else list(self.chains)

    @property
    def stiffnesses(self) -> Array:
        """Of the tendons, (B, m) [N/mm]."""
        return np.array([chain.stiffnesses for chain in self.chains])


class _SearchPoints(NamedTuple):
    """Where the searches are. Limits of tension are not applied here: tendons are elastic."""

    commands: Array  # (B, m) mm
    angles: Array  # (B, J) rad
    tensions: Array  # (B, m) N
    tips: Array  # (B, d) mm
    misses: Array  # (B, d) tip - target, mm
    tip_rates: Array  # (B, d, m) d tip / d tension, mm/N
    command_rates: Array  # (B, m, m) d command / d tension, mm/N
    corrections: Array  # (B, m) change of tension to the nearest one within the range, N
    values: Array  # (B,) objective, mm: the tip error where the tensions are within the range
    status: NDArray[np.int64]  # (B,)

    def take(self, rows: NDArray[np.int64]) -> _SearchPoints:
        """The points in these rows."""
        return _SearchPoints._make(values[rows] for values in self)


def _search(batch: _FloorBatch, starts: int, candidates: int) -> Floor:
    """The best of the local minima that are found from the starts."""
    episodes, commands, angles = _starts(batch, starts, candidates)
    many = batch[episodes]
    points, ended = _descend(many, _visit(many, commands, angles, commands))
    allowed = np.abs(points.corrections).max(axis=1) <= _TENSION_TOLERANCE
    errors = np.where(allowed, np.linalg.norm(points.misses, axis=1), np.inf)
    order = np.lexsort((errors, episodes))
    best = order[np.unique(episodes[order], return_index=True)[1]]
    status = np.where(ended & allowed, points.status, int(Status.NOT_CONVERGED))
    winners = points.take(best)
    return Floor(errors[best], winners.tips, winners.tensions, winners.commands, winners.angles, status[best])


def _starts(batch: _FloorBatch, starts: int, candidates: int) -> tuple[NDArray[np.int64], Array, Array]:
    """Episodes (B,), commands (B, m) and joint angles (B, J) of the starts.

    As an episode begins: tendons are locked at an equilibrium under the loads of the start, then all loads are applied.
    """
    count, drawn = len(batch.targets), starts * candidates
    tensions = np.tile(_levels(batch.tension_range, starts, candidates, batch.stiffnesses.shape[1]), (count, 1))
    many = batch[np.repeat(np.arange(count), drawn)]
    unloaded = solve_tensions_batch(many.mechanism, tensions, many.base_loads)
    locked = unstretched_length(unloaded.lengths, tensions, many.stiffnesses)
    loaded = solve_lengths_batch(many.mechanism, locked, many.loads, unloaded, many.tension_range)
    errors = np.where(loaded.ok, np.linalg.norm(loaded.tip - many.targets, axis=1), np.inf)
    best = np.arange(count * starts) * candidates + errors.reshape(-1, candidates).argmin(axis=1)
    best = best[np.isfinite(errors[best])]
    if len(np.unique(best // drawn)) < count:
        raise SolverError(
            "no floor: under the load of an episode no start has an equilibrium; are the loads too large?"
        )
    commands = unstretched_length(loaded.lengths, loaded.tensions, many.stiffnesses)
    return best // drawn, commands[best], loaded.joint_angles[best]


def _levels(tension_range: tuple[float, float], starts: int, candidates: int, m: int) -> Array:
    """Tensions (starts × candidates, m) [N]: one tendon has the tension of the level, the others less."""
    rng = np.random.default_rng(0)
    high = tension_range[1]
    low = max(tension_range[0], 0.01 * high)
    levels = high * (low / high) ** (np.arange(starts) / starts)
    highest = np.repeat(levels, candidates)
    tensions: Array = low * (highest[:, None] / low) ** rng.random((len(highest), m))
    tensions[np.arange(len(highest)), rng.integers(m, size=len(highest))] = highest
    return tensions


def _visit(batch: _FloorBatch, commands: Array, angles: Array, fallback: Array) -> _SearchPoints:
    """The equilibria under these commands, found from these joint angles; where there is none, under the fallback."""
    equilibria = solve_lengths_batch(batch.mechanism, commands, batch.loads, angles)
    if not np.all(equilibria.ok):
        commands = np.where(np.asarray(equilibria.ok)[:, None], commands, fallback)
        equilibria = solve_lengths_batch(batch.mechanism, commands, batch.loads, angles)
    k, m = batch.stiffnesses, commands.shape[1]
    elastic = replace(equilibria, tendon_stiffness=k)  # at the edge of slack too
    tips, rates = tip_and_tensions_dlengths(elastic)
    rates = rates / k[:, :1, None]
    regular = rates @ np.swapaxes(rates, 1, 2) + 1e-8 * np.eye(m)  # tensions turn back at folds
    command_rates = np.swapaxes(rates, 1, 2) @ np.linalg.inv(regular) / k[:, :1, None]
    tip_rates = tips @ command_rates
    misses = equilibria.tip - batch.targets
    corrections = np.clip(equilibria.tensions, *batch.tension_range) - equilibria.tensions
    tip_shifts = _times(tip_rates, corrections)
    values = (
        np.linalg.norm(misses + tip_shifts, axis=1)
        + np.linalg.norm(tip_shifts, axis=1)
        + _OUTSIDE * np.abs(corrections).sum(1)
    )
    taut = unstretched_length(equilibria.lengths, equilibria.tensions, k)
    where = (taut, equilibria.joint_angles, equilibria.tensions, equilibria.tip)
    return _SearchPoints(*where, misses, tip_rates, command_rates, corrections, values, np.asarray(equilibria.status))


def _descend(batch: _FloorBatch, points: _SearchPoints) -> tuple[_SearchPoints, NDArray[np.bool_]]:
    """The local minima below these points, and whether each was reached, (B,)."""
    points = points.take(np.arange(len(points.values)))  # a copy, to be changed below
    damping, ended = np.full(len(points.values), 1e-3), np.zeros(len(points.values), bool)
    for _ in range(_MAX_ITERATIONS):
        rows = np.flatnonzero(~ended)
        if len(rows) == 0:
            break
        current = points.take(rows)
        change = _bounded_change(current, batch.tension_range, damping[rows])
        gain = current.values - np.linalg.norm(current.misses + _times(current.tip_rates, change), axis=1)
        trial = current.commands + _times(current.command_rates, change)
        stepped = _visit(batch[rows], trial, current.angles, current.commands)
        better = stepped.values < current.values
        for values, new in zip(points, stepped, strict=True):
            values[rows[better]] = new[better]
        damping[rows] *= np.where(better, 1 / 3, 4.0)
        damping = np.maximum(damping, _SMALLEST_DAMPING)
        ended[rows] = (gain < _GOAL) | (damping[rows] > _LARGEST_DAMPING)
    return points, ended


def _bounded_change(points: _SearchPoints, tension_range: tuple[float, float], damping: Array) -> Array:
    """Change of the tensions (B, m) that minimises |tip - target|² + damping |change of command|², linearised.

    Straight to the minimum over the free tensions, as far as the first limit; that tension is held there, and so on.
    """
    low, high = (limit - points.tensions for limit in tension_range)
    tip, command = points.tip_rates, points.command_rates
    square = np.swapaxes(tip, 1, 2) @ tip + damping[:, None, None] * np.swapaxes(command, 1, 2) @ command
    square += _ROUNDING * np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(square.shape[1])
    change, held = points.corrections.copy(), np.zeros(points.corrections.shape, bool)
    for _ in range(change.shape[1] + 1):
        slope = _times(np.swapaxes(tip, 1, 2), points.misses) + _times(square, change)
        fixed = held | ((change <= low) & (slope > 0)) | ((change >= high) & (slope < 0))
        blocked = fixed[:, :, None] | fixed[:, None, :]
        free = np.where(blocked, 0.0, square) + np.eye(change.shape[1]) * fixed[:, None, :]
        way = np.linalg.solve(free, np.where(fixed, 0.0, -slope)[..., None])[..., 0]
        room = np.where(way > 0, high - change, low - change)
        share = np.divide(room, way, out=np.full(way.shape, np.inf), where=way != 0)
        length = np.minimum(share.min(axis=1, keepdims=True), 1.0)
        change = np.clip(change + length * way, low, high)
        held |= share <= length
    return change


def _times(matrices: Array, vectors: Array) -> Array:
    """Matrix times vector, row by row."""
    return (matrices @ vectors[..., None])[..., 0]
