"""Motors, sensors, past readings and the privileged state: what kernels do, done again in NumPy from infos."""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import rj_gym
from rj_gym import FlexibleArmConfig, TrackingConfig, privileged_entries
from rollingjoint import Status, solve_lengths_batch, solve_tensions_batch
from rollingjoint.errors import ConfigError, InvalidInput
from tests.rj_gym.core.test_vector import assert_same
from tests.rj_gym.rollouts import rollout, same

LANES = 8
WORLDS = ["Instrument", "ArmInstrument"]
LATE = {"period": 3, "delay": 2, "pose": "all", "position_bias_mm": 1.0, "angle_bias_rad": 0.1, "tension_noise": 0.2}
EVERYTHING = {
    "sensing": LATE | {"encoder_noise_mm": 0.02, "encoder_resolution_mm": 0.01, "tension_resolution": 0.1},
    "actuation": {"play_mm": (0.0, 2.0), "sheath_friction": (0.0, 0.5), "rate_limit_mm": 0.7, "delay": 2},
    "observe_history": [1, 3],
    "randomization": {"position_noise_mm": 0.3, "angle_noise_rad": 0.02},
    "target": {"process": "path", "loaded": True},
    "load": {"process": "ou"},
}
worlds = pytest.mark.parametrize("world", WORLDS)


def make(world, lanes=None, **settings):
    """An environment of a world, or a native vector environment; arms are small."""
    env_id, mechanism = f"rj_gym/{world}-v0", {"mechanism": "small_arm"} if "Arm" in world else {}
    if lanes is None:
        return gymnasium.make(env_id, **mechanism, **settings).unwrapped
    return gymnasium.make_vec(env_id, lanes, "vector_entry_point", **mechanism, **settings)


class Reader:
    """Named entries of observations and of the privileged state."""

    def __init__(self, env):
        self.env, self.m = env, env.task.action_size
        self._entries = {entry.name: i for i, entry in enumerate(env.task.entries())}
        self._truths = {entry.name: i for i, entry in enumerate(privileged_entries(env.config))}

    def seen(self, observation, *names):
        return np.stack([observation[..., self._entries[name]] for name in names], -1).astype(float)

    def tendons(self, observation, what):
        return self.seen(observation, *(f"tendon {j} {what}" for j in range(self.m)))

    def motors(self, observation):
        return self.tendons(observation, "command") * self.env.config.command_scale_mm + self.env.task.neutral_lengths

    def tensions(self, observation):
        return self.tendons(observation, "tension") * self.env.config.tension_range[1]

    def truth(self, info, *names):
        return np.stack([info["privileged"][..., self._truths[name]] for name in names], -1).astype(float)

    def tendon_truth(self, info, what):
        return self.truth(info, *(f"tendon {j} {what}" for j in range(self.m)))


@worlds
def test_motors_play_and_sheath_are_what_their_settings_say(world):
    env = make(world, LANES, privileged="info", start_tension=6.0, sensing={"tension_noise": 0.0})
    read, rng = Reader(env), np.random.default_rng(0)
    observation, info = env.reset(seed=0)
    half, phi = info["sampled"]["play_mm"] / 2, info["sampled"]["sheath_friction"]
    p, q = info["command"], info["command"] + info["sampled"]["motor_starts"]
    assert np.abs(q - p).max() <= half.max() and np.all(read.tendon_truth(info, "half play") == half.astype(np.float32))
    limited = False
    for step in range(45):
        assert np.allclose(read.motors(observation), q, atol=1e-5)
        assert np.allclose(read.tendon_truth(info, "command minus motor"), p - q, atol=1e-5)
        u = np.clip((p - q) / half, -1, 1)
        expected = np.minimum(info["tensions"] * np.exp(phi * u), 3 * 15.0)
        assert np.allclose(read.tensions(observation), expected, atol=1e-4)
        action = rng.uniform(-1, 1, q.shape) if step < 20 else np.sign(rng.uniform(-0.4, 1, q.shape))
        asked = np.clip(p, q - action - half, q - action + half)
        observation, *_, info = env.step(action)
        p, q = info["command"], q - action + (info["command"] - asked)
        limited |= bool(np.any(np.abs(p - asked) > 1e-3))
    assert limited and not info["tensions"].max() > 15.0


