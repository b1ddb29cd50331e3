"""Records of made-up controllers, for tests."""

import numpy as np

from agents.results.environment import plain
from agents.results.record import (
    POLICY,
    TEST,
    VALIDATION,
    BenchmarkRecord,
    ControllerRecord,
    EpisodeScores,
    RunRecord,
    World,
)
from agents.runs.environment import EnvConfig

E = 400
SETTINGS = plain(EnvConfig())
WORLDS = [World(TEST, TEST, 9_000_000, E), World(VALIDATION, VALIDATION, 3_000_000, E)]
HARD = np.random.default_rng(0).uniform(1.0, 3.0, E)  # what all controllers have in common
CURVE = np.array([[10.0, 20.0], [3.0, 1.5], [4.0, 8.0]])


def driven(errors) -> EpisodeScores:
    errors = np.asarray(errors, float)
    return EpisodeScores(errors, errors * 1.1, errors <= 1.0, 0)


def controller(name, kind, *offsets, worlds=(TEST, VALIDATION), noise=0.05, choose=0.0, **more) -> ControllerRecord:
    """Runs whose errors are HARD plus an offset each; `choose` is added in validation alone."""
    runs = []
    for place, offset in enumerate(offsets):
        rng = np.random.default_rng([place, len(name)])
        some = {
            world: driven(np.maximum(HARD + offset + noise * rng.normal(size=E) + choose * (world == VALIDATION), 0.0))
            for world in worlds
        }
        seed = place + 1 if kind == POLICY else None
        runs.append(RunRecord(some, seed, 60.0, {"training_environments": (seed or 0, 9)}, CURVE if seed else None))
    return ControllerRecord(name, kind, runs, training={"steps": 20} if kind == POLICY else {}, **more)


def benchmark(*controllers, worlds=WORLDS, title="demo", settings=SETTINGS) -> BenchmarkRecord:
    return BenchmarkRecord(title, "A task.", "rj_gym/RollingJoint-v0", settings, worlds, controllers)
