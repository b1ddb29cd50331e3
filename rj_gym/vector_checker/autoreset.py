"""Checks of the steps where an episode ends, in each autoreset mode."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import iterate
from numpy.typing import NDArray

from rj_gym.vector_checker.probe import (
    AnyVectorEnv,
    Failure,
    Inapplicable,
    Probe,
    RecordedCall,
    batch,
    calls_difference,
    fail_on,
    play_on,
    require_equal,
)
from rj_gym.vector_checker.values import difference, in_short, lane_info, space_fault


def restarts_with_a_reset_observation(probe: Probe) -> None:
    """A lane that begins anew returns the observation that reset, called at that moment, would have returned."""
    end = _first_end(probe)
    probe.require_own_streams()
    restart = end if probe.mode is AutoresetMode.SAME_STEP else end + 1
    if restart == len(probe.rollout):
        raise Inapplicable(f"the first episode ended in the last of {probe.n_steps} steps: raise n_steps")
    with probe.env(_waiting_mode(probe)) as env:
        probe.play(env, probe.actions(env)[:end])
        expected = probe.reset_lanes(env)
    returned = probe.lanes(probe.rollout[restart].observations)
    for lane in np.flatnonzero(probe.rollout[end].ended):
        require_equal(returned[lane], expected[lane], f"call {restart}: observation of lane {lane}")


def agrees_with_other_modes_until_an_episode_ends(probe: Probe) -> None:
    """For equal seeds and actions everything returned is the same in every autoreset mode until an episode ends."""
    if not probe.other_modes:
        raise Inapplicable("only one autoreset mode was given")
    probe.require_repeatable()
    before = probe.rollout[: _steps_before_an_end(probe) + 1]
    with probe.env(probe.other_modes[0]) as env:
        others = probe.play(env, probe.actions(env)[: len(before) - 1])
    fail_on(calls_difference(before, others, f", where {probe.other_modes[0].value} is expected"))


def gives_no_reward_and_no_end_in_the_restarting_step(probe: Probe) -> None:
    """The step after an end resets its lane: reward 0, neither terminated nor truncated."""
    _first_end(probe)
    for number, (before, call) in enumerate(zip(probe.rollout[1:], probe.rollout[2:], strict=False), start=2):
        rewards, ended = call.rewards[before.ended], call.ended[before.ended]
        if rewards.any() or ended.any():
            raise Failure(f"call {number}: lanes that ended in the call before have rewards {rewards}, ends {ended}")


def ignores_actions_in_the_restarting_step(probe: Probe) -> None:
    """The step after an end ignores its lane's action: whatever it was, all that follows is the same."""
    end = _first_end(probe)
    probe.require_repeatable()
    lanes = np.flatnonzero(probe.rollout[end].ended)
    with probe.env() as env:
        actions = probe.actions(env)[: end + 2]
        if len(actions) == end:
            raise Inapplicable(f"the first episode ended in the last of {probe.n_steps} steps: raise n_steps")
        actions[end] = _with_other_actions(probe, env, actions[end], lanes)
        calls = probe.play(env, actions)
    fail_on(calls_difference(calls, probe.rollout, ", after another action"))


def hands_over_final_obs_and_final_info(probe: Probe) -> None:
    """Infos has final_obs (an array of observations, else None) and final_info, masked to the lanes that ended."""
    _first_end(probe)
    space = probe.played[0].single_observation_space
    for number, call in enumerate(probe.rollout[1:], start=1):
        for key in ("final_obs", "final_info"):
            mask = call.infos.get(f"_{key}", np.zeros(probe.num_envs, bool))
            if not np.array_equal(mask, call.ended):
                raise Failure(f"call {number}: infos['_{key}'] is {in_short(mask)}, ended are {in_short(call.ended)}")
        if call.ended.any():
            fail_on(_final_fault(call, space, f"call {number}: "))


def hands_over_the_last_observation_and_info(probe: Probe) -> None:
    """final_obs and final_info are what the same step returns in a mode that does not reset in it."""
    end = _first_end(probe)
    probe.require_repeatable()
    with probe.env(_waiting_mode(probe)) as env:
        last = probe.play(env, probe.actions(env)[:end])[-1]
    infos, observations = probe.rollout[end].infos, probe.lanes(last.observations)
    ended = np.flatnonzero(last.ended)
    require_equal(np.flatnonzero(probe.rollout[end].ended), ended, f"call {end}: lanes that ended")
    for lane in map(int, ended):
        observation, info = infos["final_obs"][lane], lane_info(infos["final_info"], lane)
        where = f"call {end}, lane {lane}: "
        require_equal(observation, observations[lane], f"{where}final_obs", dtypes=False)
        require_equal(info, lane_info(last.infos, lane), f"{where}final_info", dtypes=False)