def test_play_delays_a_reversal_by_its_width():
    env = make("Instrument", sensing={"tension_noise": 0.0}, actuation={"play_mm": 2.0, "sheath_friction": 0.0})
    _, info = env.reset(seed=1)
    for _ in range(4):
        *_, info = env.step([0.5, -0.5])  # takes up the play on one side
    before = info["command"]
    moves = [np.abs(env.step([-0.5, 0.5])[-1]["command"] - before).max() for _ in range(6)]
    assert np.allclose(moves[:3], 0.0, atol=1e-9) and np.allclose(moves[3:], [0.0, 0.5, 1.0], atol=1e-9)


@worlds
def test_a_motor_follows_at_its_rate_and_actions_act_late(world):
    plain = {"sensing": {"tension_noise": 0.0}, "start_tension": 6.0}
    still = {"play_mm": 0.0, "sheath_friction": 0.0}
    env = make(world, 2, actuation=still | {"rate_limit_mm": 0.25}, **plain)
    read, action = Reader(env), np.full(env.action_space.shape, -0.25)
    observation, _ = env.reset(seed=0)
    start = read.motors(observation)
    action[:, 0] = -1.0
    for moved in (0.25, 0.5, 0.75, 1.0, 1.0):
        observation, *_ = env.step(action)
        assert np.allclose(read.motors(observation)[:, 0] - start[:, 0], moved, atol=1e-5)
        action = np.zeros_like(action)
    env = make(world, 2, actuation=still | {"delay": 2}, **plain)
    observation, _ = env.reset(seed=0)
    start, moves = read.motors(observation), [0.5, -0.25, 0.125, 0.0, 0.0]
    for step, move in enumerate(moves):
        observation, *_ = env.step(np.full(env.action_space.shape, move))
        assert np.allclose(start - read.motors(observation), sum(moves[: max(step - 1, 0)]), atol=1e-5)


@worlds
def test_a_motor_at_a_tension_limit_forgets_how_far_it_should_have_gone(world):
    still = {"play_mm": 0.0, "sheath_friction": 0.0, "rate_limit_mm": 0.25}
    env = make(world, actuation=still, start_tension=14.9, friction=None)
    env.reset(seed=0)
    for _ in range(3):
        *_, info = env.step(np.ones(env.action_space.shape))
    held = info["tensions"] == 15.0
    assert held.any()
    *_, info = env.step(np.full(env.action_space.shape, -0.25))
    assert np.all(info["tensions"][held] < 15.0)


@worlds
def test_encoders_and_tensions_are_rounded_and_noisy_as_set(world):
    settings = {"encoder_resolution_mm": 0.5, "tension_resolution": 0.25, "tension_noise": 0.0}
    env = make(world, 2, sensing=settings)
    read = Reader(env)
    observation, _ = env.reset(seed=0)
    for values, unit in ((read.motors(observation), 0.5), (read.tensions(observation), 0.25)):
        assert np.allclose(values / unit, np.round(values / unit), atol=1e-4)
    still = {"play_mm": 0.0, "sheath_friction": 0.0}
    env = make(world, 200, sensing={"encoder_noise_mm": 0.3, "tension_noise": 0.2}, actuation=still)
    observation, info = env.reset(seed=0)
    assert (read.motors(observation) - info["command"]).std() == pytest.approx(0.3, rel=0.15)
    assert (read.tensions(observation) - info["tensions"]).std() == pytest.approx(0.2, rel=0.15)


def test_pictures_come_at_their_period_late_and_keep_their_noise():
    env = make("SlowCamera", LANES, privileged="info")
    read, rng, tips = Reader(env), np.random.default_rng(0), []
    observation, info = env.reset(seed=0)
    phase, taken, shown = info["sampled"]["picture_phase"], np.zeros(LANES, int), None
    assert 0 <= phase.min() < phase.max() < 5
    for step in range(30):
        tips.append(info["tip"])
        due = (step + phase) % 5 == 0
        new = (due & (np.maximum(step - 3, 0) > taken)) | (step == 0)
        taken = np.where(due, np.maximum(step - 3, 0), taken)
        age, is_new = read.seen(observation, "picture age", "picture new").T
        assert np.allclose(10 * age, step - taken, atol=1e-5) and np.array_equal(is_new > 0.5, new)
        measured = 100 * read.seen(observation, "link 4 x", "link 4 y")
        then = np.array([tips[at][lane] for lane, at in enumerate(taken)])
        assert 0 < np.abs(measured - then).max() < 5 * 0.5
        assert shown is None or np.array_equal(measured[~new], shown[~new])
        error = 10 * read.seen(observation, "tip error x", "tip error y")
        assert np.allclose(error, info["target"] - measured, atol=1e-4)
        shown = measured
        observation, *_, info = env.step(rng.uniform(-1, 1, (LANES, 2)))


