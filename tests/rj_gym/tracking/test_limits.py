"""Limits of tension at motors, measured starts, load cells and dead bands: what settings promise, from infos alone."""

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from rj_gym import ActuationConfig, InstrumentConfig
from rollingjoint import solve_lengths, solve_tensions
from rollingjoint.errors import ConfigError, InvalidInput
from tests.rj_gym.core.test_vector import assert_same
from tests.rj_gym.rollouts import rollout, same

QUIET = {"tension_noise": 0.0}
LIMITED = {"tension_limit": [6.0, 12.0], "limit_at": "motor"}
EVERYTHING = {
    "start": "measured",
    "sensing": {"tension_gain_error": 0.05, "tension_offset": 0.3, "tension_noise": 0.1},
    "actuation": LIMITED | {"dead_band_mm": 0.05, "current_resolution": 0.5},
}
WORLDS = ["Instrument", "ArmInstrument"]
worlds = pytest.mark.parametrize("world", WORLDS)


def make(world="Instrument", lanes=None, **settings):
    """An environment, or a native vector environment; arms are small."""
    env_id, mechanism = f"rj_gym/{world}-v0", {"mechanism": "small_arm"} if "Arm" in world else {}
    if lanes is None:
        return gymnasium.make(env_id, **mechanism, **settings).unwrapped
    return gymnasium.make_vec(env_id, lanes, "vector_entry_point", **mechanism, **settings).unwrapped


class Motors:
    """Positions of motors, their tensions and sheaths in a native vector environment, from its infos."""

    def __init__(self, env, info):
        self.sampled = info["sampled"]
        self.m, self.limits = env.task.action_size, self.sampled["tension_limits"]
        self.half, self.phi = self.sampled["play_mm"] / 2, self.sampled["sheath_friction"]
        self.names = [entry.name for entry in env.task.privileged_entries()]

    def behind(self, info):
        """p - q, (B, m) [mm]."""
        places = [self.names.index(f"tendon {j} command minus motor") for j in range(self.m)]
        return info["privileged"][:, places].astype(float)

    def positions(self, info):
        return info["command"] - self.behind(info)

    def tensions(self, info):
        """At the motors, (B, m) [N]."""
        return info["tensions"] * np.exp(self.phi * np.clip(self.behind(info) / self.half, -1, 1))


def straight(limit, **actuation):
    """A chain without play, sheath and load, whose motors have one limit [N], begun: environment and info."""
    settings = {"tension_limit": limit, "limit_at": "motor", "play_mm": 0.0, "sheath_friction": 0.0}
    env = make(
        load={"magnitude": (0.0, 0.0)}, randomization={"stiffness_spread": 0.0, "actuator_offset_mm": 0.0,
        "link_tolerance_mm": 0.0, "link_tolerance_rad": 0.0}, sensing=QUIET, actuation=settings | actuation,
    )  # fmt: skip
    return env, env.reset(seed=0)[1]


def test_a_pull_is_cut_at_the_fraction_of_its_step_where_its_tension_is_the_limit():
    env, info = straight(3.4)
    chain, before = env.task.mechanism, info["command"]

    def tension(share):
        found = solve_lengths(chain, before - [share, 0.0], tension_limits=(0.0, np.inf), start=start)
        return found.tensions[0]

    start = solve_tensions(chain, info["tensions"])
    low, high = 0.0, 1.0
    assert tension(low) < 3.4 < tension(high)
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if tension(middle) < 3.4 else (low, middle)
    _, _, _, _, after = env.step(np.array([1.0, 0.0], np.float32))
    assert after["tensions"][0] == pytest.approx(3.4, abs=1e-9)
    np.testing.assert_allclose(before - after["command"], [low, 0.0], atol=1e-8)


def test_at_a_motor_the_limit_is_the_tension_before_the_sheath():
    env = make(lanes=24, privileged="info", sensing=QUIET, actuation=LIMITED, load={"process": "step", "hold_steps": 3})
    _, info = env.reset(seed=1)
    motors, rng, ends = Motors(env, info), np.random.default_rng(0), dict.fromkeys(("moved", "play", "held"), 0)
    before = info
    for _ in range(49):
        action = rng.uniform(-0.6, 1.0, (24, 2)).astype(np.float32)
        *_, info = env.step(action)
        moves = motors.positions(before) - motors.positions(info)
        low = info["tensions"] <= 0.5
        free = (action <= 0) & ~low
        np.testing.assert_allclose(moves[free], action[free], atol=1e-5)  # paying out is free
        cut = (action > 0) & (moves < action - 1e-4) & ~low
        assert np.all(moves[cut] > -1e-5)
        whole, place = (action > 0) & ~cut & ~low, motors.behind(info) / motors.half
        tension = motors.tensions(info)
        assert np.all(tension[whole] < motors.limits[whole] + 1e-3)
        held = cut & (moves < 1e-5)
        ending = cut & ~held
        np.testing.assert_allclose(tension[ending], motors.limits[ending], atol=2e-3)  # positions in single precision
        assert np.all(tension[held] > motors.limits[held] - 1e-3)
        ends["moved"] += int((ending & (place > 0.999)).sum())
        ends["play"] += int((ending & (place < 0.99)).sum())
        ends["held"] += int(held.sum())
        before = info
    assert all(count > 20 for count in ends.values()), ends


