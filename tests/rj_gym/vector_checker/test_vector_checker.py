"""The vector checker passes what keeps the contract, fails what breaks it, and says truly what Gymnasium's own do."""

from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, Tuple
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import rj_gym
from rj_gym.vector_checker import CHECKS, VectorEnvError, check_vector_env
from rj_gym.vector_checker.values import difference, space_fault
from rollingjoint import InvalidInput
from tests.rj_gym.vector_checker.toy_vector_env import (
    BROKEN,
    DISABLED,
    LIMIT,
    NEXT_STEP,
    SAME_STEP,
    ToyEnv,
    ToyVectorEnv,
)

report_on = partial(check_vector_env, n_steps=20, raise_on_failure=False)


def names(outcomes):
    return {outcome.check for outcome in outcomes}


def test_an_environment_that_keeps_the_contract_passes_every_check_in_every_mode():
    report = check_vector_env(
        lambda autoreset_mode: ToyVectorEnv(autoreset_mode, render_mode="rgb_array"),
        n_steps=20,
        max_episode_steps=LIMIT,
        scalar=ToyEnv,
    )
    assert report.modes == tuple(AutoresetMode)
    assert names(report.passed) == set(CHECKS)
    assert not report.failed and not report.skipped


@pytest.mark.parametrize(("env", "checks", "mode"), BROKEN, ids=[broken[0].__name__ for broken in BROKEN])
def test_each_fault_fails_its_checks_and_no_other(env, checks, mode):
    scalar = ToyEnv if any("scalar" in check for check in checks) else None
    make_env = env if mode is None else lambda: env(mode)
    report = report_on(make_env, max_episode_steps=LIMIT, scalar=scalar)
    assert names(report.failed) == checks, str(report)
    assert all(outcome.detail for outcome in report.failed)


def test_every_check_has_an_environment_that_fails_it():
    assert set().union(*(checks for _, checks, _ in BROKEN)) == set(CHECKS)


AT_ONCE = ("rj_gym/RollingJoint-v0", "rj_gym/LatePose-v0", "rj_gym/FlexibleArmGoal-v0")  # the others are slow


@pytest.mark.parametrize(
    "env_id", [one if one in AT_ONCE else pytest.param(one, marks=pytest.mark.slow) for one in rj_gym.IDS]
)
def test_the_tracking_environments_pass_every_check(env_id):
    settings = {"episode_steps": 7, "load": {"process": "step"}, "randomization": {"position_noise_mm": 0.2}}
    report = check_vector_env(
        lambda autoreset_mode: gymnasium.make_vec(
            env_id, 3, "vector_entry_point", render_mode="rgb_array", autoreset_mode=autoreset_mode, **settings
        ),
        n_steps=24,
        max_episode_steps=7,
        scalar=lambda: gymnasium.make(env_id, **settings),
    )
    assert report.modes == tuple(AutoresetMode)
    assert not report.skipped


def gymnasium_env(autoreset_mode, env_id, vectorization, **arguments):
    arguments["vector_kwargs"] = {"autoreset_mode": autoreset_mode, **arguments.get("vector_kwargs", {})}
    return gymnasium.make_vec(env_id, 3, vectorization, max_episode_steps=12, **arguments)


# Reset takes the mask out of the caller's options (`options.pop`): a wrapper around it sees no mask any more.
POPS_THE_MASK = {("leaves_its_arguments_alone", DISABLED)}


@pytest.mark.parametrize("env_id", ["CartPole-v1", "Pendulum-v1", "MountainCar-v0"])
def test_sync_vector_env_passes_but_for_the_mask_that_it_pops(env_id):
    report = report_on(
        lambda autoreset_mode: gymnasium_env(autoreset_mode, env_id, "sync", render_mode="rgb_array"),
        n_steps=30,
        scalar=lambda: gymnasium.make(env_id, max_episode_steps=12),
    )
    assert {(outcome.check, outcome.mode) for outcome in report.failed} == POPS_THE_MASK
    assert not report.skipped