def test_late_pictures_of_an_arm_are_those_of_its_tip_then():
    env = make("FlexibleArm", 4, orientation=True, sensing={"delay": 2})
    read, tips, frames = Reader(env), [], []
    observation, info = env.reset(seed=0)
    for step in range(8):
        tips.append(info["tip"])
        frames.append(env._buffer.state.poses[:, -1, :3, :3].copy())
        then = max(step - 2, 0)
        assert np.allclose(read.seen(observation, "tip x", "tip y", "tip z") * env.task.length, tips[then], atol=1e-3)
        columns = read.seen(observation, *(f"tip R {row}{column}" for column in "xy" for row in "xyz"))
        assert np.allclose(columns, np.concatenate([frames[then][:, :, 0], frames[then][:, :, 1]], axis=1), atol=1e-6)
        observation, *_, info = env.step(np.random.default_rng(step).uniform(-1, 1, env.action_space.shape))


def test_the_noise_of_an_arms_picture_is_drawn_once():
    env = make("FlexibleArm", 6, sensing={"period": 3, "delay": 1}, randomization={"position_noise_mm": 0.5})
    read, rng, shown, kept = Reader(env), np.random.default_rng(0), None, 0
    observation, _ = env.reset(seed=0)
    for _ in range(9):
        observation, *_ = env.step(rng.uniform(-1, 1, env.action_space.shape))
        tips, (new,) = read.seen(observation, "tip x", "tip y", "tip z"), read.seen(observation, "picture new").T
        if shown is not None:
            assert np.array_equal(np.any(tips != shown, axis=1), new > 0.5)
            kept += np.sum(new < 0.5)
        shown = tips
    assert kept > 20


def test_a_bias_is_one_constant_of_an_episode_in_everything_that_is_measured_of_a_pose():
    env = gymnasium.make_vec(
        "rj_gym/RollingJoint-v0", 50, "vector_entry_point", sensing={"position_bias_mm": 2.0, "angle_bias_rad": 0.1}
    )
    read, links = Reader(env), [f"link {k} {axis}" for k in range(1, 5) for axis in "xy"]
    (observation, info), biases = env.reset(seed=0), []
    for _ in range(3):
        true = env._buffer.state.poses[:, 1:]
        biases.append(100 * read.seen(observation, *links).reshape(50, 4, 2) - true[..., :2])
        angles = np.arctan2(*read.seen(observation, "link 2 sin angle", "link 2 cos angle").T)
        turned = (angles - true[:, 1, 2] + np.pi) % (2 * np.pi) - np.pi
        assert 0.08 < np.abs(turned).max() <= 0.1 + 1e-6
        off = 10 * read.seen(observation, "tip error x", "tip error y") - (info["target"] - info["tip"])
        assert np.allclose(off, -biases[-1][:, 3], atol=1e-4)
        observation, *_, info = env.step(np.full((50, 2), 0.3))
    assert np.allclose(np.array(biases), biases[0][:, :1], atol=1e-4)
    assert 1.8 < np.abs(biases[0]).max() <= 2.0 + 1e-4 and np.abs(biases[0].mean(axis=0)).max() < 0.6


@worlds
def test_past_readings_are_those_of_their_lags_minus_now(world):
    env = make(world, LANES, observe_history=[1, 2, 5])
    read, rng, past = Reader(env), np.random.default_rng(0), []
    observation, _ = env.reset(seed=0)
    action = np.zeros(env.action_space.shape)
    for step in range(12):
        past.append((read.motors(observation), read.tensions(observation), action))
        for lag in (1, 2, 5):
            motor, tension, _ = past[max(step - lag, 0)]
            moved, pulled = (read.tendons(observation, f"{what}, lag {lag}") for what in ("command", "tension"))
            assert np.allclose(moved, motor - past[-1][0], atol=1e-4)
            assert np.allclose(2 * pulled, tension - past[-1][1], atol=1e-4)
            taken = past[step - lag + 1][2] if lag <= step else 0.0
            assert np.allclose(read.tendons(observation, f"action, lag {lag}"), taken, atol=1e-6)
        action = rng.uniform(-1, 1, env.action_space.shape)
        observation, *_ = env.step(action)
    assert [entry.name for entry in make(world, observe_history=2).task.entries()][-1].endswith("lag 2")


