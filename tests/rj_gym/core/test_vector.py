"""The native vector environments equal their scalar siblings, lane by lane and step by step."""

import pickle
import threading
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import rj_gym
from rollingjoint import InvalidInput, RollingJointError, Status
from rollingjoint.chain.presets import five_link
from tests.rj_gym.watched_solver import watch_solver

SHORT = {"episode_steps": 4, "load": {"process": "step", "hold_steps": 2.0}, "target": {"process": "path"}}
RANDOM = {"episode_steps": 3, "randomization": {"position_noise_mm": 0.2, "stiffness_spread": 0.2}, "start": "random"}


def assert_same(native, scalar, where="observation"):
    """Equal to the last bit, dtypes, masks and nested dictionaries included."""
    if isinstance(scalar, dict):
        assert set(native) == set(scalar), f"{where}: {set(native) ^ set(scalar)}"
        for key in scalar:
            assert_same(native[key], scalar[key], f"{where}[{key!r}]")
    elif isinstance(scalar, np.ndarray) and scalar.dtype == object:
        for one, other in zip(native, scalar, strict=True):
            assert_same(one, other, where)
    elif isinstance(scalar, np.ndarray):
        assert native.dtype == scalar.dtype, f"{where}: {native.dtype} and {scalar.dtype}"
        assert np.array_equal(native, scalar), f"{where}:\n{native}\n{scalar}"
    else:
        assert native == scalar, where


@pytest.mark.parametrize("env_id", rj_gym.IDS)
@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("overrides", [SHORT, RANDOM], ids=["step, path", "randomised"])
def test_lanes_equal_scalar_environments(env_id, mode, overrides):
    lanes, rng = 5, np.random.default_rng(0)
    native = gymnasium.make_vec(env_id, lanes, "vector_entry_point", autoreset_mode=mode, **overrides)
    scalar = SyncVectorEnv([lambda: gymnasium.make(env_id, **overrides)] * lanes, autoreset_mode=mode)
    assert native.single_observation_space == scalar.single_observation_space
    assert native.observation_space == scalar.observation_space
    for one, other in zip(native.reset(seed=3), scalar.reset(seed=3), strict=True):
        assert_same(one, other)
    for _ in range(11):
        actions = rng.uniform(-1, 1, native.action_space.shape).astype(np.float32)
        outcomes = native.step(actions), scalar.step(actions)
        names = ("observation", "reward", "terminated", "truncated", "infos")
        for name, one, other in zip(names, *outcomes, strict=True):
            assert_same(one, other, name)
        ended = outcomes[0][2] | outcomes[0][3]
        if mode is AutoresetMode.DISABLED and ended.any():
            for one, other in zip(
                native.reset(options={"reset_mask": ended}), scalar.reset(options={"reset_mask": ended}), strict=True
            ):
                assert_same(one, other, "masked reset")


def test_many_lanes_on_threads_equal_scalar_environments():
    native = gymnasium.make_vec("rj_gym/RollingJoint-v0", 600, "vector_entry_point", **SHORT)
    observations, _ = native.reset(seed=11)
    actions = np.random.default_rng(1).uniform(-1, 1, (3, 600, 2)).astype(np.float32)
    stepped = [native.step(action)[0] for action in actions]
    for lane in (0, 77, 599):
        env = gymnasium.make("rj_gym/RollingJoint-v0", **SHORT)
        assert np.array_equal(env.reset(seed=11 + lane)[0], observations[lane])
        for action, batch in zip(actions, stepped, strict=True):
            assert np.array_equal(env.step(action[lane])[0], batch[lane])


def test_a_masked_reset_leaves_the_other_lanes_alone():
    env = rj_gym.RollingJointVectorEnv(3, autoreset_mode="Disabled", episode_steps=4)
    env.reset(seed=0)
    before = env.step(np.zeros((3, 2)))[0]
    after, infos = env.reset(
        options={"reset_mask": np.array([False, True, False]), "load": {"link": -1, "force": (0, 0)}}
    )
    assert np.array_equal(before[[0, 2]], after[[0, 2]])
    assert not np.array_equal(before[1], after[1])
    assert infos["_sampled"].tolist() == [False, True, False]
    assert np.all(infos["load"]["force"][1] == 0)


