"""The arm's lanes and episodes: equilibria, observation, reward, randomisation; lanes do not see each other."""

import dataclasses
import pickle

import numpy as np
import pytest

from rj_gym import FlexibleArmConfig, arm_observation_entries
from rj_gym.core.columns import ANGLE, OWN, REWARD
from rj_gym.registry import task_of
from rj_gym.tracking.arm import ArmTask, goal_angles
from rj_gym.tracking.draws import over_time
from rj_gym.tracking.episodes import TrackingEpisodeBuffer
from rj_gym.tracking.measuring import rotation_vector, turn_frame
from rollingjoint import Gravity, Status, WorldForce
from rollingjoint.chain import se3
from rollingjoint.chain.presets import flexible_arm, small_arm
from rollingjoint.compiled import standalone
from rollingjoint.statics.solve import solve_lengths, solve_lengths_batch, solve_tensions, solve_tensions_batch
from tests.rj_gym.tracking.test_sampling import HARDWARE, assert_lane_is_alone
from tests.rj_gym.watched_solver import watch_solver

RANDOMISED = {
    "position_noise_mm": 1.0,
    "angle_noise_rad": 0.1,
    "stiffness_spread": 0.3,
    "hinge_stiffness_spread": 0.2,
    "weight_spread": 0.4,
    "actuator_offset_mm": 0.5,
}
EVERYTHING = {
    "mechanism": "small_arm",
    "orientation": True,
    "observe_load": True,
    "start": "random",
    "load": {"process": "ou"},
    "target": {"process": "path"},
    "randomization": RANDOMISED,
}


def started(count=3, goal=False, seeds=None, **settings):
    lanes = TrackingEpisodeBuffer(ArmTask(FlexibleArmConfig.from_dict(settings)), count, goal)
    episodes, observation = lanes.begin([np.random.default_rng(seed) for seed in seeds or range(count)])
    return lanes, episodes, now(lanes, observation)


def now(lanes, observation):
    """Copies of everything that the lanes say of themselves."""
    readings = lanes.state.readings.copy()
    info = lanes.task.state_info(readings) | {"terms": lanes.task.reward_info(readings), "readings": readings}
    info |= {"poses": lanes.state.poses.copy(), "observation": observation, "reward": readings[:, REWARD]}
    return info


def advance(lanes, actions):
    lanes.accept(actions)
    return now(lanes, lanes.advance())


def sampled(lanes, **settings):
    task = ArmTask(FlexibleArmConfig.from_dict({"mechanism": "small_arm", "episode_steps": 30} | settings))
    return task, task.sample([np.random.default_rng(seed) for seed in range(lanes)])


def hanging(arm, gravity, weights=None):
    """The weights of an arm along a direction, as the physics makes them."""
    load = arm.gravity(tuple(gravity))
    return load if weights is None else Gravity([0.0, *weights], tuple(gravity), load.points)


def test_one_function_makes_the_task_of_a_configuration():
    task = task_of(FlexibleArmConfig())
    assert type(task) is ArmTask and task.dimension == 3 and task.mechanism.name == "flexible_arm"
    assert task.length == pytest.approx(700.0) and task.neutral_lengths.shape == (8,)


def test_a_step_is_the_elastic_equilibrium_of_the_moved_commands_under_gravity_and_payload():
    lanes, episodes, state = started(load={"magnitude": (0.2, 0.5)})
    actions = np.random.default_rng(0).uniform(-1, 1, (3, 8))
    after = advance(lanes, actions)
    for lane, action in enumerate(actions):
        arm, command = lanes.task.mechanism, state["command"][lane] - action
        payload = WorldForce(-1, tuple(episodes.payloads[lane, 0] * episodes.gravity[lane]))
        loads = [hanging(arm, episodes.gravity[lane]), payload]
        eq = solve_lengths(arm, command, loads, tension_limits=(0.5, 15.0))
        assert np.allclose(after["poses"][lane], eq.poses, atol=1e-6)
        assert np.allclose(after["tensions"][lane], eq.tensions, atol=1e-6)
        held = (eq.tensions > 0.5) & (eq.tensions < 15.0)
        assert np.allclose(after["command"][lane][held], command[held], atol=1e-9) and not held.all()