@pytest.mark.parametrize("env_id", ["rj_gym/RollingJoint-v0", "rj_gym/FlexibleArm-v0"])
def test_past_tip_errors_are_observed_where_a_pose_is(env_id):
    mechanism = {"mechanism": "small_arm"} if "Arm" in env_id else {}
    env = gymnasium.make(env_id, observe_history=[2], **mechanism).unwrapped
    read, axes = Reader(env), "xyz"[: env.task.dimension]
    errors = []
    for observation, *_ in rollout(env, seed=0, steps=5):
        errors.append(read.seen(observation, *(f"tip error {axis}" for axis in axes)))
        past = read.seen(observation, *(f"tip error {axis}, lag 2" for axis in axes))
        assert np.allclose(past, errors[max(len(errors) - 3, 0)] - errors[-1], atol=1e-5)


@worlds
def test_the_privileged_state_is_the_true_one(world):
    env = make(world, LANES, privileged="info", friction={"mu": (0.02, 0.1), "shared": False})
    read = Reader(env)
    _, start = env.reset(seed=0)
    for _ in range(3):
        *_, info = env.step(np.full(env.action_space.shape, 0.4))
    drawn, axes = start["sampled"], "xyz"[: env.task.dimension]
    error = read.truth(info, *(f"tip error {axis}" for axis in axes)) * env.config.reward.error_scale_mm
    assert np.allclose(error, info["target"] - info["tip"], atol=1e-4)
    for what, expected in {
        "sheath friction": drawn["sheath_friction"],
        "tension": info["tensions"] / 15,
        "motor offset": drawn["actuator_offsets"],
        "stiffness factor": drawn["stiffnesses"] / env.task.mechanism.stiffnesses,
        "friction": drawn["friction_mu"],
    }.items():
        assert np.allclose(read.tendon_truth(info, what), expected, atol=1e-5), what
    assert np.allclose(read.truth(info, "time"), 3 / 50)
    if "Arm" in world:
        assert np.allclose(read.truth(info, "gravity x", "gravity y", "gravity z"), info["gravity"], atol=1e-6)
        assert np.allclose(0.5 * read.truth(info, "payload")[:, 0], drawn["payloads"][:, 0], atol=1e-6)
        angles = read.truth(info, *(f"hinge {i} angle" for i in range(env.task.mechanism.n_joints)))
        assert np.allclose(angles, env._buffer.state.angles, atol=1e-6)
        assert np.allclose(env.task.length * read.truth(info, "tip x", "tip y", "tip z"), info["tip"], atol=1e-3)
    else:
        assert np.allclose(read.truth(info, "load x", "load y"), info["load"]["force"], atol=1e-6)
        assert np.all(read.truth(info, "load on link 4") == 1.0) and not read.truth(info, "load on link 2").any()


def test_privileged_rates_of_the_tip_are_central_differences():
    env = gymnasium.make("rj_gym/RollingJoint-v0", privileged="info").unwrapped
    _, info = env.reset(seed=3)
    rates = Reader(env).truth(info, *(f"tip {axis} by tendon {j}" for axis in "xy" for j in range(2)))
    tables = np.repeat(env._buffer.solver.loads, 4, axis=0)
    commands = info["command"] + 1e-4 * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    tips = solve_lengths_batch(env.task.mechanism, commands, tables, tension_limits=(0.5, 15.0)).tip
    assert np.allclose(rates.reshape(2, 2), (tips[::2] - tips[1::2]).T / 2e-4, atol=1e-5)


