"""Checks of memory: returned arrays belong to the caller, arguments stay as they are."""

from __future__ import annotations

from copy import deepcopy
from operator import itemgetter

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.lib.array_utils import byte_bounds

from rj_gym.vector_checker.probe import Failure, Probe, calls_difference, fail_on, require_equal, reset, step
from rj_gym.vector_checker.values import arrays_in


def keeps_what_it_returned(probe: Probe) -> None:
    """Observations, rewards, ends and infos that were returned are not changed by later calls."""
    for number, call in enumerate(probe.rollout):
        require_equal(call.returned, call.copy, f"call {number}: results, looked at again after the last call,")


def returns_new_memory_in_every_call(probe: Probe) -> None:
    """No two calls return arrays that share memory, not even constant ones."""
    spans = [
        (*byte_bounds(array), number, place, array)
        for number, call in enumerate(probe.rollout)
        for place, array in arrays_in(call.returned, "results")
        if array.size
    ]
    spans.sort(key=itemgetter(0))
    _, reach, owner, _, widest = spans[0]
    for start, stop, number, place, array in spans[1:]:
        if start < reach and number != owner and np.shares_memory(array, widest):
            raise Failure(f"{place} is the same memory in calls {min(number, owner)} and {max(number, owner)}")
        if stop > reach:
            reach, owner, widest = stop, number, array


def does_not_use_what_it_returned_or_was_given(probe: Probe) -> None:
    """Overwriting returned arrays and given actions after each call changes nothing that follows."""
    probe.require_repeatable()
    with probe.env() as env:
        calls = probe.play(env, probe.actions(env), spoil=True)
    fail_on(calls_difference(calls, probe.rollout, ", with earlier arrays overwritten"))


def leaves_its_arguments_alone(probe: Probe) -> None:
    """Step does not change the actions, nor reset the options, that it is given."""
    masked = probe.mode is AutoresetMode.DISABLED
    with probe.env() as env:
        reset(env, seed=probe.seed)
        options = {"reset_mask": np.ones(probe.num_envs, bool)} if masked else {}
        copies = deepcopy(options)
        reset(env, options=copies)
        require_equal(copies, options, "options, after reset,")
        actions = probe.actions(env)[0]
        copies = deepcopy(actions)
        step(env, copies)
        require_equal(copies, actions, "actions, after step,")