def test_an_episode_begins_at_its_start_tensions_and_then_the_payload_is_applied():
    lanes, episodes, state = started(start="random", load={"magnitude": (0.2, 0.5)})
    for lane in range(3):
        arm, tensions = lanes.task.mechanism, episodes.start_tensions[lane]
        free = solve_tensions(arm, tensions, [hanging(arm, episodes.gravity[lane])])
        command = free.lengths - tensions / arm.stiffnesses
        payload = WorldForce(-1, tuple(episodes.payloads[lane, 0] * episodes.gravity[lane]))
        loaded = solve_lengths(arm, command, [hanging(arm, episodes.gravity[lane]), payload])
        assert np.allclose(state["command"][lane], command, atol=1e-7)
        assert np.allclose(state["tip"][lane], loaded.tip, atol=1e-5)
        assert np.linalg.norm(loaded.tip - free.tip) > 0.1


@pytest.mark.parametrize("mechanism", ["small_arm", "flexible_arm"])
def test_targets_are_tip_poses_of_unloaded_equilibria_at_log_uniform_tensions(mechanism):
    lanes, episodes, state = started(4, mechanism=mechanism, orientation=True)
    assert episodes.target_tensions.min() >= 1.0 and episodes.target_tensions.max() <= 5.0
    for lane in range(4):
        arm = lanes.task.mechanism
        found = solve_tensions(arm, episodes.target_tensions[lane, 0], [hanging(arm, episodes.gravity[lane])])
        assert np.allclose(lanes.course.targets[lane, 0, :3], found.tip, atol=1e-6)
        assert np.allclose(lanes.course.targets[lane, 0, 3:].reshape(3, 3), found.rotations[-1], atol=1e-8)
        turn = np.linalg.norm(se3.rotation_vector(found.rotations[-1] @ state["poses"][lane, -1, :3, :3].T))
        assert state["angle_error_rad"][lane] == pytest.approx(turn, abs=1e-9) and turn > 0.01


def test_load_tables_are_the_true_loads_and_those_without_payload():
    task, drawn = sampled(5, **(EVERYTHING | {"mechanism": "flexible_arm", "episode_steps": 6}))
    lanes = TrackingEpisodeBuffer(task, 5)
    lanes.begin([np.random.default_rng(seed) for seed in range(5)])
    for _ in range(3):
        lanes.accept(np.zeros((5, 8)))
        lanes.advance()
    chains = [drawn.mechanisms[design] for design in drawn.designs]
    loads = task.load_tables(drawn, 3)
    commands = lanes.solver.laws.command
    eq = solve_lengths_batch(chains, commands, loads, tension_limits=(0.5, 15.0))
    assert np.allclose(eq.tip, lanes.state.readings[:, 8:11], atol=1e-6)
    assert np.allclose(loads[:, -1, 4:7], drawn.payloads[:, 3, None] * drawn.gravity)
    base = task.base_load_tables(drawn)
    aims = solve_tensions_batch(chains, drawn.target_tensions[:, 4], base).tip
    assert np.allclose(aims, lanes.course.targets[:, 4, :3], atol=1e-6)
    weights = np.linalg.norm(base[..., 4:7].sum(axis=1), axis=-1)
    assert np.allclose(weights, drawn.weights.sum(axis=1)) and np.ptp(weights) > 0.01


def test_gravity_is_uniform_over_the_cone_and_payloads_over_their_range():
    _, drawn = sampled(3000, gravity={"tilt": (0.2, 0.9)}, load={"magnitude": (0.1, 0.4)})
    assert np.allclose(np.linalg.norm(drawn.gravity, axis=1), 1.0)
    tilt = np.arccos(drawn.gravity[:, 2])
    assert 0.2 <= tilt.min() < 0.25 and 0.88 < tilt.max() <= 0.9
    middle = 0.5 * (np.cos(0.2) + np.cos(0.9))
    assert np.mean(drawn.gravity[:, 2] > middle) == pytest.approx(0.5, abs=0.03)  # uniform on the sphere
    assert np.abs(drawn.gravity[:, :2].mean(axis=0)).max() < 0.03
    assert 0.1 <= drawn.payloads.min() < 0.11 and 0.39 < drawn.payloads.max() <= 0.4


def test_payloads_jump_or_wander_within_their_range():
    _, jumping = sampled(300, load={"process": "step", "hold_steps": 10}, episode_steps=100)
    assert np.mean(np.diff(jumping.payloads, axis=1) != 0) == pytest.approx(0.1, abs=0.01)
    _, drifting = sampled(1000, load={"process": "ou", "magnitude": (0.2, 0.6), "correlation_steps": 8})
    away = drifting.payloads - 0.4
    assert np.abs(away).max() <= 0.2 + 1e-12 and away.std() == pytest.approx(0.1, rel=0.1)
    assert np.mean(away[:, :-8] * away[:, 8:]) / np.mean(away**2) == pytest.approx(np.exp(-1), abs=0.06)
    assert drifting.forces.shape == (1000, 31, 3)