@pytest.mark.parametrize("env_id", ["FrozenLake-v1", "Blackjack-v1"], ids=["discrete", "tuple"])
def test_observations_that_are_no_boxes_are_checked_too(env_id):
    report = report_on(
        lambda autoreset_mode: gymnasium_env(autoreset_mode, env_id, "sync"),
        n_steps=30,
        scalar=lambda: gymnasium.make(env_id, max_episode_steps=12),
    )
    assert {(outcome.check, outcome.mode) for outcome in report.failed} == POPS_THE_MASK


@pytest.mark.slow
@pytest.mark.parametrize(
    ("env_id", "mode"), [("CartPole-v1", NEXT_STEP), ("Pendulum-v1", SAME_STEP), ("MountainCar-v0", DISABLED)]
)
def test_async_vector_env_passes_but_for_the_mask_that_it_pops(env_id, mode):
    # fork keeps the test fast; newer Pythons warn of it where threads run, which is not the environment's fault
    report = report_on(
        lambda: gymnasium_env(mode, env_id, "async", vector_kwargs={"context": "fork"}),
        n_steps=30,
        scalar=lambda: gymnasium.make(env_id, max_episode_steps=12),
        skip={"warns_of_nothing": "fork beside threads"},
    )
    assert {(outcome.check, outcome.mode) for outcome in report.failed} == {
        (check, at) for check, at in POPS_THE_MASK if at == mode
    }


def test_sync_vector_env_without_copies_returns_the_same_observations_again():
    report = report_on(lambda: SyncVectorEnv([ToyEnv] * 3, copy=False))
    assert names(report.failed) == {"keeps_what_it_returned", "returns_new_memory_in_every_call"}


def test_what_the_native_cartpole_does_differently():
    report = report_on(
        lambda: gymnasium.make_vec("CartPole-v1", 3, "vector_entry_point", render_mode="rgb_array"),
        n_steps=60,
        scalar=lambda: gymnasium.make("CartPole-v1"),
    )
    assert report.modes == (NEXT_STEP,)  # it has no other
    assert names(report.failed) == {
        "renders_one_frame_per_lane",  # a list of frames, where VectorEnv.render promises a tuple
        "closes_twice",  # it replaces close instead of close_extras, so that closed stays False
        "counts_an_integer_seed_up_over_lanes",  # one generator draws for all lanes,
        "takes_one_seed_per_lane",  # takes whole numbers only,
        "leaves_random_numbers_of_lanes_seeded_none",
        "equals_scalar_environments",  # and so lanes begin elsewhere than scalar environments
    }
    assert "closed is False" in str(report)
    # the first is not reached in 60 steps; a restart cannot be repeated where lanes share their random numbers
    assert {"truncates_at_its_time_limit", "restarts_with_a_reset_observation"} <= names(report.skipped)


def test_native_cartpole_truncates_at_the_limit_that_make_vec_was_given():
    report = report_on(lambda: gymnasium.make_vec("CartPole-v1", 3, "vector_entry_point", max_episode_steps=8))
    assert "truncates_at_its_time_limit" in names(report.passed)


def test_a_popped_mask_makes_a_wrapper_forget_the_statistics_of_every_lane():
    env = RecordEpisodeStatistics(gymnasium_env(DISABLED, "CartPole-v1", "sync"))
    env.reset(seed=0)
    env.step(np.array([0, 1, 0]))
    env.reset(options={"reset_mask": np.array([True, False, False])})
    assert env.episode_lengths.tolist() == [0, 0, 0]  # [0, 1, 1] would be right: the fault that the check is about


def test_failures_raise_one_error_that_lists_them_all():
    with pytest.raises(VectorEnvError, match="fails 3 checks") as raised:
        check_vector_env(lambda: SyncVectorEnv([ToyEnv] * 3, copy=False), n_steps=20, max_episode_steps=4)
    for name in ("keeps_what_it_returned", "returns_new_memory_in_every_call", "truncates_at_its_time_limit"):
        assert f"- failed: {name} (NextStep): " in str(raised.value)
    assert isinstance(raised.value, RuntimeError)
    assert raised.value.report.passed


def test_the_report_prints_a_row_per_check_and_the_reason_of_every_skip():
    text = str(report_on(ToyVectorEnv, skip={"closes_twice": "it has no window"}))
    lines = text.splitlines()
    assert lines[0].startswith("ToyVectorEnv(num_envs=3): ")
    assert lines[1].split() == ["check", "NextStep", "SameStep", "Disabled"]
    assert [line.split()[0] for line in lines[2 : 2 + len(CHECKS)]] == list(CHECKS)
    assert "- skipped: closes_twice (NextStep, SameStep, Disabled): it has no window" in lines


