"""The bank of Kalman filters: its model, its formulas one by one, and what it finds out in environments."""

from types import SimpleNamespace

import numpy as np
import pytest

from agents.controllers.controller import Reading
from agents.controllers.filters import kalman, kernels
from agents.controllers.filters.bank import Bank
from agents.controllers.filters.filters import Filters
from agents.controllers.filters.hypotheses import FilterSettings, Hypotheses, evenly_spread
from agents.controllers.filters.kernels import Play, StateLayout
from agents.controllers.filters.levers import turn_gravity
from agents.controllers.filters.models import model_of
from agents.controllers.privileged_feedback import privileged
from rj_gym.registry import task_of
from rj_gym.tracking.config import FlexibleArmConfig, PitchYawConfig, TrackingConfig
from rj_gym.tracking.vector import ArmInstrumentVectorEnv, PitchYawVectorEnv, RollingJointVectorEnv
from rj_gym.tracking.worlds import ArmInstrumentConfig, InstrumentConfig, SlowCameraConfig
from rollingjoint import pitch_yaw
from rollingjoint.errors import ConfigError

EXACT = {"stiffness_spread": 0.0, "link_tolerance_mm": 0.0, "link_tolerance_rad": 0.0, "actuator_offset_mm": 0.0}
SURE = {"offset_sd_mm": 0.0, "offset_walk_mm": 0.0, "stiffness_sd": 0.0, "bias_sd_mm": 0.0, "force_walk": 0.0}


PLANAR = StateLayout.of(2, 2, 2)


def instrument(**settings):
    return task_of(InstrumentConfig.from_dict(settings))


def arm_instrument(**settings):
    return task_of(ArmInstrumentConfig.from_dict(settings))


def instrument_in_space(**settings):
    return task_of(PitchYawConfig.from_dict({"sensing": {"pose": "none"}} | settings))


def rows_of_play(task, rng, rows):
    """Places in the play, states and motors of rows, one episode each."""
    m, d = task.mechanism.n_tendons, task.dimension
    at = StateLayout.of(d, m, d)
    spreads = [0.3] * 2 + [0.1] * (d - 2) + [0.1] * m + [0.05] * m + [0.2] * d + [0.0] * 3 * m
    states = rng.normal(size=(rows, at.total)) * spreads
    states[:, at.half_widths : at.frictions] = rng.uniform(0.3, 1.5, (rows, m))
    states[:, at.frictions : at.starts] = rng.uniform(0.1, 0.6, (rows, m))
    played = task.mechanism.neutral_lengths - rng.uniform(0.5, 3.0, (rows, m))
    play = Play(played, rng.choice([-1.0, 0.3, 1.0], (rows, m)), rng.choice([0.0, 1.0], (rows, m)))
    motors = played - states[:, at.half_widths : at.frictions] * rng.uniform(-1, 1, (rows, m))
    return play, states, motors


def predicted(task, play, states, motors):
    """Link angles, tip and measured tensions of the model, and their derivatives by the states."""
    model = model_of(task, np.array([3]))
    found = model.predict(states, play, np.repeat(task.mechanism.neutral_angles[None], len(states), axis=0))
    expected, columns = np.empty_like(motors), np.empty_like(found.linear.tensions)
    at = model.places
    kernels.expect_tensions(found.solved, found.linear, play, states, motors, at, expected, columns)
    biases = states[:, at.bias : at.half_widths]
    values = np.hstack([found.link_angles, found.equilibria.tip + biases, expected])
    return values, np.concatenate([found.linear.angles, found.linear.tip, columns], axis=1)