def test_lanes_may_get_mechanisms_whose_tendons_end_elsewhere():
    chain = five_link()
    short = chain.replace(tendons=[replace(tendon, end=3) for tendon in chain.tendons])
    settings = {"episode_steps": 4, "load": {"link": "tip"}}
    env = rj_gym.RollingJointVectorEnv(3, autoreset_mode="Disabled", **settings)
    scalar = rj_gym.RollingJointEnv(**settings)
    env.reset(seed=0), scalar.reset(seed=1)
    env.reset(options={"reset_mask": np.array([False, True, False]), "mechanism": short})
    scalar.reset(options={"mechanism": short})
    for _ in range(3):
        observations, *_ = env.step(np.full((3, 2), 0.4))
        assert np.array_equal(observations[1], scalar.step(np.full(2, 0.4))[0])
        assert not np.array_equal(observations[1], observations[0])


def test_an_ended_lane_must_be_reset_when_autoreset_is_disabled():
    env = rj_gym.RollingJointVectorEnv(2, autoreset_mode=AutoresetMode.DISABLED, episode_steps=1)
    env.reset(seed=0)
    env.step(np.zeros((2, 2)))
    with pytest.raises(ResetNeeded, match=r"Lanes \[0, 1\]"):
        env.step(np.zeros((2, 2)))


def test_a_failed_solve_ends_its_lane_only():
    env = rj_gym.RollingJointVectorEnv(3, autoreset_mode="SameStep")
    env.reset(seed=0)

    def fail_in_lane_1():  # but its restart, in a room of its own, succeeds
        env._buffer.solver.results.status[1] = Status.NOT_CONVERGED

    watch_solver(env._buffer, after=fail_in_lane_1)
    observations, rewards, terminated, truncated, infos = env.step(np.zeros((3, 2)))
    assert terminated.tolist() == [False, True, False]
    assert not truncated.any()
    assert rewards[1] < -90 < rewards[0]
    assert infos["final_info"]["status"][1] == "NOT_CONVERGED"
    assert np.all(np.isfinite(observations))


@pytest.mark.parametrize(
    "actions",
    [np.zeros((2, 2)), np.full((3, 2), np.nan), "push", np.zeros((3, 3))],
    ids=["shape", "nan", "text", "wide"],
)
def test_invalid_actions_change_nothing(actions):
    env, untouched = rj_gym.RollingJointVectorEnv(3), rj_gym.RollingJointVectorEnv(3)
    env.reset(seed=0), untouched.reset(seed=0)
    with pytest.raises(InvalidInput, match=r"\(3, 2\)"):
        env.step(actions)
    for one, other in zip(env.step(np.ones((3, 2))), untouched.step(np.ones((3, 2))), strict=True):
        assert_same(one, other)


@pytest.mark.parametrize(
    "call",
    [
        lambda: rj_gym.RollingJointVectorEnv(0),
        lambda: rj_gym.RollingJointVectorEnv("many"),
        lambda: rj_gym.RollingJointVectorEnv(2**70),
        lambda: rj_gym.RollingJointVectorEnv(2, render_lanes=[2]),
        lambda: rj_gym.RollingJointVectorEnv(2, render_lanes=[-1]),
        lambda: rj_gym.RollingJointVectorEnv(2, render_lanes=[0.5]),
        lambda: rj_gym.RollingJointVectorEnv(2, render_lanes=1),
        lambda: rj_gym.RollingJointVectorEnv(2, render_lanes="01"),
        lambda: rj_gym.RollingJointVectorEnv(2, render_lanes=[[0], [1, 0]]),
        lambda: rj_gym.RollingJointVectorEnv(2, autoreset_mode="never"),
        lambda: rj_gym.RollingJointVectorEnv(2, render_mode="human"),
        lambda: rj_gym.RollingJointVectorEnv(2).reset(seed=[1, 2, 3]),
        lambda: rj_gym.RollingJointVectorEnv(2).reset(options={"reset_mask": np.array([True, False])}),
        lambda: rj_gym.RollingJointVectorEnv(2).reset(options={"reset_mask": np.array([1, 0])}),
        lambda: rj_gym.RollingJointVectorEnv(2).reset(options={"goal": 1}),
    ],
)
def test_unusable_arguments_are_refused(call):
    with pytest.raises(InvalidInput) as raised:
        call()
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("seed", [[4, 5, 1.5], [4, 5, -1], [4, "5", 6], [4, 5], "456", -1, 1.5, True, {4, 5, 6}])
def test_refused_seeds_reseed_no_lane(seed):
    env, untouched = rj_gym.RollingJointVectorEnv(3), rj_gym.RollingJointVectorEnv(3)
    env.reset(seed=0), untouched.reset(seed=0)
    with pytest.raises(InvalidInput, match=r"^seed.*: expected a whole number, 0 or more, or None"):
        env.reset(seed=seed)
    for one, other in zip(env.reset(), untouched.reset(), strict=True):
        assert_same(one, other)