def test_a_motor_at_rest_holds_whatever_its_tension_becomes():
    env, info = straight(4.0)
    while info["tensions"][0] < 4.0 - 1e-9:
        *_, info = env.step(np.array([1.0, 0.0], np.float32))
    before = info["command"][0]
    for _ in range(3):
        *_, info = env.step(np.array([0.0, 1.0], np.float32))
    assert info["tensions"][0] > 4.0 + 1e-3 and info["command"][0] == pytest.approx(before, abs=1e-9)
    chain = env.task.mechanism
    found = solve_lengths(chain, info["command"], tension_limits=(0.0, np.inf), start=solve_tensions(chain, [4.0, 4.0]))
    np.testing.assert_allclose(info["tensions"], found.tensions, rtol=1e-8)


def test_a_limit_at_tendons_is_drawn_per_tendon_and_met_behind_the_sheath():
    env = make(lanes=6, sensing=QUIET, actuation={"tension_limit": [6.0, 12.0]})
    _, info = env.reset(seed=1)
    limits = info["sampled"]["tension_limits"]
    assert len(np.unique(limits)) == 12 and limits.min() >= 6.0 and limits.max() <= 12.0
    for _ in range(40):
        *_, info = env.step(np.ones((6, 2), np.float32))
    np.testing.assert_allclose(info["tensions"], limits, atol=1e-9)


@worlds
@pytest.mark.parametrize("limit_at", ["tendon", "motor"])
def test_limits_change_neither_scales_nor_other_draws(world, limit_at):
    plain, first, second = (
        make(world, **({"actuation": {"tension_limit": limit, "limit_at": limit_at}} if limit else {}))
        for limit in (None, [20.0, 20.0], [10.0, 30.0])
    )
    assert first.observation_space == second.observation_space
    assert [entry.unit for entry in first.task.entries()] == [entry.unit for entry in plain.task.entries()]
    assert first.config.actuation.play_mm == plain.config.actuation.play_mm  # other settings stay
    for _ in range(2):  # the second episode is drawn by the same generator
        starts = [env.reset(seed=4 if _ == 0 else None) for env in (first, second)]
        assert np.array_equal(starts[0][0], starts[1][0])
        drawn = [start[1]["sampled"] for start in starts]
        assert np.all(drawn[0].pop("tension_limits") == 20.0) and np.ptp(drawn[1].pop("tension_limits")) > 0.0
        assert same(*drawn)
    assert np.array_equal(plain.reset(seed=4)[0], first.reset(seed=4)[0])


@worlds
def test_the_vector_environment_is_many_scalar_ones(world):
    scalars = SyncVectorEnv([lambda: make(world, **EVERYTHING)] * 4)
    vectors = make(world, 4, **EVERYTHING)
    rng = np.random.default_rng(0)
    for native, scalar in zip(vectors.reset(seed=3), scalars.reset(seed=3), strict=True):
        assert_same(native, scalar)
    for _ in range(55):
        actions = rng.uniform(-0.5, 1.0, scalars.action_space.shape).astype(np.float32)
        for native, scalar in zip(vectors.step(actions), scalars.step(actions), strict=True):
            assert_same(native, scalar)


def test_pulls_that_end_in_another_way_are_solved_anew_without_the_other_lanes():
    envs, lanes, taken, anew = make("ArmInstrument", 64, actuation=LIMITED), 64, [], 0
    envs.reset(seed=0)
    steps = envs._buffer.solver._steps
    step = steps._step
    steps._step = lambda first, last: taken.append(last - first) or step(first, last)
    for _ in range(20):
        envs.step(np.ones((lanes, envs.single_action_space.shape[0])))
        assert taken[0] == lanes and max(taken[1:], default=0) <= 8
        anew += sum(taken[1:])
        taken.clear()
    assert 0 < anew < 20 * lanes


@worlds
def test_lanes_go_on_from_states_and_pickles(world):
    env = make(world, 3, **EVERYTHING)
    rollout(env, 0, 20)
    state, copy = env.get_state(), pickle.loads(pickle.dumps(env))
    actions = np.random.default_rng(1).uniform(-0.3, 1.0, (12, *env.action_space.shape)).astype(np.float32)
    expected = [env.step(action) for action in actions]
    env.set_state(state)
    for other in (env, copy):
        assert same(expected, [other.step(action) for action in actions])


