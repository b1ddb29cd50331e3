"""Checks of the attributes, spaces and types that the environment states and returns."""

from __future__ import annotations

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from rj_gym.vector_checker.probe import Failure, Inapplicable, Probe, fail_on, reset, step
from rj_gym.vector_checker.values import array_fault, in_short, info_fault, space_fault


def runs(probe: Probe) -> None:
    """Reset returns (observations, infos) and step five values, through all steps; without this nothing else runs."""
    if not probe.rollout:
        raise Failure("no call returned")


def states_num_envs(probe: Probe) -> None:
    """num_envs is a whole number, 1 or more."""
    num_envs = probe.num_envs
    if not isinstance(num_envs, int | np.integer) or num_envs < 1:
        raise Failure(f"num_envs is {in_short(num_envs)}")


def batches_the_single_spaces(probe: Probe) -> None:
    """observation_space and action_space are the single spaces, batched by gymnasium.vector.utils.batch_space."""
    env = probe.played[0]
    for name in ("observation_space", "action_space"):
        batched = batch_space(getattr(env, f"single_{name}"), env.num_envs)
        if getattr(env, name) != batched:
            raise Failure(f"{name} is {in_short(getattr(env, name))}, expected {in_short(batched)}")


def states_its_autoreset_mode(probe: Probe) -> None:
    """metadata["autoreset_mode"] is an AutoresetMode, the one asked for."""
    stated = probe.played[0].metadata.get("autoreset_mode")
    if not isinstance(stated, AutoresetMode) or stated is not probe.mode:
        raise Failure(f"metadata['autoreset_mode'] is {stated!r}, expected {probe.mode or 'an AutoresetMode'}")


def returns_observations_of_its_space(probe: Probe) -> None:
    """Every observation has the keys, shapes and dtypes of observation_space and lies within its bounds."""
    for number, call in enumerate(probe.rollout):
        fail_on(space_fault(probe.played[0].observation_space, call.observations, f"call {number}: observations"))


def returns_one_float_reward_per_lane(probe: Probe) -> None:
    """Rewards are finite floats of shape (num_envs,)."""
    for number, call in enumerate(probe.rollout):
        if call.is_step:
            fail_on(array_fault(call.rewards, (probe.num_envs,), np.floating, f"call {number}: rewards"))
            if not np.isfinite(call.rewards).all():
                raise Failure(f"call {number}: rewards are {in_short(call.rewards)}")


def returns_one_bool_per_lane_for_each_end(probe: Probe) -> None:
    """Terminations and truncations are booleans of shape (num_envs,)."""
    for number, call in enumerate(probe.rollout):
        if call.is_step:
            for name, ends in zip(("terminations", "truncations"), call.ends, strict=True):
                fail_on(array_fault(ends, (probe.num_envs,), np.bool_, f"call {number}: {name}"))


def returns_infos_as_arrays_with_masks(probe: Probe) -> None:
    """Infos is a dict of arrays (num_envs, ...), each with a boolean mask `_key` (num_envs,); nested dicts alike."""
    for number, call in enumerate(probe.rollout):
        fail_on(info_fault(call.infos, probe.num_envs, f"call {number}: infos"))


def renders_one_frame_per_lane(probe: Probe) -> None:
    """With a render mode, render returns a tuple of num_envs frames; "rgb_array" ones are uint8 (H, W, 3)."""
    mode = probe.played[0].render_mode
    if mode in (None, "human"):
        raise Inapplicable(f"render_mode is {mode!r}")
    with probe.env() as env:
        if env.render_mode not in env.metadata.get("render_modes", ()):
            raise Failure(f"render_mode {env.render_mode!r} is not in metadata['render_modes']")
        reset(env, seed=probe.seed)
        step(env, probe.actions(env)[0])
        frames = env.render()
        if not isinstance(frames, tuple) or len(frames) != env.num_envs:
            raise Failure(f"render returned {in_short(frames)}, expected a tuple of {env.num_envs} frames")
        for lane, frame in enumerate(frames if env.render_mode == "rgb_array" else ()):
            fail_on(array_fault(frame, (*np.shape(frame)[:2], 3), np.uint8, f"frame of lane {lane}"))


def closes_twice(probe: Probe) -> None:
    """Close can be called twice, and leaves closed = True."""
    if probe.is_built:
        raise Inapplicable("a built environment stays open")
    with probe.env() as env:
        reset(env, seed=probe.seed)
        env.close()
        env.close()
        if env.closed is not True:
            raise Failure(f"closed is {env.closed!r} after close()")


def warns_of_nothing(probe: Probe) -> None:
    """No check of this mode made the environment warn."""
    if probe.warnings:
        raise Failure("; ".join(dict.fromkeys(probe.warnings)))
