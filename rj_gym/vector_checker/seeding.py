"""Checks of seeds and random numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rj_gym.vector_checker.probe import (
    Failure,
    Inapplicable,
    Probe,
    RecordedCall,
    calls_difference,
    fail_on,
    require_equal,
    reset,
)
from rj_gym.vector_checker.values import difference

RESETS = 6  # enough that small spaces do not start alike by chance


def repeats_the_rollout_of_a_seed(probe: Probe) -> None:
    """The same seed and actions give the same observations, rewards, ends and infos in the same environment."""
    with probe.env() as env:
        actions = probe.actions(env)
        first, second = (probe.play(env, actions) for _ in range(2))
    fail_on(calls_difference(second, first))


def repeats_the_rollout_in_a_new_environment(probe: Probe) -> None:
    """The same seed and actions give the same observations, rewards, ends and infos in a new environment."""
    if probe.is_built:
        raise Inapplicable("needs a function that builds environments")
    fail_on(calls_difference(probe.repetition, probe.rollout))


def counts_an_integer_seed_up_over_lanes(probe: Probe) -> None:
    """An integer seed gives lane i the seed + i: lane i + 1 plays as lane i does with the next seed."""
    if probe.num_envs == 1:
        raise Inapplicable("there is one lane")
    with probe.env() as env:
        actions = probe.equal_actions(env)[:10]
        calls, later = (_until_an_end(probe.play(env, actions, seed=probe.seed + shift)) for shift in (0, 1))
    for number, (call, successor) in enumerate(zip(calls, later, strict=False)):
        lanes, shifted = probe.lanes(call.observations)[1:], probe.lanes(successor.observations)[:-1]
        require_equal(shifted, lanes, f"call {number}: observations of lanes 0, 1, ... with the next seed")
        if call.is_step:
            require_equal(successor.rewards[:-1], call.rewards[1:], f"call {number}: rewards with the next seed")


def takes_one_seed_per_lane(probe: Probe) -> None:
    """A list of seeds gives each lane its own: seed + i as the integer does, and in any order."""
    seeds = [probe.seed + lane for lane in range(probe.num_envs)]
    with probe.env() as env:
        expected = probe.reset_lanes(env, seed=probe.seed)
        require_equal(probe.reset_lanes(env, seed=seeds), expected, f"observations with seed={seeds}")
        backwards = probe.reset_lanes(env, seed=seeds[::-1])
        require_equal(backwards, expected[::-1], f"observations with seed={seeds[::-1]}")


def leaves_random_numbers_of_lanes_seeded_none(probe: Probe) -> None:
    """None in a list of seeds leaves that lane's random numbers as they are."""
    seeds = [probe.seed, *[None] * (probe.num_envs - 1)]
    with probe.env() as env:
        first = probe.reset_lanes(env, seed=probe.seed)
        second = probe.reset_lanes(env)
        reset(env, seed=probe.seed)
        mixed = probe.reset_lanes(env, seed=seeds)
    require_equal(mixed, [first[0], *second[1:]], f"observations with seed={seeds}")


def gives_lanes_different_random_numbers(probe: Probe) -> None:
    """With an integer seed the lanes do not all begin alike."""
    if probe.num_envs == 1:
        raise Inapplicable("there is one lane")
    starts = [probe.lanes(observations) for observations in _starts(probe)]
    if not any(difference(lanes[1:], lanes[:-1], "lanes") for lanes in starts):
        raise Failure(f"all lanes begin alike, {RESETS} times")


def goes_on_with_its_random_numbers_without_a_seed(probe: Probe) -> None:
    """Reset without a seed begins differently, and the same sequence of resets repeats itself after a seed."""
    starts, again = _starts(probe), _starts(probe)
    require_equal(again, starts, "observations of a seeded reset and those after it")
    if not difference(starts[1:], starts[:-1], "starts"):
        raise Failure(f"{RESETS - 1} resets without a seed begin as the seeded one")


def _starts(probe: Probe) -> list[Any]:
    """Observations of a seeded reset and of some without a seed."""
    with probe.env() as env:
        seeded = reset(env, seed=probe.seed).observations
        unlike = reset(env, seed=probe.seed + 1000).observations
        if not difference(seeded, unlike, "observations"):
            raise Inapplicable("episodes begin alike with every seed")
        reset(env, seed=probe.seed)
        return [seeded, *(reset(env).observations for _ in range(RESETS - 1))]


def _until_an_end(calls: Sequence[RecordedCall]) -> list[RecordedCall]:
    """Calls up to the first in which an episode ended, that one left out."""
    ends = [number for number, call in enumerate(calls) if call.is_step and call.ended.any()]
    return list(calls[: ends[0]] if ends else calls)
