"""Policies that have learned nothing, for tests."""

from itertools import pairwise

import numpy as np

from agents.policies.network import Network
from agents.policies.recorded_score import ERRORS, SHARES, RecordedScore
from agents.policies.shipped import ShippedPolicy, entry_names, standalone
from rj_gym import settings_of
from rj_gym.registry import task_of

FLAT, GOAL = "rj_gym/RollingJoint-v0", "rj_gym/RollingJointGoal-v0"
ARM, ARM_GOAL = "rj_gym/FlexibleArm-v0", "rj_gym/FlexibleArmGoal-v0"


def random_network(inputs, entries, actions, activation="tanh", output="clip"):
    rng = np.random.default_rng(0)
    widths = [entries, 5, 4, actions]
    layers = [
        (rng.normal(size=(after, before)).astype(np.float32), rng.normal(size=after).astype(np.float32))
        for before, after in pairwise(widths)
    ]
    normaliser = rng.normal(size=entries), rng.uniform(0.5, 2.0, entries), np.full(entries, 10.0)
    bounds = -np.ones(actions, np.float32), np.ones(actions, np.float32)
    return Network(inputs, *normaliser, layers, activation, output, *bounds)


def random_policy(env_id=FLAT, **changes):
    """A policy that has learned nothing."""
    config = standalone(settings_of(env_id)(**changes))
    goal, size = env_id in (GOAL, ARM_GOAL), len(task_of(config).goal_bounds())
    entries = entry_names(config, goal)
    inputs = {"observation": len(entries), "achieved_goal": size, "desired_goal": size} if goal else {}
    network = random_network(inputs, sum(inputs.values()) or len(entries), config.mechanism.n_tendons)
    training = {"config": {"seed": 1}, "steps": 40, "seed": 1, "versions": {"python": "3"}}
    record = RecordedScore(20_000, 4, dict.fromkeys(ERRORS + SHARES, 0.5), dict.fromkeys(ERRORS + SHARES, 0.1))
    return ShippedPolicy("random", "ppo", network, env_id, config, entries, training, record)


FILE = random_policy(load={"magnitude": (0.0, 1.5)}, target={"process": "path"}).to_bytes()
