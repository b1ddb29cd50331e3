"""Friction in the tracking environments: what is drawn, steps from their history, and where that history is kept."""

import pickle
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import rj_gym
from rj_gym import FrictionConfig, RollingJointEnv, RollingJointVectorEnv, TrackingConfig
from rj_gym.tracking.kernels import friction_columns
from rj_gym.tracking.render import TrackingScene
from rollingjoint import CapstanFriction, Status, solve_lengths, solve_tensions
from rollingjoint.chain.presets import five_link
from rollingjoint.errors import ConfigError, InvalidInput
from rollingjoint.load import WorldForce
from tests.rj_gym.core.test_vector import assert_same
from tests.rj_gym.rollouts import rollout, same

FRICTION = {"mu": (0.02, 0.2), "shared": False}
RANDOM = {
    "episode_steps": 4,
    "friction": FRICTION,
    "load": {"process": "ou"},
    "start": "random",
    "randomization": {"position_noise_mm": 0.2, "stiffness_spread": 0.2, "actuator_offset_mm": 0.3},
}
MECHANISMS = {"RollingJoint": "five_link", "FlexibleArm": "small_arm"}
IDS = ["rj_gym/RollingJoint-v0", "rj_gym/RollingJointGoal-v0", "rj_gym/FlexibleArm-v0", "rj_gym/FlexibleArmGoal-v0"]
SAID = {"sticking", "gap_tensions", "dissipated_work"}
ids = pytest.mark.parametrize("env_id", IDS)


def make(env_id, lanes=None, **settings):
    """An environment of an id, or a native vector environment, of a mechanism that is solved fast."""
    mechanism = MECHANISMS["FlexibleArm" if "Arm" in env_id else "RollingJoint"]
    if lanes is None:
        return gymnasium.make(env_id, mechanism=mechanism, **settings).unwrapped
    return gymnasium.make_vec(env_id, lanes, "vector_entry_point", mechanism=mechanism, **settings)


def fail_from_now_on(buffer, lane=0):
    """Steps give this lane nothing usable."""
    step = buffer.solver._steps._step

    def fail(first, last):
        step(first, last)
        buffer.solver.results.status[lane] = Status.NOT_CONVERGED
        buffer.solver.results.poses[lane] += 100.0
        for array in buffer.solver.friction.after:
            array[lane] += 0.5

    buffer.solver._steps._step = fail


def history(env):
    return [array.copy() for array in env._buffer.solver.friction.before]


def test_friction_is_off_by_default_and_its_own_defaults_are_the_documented_ones():
    assert TrackingConfig().friction is None
    assert TrackingConfig(friction={}).friction == FrictionConfig(mu=(0.0, 0.1), presliding=0.02, shared=True)
    assert TrackingConfig(friction={"mu": 0.1}).friction.mu == (0.1, 0.1)
    changed = TrackingConfig(friction={"mu": 0.1}).updated({"friction": {"shared": False}})
    assert (
        changed.friction == FrictionConfig(0.1, shared=False) and changed.updated({"friction": None}).friction is None
    )


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({"mu": 0.3}, "friction.mu.*from 0 to 0.25"),
        ({"mu": (0.1, 0.05)}, "low <= high"),
        ({"mu": -0.1}, "from 0 to 0.25"),
        ({"mu": "some"}, "two numbers"),
        ({"mu": True}, "from 0 to 0.25"),
        ({"presliding": 0.001}, "friction.presliding.*from 0.01 to 10"),
        ({"shared": 1}, "true or false"),
        ({"mus": 0.1}, "Did you mean 'mu'"),
        (0.1, "a dictionary or a FrictionConfig"),
    ],
)
def test_wrong_settings_are_refused_in_one_line(value, words):
    with pytest.raises(ConfigError, match=words) as complaint:
        TrackingConfig(friction=value)
    assert "\n" not in str(complaint.value)


@ids
def test_friction_changes_neither_the_spaces_nor_what_else_is_drawn(env_id):
    settings = {key: value for key, value in RANDOM.items() if key != "friction"}
    plain, rubbed = make(env_id, **settings), make(env_id, **RANDOM)
    assert rubbed.observation_space == plain.observation_space
    (_, without), (_, info) = plain.reset(seed=3), rubbed.reset(seed=3)
    assert info.keys() - without.keys() == SAID and info["sampled"].keys() - without["sampled"].keys() == {
        "friction_mu"
    }
    assert all(same(info["sampled"][key], without["sampled"][key]) for key in without["sampled"])
    assert not np.array_equal(info["tip"], without["tip"])