def test_randomised_arms_stay_within_the_stated_ranges_and_share_their_geometry():
    task, drawn = sampled(40, **EVERYTHING)
    nominal = task.mechanism
    for values, base, spread in (
        (drawn.stiffnesses, nominal.stiffnesses, 0.3),
        (drawn.hinge_stiffnesses, [bead.stiffness for bead in nominal.beads], 0.2),
        (drawn.weights, [bead.weight for bead in nominal.beads], 0.4),
    ):
        away = values / base - 1
        assert np.abs(away).max() <= spread and np.abs(away).max() > 0.9 * spread
    arm = drawn.mechanisms[7]
    rebuilt = nominal.replace(beads=arm.beads, tendons=arm.tendons)
    assert all(np.array_equal(one, other) for one, other in zip(arm.arrays, rebuilt.arrays, strict=True))
    assert np.array_equal(arm.stiffnesses, rebuilt.stiffnesses)
    assert drawn.noise[..., :3].std() == pytest.approx(1.0, rel=0.05)
    assert drawn.noise[..., 3:].std() == pytest.approx(0.1, rel=0.05)


def test_randomisation_leaves_gravity_payload_and_start_of_a_seed_as_they_are():
    plain, varied = (sampled(3, **(EVERYTHING | {"randomization": some}))[1] for some in ({}, RANDOMISED))
    for name in ("gravity", "payloads", "start_tensions", "target_tensions"):
        assert np.array_equal(getattr(plain, name), getattr(varied, name)), name
    assert plain.mechanisms == (sampled(1)[0].mechanism,) or len(plain.mechanisms) == 1


def test_a_lane_does_not_depend_on_the_lanes_beside_it():
    everything = EVERYTHING | HARDWARE | {"friction": {"shared": False}}
    _, many = sampled(4, **everything)
    alone = sampled(1, **everything)[0].sample([np.random.default_rng(2)])
    assert_lane_is_alone(many, 2, alone)


def reference_observation(lanes, state, time):
    """The observation with everything shown, in plain NumPy."""
    task, config = lanes.task, lanes.task.config
    tips, noise = state["poses"][:, -1], lanes.course.noise[:, time] if lanes.course.noise.size else np.zeros(6)
    place, R = tips[:, :3, 3] + noise[..., :3], se3.rotation(noise[..., 3:]) @ tips[:, :3, :3]
    aims = over_time(lanes.course.targets, config.episode_steps + 1)[:, time]
    wanted, payload = aims[:, 3:].reshape(-1, 3, 3), np.linalg.norm(state["load"]["force"], axis=1)
    count = len(place)
    parts = [
        place / task.length,
        np.swapaxes(R, 1, 2).reshape(count, 9)[:, :6],
        (state["command"] - task.neutral_lengths) / config.command_scale_mm,
        state["tensions"] / config.tension_range[1],
        aims[:, :3] / task.length,
        np.swapaxes(wanted, 1, 2).reshape(count, 9)[:, :6],
        (aims[:, :3] - place) / config.reward.error_scale_mm,
        se3.rotation_vector(wanted @ np.swapaxes(R, 1, 2)) / config.reward.angle_scale_rad,
        state["gravity"],
        payload[:, None] / config.load.magnitude[1],
    ]
    return np.clip(np.concatenate(parts, axis=1), *task.observation_bounds())


def test_observations_equal_their_formulas_in_numpy():
    lanes, _, state = started(20, **EVERYTHING)
    rng = np.random.default_rng(0)
    for time in range(4):
        assert np.allclose(state["observation"], reference_observation(lanes, state, time), rtol=2e-7, atol=2e-7)
        state = advance(lanes, rng.uniform(-1, 1, lanes._actions.shape))
    assert np.array_equal(lanes.observe(), state["observation"])


