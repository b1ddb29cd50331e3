"""Short episodes of environments, and whether two are the same."""

import numpy as np


def rollout(env, seed, steps=12, largest=1.0, dtype=np.float32, **reset):
    """Observations, rewards and infos of an episode with actions drawn from the seed."""
    rng = np.random.default_rng(seed)
    record = [env.reset(seed=seed, **reset)]
    actions = rng.uniform(-largest, largest, (steps, *env.action_space.shape)).astype(dtype)
    return record + [env.step(action) for action in actions]


def same(first, second):
    """Bit for bit, types and nested dictionaries included."""
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(first[key], second[key]) for key in first)
    if isinstance(first, list | tuple) or (isinstance(first, np.ndarray) and first.dtype.hasobject):
        return len(first) == len(second) and all(map(same, first, second))
    if isinstance(first, np.ndarray):
        return first.dtype == second.dtype and np.array_equal(first, second)
    return first == second