def masked_resets_leave_other_lanes_alone(probe: Probe) -> None:
    """reset with options["reset_mask"] changes no other lane: not its observation, and nothing that follows."""
    probe.require_repeatable()
    before, steps = _middle(probe), _steps_before_an_end(probe)
    mask = _last_lane(probe)
    if mask.all():
        raise Inapplicable("there is one lane")
    with probe.env() as env:
        calls = probe.play(env, probe.actions(env)[:before])
        masked = probe.reset_lanes(env, options={"reset_mask": mask.copy()})
        calls += [call for call in play_on(env, probe.actions(env)[before:steps]) if call.is_step]
    require_equal(masked[:-1], probe.lanes(calls[before].observations)[:-1], "observations of the other lanes")
    for number, (call, expected) in enumerate(zip(calls, probe.rollout, strict=False)):
        lanes, others = probe.lanes(call.observations)[:-1], probe.lanes(expected.observations)[:-1]
        require_equal(lanes, others, f"step {number}: observations of the other lanes")
        if call.is_step:
            require_equal(call.rewards[:-1], expected.rewards[:-1], f"step {number}: rewards of the other lanes")


def masked_resets_begin_their_lanes_anew(probe: Probe) -> None:
    """A masked lane returns the observation that a reset of all lanes, called at that moment, would have returned."""
    probe.require_own_streams()
    require_equal(_reset_midway(probe, _last_lane(probe)), _reset_midway(probe, None), "observation of the masked lane")


def masked_resets_seed_their_lanes(probe: Probe) -> None:
    """A masked reset with a seed gives lane i the seed + i, as a reset of all lanes does."""
    probe.require_own_streams()
    masked, complete = (_reset_midway(probe, mask, seed=probe.seed + 7) for mask in (_last_lane(probe), None))
    require_equal(masked, complete, "observation of the masked lane")


def _first_end(probe: Probe) -> int:
    """Number of the call in which an episode ended first; it is also the number of steps until then."""
    for number, call in enumerate(probe.rollout):
        if call.is_step and call.ended.any():
            return number
    raise Inapplicable(f"no episode ended in {probe.n_steps} steps: raise n_steps or shorten the episodes")


def _steps_before_an_end(probe: Probe) -> int:
    try:
        return _first_end(probe) - 1
    except Inapplicable:
        return probe.n_steps


def _middle(probe: Probe) -> int:
    return (_steps_before_an_end(probe) + 1) // 2


def _waiting_mode(probe: Probe) -> AutoresetMode | None:
    """A mode in which the step that ends an episode does not reset its lane."""
    if probe.mode is not AutoresetMode.SAME_STEP:
        return probe.mode
    if not probe.other_modes:
        raise Inapplicable("needs a function that takes autoreset_mode, to compare with another mode")
    return probe.other_modes[0]


def _last_lane(probe: Probe) -> NDArray[np.bool_]:
    return np.arange(probe.num_envs) == probe.num_envs - 1


def _reset_midway(probe: Probe, mask: NDArray[np.bool_] | None, **arguments: Any) -> Any:
    """The last lane's observation after a reset in the middle of the first episode."""
    with probe.env() as env:
        probe.play(env, probe.actions(env)[: _middle(probe)])
        if mask is not None:
            arguments["options"] = {"reset_mask": mask}
        return probe.reset_lanes(env, **arguments)[-1]


def _with_other_actions(probe: Probe, env: AnyVectorEnv, actions: Any, lanes: NDArray[np.intp]) -> Any:
    """The actions, but another one in each of these lanes."""
    space, items = deepcopy(env.single_action_space), list(iterate(env.action_space, actions))
    space.seed(probe.seed)
    for lane in lanes:
        samples = (space.sample() for _ in range(100))
        others = (action for action in samples if difference(action, items[lane], "action", dtypes=False))
        items[lane] = next(others, None)
        if items[lane] is None:
            raise Inapplicable("there is only one action")
    return batch(space, items)


def _final_fault(call: RecordedCall, space: spaces.Space[Any], where: str) -> str | None:
    final = call.infos["final_obs"]
    if not isinstance(final, np.ndarray) or final.dtype != object or final.shape != call.ended.shape:
        return f"{where}infos['final_obs'] is {in_short(final)}, expected an array of {len(call.ended)} objects"
    if not isinstance(call.infos["final_info"], dict):
        return f"{where}infos['final_info'] is {in_short(call.infos['final_info'])}, expected a dict"
    for lane, observation in enumerate(final):
        name = f"{where}infos['final_obs'][{lane}]"
        if not call.ended[lane] and observation is not None:
            return f"{name} is {in_short(observation)}, expected None"
        fault = space_fault(space, observation, name) if call.ended[lane] else None
        if fault:
            return fault
    return None