@pytest.mark.parametrize("env_id", ["rj_gym/RollingJoint-v0", "rj_gym/FlexibleArm-v0"])
@pytest.mark.parametrize("process", ["fixed", "path"])
def test_loaded_targets_are_tips_under_the_load_with_which_the_episode_ends_or_unloaded_at_a_limit(env_id, process):
    arm = {"mechanism": "small_arm"} if "Arm" in env_id else {}
    settings = {"target": {"loaded": True, "process": process}, "load": {"process": "ou"}, "episode_steps": 6} | arm
    env = gymnasium.make_vec(env_id, 4, "vector_entry_point", **settings)
    _, info = env.reset(seed=0)
    draws = env.task.sample([np.random.default_rng(seed) for seed in range(4)])
    tables = env.task.load_tables(draws, 6)
    solved = solve_tensions_batch(env.task.mechanism, draws.target_tensions[:, -1], tables)
    unloaded = solve_tensions_batch(env.task.mechanism, draws.target_tensions[:, -1], env.task.base_load_tables(draws))
    reached = solved.status == Status.CONVERGED  # other targets are unloaded: a joint would be at its end
    targets = info["sampled"]["targets"][:, -1]
    assert np.allclose(targets[reached], solved.tip[reached], atol=1e-5)
    assert np.allclose(targets[~reached], unloaded.tip[~reached], atol=1e-5)
    assert np.abs(unloaded.tip - solved.tip)[reached].max() > 0.1


@pytest.mark.parametrize("env_id", ["rj_gym/RollingJoint-v0", "rj_gym/FlexibleArm-v0"])
def test_whatever_is_set_lanes_equal_scalar_environments_and_pickles_go_on(env_id):
    settings = EVERYTHING | {"episode_steps": 5, "privileged": "observation"}
    settings |= {"mechanism": "small_arm", "orientation": True} if "Arm" in env_id else {}
    native = gymnasium.make_vec(env_id, 3, "vector_entry_point", autoreset_mode="Disabled", **settings)
    scalar = SyncVectorEnv([lambda: gymnasium.make(env_id, **settings)] * 3, autoreset_mode=AutoresetMode.DISABLED)
    rng = np.random.default_rng(0)
    for one, other in zip(native.reset(seed=3), scalar.reset(seed=3), strict=True):
        assert_same(one, other)
    for step in range(12):
        action = rng.uniform(-1, 1, native.action_space.shape).astype(np.float32)
        copy = pickle.loads(pickle.dumps(native)) if step == 3 else None
        outcomes = native.step(action), scalar.step(action)
        for one, other in zip(*outcomes, strict=True):
            assert_same(one, other)
        assert copy is None or same(copy.step(action), outcomes[0])
        mask = outcomes[0][3] if outcomes[0][3].any() else np.array([False, step in (1, 7), False])
        if mask.any():
            reset = {"options": {"reset_mask": mask}}
            for one, other in zip(native.reset(**reset), scalar.reset(**reset), strict=True):
                assert_same(one, other, "masked reset")


def test_settings_of_sensors_and_motors_leave_what_else_is_drawn_as_it_was():
    plain = {key: value for key, value in EVERYTHING.items() if key in ("randomization", "target", "load")}
    (_, without), (_, info) = (
        gymnasium.make("rj_gym/RollingJoint-v0", **each).reset(seed=3) for each in (plain, EVERYTHING)
    )
    added = {"play_mm", "motor_starts", "sheath_friction", "picture_phase"}
    assert info["sampled"].keys() - without["sampled"].keys() == added
    assert all(same(info["sampled"][key], without["sampled"][key]) for key in without["sampled"])


def test_every_part_is_off_by_default_and_worlds_are_what_their_tests_compare():
    assert not TrackingConfig().is_instrumented and not FlexibleArmConfig().is_instrumented
    assert rj_gym.InstrumentConfig().actuation == rj_gym.ActuationConfig((0.5, 3.0), (0.0, 0.6))
    assert rj_gym.InstrumentShiftConfig().actuation == rj_gym.ActuationConfig((0.5, 2.0), (0.0, 0.3))
    assert rj_gym.SlowCameraConfig().sensing == rj_gym.SensingConfig(period=5, delay=3, tension_noise=0.1)
    assert rj_gym.LatePoseConfig().sensing == rj_gym.SensingConfig(delay=2, tension_noise=0.1)
    arm = rj_gym.ArmInstrumentConfig()
    assert arm.actuation == rj_gym.ActuationConfig((0.2, 1.0), (0.0, 0.3)) and arm.friction.mu == (0.0, 0.1)
    for config in (rj_gym.settings_of(env_id)() for env_id in rj_gym.IDS):
        assert not config.is_instrumented or config.sensing.tension_noise == 0.1


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"sensing": {"pose": "some"}}, "sensing.pose"),
        ({"sensing": {"period": 0}}, "sensing.period"),
        ({"sensing": {"delay": -1}}, "sensing.delay"),
        ({"sensing": {"tension_noise": float("nan")}}, "sensing.tension_noise"),
        ({"sensing": {"angle_bias_rad": 2.0}}, "sensing.angle_bias_rad"),
        ({"actuation": {"play_mm": (3, 1)}}, "actuation.play_mm"),
        ({"actuation": {"play_mm": 30.0}}, "actuation.play_mm"),
        ({"actuation": {"sheath_friction": -0.1}}, "actuation.sheath_friction"),
        ({"actuation": {"rate_limit_mm": 0.0}}, "actuation.rate_limit_mm"),
        ({"actuation": {"delay": 1.5}}, "actuation.delay"),
        ({"actuation": {"plays": 1.0}}, "one of play_mm"),
        ({"observe_history": []}, "observe_history"),
        ({"observe_history": [0, 1]}, "observe_history"),
        ({"observe_history": [2, 2]}, "observe_history"),
        ({"observe_history": "3"}, "observe_history"),
        ({"privileged": True}, "privileged"),
        ({"target": {"loaded": 1}}, "target.loaded"),
    ],
)
@pytest.mark.parametrize("kind", [TrackingConfig, FlexibleArmConfig])
def test_wrong_settings_are_refused_in_one_line(kind, settings, words):
    with pytest.raises(ConfigError, match=words) as complaint:
        kind.from_dict(settings)
    assert "\n" not in str(complaint.value)