@pytest.mark.parametrize("goal", [False, True])
@pytest.mark.parametrize("orientation", [False, True])
@pytest.mark.parametrize("shown", [False, True])
def test_entries_name_every_number_of_the_observation(goal, orientation, shown):
    settings = {"observe_load": shown, "observe_tensions": not shown, "orientation": orientation}
    lanes, episodes, state = started(2, goal, mechanism="small_arm", **settings)
    task = lanes.task
    entries = arm_observation_entries(task.config, task.mechanism, goal)
    assert state["observation"].shape == (2, len(entries)) and state["observation"].dtype == np.float32
    assert len({entry.name for entry in entries}) == len(entries)
    named = dict(zip([entry.name for entry in entries], state["observation"][0].tolist(), strict=True))
    assert named["tip z"] * task.length == pytest.approx(state["tip"][0, 2], abs=1e-4)
    command = state["command"][0, 1] - task.mechanism.neutral_lengths[1]
    assert named["tendon 1 command"] * 30 == pytest.approx(command, abs=1e-5)
    assert ("tendon 0 tension" in named) == (not shown) and ("payload" in named) == shown
    assert ("target x" in named) == (not goal) and ("tip error x" in named) == (not goal)
    assert ("tip R zy" in named) == orientation and ("angle error x" in named) == (orientation and not goal)
    if orientation:
        assert named["tip R zy"] == pytest.approx(state["poses"][0, -1, 2, 1], abs=1e-6)
    if shown:
        assert named["payload"] * 0.5 == pytest.approx(episodes.payloads[0, 0], abs=1e-6)
        assert named["gravity x"] == pytest.approx(episodes.gravity[0, 0], abs=1e-6)
    if not goal:
        assert named["tip error y"] * 30 == pytest.approx(state["target"][0, 1] - state["tip"][0, 1], abs=1e-4)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 0.3, 2.0, 3.1, np.pi - 1e-7, np.pi])
def test_rotation_vectors_and_turned_frames_of_kernels_are_those_of_the_physics(angle):
    vector, turned = standalone(rotation_vector), standalone(turn_frame)
    for axis in np.vstack([np.eye(3), np.random.default_rng(0).normal(size=(20, 3))]):
        w = angle * axis / np.linalg.norm(axis)
        R = se3.rotation(w)
        *found, size = vector(R)
        assert np.allclose(found, se3.rotation_vector(R), atol=1e-12) and size == pytest.approx(angle, abs=1e-7)
        frame = se3.rotation(axis).copy()
        turned(frame, *w)
        assert np.allclose(frame, R @ se3.rotation(axis), atol=1e-14)
        two = [np.concatenate([one[:, 0], one[:, 1]]) for one in (R @ se3.rotation(axis), se3.rotation(axis))]
        assert goal_angles(*two) == pytest.approx(angle, abs=1e-7)


def test_reward_terms_follow_their_definition():
    reward = {"effort": 0.2, "smoothness": 0.3, "error_scale_mm": 5.0, "angle_scale_rad": 0.1}
    lanes, _, _ = started(mechanism="small_arm", orientation=True, reward=reward, target={"process": "path"})
    advance(lanes, np.full((3, 4), 0.5))
    second = advance(lanes, np.array([[0.5, -0.5, 0.5, -0.5]] * 3))
    aim, tip = lanes.course.targets[:, 2], second["poses"][:, -1]
    error = np.linalg.norm(tip[:, :3, 3] - aim[:, :3], axis=-1)
    turn = aim[:, 3:].reshape(-1, 3, 3) @ np.swapaxes(tip[:, :3, :3], 1, 2)
    angle = np.linalg.norm(se3.rotation_vector(turn), axis=1)
    terms = {
        "tracking": -error / 5.0,
        "effort": -0.2 * np.mean((second["tensions"] / 15.0) ** 2, axis=1),
        "smoothness": np.full(3, -0.3 * 0.5),
        "failure": np.zeros(3),
        "orientation": -angle / 0.1,
    }
    assert second["terms"].keys() == terms.keys()
    for name, values in terms.items():
        assert np.allclose(second["terms"][name], values, rtol=1e-9, atol=0), name
    assert np.allclose(second["reward"], sum(terms.values())) and np.allclose(second["error_mm"], error, rtol=1e-13)


def test_without_orientation_neither_reward_nor_info_speak_of_it():
    lanes, _, state = started(mechanism="small_arm")
    assert "orientation" not in state["terms"] and "angle_error_rad" not in state
    assert not state["readings"][:, ANGLE - OWN :].any() and lanes.course.targets.shape == (3, 1, 3)


def test_a_lane_without_equilibrium_keeps_its_last_good_pose_and_pays_the_penalty():
    lanes, _, state = started(mechanism="small_arm", reward={"failure_penalty": 7.0})

    def fail():
        lanes.solver.results.status[1] = Status.NOT_CONVERGED
        lanes.solver.results.poses[1] += 100.0

    watch_solver(lanes, after=fail)
    after = advance(lanes, np.ones((3, 4)))
    assert after["status"].tolist() == ["CONVERGED", "NOT_CONVERGED", "CONVERGED"]
    for name in ("poses", "command", "tensions"):
        assert np.array_equal(after[name][1], state[name][1]) and not np.array_equal(after[name][0], state[name][0])
    assert after["terms"]["failure"].tolist() == [0.0, -7.0, 0.0]


