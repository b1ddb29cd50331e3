"""The table of checks, in order, and the function that runs them."""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any

import gymnasium
from gymnasium.vector import AutoresetMode, VectorEnv

from rj_gym.vector_checker import autoreset, episodes, interface, memory, seeding
from rj_gym.vector_checker.probe import AnyVectorEnv, Failure, Inapplicable, Probe
from rj_gym.vector_checker.report import Outcome, Report, Result
from rollingjoint.checks import as_integer
from rollingjoint.errors import InvalidInput

Check = Callable[[Probe], None]

IN_EVERY_MODE: tuple[Check, ...] = (
    interface.states_num_envs,
    interface.batches_the_single_spaces,
    interface.states_its_autoreset_mode,
    interface.returns_observations_of_its_space,
    interface.returns_one_float_reward_per_lane,
    interface.returns_one_bool_per_lane_for_each_end,
    interface.returns_infos_as_arrays_with_masks,
    interface.renders_one_frame_per_lane,
    interface.closes_twice,
    seeding.repeats_the_rollout_of_a_seed,
    seeding.repeats_the_rollout_in_a_new_environment,
    seeding.counts_an_integer_seed_up_over_lanes,
    seeding.takes_one_seed_per_lane,
    seeding.leaves_random_numbers_of_lanes_seeded_none,
    seeding.gives_lanes_different_random_numbers,
    seeding.goes_on_with_its_random_numbers_without_a_seed,
    memory.keeps_what_it_returned,
    memory.returns_new_memory_in_every_call,
    memory.does_not_use_what_it_returned_or_was_given,
    memory.leaves_its_arguments_alone,
    episodes.truncates_at_its_time_limit,
    episodes.equals_scalar_environments,
    episodes.equals_scalar_infos,
    autoreset.agrees_with_other_modes_until_an_episode_ends,
    autoreset.restarts_with_a_reset_observation,
)
IN_ONE_MODE: dict[AutoresetMode, tuple[Check, ...]] = {
    AutoresetMode.NEXT_STEP: (
        autoreset.gives_no_reward_and_no_end_in_the_restarting_step,
        autoreset.ignores_actions_in_the_restarting_step,
    ),
    AutoresetMode.SAME_STEP: (
        autoreset.hands_over_final_obs_and_final_info,
        autoreset.hands_over_the_last_observation_and_info,
    ),
    AutoresetMode.DISABLED: (
        autoreset.masked_resets_leave_other_lanes_alone,
        autoreset.masked_resets_begin_their_lanes_anew,
        autoreset.masked_resets_seed_their_lanes,
    ),
}
CHECKS: dict[str, str] = {
    check.__name__: " ".join((check.__doc__ or "").split())
    for check in (
        interface.runs,
        *IN_EVERY_MODE,
        *(check for checks in IN_ONE_MODE.values() for check in checks),
        interface.warns_of_nothing,
    )
}
"""Name and claim of every check."""