@pytest.mark.parametrize(
    "task",
    [
        instrument(),
        instrument(mechanism="two_segment"),
        arm_instrument(mechanism="small_arm"),
        arm_instrument(),
        instrument_in_space(),
        instrument_in_space(mechanism=pitch_yaw(weight=0.05).replace(name="heavy tube")),
    ],
    ids=lambda task: task.mechanism.name,
)
def test_derivatives_of_the_model_are_central_differences(task):
    rng, step = np.random.default_rng(0), 1e-5
    play, states, motors = rows_of_play(task, rng, 12)
    _, columns = predicted(task, play, states, motors)
    for i in range(states.shape[1]):
        sides = []
        for way in (step, -step):
            moved = states.copy()
            moved[:, i] += way
            there = Play(play.played.copy(), play.by_width, play.by_place)
            at = StateLayout.of(task.dimension, play.played.shape[1], task.dimension)
            kernels.correct_play(there, moved - states, at)
            sides.append(predicted(task, there, moved, motors)[0])
        expected = (sides[0] - sides[1]) / (2 * step)
        large = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(columns[:, :, i], expected, atol=2e-4 * large, err_msg=f"state {i}")


def test_nothing_is_learnt_where_the_model_has_no_equilibrium():
    task = instrument()
    play, states, motors = rows_of_play(task, np.random.default_rng(1), 2)
    play.played[1] = 1e4  # slack
    states[1, :2] = 1e13
    values, columns = predicted(task, play, states, motors)
    assert np.abs(columns[0]).max() > 0.1
    np.testing.assert_array_equal(columns[1, 6:], 0.0)
    assert np.all(np.isfinite(values[0]))
    covariances, evidence, before = np.tile(np.eye(14), (2, 1, 1)), np.zeros(2), states.copy()
    expected, changes = values[:, 6:].copy(), columns[:, 6:].copy()  # contiguous, as the kernel is compiled for
    kalman.update(states, covariances, evidence, expected, changes, np.ones((2, 2)), np.ones((2, 2)))
    np.testing.assert_array_equal(states[1], before[1])
    assert evidence[1] == 2 * kalman.UNEXPECTED
    assert np.abs(states[0] - before[0]).max() > 0.01


def test_an_update_is_that_of_the_textbook():
    rng = np.random.default_rng(2)
    roots = rng.normal(size=(5, 6, 6))
    P, x, C = roots @ roots.swapaxes(1, 2), rng.normal(size=(5, 6)), rng.normal(size=(5, 3, 6))
    predicted, measured, R = rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), rng.uniform(0.1, 2.0, (5, 3))
    states, covariances, evidence = x.copy(), P.copy(), np.zeros(5)
    kalman.update(states, covariances, evidence, predicted, C, measured, R)
    for b in range(5):
        S = C[b] @ P[b] @ C[b].T + np.diag(R[b])
        K, v = P[b] @ C[b].T @ np.linalg.inv(S), measured[b] - predicted[b]
        np.testing.assert_allclose(states[b], x[b] + K @ v, atol=1e-10)
        np.testing.assert_allclose(covariances[b], P[b] - K @ C[b] @ P[b], atol=1e-10)
        assert evidence[b] == pytest.approx(-0.5 * (v @ np.linalg.solve(S, v) + np.linalg.slogdet(S)[1]))


def test_on_a_linear_system_estimates_are_unbiased_and_as_uncertain_as_they_say():
    """4,000 random walks measured 20 times; the mean squared error over the variance is a mean of chi squares."""
    rng, rows = np.random.default_rng(3), 4000
    truth = rng.normal(size=(rows, 2)) * [1.0, 2.0]
    states, covariances = np.zeros((rows, 2)), np.tile(np.diag([1.0, 4.0]), (rows, 1, 1))
    memory, walk = np.array([0.9, 1.0]), np.array([0.19, 0.01])
    for _ in range(20):
        kalman.forecast(states, covariances, memory, walk)
        truth = memory * truth + np.sqrt(walk) * rng.normal(size=(rows, 2))
        columns = rng.normal(size=(rows, 1, 2))
        measured = np.sum(columns[:, 0] * truth, axis=1, keepdims=True) + 0.5 * rng.normal(size=(rows, 1))
        expected = np.sum(columns[:, 0] * states, axis=1, keepdims=True)
        kalman.update(states, covariances, np.zeros(rows), expected, columns, measured, np.full((rows, 1), 0.25))
    errors = states - truth
    assert np.all(np.abs(errors.mean(axis=0)) < 4 * errors.std(axis=0) / np.sqrt(rows))
    normalised = np.einsum("bi,bij,bj->b", errors, np.linalg.inv(covariances), errors)
    assert normalised.mean() == pytest.approx(2.0, abs=4 * 2.0 / np.sqrt(rows))


