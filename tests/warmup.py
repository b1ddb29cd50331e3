"""Kernels that tests need beside those of `rj warmup`; compiled once, before each worker would compile them."""

import numpy as np

from rollingjoint.warmup import Group


def controllers() -> None:
    """Let the opponents of learning act in the world of instruments and in that of slow cameras."""
    from agents.controllers.tuned import tuned_controllers
    from agents.runs.environment import EnvConfig
    from rj_gym.registry import task_of

    for env_id in ("rj_gym/Instrument-v0", "rj_gym/SlowCamera-v0"):
        for controller in tuned_controllers(env_id).values():
            task = task_of(EnvConfig(env_id).arguments()["config"])
            controller.begin(task, 2)
            rng = np.random.default_rng(0)
            for _ in range(2):
                observations = rng.uniform(*task.observation_bounds(), (2, task.observation_bounds()[0].size))
                controller.act(observations.astype(np.float32))


GROUPS = (Group("the controllers", controllers, after="the planar environments", family="planar"),)