def check_vector_env(
    make_env: Callable[..., AnyVectorEnv] | AnyVectorEnv,
    *,
    seed: int = 0,
    n_steps: int = 250,
    max_episode_steps: int | None = None,
    scalar: Callable[[], gymnasium.Env[Any, Any]] | None = None,
    skip: Mapping[str, str] | None = None,
    raise_on_failure: bool = True,
) -> Report:
    """Report on whether a vector environment keeps the contract of gymnasium.vector.VectorEnv (Gymnasium 1.4).

    Args:
        make_env: builds the environment. If it has a parameter named `autoreset_mode`, it is called with that keyword,
            and every mode is checked; otherwise without arguments, and the mode that the environment states is checked.
            Or an environment, which stays open; then checks that need new ones are skipped.
        seed: first of the seeds used.
        n_steps: steps of each rollout; enough for episodes to end.
        max_episode_steps: the time limit; if None, the limit of the environment's spec.
        scalar: builds the scalar environment that every lane should equal (optional).
        skip: names of checks to leave out (see CHECKS), each with the reason, which the report repeats.
        raise_on_failure: if False, failures are only in the report.
    Raises:
        VectorEnvError: a check failed; its message has every failure, its attribute `report` the whole report.
        InvalidInput: arguments that cannot be used.
    """
    skip = dict(skip or {})
    for name in skip:
        if name not in CHECKS:
            near = get_close_matches(name, CHECKS, 1, 0.0)[0]
            raise InvalidInput("skip", name, "the name of a check", f"The nearest is {near!r}; see CHECKS.")
    n_steps = as_integer("n_steps", n_steps, 1, allowed="a whole number of steps, 1 or more")
    seed = as_integer("seed", seed, 0, allowed="a whole number, 0 or more")
    make, modes, name, is_built = _builder(make_env)
    outcomes: list[Outcome] = []
    for mode in modes:
        others = tuple(candidate for candidate in modes if candidate not in (mode, None))
        probe = Probe(make, mode, others, seed, n_steps, max_episode_steps, scalar, is_built)
        outcomes += _outcomes(probe, skip)
    order = list(CHECKS)
    outcomes.sort(key=lambda outcome: order.index(outcome.check))
    report = Report(name, tuple(outcomes))
    if raise_on_failure:
        report.raise_if_failed()
    return report


def _builder(
    source: Callable[..., AnyVectorEnv] | AnyVectorEnv,
) -> tuple[Callable[[AutoresetMode | None], AnyVectorEnv], list[AutoresetMode | None], str, bool]:
    """A function that builds an environment in a mode, the modes to check, the name, and whether it is built."""
    if isinstance(source, VectorEnv):
        env = source
        return (lambda mode: env), [_stated_mode(env)], str(env), True
    if not callable(source):
        raise InvalidInput("make_env", source, "a function that builds a gymnasium.vector.VectorEnv, or one built")
    build = source
    takes_mode = "autoreset_mode" in inspect.signature(build).parameters

    def make(mode: AutoresetMode | None) -> AnyVectorEnv:
        return build(autoreset_mode=mode or AutoresetMode.NEXT_STEP) if takes_mode else build()

    env = make(None)
    if not isinstance(env, VectorEnv):
        raise InvalidInput("make_env()", env, "a gymnasium.vector.VectorEnv")
    env.close()
    return make, list(AutoresetMode) if takes_mode else [_stated_mode(env)], str(env), False


def _stated_mode(env: AnyVectorEnv) -> AutoresetMode | None:
    mode = env.metadata.get("autoreset_mode")
    return mode if isinstance(mode, AutoresetMode) else None


def _outcomes(probe: Probe, skip: Mapping[str, str]) -> list[Outcome]:
    """Every check of one mode; none but the first if the environment does not run."""
    outcomes = [_outcome(interface.runs, probe, skip)]
    specific = IN_ONE_MODE[probe.mode] if probe.mode else ()
    checks = (*IN_EVERY_MODE, *specific, interface.warns_of_nothing)
    if outcomes[0].result == "failed":
        skip = {check.__name__: "it does not run" for check in checks}
    return outcomes + [_outcome(check, probe, skip) for check in checks]


def _outcome(check: Check, probe: Probe, skip: Mapping[str, str]) -> Outcome:
    result: Result = "passed"
    detail = skip.get(check.__name__, "")
    if check.__name__ in skip:
        result = "skipped"
    else:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            warnings.filterwarnings("ignore", ".* is out of date", DeprecationWarning)  # of an id, and no fault
            try:
                check(probe)
            except Inapplicable as reason:
                result, detail = "skipped", str(reason)
            except Failure as fault:
                result, detail = "failed", str(fault)
            except Exception as error:
                result, detail = "failed", f"{type(error).__name__}: {error}"
        probe.warnings.extend(f"{note.category.__name__}: {_plain(str(note.message))}" for note in caught)
    return Outcome(check.__name__, CHECKS[check.__name__], probe.mode, result, detail)


def _plain(text: str) -> str:
    """Text without terminal colours."""
    return re.sub(r"\x1b\[[0-9;]*m", "", text)