@ids
def test_coefficients_are_drawn_per_episode_shared_or_per_tendon(env_id):
    env = make(env_id, friction=FRICTION)
    drawn = np.array([env.reset(seed=seed)[1]["sampled"]["friction_mu"] for seed in range(200)])
    assert drawn.shape[1] == env.task.action_size and np.all((drawn >= 0.02) & (drawn <= 0.2))
    assert np.allclose(drawn.mean(axis=0), 0.11, atol=0.015) and np.all(np.abs(np.corrcoef(drawn.T)[0, 1:]) < 0.2)
    shared = make(env_id, friction=FRICTION | {"shared": True}).reset(seed=0)[1]["sampled"]["friction_mu"]
    assert np.all(shared == shared[0])


@pytest.mark.parametrize("env_id", IDS[::2])
def test_a_step_is_the_solve_from_the_history_of_the_last_one(env_id):
    env = make(env_id, friction={"mu": (0.05, 0.2), "presliding": 0.03})
    _, info = env.reset(seed=4)
    drawn, rng = info["sampled"], np.random.default_rng(0)
    chain = env.task.mechanism.replace(friction=CapstanFriction(drawn["friction_mu"][0], 0.03))
    weights = [chain.gravity(tuple(info["gravity"]))] if "gravity" in info else []
    loads = [*weights, WorldForce(int(drawn["link"]), tuple(drawn["forces"][0]))]
    last = solve_tensions(chain, drawn["start_tensions"], weights)
    command = last.lengths - last.tensions / chain.stiffnesses
    for _ in range(20):
        last = solve_lengths(chain, command, loads, tension_limits=(0.5, 15.0), history=last)
        assert np.allclose(info["tip"], last.tip, atol=1e-6) and np.allclose(info["tensions"], last.tensions, atol=1e-7)
        assert np.allclose(info["gap_tensions"], last.gap_tensions, atol=1e-7)
        assert np.array_equal(info["sticking"], last.sticking)
        assert info["dissipated_work"] == pytest.approx(last.dissipated_work, abs=1e-7)
        action = rng.uniform(-1, 1, len(command))
        command = info["command"] - action
        *_, info = env.step(action)


def test_coming_back_leaves_the_tip_elsewhere_and_takes_work_unless_mu_is_zero():
    def there_and_back(mu):
        env = RollingJointEnv(friction={"mu": mu})
        _, info = env.reset(seed=1, options={"load": {"link": -1, "force": (0, 0)}})
        tips, work = [info["tip"]], 0.0
        for action in ([1.0, -1.0], [-1.0, 1.0]) * 3:
            *_, info = env.step(action)
            tips.append(info["tip"])
            work += info["dissipated_work"]
        return np.linalg.norm(tips[-1] - tips[0]), work

    distance, work = there_and_back(0.1)
    assert 0.1 < distance < 5.0 and work > 1.0
    assert there_and_back(0.0) == pytest.approx((0.0, 0.0), abs=1e-7)


@ids
@pytest.mark.parametrize("mode", AutoresetMode)
def test_lanes_equal_scalar_environments(env_id, mode):
    lanes, rng = 4, np.random.default_rng(0)
    native = make(env_id, lanes, autoreset_mode=mode, **RANDOM)
    scalar = SyncVectorEnv([lambda: make(env_id, **RANDOM)] * lanes, autoreset_mode=mode)
    assert_same(native.reset(seed=3)[1], scalar.reset(seed=3)[1])
    for _ in range(11):
        actions = rng.uniform(-1, 1, native.action_space.shape).astype(np.float32)
        outcomes = native.step(actions), scalar.step(actions)
        for one, other in zip(*outcomes, strict=True):
            assert_same(one, other)
        ended = outcomes[0][2] | outcomes[0][3]
        if mode is AutoresetMode.DISABLED and ended.any():
            reset = {"options": {"reset_mask": ended}}
            assert_same(native.reset(**reset)[1], scalar.reset(**reset)[1])


@ids
def test_a_masked_reset_gives_its_lanes_a_fresh_history_and_leaves_the_others_alone(env_id):
    env = make(env_id, 3, autoreset_mode="Disabled", friction=FRICTION)
    untouched = make(env_id, 3, autoreset_mode="Disabled", friction=FRICTION)
    for each in (env, untouched):
        each.reset(seed=0)
        each.step(np.ones(each.action_space.shape))
    before, mask = history(env), np.array([False, True, False])
    env.reset(seed=[None, 77, None], options={"reset_mask": mask})
    for kept, now in zip(before, history(env), strict=True):
        assert np.array_equal(kept[~mask], now[~mask])
    assert not np.array_equal(before[0][1], history(env)[0][1])
    fresh = make(env_id, 3, friction=FRICTION)
    fresh.reset(seed=[5, 77, 6])
    action = np.full(env.action_space.shape, -0.5)
    here, there, new = (each.step(action) for each in (env, untouched, fresh))
    assert np.array_equal(here[4]["gap_tensions"][~mask], there[4]["gap_tensions"][~mask])
    assert np.array_equal(here[4]["gap_tensions"][mask], new[4]["gap_tensions"][mask])