def behind(seen):
    """True commands of the tendons minus the motors, (B, m) [mm]."""
    return privileged(seen, "tendon 0 command minus motor", "tendon 1 command minus motor")


def test_the_play_of_a_filter_is_that_of_the_environment():
    """As long as no tension comes to its limit, where the environment moves motors along with their tendons."""
    settings = {"play_mm": (1.3, 1.3), "sheath_friction": (0.2, 0.2)}
    task = {"start_tension": 8.0, "load": {"magnitude": (0.0, 0.2)}}
    env = RollingJointVectorEnv(20, actuation=settings, privileged="observation", episode_steps=40, **task)
    observation, _ = env.reset(seed=4)
    seen = Reading(observation, env.task)
    play = Play(seen.commands + behind(seen), np.zeros((20, 2)), np.zeros((20, 2)))
    states, rng, edges = np.zeros((20, 14)), np.random.default_rng(4), 0
    states[:, 8:10] = 0.65
    free = np.ones(20, bool)
    for _ in range(35):
        observation, *_, info = env.step((rng.uniform(-0.9, 0.9, (20, 1)) * [1.0, -1.0]).astype(np.float32))
        seen = Reading(observation, env.task)
        kernels.move_play(play, states, seen.commands, PLANAR)
        free &= np.all((info["tensions"] > 0.5) & (info["tensions"] < 15.0), axis=1)
        np.testing.assert_allclose(play.played[free], (seen.commands + behind(seen))[free], atol=1e-5)
        edges += np.sum(np.abs(behind(seen)[free]) > 0.6499)
    assert free.sum() > 5 and edges > 100  # tendons were taken along


def test_derivatives_of_the_play_are_those_of_a_walk():
    """Tendons that no edge has touched go with their place; others with the width, from the side that took them."""
    rng, step = np.random.default_rng(5), 1e-6
    motors = 100.0 + np.cumsum(rng.uniform(-0.5, 0.5, (12, 40, 2)), axis=0)
    half, place = rng.uniform(0.2, 2.0, (40, 2)), rng.uniform(-0.9, 0.9, (40, 2))

    def end(half, offset):
        play = Play(100.0 + half * place + offset, place.copy(), np.ones((40, 2)))
        states = np.zeros((40, 14))
        states[:, 8:10] = half
        for there in motors:
            kernels.move_play(play, states, there, PLANAR)
        return play

    found = end(half, 0.0)
    by_width = (end(half + step, 0.0).played - end(half - step, 0.0).played) / (2 * step)
    by_place = (end(half, step).played - end(half, -step).played) / (2 * step)
    np.testing.assert_allclose(found.by_width, by_width, atol=1e-6)
    np.testing.assert_allclose(found.by_place, by_place, atol=1e-6)
    assert 0.1 < found.by_place.mean() < 0.9


def driven(task_settings, filter_settings, lanes=40, steps=25, world=InstrumentConfig, seed=9_000):
    """The bank, the last info and estimate after steps that pull tendons in and pay them out by turns."""
    config = world.from_dict({"episode_steps": steps + 1} | task_settings)
    env = RollingJointVectorEnv(lanes, config=config)
    observation, info = env.reset(seed=seed)
    bank = Bank(env.task, FilterSettings.from_dict(filter_settings))
    bank.reset(np.ones(lanes, bool))
    for step in range(steps):
        bank.take_in(Reading(observation, env.task))
        way = -1.0 if 6 <= step < 14 else 1.0
        observation, *_, info = env.step(np.tile([way, 0.4 * way], (lanes, 1)).astype(np.float32))
    return bank, info, bank.take_in(Reading(observation, env.task))