@pytest.mark.parametrize("place", ["motor", "tendon"])
def test_a_measured_start_shows_the_start_tension_whatever_is_hidden(place):
    sensing = {"tension_gain_error": 0.1, "tension_offset": 0.4, "tension_at": place, "tension_noise": 0.0}
    unloaded = {"load": {"magnitude": (0.0, 0.0)}, "sensing": sensing}
    env = make(lanes=8, start="measured", **unloaded)
    observation, info = env.reset(seed=0)
    names = [entry.name for entry in env.task.entries()]
    shown = 15.0 * observation[:, [names.index(f"tendon {j} tension") for j in range(2)]]
    np.testing.assert_allclose(shown, 3.0, atol=2e-6)
    sampled = info["sampled"]
    u = np.clip(-2.0 * sampled["motor_starts"] / sampled["play_mm"], -1, 1)
    ratio = np.exp(sampled["sheath_friction"] * u) if place == "motor" else 1.0
    true = (3.0 - sampled["tension_offsets"]) / sampled["tension_gains"] / ratio
    np.testing.assert_allclose(info["tensions"], true, rtol=1e-9)
    assert np.ptp(true) > 0.3 and np.abs(sampled["tension_gains"] - 1.0).max() <= 0.1
    assert np.abs(make(lanes=8, **unloaded).reset(seed=0)[1]["tensions"] - 3.0).max() > 0.3  # as simulated


def test_a_motor_s_servo_is_at_rest_within_its_dead_band():
    env = make(actuation={"dead_band_mm": 0.3, "play_mm": 0.0, "sheath_friction": 0.0})
    _, info = env.reset(seed=0)
    q = goal = info["command"]
    for action in (0.2, 0.2, 0.5, -0.1, -0.6, -1.0, 0.3):
        *_, info = env.step(np.full(2, action, np.float32))
        goal = goal - np.float32(action)
        q = np.clip(q, goal - 0.3, goal + 0.3)
        np.testing.assert_allclose(info["command"], q, atol=1e-9)


def test_limits_are_whole_counts_of_the_motor_s_current():
    env = make(lanes=20, actuation=LIMITED | {"current_resolution": 0.5})
    counts = env.reset(seed=0)[1]["sampled"]["tension_limits"] / 0.5
    assert np.array_equal(counts, np.round(counts)) and len(np.unique(counts)) > 5


def test_a_reset_can_fix_limits_where_there_are_any():
    env = make(actuation=LIMITED)
    assert np.array_equal(env.reset(options={"tension_limit": [7.0, 8.0]})[1]["sampled"]["tension_limits"], [7.0, 8.0])
    with pytest.raises(InvalidInput, match="tension_limit"):
        make().reset(options={"tension_limit": 7.0})


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"actuation": {"limit_at": "sheath"}}, "one of 'tendon', 'motor'"),
        ({"actuation": {"tension_limit": [30.0, 10.0]}}, "tension_limit"),
        (
            {"actuation": {"tension_limit": [20.0]}},
            r"tension_limit = \[20.0\]: expected a number or two, \(low, high\) \[N\]. Write 20 or \(20, 20\)",
        ),
        ({"actuation": {"play_mm": [99.0]}}, "play_mm = 99.0: expected a finite number from 0 to 20"),
        ({"actuation": {"tension_limit": 2.0}}, "above 3 N"),
        ({"actuation": LIMITED, "start_tension": 7.0}, "above 7 N"),
        ({"start": "homed"}, "one of .*measured"),
        ({"sensing": {"tension_at": "sheath"}}, "one of .*tendon"),
    ],
)
def test_settings_that_cannot_be_used_are_refused_in_one_line(settings, match):
    with pytest.raises(ConfigError, match=match) as refused:
        InstrumentConfig.from_dict(settings)
    assert "\n" not in str(refused.value)


def test_a_number_is_the_range_of_one_limit():
    assert ActuationConfig(tension_limit=20.0) == ActuationConfig(tension_limit=[20.0, 20.0])


@pytest.mark.parametrize("stem", ["Instrument", "InstrumentShift", "SlowCamera", "LatePose", "ArmInstrument"])
def test_version_1_takes_a_limit_for_every_motor_and_keeps_its_other_settings(stem):
    first, plain, limited = (
        gymnasium.make(f"rj_gym/{stem}-v{version}", **settings).unwrapped
        for version, settings in ((0, {}), (1, {}), (1, {"actuation": {"tension_limit": [20, 20]}}))
    )
    assert limited.observation_space == plain.observation_space == first.observation_space
    assert [entry.unit for entry in plain.task.entries()] == [entry.unit for entry in first.task.entries()]
    changed = {"tension_limit": (20.0, 20.0)}
    assert limited.config == plain.config.updated({"actuation": changed})
    assert np.all(limited.reset(seed=0)[1]["sampled"]["tension_limits"] == 20.0)


@pytest.mark.parametrize(
    ("actuation", "held", "possible"),
    [
        ({}, 15.0, 15.0),
        ({"tension_limit": [10.0, 30.0]}, 10.0, 30.0),
        ({"limit_at": "motor"}, 15.0 / np.exp(0.6), np.inf),
        ({"limit_at": "motor", "tension_limit": [10.0, 30.0]}, 10.0, np.inf),
        ({"limit_at": "motor", "tension_limit": 60.0}, 15.0, np.inf),
    ],
)
def test_models_plan_with_tensions_that_motors_hold_and_expect_all_that_there_can_be(actuation, held, possible):
    config = InstrumentConfig.from_dict({"actuation": actuation})
    assert config.held_tensions == pytest.approx((0.5, held)) and config.possible_tensions == (0.5, possible)