def test_commands_do_not_wind_up_and_answer_at_once():
    lanes, _, state = started()
    for _ in range(12):
        state = advance(lanes, np.ones((3, 8)))
    assert np.allclose(state["tensions"], 15.0)
    back = advance(lanes, np.full((3, 8), -0.2))
    assert np.all((back["tensions"] < 14.0) & (back["tensions"] > 0.5))


def test_actuator_offset_moves_the_arm_but_not_what_the_motors_believe():
    lanes, episodes, state = started(2, mechanism="small_arm", randomization={"actuator_offset_mm": 1.0})
    after = advance(lanes, np.full((2, 4), 0.1))
    lengths = lanes.task.mechanism.tendon_lengths(lanes.state.angles)
    assert np.allclose(lengths - after["tensions"] / 5.0, after["command"] + episodes.actuator_offsets, atol=1e-7)
    assert np.allclose(after["command"], state["command"] - 0.1, atol=1e-9)
    assert np.abs(episodes.actuator_offsets).max() > 0.3


@pytest.mark.parametrize("settings", [{"mechanism": "small_arm"}, EVERYTHING, {}], ids=["small", "varied", "default"])
def test_a_lane_is_the_same_in_any_batch_and_at_any_place(settings):
    seeds = list(range(300 if "mechanism" in settings else 40))  # enough for threads
    many, backwards = (started(len(seeds), seeds=some, **settings)[0] for some in (seeds, seeds[::-1]))
    alone = {lane: started(1, seeds=[lane], **settings)[0] for lane in (0, len(seeds) - 1)}
    for step in range(3):
        actions = np.random.default_rng(step).uniform(-1, 1, many._actions.shape)
        state, turned = advance(many, actions), advance(backwards, actions[::-1])
        ones = {lane: advance(single, actions[lane : lane + 1]) for lane, single in alone.items()}
        for name in ("observation", "reward", "poses", "command"):
            assert np.array_equal(state[name], turned[name][::-1]), name
            assert all(np.array_equal(one[name][0], state[name][lane]) for lane, one in ones.items()), name


@pytest.mark.parametrize("settings", [{"mechanism": "small_arm"}, EVERYTHING], ids=["small", "everything"])
def test_lanes_taken_from_another_room_and_pickled_ones_go_on_as_they_were(settings):
    room, _, state = started(2, seeds=[7, 8], **settings)
    house, _, _ = started(5, **settings)
    advance(house, np.ones(house._actions.shape))
    house.take(np.array([3, 1]), room)
    assert np.array_equal(house.observe()[[3, 1]], state["observation"])
    copy = pickle.loads(pickle.dumps(house))
    for step in range(3):
        actions = np.random.default_rng(step).uniform(-1, 1, house._actions.shape)
        here, there, again = advance(house, actions), advance(room, actions[[3, 1]]), advance(copy, actions)
        assert np.array_equal(here["observation"][[3, 1]], there["observation"])
        assert np.array_equal(here["readings"], again["readings"])


def test_arms_whose_tendons_end_elsewhere_are_solved_lane_by_lane():
    arm = small_arm()
    short = arm.replace(tendons=[dataclasses.replace(tendon, end=3) for tendon in arm.tendons])
    house, _, _ = started(3, mechanism=arm)
    room, _, _ = started(1, seeds=[9], mechanism=short)
    house.take(np.array([1]), room)
    here, there = advance(house, np.full((3, 4), 0.4)), advance(room, np.full((1, 4), 0.4))
    assert np.array_equal(here["poses"][1], there["poses"][0]) and len(house.solver.mechanisms) == 2
    assert np.all(here["status"] == "CONVERGED")


def test_scaled_arms_are_new_and_leave_the_nominal_one_alone():
    arm = flexible_arm()
    assert np.all(arm.stiffnesses == 10.0)
    before = [array.copy() for array in arm.arrays]
    other = arm.scaled(np.full(32, 2.0), np.full(8, 3.0), np.full(32, 0.5))
    assert other != arm and other.beads[4].stiffness == 2 * arm.beads[4].stiffness
    assert other.beads[4].weight == 0.5 * arm.beads[4].weight and np.allclose(other.stiffnesses, 30.0)
    assert all(np.array_equal(one, old) for one, old in zip(arm.arrays, before, strict=True))
