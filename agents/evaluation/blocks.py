"""Episodes of several controllers, block by block, wherever an executor runs them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cloudpickle  # type: ignore[import-untyped]

from agents.controllers.controller import Controller
from agents.evaluation.rollout import BLOCK, Episodes, joined, run_episodes
from agents.executors.driver import Unit, values_of
from agents.executors.progress import Progress
from agents.executors.protocol import Executor
from agents.runs.command_line import signals_seen
from agents.runs.environment import EnvConfig


def driven(
    env: EnvConfig, controllers: Mapping[str, Controller], seeds: Sequence[int], executor: Executor | None
) -> dict[str, Episodes]:
    """The episodes of every controller, one per seed; None as executor: in this process."""
    if executor is None:
        return {name: run_episodes(env, controller, seeds) for name, controller in controllers.items()}
    blocks = [seeds[first : first + BLOCK] for first in range(0, len(seeds), BLOCK)]
    pickled = {name: cloudpickle.dumps(controller) for name, controller in controllers.items()}
    units = [Unit(name, _episodes, (env, pickled[name], block)) for name in controllers for block in blocks]
    with signals_seen() as signals, Progress(len(units), "block") as progress:
        values = iter(values_of(executor, units, progress, signals))
    return {name: joined([next(values) for _ in blocks]) for name in controllers}


def _episodes(env: EnvConfig, controller: bytes, seeds: Sequence[int]) -> Episodes:
    return run_episodes(env, cloudpickle.loads(controller), seeds)