@pytest.mark.parametrize("stem", ["RollingJointGoal", "FlexibleArmGoal"])
@pytest.mark.parametrize(
    "settings", [{"sensing": {"delay": 1}}, {"actuation": {"delay": 1}}, {"observe_history": 1}, {"privileged": "info"}]
)
def test_goal_environments_refuse_them(stem, settings):
    with pytest.raises(ConfigError, match="in a Goal environment"):
        gymnasium.make(f"rj_gym/{stem}-v0", **settings)


@worlds
def test_nothing_is_ever_without_a_number(world):
    env = make(world, 16, observe_history=3, privileged="observation", target={"process": "path"})
    observation, _ = env.reset(seed=0)
    for step in range(25):
        back_and_forth = np.sign(np.sin(step / 3 + np.arange(env.action_space.shape[0])))
        observation, reward, *_, info = env.step(np.repeat(back_and_forth[:, None], env.task.action_size, axis=1))
        assert all(np.isfinite(part).all() for part in observation.values()) and np.isfinite(reward).all()
        assert env.observation_space.contains(observation) and np.isfinite(info["error_mm"]).all()


@worlds
def test_reset_can_fix_play_sheath_friction_and_motors_for_one_episode(world):
    env = make(world)
    drawn = env.reset(seed=3)[1]["sampled"]
    m = env.task.action_size
    widths = np.linspace(3.0, 4.0, m)
    options = {"play_mm": widths, "sheath_friction": 0.7, "actuator_offsets": -0.9}
    observation, info = env.reset(seed=3, options=options)
    fixed = info["sampled"]
    np.testing.assert_array_equal(fixed["play_mm"], widths)
    np.testing.assert_array_equal(fixed["sheath_friction"], [0.7] * m)
    np.testing.assert_array_equal(fixed["actuator_offsets"], [-0.9] * m)
    share = drawn["motor_starts"] / drawn["play_mm"]
    np.testing.assert_allclose(fixed["motor_starts"], share * widths)
    np.testing.assert_array_equal(fixed["forces"], drawn["forces"])
    motors = Reader(env).motors(observation)
    np.testing.assert_allclose(motors - info["command"], fixed["motor_starts"], atol=1e-4)
    same_as_before = env.reset(seed=3)[1]["sampled"]
    np.testing.assert_array_equal(same_as_before["play_mm"], drawn["play_mm"])


@pytest.mark.parametrize("option", ["play_mm", "sheath_friction", "actuator_offsets"])
def test_what_a_reset_cannot_fix_of_motors_is_refused(option):
    env = make("Instrument")
    for wrong in (-21.0, 21.0, [0.1] * 3, "much", None, np.nan):
        with pytest.raises(InvalidInput, match=rf"options\['{option}'\]"):
            env.reset(options={option: wrong})
    plain = rj_gym.RollingJointEnv()
    if option == "actuator_offsets":
        assert plain.reset(options={option: 0.5})[1]["sampled"][option].tolist() == [0.5, 0.5]
    else:
        with pytest.raises(InvalidInput, match=f"only in an environment with {option}"):
            plain.reset(options={option: 0.5})