@ids
def test_a_pickled_environment_goes_on_from_its_history(env_id):
    env = make(env_id, **RANDOM | {"episode_steps": 20})
    rollout(env, seed=3, steps=5)
    lanes = make(env_id, 3, **RANDOM)
    rollout(lanes, seed=3, steps=6)
    for each in (env, lanes):
        copy, rng = pickle.loads(pickle.dumps(each)), np.random.default_rng(1)
        for _ in range(4):
            action = rng.uniform(-1, 1, each.action_space.shape).astype(np.float32)
            assert same(each.step(action), copy.step(action))


@ids
def test_a_failed_step_keeps_pose_and_history_and_takes_no_work(env_id):
    env = make(env_id, friction=FRICTION)
    rollout(env, seed=0, steps=3)
    before, poses = history(env), env._buffer.state.poses.copy()
    last = env._buffer.task.friction_info(env._buffer.readings.copy())
    fail_from_now_on(env._buffer)
    _, _, terminated, _, info = env.step(env.action_space.sample())
    assert terminated and info["status"] == "NOT_CONVERGED" and info["dissipated_work"] == 0.0
    assert np.array_equal(poses, env._buffer.state.poses)
    assert all(np.array_equal(kept, now) for kept, now in zip(before, history(env), strict=True))
    assert np.array_equal(info["gap_tensions"], last["gap_tensions"][0])
    assert np.array_equal(info["sticking"], last["sticking"][0])


def test_a_failed_step_ends_its_lane_only():
    env = RollingJointVectorEnv(3, autoreset_mode="Disabled", friction=FRICTION)
    env.reset(seed=0)
    fail_from_now_on(env._buffer, lane=1)
    before = history(env)
    _, _, terminated, _, infos = env.step(np.ones((3, 2)))
    assert terminated.tolist() == [False, True, False]
    assert (infos["dissipated_work"] == 0.0).tolist() == [False, True, False]
    changed = [not np.array_equal(kept, now) for kept, now in zip(before[1], history(env)[1], strict=True)]
    assert changed == [True, False, True]


def test_every_reset_starts_as_if_nothing_had_ever_slipped():
    env = RollingJointEnv(friction={"mu": 0.1})
    first = rollout(env, seed=8, steps=5)
    rollout(env, seed=9, steps=7)
    assert same(rollout(env, seed=8, steps=5), first)
    _, info = env.reset(options={"load": {"link": -1, "force": (0.0, 0.0)}})
    assert np.all(info["sticking"]) and info["dissipated_work"] == pytest.approx(0.0, abs=1e-9)
    assert np.allclose(info["gap_tensions"], info["tensions"], atol=1e-6)


def test_reset_can_fix_the_coefficients_for_one_episode():
    env = RollingJointEnv(friction={"mu": (0.02, 0.1)})
    for value, mu in ((0.2, [0.2, 0.2]), ([0.0, 0.15], [0.0, 0.15])):
        _, info = env.reset(seed=0, options={"friction": value})
        assert info["sampled"]["friction_mu"].tolist() == mu
    assert np.all(env.reset(seed=0)[1]["sampled"]["friction_mu"] <= 0.1)
    for wrong in (0.3, [0.1, -0.1], [0.1] * 3, "much", None):
        with pytest.raises(InvalidInput, match=r"options\['friction'\]"):
            env.reset(options={"friction": wrong})
    with pytest.raises(InvalidInput, match="only in an environment with friction"):
        RollingJointEnv().reset(options={"friction": 0.1})


def test_a_mechanism_with_friction_of_its_own_brings_it_along():
    chain = five_link()
    rubbed = chain.replace(
        friction=CapstanFriction(0.08, 0.05, extra_turn=0.1, rolling=0.05),
        tendons=[replace(chain.tendons[0], friction=CapstanFriction(0.2)), chain.tendons[1]],
    )
    env = RollingJointEnv(mechanism=rubbed)
    _, info = env.reset(seed=0)
    assert info["sampled"]["friction_mu"].tolist() == [0.2, 0.08] and info.keys() > SAID
    law = env._buffer.solver.friction.law
    assert np.array_equal(law.tendons[0], rubbed.friction_coefficients)
    assert np.array_equal(law.rolling[0], rubbed.rolling_coefficients)
    env = RollingJointEnv(mechanism=rubbed, friction={"mu": 0.1, "presliding": 0.03})
    env.reset(seed=0)
    expected = np.array([[0.1, 0.03, 0.0, 0.0, 0.0], [0.1, 0.03, 0.1, 0.0, 0.0]])
    assert np.array_equal(env._buffer.solver.friction.law.tendons[0], expected)
    with pytest.raises(InvalidInput, match="has friction"):
        RollingJointEnv().reset(options={"mechanism": rubbed})
    _, info = RollingJointEnv(mechanism=rubbed).reset(seed=0, options={"mechanism": chain})
    assert np.all(info["sampled"]["friction_mu"] == 0.0)


