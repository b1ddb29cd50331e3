"""Episodes of every id, and what shipped policies reach in them. Runs inside a checkout."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy
from typing import Any

import gymnasium
import numpy as np

import rj_gym
from guard_rows.drawing import Sizes, actions
from guard_rows.record import Record
from rollingjoint import uniform

ARMS = ("rj_gym/FlexibleArm-v0", "rj_gym/FlexibleArmGoal-v0", "rj_gym/ArmInstrument-v0", "rj_gym/ArmInstrument-v1")
_MM_AND_N = ("error_mm", "tip", "target", "load.force", "tensions", "command", "gap_tensions")
ARM_RULE = {
    **{f"info.{name}": (1e-7, 0.0) for name in _MM_AND_N},
    **dict.fromkeys(("info.status", "terminated", "truncated"), (0.0, 0.0)),
    "info.sampled.targets": (1e-7, 0.0),
    "reward": (1e-7, 0.0),
    **{key: (1e-5, 0.0) for key in ("observation", "achieved_goal", "desired_goal")},  # single precision
}
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "friction": ("rj_gym/RollingJoint-v0", {"friction": {"mu": (0.0, 0.1)}}),
    "randomised": (
        "rj_gym/RollingJoint-v0",
        {
            "load": {"process": "ou"},
            "randomization": {
                "position_noise_mm": 0.2,
                "angle_noise_rad": 0.005,
                "stiffness_spread": 0.2,
                "link_tolerance_mm": 0.1,
                "link_tolerance_rad": 0.01,
                "actuator_offset_mm": 0.5,
            },
        },
    ),
    "two_segment": ("rj_gym/RollingJoint-v0", {"mechanism": "two_segment", "start": "random", "observe_load": True}),
    "20 links": ("rj_gym/RollingJoint-v0", {"mechanism": uniform(20)}),
    "moving target": ("rj_gym/RollingJoint-v0", {"target": {"process": "path"}, "load": {"process": "step"}}),
    "history and privileged": ("rj_gym/Instrument-v0", {"observe_history": [1, 2, 4], "privileged": "info"}),
    "privileged observation": ("rj_gym/LatePose-v0", {"privileged": "observation"}),
    "sparse goal": ("rj_gym/RollingJointGoal-v0", {"reward": {"goal": "sparse"}}),
}


def records(sizes: Sizes) -> Iterator[Record]:
    """Records of all ids, of some with other settings, and of the policies."""
    for env_id in rj_gym.IDS:
        rule = ARM_RULE if env_id in ARMS else None
        yield _scalar(env_id, env_id, {}, range(sizes.episodes), sizes.steps, rule)
        yield _vector(env_id, env_id, {}, sizes, rule)
    for name, (env_id, settings) in VARIANTS.items():
        row, few = f"{env_id}, {name}", range(max(2, sizes.episodes // 5))
        yield _scalar(row, env_id, settings, few, sizes.steps, None)
        yield _vector(row, env_id, settings, sizes, None)
    for env_id in rj_gym.DESIGN_IDS:
        yield _scalar(env_id, env_id, {}, range(max(2, sizes.episodes // 10)), min(sizes.steps, 10), None)
    yield _policies(sizes)


def _scalar(row: str, env_id: str, settings: Mapping[str, Any], seeds: range, steps: int, rule: Any) -> Record:
    """Whole episodes of the environment that gymnasium.make makes."""
    record = Record(f"{row}: episodes", rule)
    env = gymnasium.make(env_id, **settings)
    size = int(np.prod(env.action_space.shape))
    for seed in seeds:
        observation, info = env.reset(seed=seed)
        moments = [_flat(observation, info)]
        drawn = actions(min(steps, 100), size, seed)
        for action in drawn.reshape(-1, *env.action_space.shape):
            observation, reward, terminated, truncated, info = env.step(action)
            moments.append(_flat(observation, info) | _ends(reward, terminated, truncated))
            if terminated or truncated:
                break
        record.add(f"seed {seed}", _over_time(moments))
        record.count += len(moments) - 1
    env.close()
    return record


def _vector(row: str, env_id: str, settings: Mapping[str, Any], sizes: Sizes, rule: Any) -> Record:
    """Lanes of the native vector environment, over an automatic reset."""
    record = Record(f"{row}: lanes", rule)
    envs = gymnasium.make_vec(env_id, sizes.lanes, "vector_entry_point", **settings)
    observation, info = envs.reset(seed=7)
    moments, shape = [_flat(observation, info)], envs.action_space.shape
    for action in actions(min(sizes.steps, 60), int(np.prod(shape)), 10**6).reshape(-1, *shape):
        observation, reward, terminated, truncated, info = envs.step(action)
        moments.append(_flat(observation, info) | _ends(reward, terminated, truncated))
    record.add(f"{sizes.lanes} lanes", _over_time(moments))
    record.count = sizes.lanes * (len(moments) - 1)
    envs.close()
    return record


def _policies(sizes: Sizes) -> Record:
    """Mean errors of the shipped policies, which may be off by 1 %."""
    from agents.shipped import list_policies, load_policy

    record = Record("shipped policies: means", {"*": (0.0, 0.01)})
    for name in list_policies()[: None if sizes.runs else 1]:
        policy = load_policy(name, version=0)
        envs = gymnasium.make_vec(policy.env_id, sizes.episodes, "vector_entry_point", config=policy.settings)
        observation, info = envs.reset(seed=20_000)
        policy.reset(episodes=sizes.episodes)
        errors = [np.array(info["error_mm"])]
        for _ in range(policy.settings.episode_steps):
            observation, _, _, _, info = envs.step(policy(observation))
            errors.append(np.array(info["error_mm"]))
        record.add(name, {"last 10 steps [mm]": np.mean(errors[-10:]), "all steps [mm]": np.mean(errors)})
        record.count += sizes.episodes
        envs.close()
    return record


def _ends(reward: Any, terminated: Any, truncated: Any) -> dict[str, Any]:
    return {"reward": reward, "terminated": terminated, "truncated": truncated}


def _flat(observation: Any, info: Mapping[str, Any]) -> dict[str, Any]:
    """Everything by its path: observation, or the keys of a dictionary, and info.KEY."""
    seen = observation if isinstance(observation, Mapping) else {"observation": observation}
    return {**{key: copy(value) for key, value in seen.items()}, **_paths("info", info)}


def _paths(path: str, values: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in values.items():
        below = f"{path}.{key}"
        flat |= _paths(below, value) if isinstance(value, Mapping) else {below: copy(value)}
    return flat


def _over_time(moments: list[dict[str, Any]]) -> dict[str, Any]:
    """Every value with a leading axis of the moments that have it, and what its type was."""
    names = dict.fromkeys(name for moment in moments for name in moment)
    stacked: dict[str, Any] = {}
    for name in names:
        values = [np.array(moment[name]) for moment in moments if name in moment]
        if values[0].dtype.kind == "O":  # texts of lanes, or what a lane has that another has not
            values = [value.astype(str) for value in values]
        shared = all(value.shape == values[0].shape for value in values)
        stacked[name] = np.array(values) if shared else np.concatenate([value.ravel() for value in values])
    types = {name: type(next(moment[name] for moment in moments if name in moment)).__name__ for name in names}
    return stacked | {"types": ", ".join(f"{name} {kind}" for name, kind in types.items())}