def test_without_an_ended_episode_the_checks_of_autoreset_are_skipped_with_a_hint():
    report = report_on(ToyVectorEnv, n_steps=1)
    assert not report.failed
    reasons = {outcome.check: outcome.detail for outcome in report.skipped}
    assert "raise n_steps" in reasons["restarts_with_a_reset_observation"]
    assert "raise n_steps" in reasons["hands_over_final_obs_and_final_info"]


def test_a_built_environment_is_checked_in_its_mode_and_stays_open():
    env = ToyVectorEnv(SAME_STEP)
    report = check_vector_env(env, n_steps=20)
    assert report.modes == (SAME_STEP,)
    assert {"closes_twice", "repeats_the_rollout_in_a_new_environment"} <= names(report.skipped)
    assert not env.closed


def test_an_environment_with_one_lane_passes():
    report = check_vector_env(lambda autoreset_mode: ToyVectorEnv(autoreset_mode, num_envs=1), n_steps=20)
    assert "gives_lanes_different_random_numbers" in names(report.skipped)


def test_built_environments_are_closed():
    built = []

    def make_env():
        built.append(ToyVectorEnv())
        return built[-1]

    check_vector_env(make_env, n_steps=20)
    assert built and all(env.closed for env in built)


def test_actions_and_the_environments_own_sampling_stay_as_they_are():
    env, other = ToyVectorEnv(), ToyVectorEnv()
    for one in (env, other):
        one.action_space.seed(5)
    check_vector_env(env, n_steps=5)
    assert np.array_equal(env.action_space.sample(), other.action_space.sample())


NAN = np.array([1.0, np.nan])


@pytest.mark.parametrize(
    ("one", "other", "expected"),
    [
        (NAN, NAN.copy(), None),
        ({"a": [NAN, "x"]}, {"a": [NAN.copy(), "x"]}, None),
        (np.array([np.nan, 2.0, np.nan]), np.array([np.nan, 2.0, 3.0]), "value[2] is nan, expected 3.0"),
        ({"a": (1, 2)}, {"a": (1, 3)}, "value['a'][1] is 2, expected 3"),
        ({"a": 1}, {"b": 1}, "value has the keys ['a'], expected ['b']"),
        (np.float32(1), np.float64(1), "value is 1.0 (float32), expected 1.0 (float64)"),
        (np.array([None, NAN], object), np.array([None, NAN + 1], object), "value[1][0] is 1.0, expected 2.0"),
    ],
)
def test_the_first_difference_of_nested_values_is_named(one, other, expected):
    assert difference(one, other, "value") == expected


def test_numbers_may_differ_in_dtype_where_that_is_allowed():
    assert difference(np.ones(2, np.float32), np.ones(2), "value", dtypes=False) is None
    assert difference(np.ones(2, int), np.full(2, 2.0), "value", dtypes=False)


def test_castable_dtypes_are_not_those_of_the_space():
    space = Dict(x=Box(0, 1, (2,), np.float64), y=Tuple((Discrete(3), Box(0, 1))))
    value = {"x": np.zeros(2), "y": (2, np.zeros(1, np.float32))}
    assert space_fault(space, value, "value") is None
    assert "float32" in space_fault(space, value | {"x": np.zeros(2, np.float32)}, "value")
    assert "value['y'][0] is 3" in space_fault(space, value | {"y": (3, np.zeros(1, np.float32))}, "value")
    assert "which is not in" in space_fault(space, {"x": np.zeros(2)}, "value")


@pytest.mark.parametrize(
    ("make_env", "arguments"),
    [
        ("CartPole-v1", {}),
        (ToyEnv, {}),
        (ToyVectorEnv, {"n_steps": 0}),
        (ToyVectorEnv, {"seed": -1}),
        (ToyVectorEnv, {"skip": {"closes_once": "no such check"}}),
    ],
    ids=["id", "scalar", "no steps", "negative seed", "unknown check"],
)
def test_unusable_arguments_are_refused(make_env, arguments):
    with pytest.raises(InvalidInput):
        check_vector_env(make_env, **arguments)