@pytest.mark.parametrize("seed", [np.int64(4), [np.int64(4), 5, np.uint8(6)], np.array([4, 5, 6]), (4, 5.0, 6), 4.0])
def test_whole_numbers_of_any_type_are_seeds(seed):
    given, plain = (rj_gym.RollingJointVectorEnv(3).reset(seed=each) for each in (seed, 4))
    for one, other in zip(given, plain, strict=True):
        assert_same(one, other)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_calls_share_no_memory(mode):
    env = rj_gym.RollingJointVectorEnv(3, autoreset_mode=mode, episode_steps=2)
    calls = [env.reset(seed=0)]
    for k in range(5):
        calls.append(env.step(np.full((3, 2), 0.1 * k)))
        if mode is AutoresetMode.DISABLED and calls[-1][3].any():
            calls.append(env.reset(options={"reset_mask": calls[-1][3].copy()}))
    groups = [arrays_in(call) + internal_arrays(env) * (call is calls[-1]) for call in calls]
    assert all(len(group) > 20 for group in groups)
    for k, group in enumerate(groups):
        for array in group:
            assert not any(np.shares_memory(array, other) for later in groups[k + 1 :] for other in later)
    returned = arrays_in(calls[-1])
    assert not any(np.shares_memory(array, inside) for array in returned for inside in internal_arrays(env))