def test_lanes_may_get_mechanisms_whose_tendons_end_elsewhere():
    chain = five_link()
    short = chain.replace(tendons=[chain.tendons[0], replace(chain.tendons[1], end=2)])
    env = RollingJointVectorEnv(3, autoreset_mode="Disabled", friction=FRICTION)
    scalar = RollingJointEnv(friction=FRICTION)
    env.reset(seed=0), scalar.reset(seed=1)
    env.reset(options={"reset_mask": np.array([False, True, False]), "mechanism": short})
    scalar.reset(options={"mechanism": short})
    for _ in range(3):
        observations, *_, infos = env.step(np.full((3, 2), 0.4))
        observation, *_, info = scalar.step(np.full(2, 0.4))
        assert np.array_equal(observations[1], observation)
        for key in SAID:
            assert np.array_equal(infos[key][1], info[key])
    assert not info["sticking"][2:, 1].any() and np.all(info["gap_tensions"][2:, 1] == 0.0)


def test_infos_share_no_memory_with_the_environment_or_each_other():
    env = RollingJointEnv(friction=FRICTION)
    infos = [info for *_, info in rollout(env, seed=0, steps=3)]
    inside = [*env._buffer.state, *env._buffer.solver.friction.before, *env._buffer.solver.friction.law]
    for info in infos:
        for other in [*inside, *(other["gap_tensions"] for other in infos if other is not info)]:
            assert not np.shares_memory(info["gap_tensions"], other)
    infos[0]["sampled"]["friction_mu"][...] = 9.0
    assert np.all(env._buffer.solver.friction.law.tendons[..., 0] < 1.0)


def test_readings_have_room_for_friction_only_where_there_is_some():
    plain, rubbed = RollingJointEnv(), RollingJointEnv(friction={})
    assert rubbed._buffer.readings.shape[1] - plain._buffer.readings.shape[1] == friction_columns(4, 2) == 17
    assert plain._buffer.solver.friction is None


@pytest.mark.slow
@pytest.mark.parametrize("env_id", IDS[::3])
def test_the_vector_environment_passes_the_checker(env_id):
    rj_gym.check_vector_env(
        lambda autoreset_mode: make(env_id, 3, autoreset_mode=autoreset_mode, **RANDOM),
        n_steps=12,
        max_episode_steps=RANDOM["episode_steps"],
        scalar=lambda: make(env_id, **RANDOM),
    )


def scene(gap_tensions):
    return TrackingScene(
        mechanism=None,
        poses=np.zeros((3, 3)),
        tensions=np.array([8.0, 4.0]),
        tension_range=(0.5, 15.0),
        targets=np.zeros((2, 2)),
        tip=np.zeros(2),
        trail=np.zeros((0, 2)),
        step=0,
        gap_tensions=gap_tensions,
    )


def test_pictures_have_a_tension_per_gap_and_one_between_them_per_link():
    points = np.arange(12.0).reshape(6, 2)  # hole, gap, link, gap, link's end
    ((line, tension),) = scene(None).tendon_parts(0, points, from_hole=True)
    assert line is points and tension == 8.0
    rubbed = scene(np.array([[6.0, 5.0], [4.0, 0.0]]))
    parts = list(rubbed.tendon_parts(0, points, from_hole=True))
    assert [tension for _, tension in parts] == [7.0, 6.0, 5.0, 4.0, 4.0]
    assert all(np.array_equal(part, points[k : k + 2]) for k, (part, _) in enumerate(parts))
    assert [tension for _, tension in rubbed.tendon_parts(0, points[:5], from_hole=False)] == [6.0, 5.0, 4.0, 4.0]
    assert [tension for _, tension in rubbed.tendon_parts(1, points[:4], from_hole=True)] == [4.5, 5.0, 5.0]


def test_a_picture_shows_the_tensions_along_the_tendons():
    def shades(mu):
        env = RollingJointEnv(render_mode="rgb_array", friction={"mu": mu})
        env.reset(seed=0, options={"load": {"link": -1, "force": (0.0, 0.0)}})
        for _ in range(5):
            env.step([1.0, 0.2])
        below = env.render()[120:].reshape(-1, 3).astype(int)
        reddish = below[(below[:, 0] > 130) & (below[:, 1] < 100)]
        return len(np.unique(reddish, axis=0)), env

    few, many = shades(0.0)[0], shades(0.2)[0]
    assert many > few
