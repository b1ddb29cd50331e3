"""The floor of an episode: the smallest tip error that any command reaches against its true load and mechanism.

A command is an unstretched length per tendon; motors keep the tensions within a range. A command can reach every
stable equilibrium of elastic tendons with tensions in that range. Poses that are unstable under constant tensions
can be stable under constant lengths, so the search is over commands, and the range is a constraint on its result. An
error minus its floor is the regret: the possible gain of a better controller; it is negative by rounding at most.

With friction there is no floor: the equilibrium under a command then depends on the way to it. A bound for every path
would have to let every hole hold or slip as it likes; then too many tips are within reach for it to be of use.
`why_no_floor` gives the reason, `episode_floor` refuses.

Quasi-static: the floor is the best equilibrium of one step, whether or not there was time to reach it, and errors of
a step that ended an episode without an equilibrium (`terminated`) are no equilibrium's. The search is
`rollingjoint.reach_batch`, local, from several starts, which depend on the other episodes: floors agree within 1e-6 mm,
of several commands that reach a target another one may be found. That the global minimum is found is tested on
samples, not proven: four times the starts find no lower floor in
`pytest -m slow -s tests/agents/evaluation/test_floor.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from agents.runs.environment import EnvConfig
from rj_gym.registry import task_of
from rj_gym.tracking.task import TrackingTask
from rollingjoint import ReachStatus, Status, reach_batch, solve_tensions_batch
from rollingjoint.chain.chain import AnyChain, Chain
from rollingjoint.errors import ConfigError, InvalidInput, SolverError

Array = NDArray[np.float64]

STARTS = 96  # per episode, at most

WITH_FRICTION = (
    "With friction the tip under a command depends on the moves before it: no floor is known that holds for every path."
)

WITH_TERMS = "Own targets have no floor, which is searched for from the tensions of a target: target_tensions have one."


@dataclass(frozen=True)
class Floor:
    """The best equilibria of E episodes, or of steps of them: (E, ...) or (E, steps, ...).

    Attributes:
        errors: tip error [mm], (...); infinite where no search found an equilibrium.
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
) -> Floor:
    """The floor of the episodes that reset(seed=...) begins, arrays (E, ...) at their last step.

    Args:
        env: an environment of rj_gym that tracks a target.
        seeds: one per episode.
        steps: steps to look at, from 0 (after reset) to episode_steps: arrays (E, len(steps), ...).
        starts: as for `floor`.
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
    floors = [_floor_of(own, episodes, moments, starts) for _, own, episodes in parts]
    order = np.argsort(np.concatenate([rows for rows, _, _ in parts]))
    if len({each.joint_angles.shape[-1] for each in floors}) > 1:
        floors = _with_all_joints(floors)
    joined = _joined(floors, lambda values: np.concatenate(values)[order])
    return joined if steps is not None else _joined([joined], lambda values: values[0][:, 0])


def _floor_of(task: TrackingTask, episodes: Any, moments: Sequence[int], starts: int) -> Floor:
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
        return floor(chains, targets, loads, usable, starts)

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
    starts: int = STARTS,
) -> Floor:
    """The smallest distances from tip to target, arrays (E, ...).

    Args:
        mechanism: a chain, or one per episode.
        targets: (E, 2 or 3) [mm].
        loads: load tables, (E, rows, columns), columns rollingjoint.load.LOAD_COLUMNS or SPATIAL_LOAD_COLUMNS.
        tension_range: lowest and highest tension of every tendon [N].
        starts: as of `reach_batch`.
    Raises:
        SolverError: a load under which no start has an equilibrium.
    """
    chains = [mechanism] * len(targets) if isinstance(mechanism, Chain) else list(mechanism)
    is_uniform = all(chain == chains[0] for chain in chains)
    best: Any = reach_batch(chains[0] if is_uniform else chains, targets, loads, tension_range, starts=starts)
    if np.isinf(best.distance).any():
        raise SolverError(
            "no floor: under the load of an episode no start has an equilibrium; are the loads too large?"
        )
    settled = best.status <= int(ReachStatus.OUT_OF_REACH)
    status = np.where(settled, best.equilibrium.status, int(Status.NOT_CONVERGED))
    return Floor(best.distance, best.tip, best.tensions, best.lengths, best.joint_angles, status)


def _joined(parts: Sequence[Floor], join: Callable[..., Any]) -> Floor:
    return Floor(**{field.name: join([getattr(part, field.name) for part in parts]) for field in fields(Floor)})