def arrays_in(value):
    """All numeric arrays in nested results."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        return [value]
    if isinstance(value, dict):
        value = tuple(value.values())
    return [array for part in value for array in arrays_in(part)] if isinstance(value, tuple | np.ndarray) else []


def internal_arrays(env):
    lanes = env._buffer
    return [*lanes.state, *lanes.course, lanes._actions, lanes.solver.loads, *lanes.solver.results]


def test_stepping_before_reset_is_refused():
    with pytest.raises(ResetNeeded):
        rj_gym.RollingJointVectorEnv(2).step(np.zeros((2, 2)))


def test_a_pickled_batch_goes_on_alike():
    env = rj_gym.RollingJointVectorEnv(3, render_mode="rgb_array")
    env.reset(seed=5)
    env.step(np.ones((3, 2)))
    env.render()
    copy = pickle.loads(pickle.dumps(env))
    for _ in range(3):
        assert_same(copy.step(-np.ones((3, 2)))[0], env.step(-np.ones((3, 2)))[0])


def test_pictures_of_chosen_lanes_equal_those_of_scalar_environments():
    env = rj_gym.RollingJointVectorEnv(3, render_mode="rgb_array", render_lanes=[2])
    scalar = gymnasium.make("rj_gym/RollingJoint-v0", render_mode="rgb_array")
    env.reset(seed=4)
    scalar.reset(seed=6)
    for action in ([1, 0], [0.5, -1]):
        env.step([action] * 3)
        scalar.step(np.array(action, np.float32))
    (picture,) = env.render()
    assert np.array_equal(picture, scalar.render())
    env.close()


@pytest.mark.parametrize(
    "call",
    [
        lambda env: env.step(np.zeros((2, 2))),
        lambda env: env.reset(seed=5),
        lambda env: env.render(),
        lambda env: env.close(),
        lambda env: pickle.dumps(env),
    ],
    ids=["step", "reset", "render", "close", "pickle"],
)
def test_a_second_thread_gets_an_error_and_changes_nothing(call, monkeypatch):
    env, untouched = (rj_gym.RollingJointVectorEnv(2, render_mode="rgb_array") for _ in range(2))
    env.reset(seed=0), untouched.reset(seed=0)
    begun, go_on, stepped = threading.Event(), threading.Event(), []
    advance = env._buffer.advance

    def slow(ended):
        begun.set()
        assert go_on.wait(10)
        return advance(ended)

    with monkeypatch.context() as patch:
        patch.setattr(env._buffer, "advance", slow, raising=False)
        first = threading.Thread(target=lambda: stepped.append(env.step(np.ones((2, 2)))))
        first.start()
        assert begun.wait(10)
        patch.setattr(env._buffer, "advance", advance)
        try:
            with pytest.raises(RollingJointError, match="one thread at a time") as raised:
                call(env)
        finally:
            go_on.set()
            first.join()
    assert "\n" not in str(raised.value)
    assert_same(stepped[0][0], untouched.step(np.ones((2, 2)))[0])
    again = pickle.loads(pickle.dumps(env))  # free again, and so is the copy
    assert_same(again.step(np.ones((2, 2)))[0], untouched.step(np.ones((2, 2)))[0])


def test_a_refused_or_interrupted_call_leaves_the_environment_free(monkeypatch):
    env = rj_gym.RollingJointVectorEnv(2)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros((2, 2)))
    with monkeypatch.context() as patch:
        patch.setattr(env._buffer, "restart", lambda *arguments: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            env.reset()
    env.reset(seed=0)


@pytest.mark.parametrize("env_id", ["rj_gym/RollingJoint-v0", "rj_gym/FlexibleArm-v0"])
def test_the_scene_of_a_lane_is_what_happened_there_and_stays_as_it_was(env_id):
    envs = gymnasium.make_vec(env_id, 3, "vector_entry_point", **SHORT)
    with pytest.raises(ResetNeeded, match="scene"):
        envs.scene()
    _, info = envs.reset(seed=2)
    scenes, tips = [[envs.scene(lane) for lane in range(3)]], [info["tip"]]
    for _ in range(3):
        *_, info = envs.step(np.full(envs.action_space.shape, 0.3, np.float32))
        scenes.append([envs.scene(lane) for lane in range(3)])
        tips.append(info["tip"])
    for step, (there, seen) in enumerate(zip(scenes, tips, strict=True)):
        np.testing.assert_array_equal([scene.tip for scene in there], seen)
        assert [scene.step for scene in there] == [step] * 3
        np.testing.assert_array_equal([scene.trail for scene in there], seen[:, None])
    assert len({scene.poses.tobytes() for there in scenes for scene in there}) == 12


def targets_of(infos):
    return infos["target"].tolist()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_options_of_single_lanes_hold_as_long_as_they_are_kept(mode):
    envs = rj_gym.RollingJointVectorEnv(4, episode_steps=2, autoreset_mode=mode)
    near, far = {"target": (1.0, 80.0)}, {"target": (9.0, 85.0), "load": {"link": -1, "force": (0.5, 0.0)}}
    scalar = rj_gym.RollingJointEnv(episode_steps=2)
    observations, infos = envs.reset(seed=3, options={"lanes": [near, far, {}, near], "keep": True})
    for lane, options in enumerate((near, far, {}, near)):
        alone, info = scalar.reset(seed=3 + lane, options=options)
        assert np.array_equal(observations[lane], alone)
        assert np.array_equal(infos["sampled"]["forces"][lane], info["sampled"]["forces"])
    drawn = targets_of(infos)[2]
    for _ in range(4):
        infos = envs.step(np.zeros((4, 2)))[4]
    first, second, third, fourth = targets_of(infos)
    assert first == fourth == [1.0, 80.0] and second == [9.0, 85.0] and third != drawn
    envs.reset(options={"reset_mask": [True, False, False, False]})
    for _ in range(4):
        infos = envs.step(np.zeros((4, 2)))[4]
    assert targets_of(infos)[0] != [1.0, 80.0] and targets_of(infos)[1] == [9.0, 85.0]


def test_options_that_cannot_be_used_in_one_lane_change_no_lane():
    envs, untouched = rj_gym.RollingJointVectorEnv(3), rj_gym.RollingJointVectorEnv(3)
    envs.reset(seed=0), untouched.reset(seed=0)
    for options, message in (
        ({"lanes": [{}, {"target": "up"}, {}]}, "target"),
        ({"lanes": [{}]}, r"options\['lanes'\] = .*a sequence of 3 options"),
        ({"lanes": [{}] * 3, "target": (1.0, 80.0)}, r"no others beside it"),
        ({"keep": "yes"}, r"options\['keep'\] = 'yes'"),
    ):
        with pytest.raises(InvalidInput, match=message):
            envs.reset(options=options)
    one, other = envs.step(np.ones((3, 2))), untouched.step(np.ones((3, 2)))
    assert np.array_equal(one[0], other[0]) and np.array_equal(one[1], other[1])
