"""Checks of whole episodes: their length, and equality with scalar environments."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.typing import NDArray

from rj_gym.vector_checker.probe import Failure, Inapplicable, Probe, RecordedCall, require_equal
from rj_gym.vector_checker.values import lane_info


def truncates_at_its_time_limit(probe: Probe) -> None:
    """A lane is truncated when its episode has as many steps as the stated limit, and not before."""
    limit = _stated_limit(probe)
    if probe.mode is None:
        raise Inapplicable("no autoreset mode is stated")
    reached = False
    for number, lengths, call in _episode_lengths(probe):
        late = (lengths > limit) | ((lengths == limit) & ~call.ended)
        early = np.logical_and(call.ends[1], lengths < limit)
        reached |= bool((lengths == limit).any())
        for wrong, what in ((late, "is not truncated"), (early, "is truncated")):
            for lane in np.flatnonzero(wrong):
                raise Failure(f"call {number}: lane {lane} {what} after {lengths[lane]} steps; the limit is {limit}")
    if not reached:
        raise Inapplicable(f"no episode reached {limit} steps: raise n_steps")


def equals_scalar_environments(probe: Probe) -> None:
    """Spaces, observations, rewards and ends are those of scalar environments with seed + lane, step by step."""
    for number, (call, expected) in enumerate(_beside_scalar(probe)):
        for name in call.copy.keys() - {"infos"}:
            require_equal(call.copy[name], expected.copy[name], f"call {number}: {name}", dtypes=False)


def equals_scalar_infos(probe: Probe) -> None:
    """Infos are those of scalar environments with seed + lane, gathered as Gymnasium does, step by step."""
    for number, (call, expected) in enumerate(_beside_scalar(probe)):
        for lane in range(probe.num_envs):
            info, scalar = lane_info(call.infos, lane), lane_info(expected.infos, lane)
            require_equal(info, scalar, f"call {number}: info of lane {lane}", dtypes=False)


def _stated_limit(probe: Probe) -> int:
    """The limit passed in, else make_vec's, where the keyword argument goes before the registered value."""
    spec = probe.played[0].spec
    registered = spec.kwargs.get("max_episode_steps", spec.max_episode_steps) if spec else None
    limit = registered if probe.max_episode_steps is None else probe.max_episode_steps
    if limit is None:
        raise Inapplicable("no time limit is stated: give max_episode_steps")
    return int(limit)


def _episode_lengths(probe: Probe) -> Iterator[tuple[int, NDArray[np.int_], RecordedCall]]:
    """Number, steps of every lane's episode so far, and call, for each step."""
    lengths, over = np.zeros(probe.num_envs, int), np.zeros(probe.num_envs, bool)
    for number, call in enumerate(probe.rollout):
        if call.is_step:
            lengths += 1
            if probe.mode is AutoresetMode.NEXT_STEP:
                lengths[over] = 0
            yield number, lengths, call
            over = call.ended
            if probe.mode is not AutoresetMode.NEXT_STEP:
                lengths[over] = 0


def _beside_scalar(probe: Probe) -> Iterator[tuple[RecordedCall, RecordedCall]]:
    """Every call of the rollout with the same call of Gymnasium's SyncVectorEnv of the scalar environments."""
    if probe.scalar is None:
        raise Inapplicable("no scalar environment was given")
    if probe.mode is None:
        raise Inapplicable("no autoreset mode is stated")
    reference = SyncVectorEnv([probe.scalar] * probe.num_envs, autoreset_mode=probe.mode)
    try:
        for name in ("single_observation_space", "single_action_space"):
            if getattr(probe.played[0], name) != getattr(reference, name):
                raise Failure(f"{name} is not that of the scalar environment")
        calls = probe.play(reference, probe.actions(probe.played[0]))
    finally:
        reference.close()
    yield from zip(probe.rollout, calls, strict=False)