def test_exact_tensions_tell_the_load_and_the_tip():
    """Measured: force within 0.05 N and tip within 0.04 mm in 90 % of the episodes."""
    exact = {"randomization": EXACT, "actuation": {"play_mm": 0.0, "sheath_friction": 0.0}}
    exact["sensing"] = {"tension_noise": 0.0}
    settings = SURE | {"tension_sd": 0.1, "tension_share": 0.0}
    bank, info, estimate = driven(exact, settings)
    forces = np.linalg.norm(bank.belief.states[:, :2] - info["load"]["force"], axis=1)
    tips = np.linalg.norm(estimate.tip - info["tip"], axis=1)
    assert np.percentile(forces, 90) < 0.1
    assert np.percentile(tips, 90) < 0.1


def test_vectors_turn_gravity_by_their_length_towards_where_they_point():
    turns = np.array([[0.0, 0.0], [0.3, 0.4], [1e-5, -2e-5], [0.0, 2.0]])
    gravity, by_turn = np.empty((4, 3)), np.empty((4, 3, 2))
    turn_gravity(turns, gravity, by_turn)
    np.testing.assert_allclose(np.linalg.norm(gravity, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(gravity[1], [0.6 * np.sin(0.5), 0.8 * np.sin(0.5), np.cos(0.5)])
    for axis in range(2):
        ahead, back = np.empty((4, 3)), np.empty((4, 3))
        for found, way in ((ahead, 1e-6), (back, -1e-6)):
            turn_gravity(turns + way * np.eye(2)[axis], found, np.empty((4, 3, 2)))
        np.testing.assert_allclose(by_turn[..., axis], (ahead - back) / 2e-6, atol=1e-9)


def arm_driven(steps, task_settings, filter_settings, lanes=12):
    """The bank of an arm, the last info and estimate after steps that bend it to and fro."""
    env = ArmInstrumentVectorEnv(lanes, config=ArmInstrumentConfig.from_dict(task_settings))
    observation, info = env.reset(seed=9_000)
    bank = Bank(env.task, FilterSettings.from_dict(filter_settings))
    bank.reset(np.ones(lanes, bool))
    for step in range(steps):
        bank.take_in(Reading(observation, env.task))
        way = np.array([0.5, 0.2, -0.5, -0.2] * 2) * (-1.0 if step < 4 else 1.0)
        observation, *_, info = env.step(np.tile(way, (lanes, 1)).astype(np.float32))
    return bank, info, bank.take_in(Reading(observation, env.task))


EXACT_ARM = {
    "randomization": {
        "stiffness_spread": 0.0,
        "hinge_stiffness_spread": 0.0,
        "weight_spread": 0.0,
        "actuator_offset_mm": 0.0,
    },
    "actuation": {"play_mm": 0.0, "sheath_friction": 0.0},
    "sensing": {"tension_noise": 0.0},
    "friction": None,
    "start_tension": 6.0,
}


def leaning(info):
    """By how much gravity is turned from hanging, (B, 2) [rad]."""
    gravity = info["gravity"]
    across = np.linalg.norm(gravity[:, :2], axis=1, keepdims=True)
    return np.arctan2(across, gravity[:, 2:]) * gravity[:, :2] / across


def test_lengths_at_the_start_tell_where_gravity_leans():
    bank, info, _ = arm_driven(0, EXACT_ARM, SURE | {"start_sd_mm": 1e-3, "tension_sd": 1e4})
    np.testing.assert_allclose(bank.belief.states[:, :2], leaning(info), atol=1e-3)
    assert np.abs(leaning(info)).max() > 0.3


def test_exact_tensions_tell_payload_and_tip_of_an_arm():
    settings = SURE | {"start_sd_mm": 0.01, "tension_sd": 0.02, "tension_share": 0.0}
    bank, info, estimate = arm_driven(8, EXACT_ARM, settings)
    payloads = 0.25 + bank.belief.states[:, 2]
    np.testing.assert_allclose(payloads, np.linalg.norm(info["load"]["force"], axis=1), atol=0.02)
    np.testing.assert_allclose(estimate.tip, info["tip"], atol=0.5)


def test_exact_tensions_tell_the_force_at_the_tip_of_a_tube():
    env = PitchYawVectorEnv(12, sensing={"pose": "none"}, start_tension=6.0)
    observation, info = env.reset(seed=9_000)
    settings = SURE | {"start_sd_mm": 0.01, "tension_sd": 0.005, "tension_share": 0.0}
    bank = Bank(env.task, FilterSettings.from_dict(settings))
    bank.reset(np.ones(12, bool))
    for step in range(8):
        bank.take_in(Reading(observation, env.task))
        way = np.array([0.5, 0.2, -0.5, -0.2] * 2) * (-1.0 if step < 4 else 1.0)
        observation, *_, info = env.step(np.tile(way, (12, 1)).astype(np.float32))
    estimate = bank.take_in(Reading(observation, env.task))
    np.testing.assert_allclose(bank.belief.states[:, :3], info["load"]["force"], atol=0.02)
    np.testing.assert_allclose(estimate.tip, info["tip"], atol=0.2)


def test_pictures_of_an_arm_show_how_far_its_tip_is_off():
    task = task_of(FlexibleArmConfig.from_dict({"load": {"magnitude": (0.0, 0.0)}, "gravity": {"tilt": (0.0, 0.0)}}))
    bank = Bank(task, FilterSettings.from_dict(SURE | {"bias_sd_mm": 5.0, "position_sd_mm": 0.01}))
    bank.reset(np.ones(2, bool))
    yes = np.ones(2, bool)
    common = {"commands": task.mechanism.neutral_lengths - np.full((2, 8), 0.3), "tensions": np.full((2, 8), 3.0)}
    tip = np.array([[3.0, -2.0, 699.0]] * 2)
    estimate = bank.take_in(SimpleNamespace(**common, tip=tip, picture_is_new=yes, picture_age=np.zeros(2)))
    np.testing.assert_allclose(estimate.tip, tip, atol=0.05)


def test_play_and_sheath_friction_are_found_from_tensions():
    """One filter, which begins in the middle of the ranges; measured: medians of 0.09 of 0.31 mm, of 0.02 of 0.12."""
    settings = {"randomization": EXACT, "load": {"magnitude": (0.0, 0.0)}, "privileged": "info"}
    assumed = {"tension_sd": 0.1, "tension_share": 0.01, "width_share": 0.3, "friction_share": 0.3, "place_share": 0.58}
    bank, info, _ = driven(settings, SURE | assumed | {"hypotheses": 1}, steps=22)
    names = [entry.name for entry in task_of(InstrumentConfig()).privileged_entries()]
    for what, begun, columns in (("half play", 0.875, slice(8, 10)), ("sheath friction", 0.3, slice(10, 12))):
        true = info["privileged"][:, [names.index(f"tendon {j} {what}") for j in range(2)]]
        left = np.median(np.abs(bank.belief.states[:, columns] - true))
        assert left < 0.4 * np.median(np.abs(begun - true)), what


def test_the_bank_finds_the_loaded_link():
    """Pictures of every step; measured: the right one of four in all of 40 episodes."""
    settings = {"sensing": {"period": 1, "delay": 0}, "load": {"magnitude": (0.6, 1.0), "process": "constant"}}
    settings["randomization"] = EXACT | {"position_noise_mm": 0.1, "angle_noise_rad": 0.002}
    assumed = {"tension_sd": 0.1, "tension_share": 0.0, "angle_sd": 0.002, "position_sd_mm": 0.1, "tempering": 1.0}
    bank, info, _ = driven(settings, SURE | assumed, world=SlowCameraConfig)
    likeliest = bank.hypotheses.links[bank.weights.argmax(axis=1)]
    assert np.mean(likeliest == info["load"]["link"]) > 0.9
    np.testing.assert_allclose(bank.weights.sum(axis=1), 1.0)


def test_a_late_picture_counts_as_if_it_had_come_in_time():
    """Two banks see the same tensions; one has the picture of step 1 at once, the other two steps later."""
    rng, lanes = np.random.default_rng(6), 5
    tasks = [task_of(SlowCameraConfig.from_dict({"sensing": {"period": 1, "delay": d}})) for d in (0, 2)]
    settings = FilterSettings.from_dict({"tension_sd": 0.1})
    banks = [Bank(task, settings) for task in tasks]
    for bank in banks:
        bank.reset(np.ones(lanes, bool))
    neutral, yes, no = tasks[0].mechanism.neutral_lengths, np.ones(lanes, bool), np.zeros(lanes, bool)
    poses = np.zeros((lanes, 5, 3))
    poses[:, 1:, 2] = rng.normal(size=(lanes, 4)) * 0.1
    tip = np.array([0.0, 100.0]) + rng.normal(size=(lanes, 2))
    for step in range(4):
        common = {"commands": neutral - 0.6 - 0.5 * step + np.zeros((lanes, 2)), "poses": poses, "tip": tip}
        common["tensions"] = 3.0 + step + 0.1 * rng.normal(size=(lanes, 2))
        for bank, new in zip(banks, ((1, 0), (3, 2)), strict=True):
            age = np.full(lanes, new[1])
            news = {"picture_is_new": yes if step == new[0] else no, "picture_age": age}
            estimate = bank.take_in(SimpleNamespace(**common, **news))
    in_time, late = (bank.belief for bank in banks)
    np.testing.assert_allclose(late.states, in_time.states, atol=1e-7)
    np.testing.assert_allclose(late.covariances, in_time.covariances, atol=1e-7)
    np.testing.assert_allclose(banks[1].weights, banks[0].weights, atol=1e-7)
    assert np.abs(in_time.states[:, :2]).max() > 0.05
    assert np.all(np.isfinite(estimate.tip))


def test_every_link_that_may_be_loaded_has_hypotheses_and_the_first_is_the_middle_of_the_ranges():
    task = task_of(TrackingConfig.from_dict({"actuation": {"play_mm": (1.0, 2.0), "sheath_friction": (0.0, 0.4)}}))
    found = Hypotheses.of(task.config, FilterSettings.from_dict({"hypotheses": 8}), 5, 2)
    assert len(found) == 4 * 8
    assert list(found.links[::8]) == [1, 2, 3, 4]
    np.testing.assert_allclose(found.half_widths[::8], 0.75)
    np.testing.assert_allclose(found.frictions[::8], 0.2)
    np.testing.assert_allclose(found.places[::8], 0.0)
    assert found.half_widths.min() >= 0.5 and found.half_widths.max() <= 1.0 and np.ptp(found.half_widths) > 0.3
    wider = Hypotheses.of(task.config, FilterSettings.from_dict({"play_mm": (1.0, 6.0)}), 5, 2)
    assert wider.half_widths.max() > 2.0
    assert len(Hypotheses.of(TrackingConfig(), FilterSettings(hypotheses=8), 5, 2)) == 4


def test_points_are_spread_evenly():
    points = evenly_spread(256, 6)
    assert points.min() >= 0.0 and points.max() < 1.0
    for column in points.T:
        counts, _ = np.histogram(column, 16, (0.0, 1.0))
        assert counts.min() >= 8 and counts.max() <= 24


def test_without_play_and_friction_of_no_width_filters_are_those_of_a_plain_load():
    task = task_of(TrackingConfig.from_dict({"load": {"link": "tip"}}))
    filters = Filters(task, FilterSettings(), Hypotheses.of(task.config, FilterSettings(), 5, 2))
    belief = filters.begin(np.tile(task.mechanism.neutral_lengths - 0.6, (3, 1)))
    assert np.all(belief.covariances[:, 8:, :] == 0.0) and np.all(belief.states[:, 8:] == 0.0)
    np.testing.assert_allclose(np.diagonal(belief.covariances, axis1=1, axis2=2)[:, :2], 1.0 / 6.0)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"hypotheses": 0}, "filter.hypotheses"),
        ({"tempering": 1.5}, "filter.tempering"),
        ({"tension_sd": 0.0}, "filter.tension_sd"),
        ({"play_mm": (2.0, 1.0)}, "filter.play_mm"),
        ({"tension": 1.0}, "tension_sd"),
    ],
)
def test_settings_that_make_no_sense_are_refused(wrong, message):
    with pytest.raises(ConfigError, match=message):
        FilterSettings.from_dict(wrong)
