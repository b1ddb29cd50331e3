"""The task's lanes: commands, tensions, reward terms, observation, end, and lanes that do not see each other."""

import os
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

from rj_gym import TrackingConfig, observation_entries
from rj_gym.core.columns import REWARD
from rj_gym.tracking.episodes import TrackingEpisodeBuffer
from rj_gym.tracking.planar import PlanarTask
from rollingjoint.chain.status import Status
from rollingjoint.compiled import entry_address, kernel
from rollingjoint.errors import InvalidInput
from rollingjoint.load import WorldForce
from rollingjoint.statics.solve import solve_lengths
from tests.rj_gym.watched_solver import watch_solver

EVERYTHING = {
    "observe_load": True,
    "load": {"process": "ou", "magnitude": (0, 1.5)},
    "target": {"process": "path"},
    "randomization": {"position_noise_mm": 1.0, "angle_noise_rad": 0.1, "actuator_offset_mm": 0.5},
}


def started(count=3, goal=False, seeds=None, **settings):
    lanes = TrackingEpisodeBuffer(PlanarTask(TrackingConfig.from_dict(settings)), count, goal)
    episodes, observation = lanes.begin([np.random.default_rng(seed) for seed in seeds or range(count)])
    return lanes, episodes, now(lanes, observation)


def now(lanes, observation):
    """Copies of everything that the lanes say of themselves."""
    readings = lanes.state.readings.copy()
    return SimpleNamespace(
        **lanes.task.state_info(readings),
        terms=lanes.task.reward_info(readings),
        reward=readings[:, REWARD],
        poses=lanes.state.poses.copy(),
        angles=lanes.state.angles.copy(),
        observation=observation,
    )


def advance(lanes, actions):
    lanes.accept(actions)
    return now(lanes, lanes.advance())


def left_by_a_step(lanes, first, last):
    """How many lanes of a range a step leaves to the general solver."""
    lanes.accept(np.ones((lanes.capacity, 2)))
    observations = np.empty((lanes.capacity, lanes._entries), np.float32)
    return lanes._kernels.step(observations.ctypes.data, first, last)


def fail_in(lane, lanes):
    """From now on the solver gives this lane nothing usable."""

    def fail():
        lanes.solver.results.status[lane] = Status.NOT_CONVERGED
        lanes.solver.results.poses[lane] += 100.0

    watch_solver(lanes, after=fail)


def test_a_step_is_the_elastic_equilibrium_of_the_moved_commands_under_the_load():
    lanes, episodes, state = started(load={"magnitude": (0.5, 1.5)})
    actions = np.array([[1.0, -0.5], [0.2, 0.3], [-1.0, 1.0]])
    after = advance(lanes, actions)
    for lane, action in enumerate(actions):
        command = state.command[lane] - action
        load = WorldForce(int(episodes.links[lane]), tuple(episodes.forces[lane, 0]))
        eq = solve_lengths(lanes.task.mechanism, command, [load], tension_limits=(0.5, 15.0))
        assert np.allclose(after.poses[lane], eq.poses, atol=1e-7)
        assert np.allclose(after.tensions[lane], eq.tensions, atol=1e-7)
        assert np.allclose(after.command[lane], command, atol=1e-9)


def test_every_solve_starts_on_the_tangent_of_the_last_equilibrium():
    lanes, _, state = started()
    starts = []
    watch_solver(lanes, before=lambda: starts.append(lanes.solver.starts.copy()))
    responses = lanes.state.responses.copy()
    after = advance(lanes, np.full((3, 2), 0.1))
    change = np.einsum("bim,bm->bi", responses, after.command - state.command)
    assert np.allclose(starts[0], state.angles + change, atol=1e-12)
    assert np.all(np.abs(starts[0] - after.angles).max(axis=1) < 0.3 * np.abs(state.angles - after.angles).max(axis=1))


def test_responses_of_the_equilibrium_are_its_derivatives():
    lanes, _, _ = started(load={"magnitude": (0.5, 1.0)})
    base, responses = advance(lanes, np.array([[1.0, -0.5], [0.2, 0.3], [-1.0, 1.0]])), lanes.state.responses.copy()
    for j in range(2):
        bent = []
        for sign in (1.0, -1.0):
            other = pickle.loads(pickle.dumps(lanes))
            bent.append(advance(other, -sign * 1e-4 * np.eye(2)[[j] * 3]).angles)
        assert np.allclose((bent[0] - bent[1]) / 2e-4, responses[:, :, j], atol=1e-6)
    assert np.abs(responses).mean() > 1e-3 and np.all(base.status == "CONVERGED")


def test_a_prediction_that_goes_far_is_not_used():
    lanes, _, state = started(action_scale_mm=30.0)
    starts = []
    watch_solver(lanes, before=lambda: starts.append(lanes.solver.starts.copy()))
    advance(lanes, np.array([[1.0, -1.0]] * 3))
    assert np.array_equal(starts[0], state.angles)


@pytest.mark.skipif("ROLLINGJOINT_CHECK_BOUNDS" in os.environ, reason="in that mode what a solver raises is raised")
def test_a_solver_that_cannot_get_memory_leaves_all_lanes_to_the_other_one():
    lanes, others = started()[0], started()[0]

    @kernel
    def out_of_memory(pins, first, last):
        if pins >= 0:
            raise MemoryError
        return 0

    solver = lanes.solver.alone
    entry = entry_address(out_of_memory, int, int, int)
    lanes.solver.alone = SimpleNamespace(entry=entry, pins=solver.pins, solve_the_rest=solver.solve_the_rest)
    lanes._bind()
    one, other = advance(lanes, np.ones((3, 2))), advance(others, np.ones((3, 2)))
    assert np.allclose(one.poses, other.poses, atol=1e-7) and np.all(one.status == "CONVERGED")
    assert left_by_a_step(lanes, 1, 3) == 2


def test_a_step_leaves_no_lane_where_all_are_solved_together_and_every_one_without_that_solver():
    lanes = started()[0]
    assert left_by_a_step(lanes, 1, 3) == 0
    watch_solver(lanes)
    assert left_by_a_step(lanes, 1, 3) == 2


def test_pulling_tendons_in_raises_tension_and_shortens_commands():
    lanes, _, state = started()
    after = advance(lanes, np.ones((3, 2)))
    assert np.all(after.command < state.command) and np.all(after.tensions > state.tensions)


@pytest.mark.parametrize(("action", "limit"), [(1.0, 15.0), (-1.0, 0.5)])
def test_commands_do_not_wind_up_at_a_tension_limit(action, limit):
    lanes, _, state = started(load={"magnitude": (0, 0)})
    for _ in range(30):
        state = advance(lanes, np.full((3, 2), action))
    assert np.allclose(state.tensions, limit)
    back = advance(lanes, np.full((3, 2), -0.1 * action))
    assert np.all(np.abs(back.tensions - limit) > 0.1)  # answers at once
    assert np.all((back.tensions >= 0.5) & (back.tensions <= 15.0))


def test_actions_beyond_the_box_are_clipped():
    beyond, within = (advance(started()[0], np.full((3, 2), action)) for action in (7.0, 1.0))
    assert np.array_equal(beyond.poses, within.poses)


def test_reward_terms_follow_their_definition():
    reward = {"effort": 0.2, "smoothness": 0.3, "error_scale_mm": 5.0}
    lanes, _, _ = started(reward=reward, target={"process": "path"})
    advance(lanes, np.full((3, 2), 0.5))
    second = advance(lanes, np.array([[0.5, -0.5]] * 3))
    error = np.linalg.norm(second.poses[:, -1, :2] - lanes.course.targets[:, 2], axis=-1)
    terms = {
        "tracking": -error / 5.0,
        "effort": -0.2 * np.mean((second.tensions / 15.0) ** 2, axis=1),
        "smoothness": np.full(3, -0.3 * 0.5),
        "failure": np.zeros(3),
    }
    for name, values in terms.items():
        assert np.allclose(second.terms[name], values, rtol=1e-13, atol=0), name
    assert np.allclose(second.error_mm, error, rtol=1e-13) and np.allclose(second.reward, sum(terms.values()))


def test_a_lane_without_equilibrium_keeps_its_last_good_pose_and_pays_the_penalty():
    lanes, _, state = started(reward={"failure_penalty": 7.0})
    fail_in(1, lanes)
    after = advance(lanes, np.ones((3, 2)))
    assert after.status.tolist() == ["CONVERGED", "NOT_CONVERGED", "CONVERGED"]
    for name in ("poses", "angles", "command", "tensions"):
        before, kept = getattr(state, name), getattr(after, name)
        assert np.array_equal(kept[1], before[1]), name
        assert not np.array_equal(kept[0], before[0]), name
    assert after.terms["failure"].tolist() == [0.0, -7.0, 0.0]


@pytest.mark.parametrize("goal", [False, True])
@pytest.mark.parametrize("mechanism", ["five_link", "two_segment"])
@pytest.mark.parametrize("shown", [False, True])
def test_entries_name_every_number_of_the_observation(goal, mechanism, shown):
    settings = {"observe_load": shown, "observe_tensions": not shown, "mechanism": mechanism}
    lanes, episodes, state = started(2, goal, **settings)
    task = lanes.task
    entries = observation_entries(task.config, task.mechanism, goal)
    assert state.observation.shape == (2, len(entries)) and state.observation.dtype == np.float32
    assert len({entry.name for entry in entries}) == len(entries)
    named = dict(zip([entry.name for entry in entries], state.observation[0].tolist(), strict=True))
    tip = task.mechanism.n_links - 1
    assert named[f"link {tip} x"] * task.length == pytest.approx(state.tip[0, 0], abs=1e-4)
    angle = np.arctan2(named["link 1 sin angle"], named["link 1 cos angle"])
    assert angle == pytest.approx(state.poses[0, 1, 2], abs=1e-6)
    command = state.command[0, 1] - task.mechanism.neutral_lengths[1]
    assert named["tendon 1 command"] * 20.0 == pytest.approx(command, abs=1e-5)
    assert ("tendon 0 tension" in named) == (not shown) and ("load x" in named) == shown
    if shown:
        assert named["load y"] == pytest.approx(state.load["force"][0, 1], abs=1e-6)
        pulled = [k for k in range(1, tip + 1) if named[f"load on link {k}"] == 1.0]
        assert pulled == [episodes.links[0]]
    else:
        assert named["tendon 0 tension"] * 15 == pytest.approx(state.tensions[0, 0], abs=1e-5)
    if goal:
        assert "target x" not in named and "tip error x" not in named
    else:
        assert named["target y"] * task.length == pytest.approx(state.target[0, 1], abs=1e-4)
        assert named["tip error x"] * 10 == pytest.approx(state.target[0, 0] - state.tip[0, 0], abs=1e-4)


def reference_observation(lanes, state, time):
    """The observation of the plain variant with the load shown, in plain NumPy."""
    task, config = lanes.task, lanes.task.config
    measured = state.poses[:, 1:] + (lanes.course.noise[:, time] if lanes.course.noise.size else 0.0)
    x, y, angle = np.moveaxis(measured, -1, 0)
    links = np.stack([x / task.length, y / task.length, np.cos(angle), np.sin(angle)], axis=-1)
    pulled = state.load["link"][:, None] == np.arange(1, task.mechanism.n_links)
    parts = [
        links.reshape(len(x), -1),
        (state.command - task.neutral_lengths) / config.command_scale_mm,
        state.tensions / config.tension_range[1],
        state.target / task.length,
        (state.target - measured[:, -1, :2]) / config.reward.error_scale_mm,
        state.load["force"] / config.load.magnitude[1],
        pulled,
    ]
    return np.clip(np.concatenate(parts, axis=1), *task.observation_bounds())


@pytest.mark.parametrize("mechanism", ["five_link", "two_segment"])
def test_observations_equal_their_formulas_in_numpy(mechanism):
    lanes, _, state = started(40, mechanism=mechanism, **EVERYTHING)
    rng = np.random.default_rng(0)
    for time in range(6):
        assert np.allclose(state.observation, reference_observation(lanes, state, time), rtol=2e-7, atol=2e-7)
        state = advance(lanes, rng.uniform(-1, 1, lanes._actions.shape))
    assert np.array_equal(lanes.observe(), state.observation)


def test_observed_angles_are_right_all_around_and_far_out():
    lanes, _, state = started(500)
    lanes.state.poses[:, 1:, 2] = np.linspace(-40, 40, 2000).reshape(500, 4)
    lanes.state.poses[0, 1:, 2] = [np.pi / 2, -np.pi / 2, np.pi, 1e4]
    state = now(lanes, lanes.observe())
    angles, seen = lanes.state.poses[:, 1:, 2], state.observation[:, :16].reshape(500, 4, 4)
    assert np.allclose(seen[..., 2], np.cos(angles), rtol=0, atol=6e-8)
    assert np.allclose(seen[..., 3], np.sin(angles), rtol=0, atol=6e-8)


def test_sensor_noise_is_seen_but_does_not_move_the_mechanism():
    plain = started(2)[2]
    noisy = started(2, randomization={"position_noise_mm": 1.0, "angle_noise_rad": 0.1})[2]
    assert np.array_equal(plain.poses, noisy.poses)
    assert 0.1 < np.abs(plain.observation - noisy.observation).max() * 100 < 60


def test_actuator_offset_moves_the_mechanism_but_not_what_the_motors_believe():
    lanes, episodes, state = started(2, randomization={"actuator_offset_mm": 1.0}, load={"magnitude": (0, 0)})
    after = advance(lanes, np.full((2, 2), 0.25))
    stretch = after.tensions / 5.0
    lengths = lanes.task.mechanism.tendon_lengths(after.angles)
    assert np.allclose(lengths - stretch, after.command + episodes.actuator_offsets, atol=1e-7)
    assert np.allclose(after.command, state.command - 0.25, atol=1e-9)


VARIED = {"randomization": {"link_tolerance_mm": 0.1, "stiffness_spread": 0.2}, "load": {"process": "ou"}}


@pytest.mark.parametrize("settings", [{}, EVERYTHING, VARIED], ids=["default", "everything", "mechanisms"])
def test_a_lane_is_the_same_in_any_batch_and_at_any_place(settings):
    seeds = list(range(150)) if settings is not VARIED else list(range(5))
    many, _, state = started(len(seeds), seeds=seeds, **settings)
    backwards, _, turned = started(len(seeds), seeds=seeds[::-1], **settings)
    last = len(seeds) - 1
    alone = {lane: started(1, seeds=[lane], **settings) for lane in (0, last // 2, last)}
    for step in range(4):
        actions = np.random.default_rng(step).uniform(-1, 1, (len(seeds), 2))
        state, turned = advance(many, actions), advance(backwards, actions[::-1])
        for name in ("observation", "reward", "poses", "command"):
            assert np.array_equal(getattr(state, name), getattr(turned, name)[::-1]), name
        for lane, (single, *_) in alone.items():
            one = advance(single, actions[lane : lane + 1])
            for name in ("observation", "reward", "poses", "command"):
                assert np.array_equal(getattr(one, name)[0], getattr(state, name)[lane]), name


@pytest.mark.parametrize("settings", [{}, EVERYTHING, VARIED], ids=["default", "everything", "mechanisms"])
def test_lanes_taken_from_another_room_go_on_as_they_were(settings):
    room, _, state = started(2, seeds=[7, 8], **settings)
    house, _, _ = started(5, **settings)
    advance(house, np.ones((5, 2)))
    house.take(np.array([3, 1]), room)
    assert np.array_equal(house.observe()[[3, 1]], state.observation)
    for step in range(3):
        actions = np.random.default_rng(step).uniform(-1, 1, (5, 2))
        here, there = advance(house, actions), advance(room, actions[[3, 1]])
        assert np.array_equal(here.observation[[3, 1]], there.observation)
        assert np.array_equal(here.poses[[3, 1]], there.poses)


def test_a_room_that_was_fuller_before_begins_as_a_new_one():
    room, _, _ = started(4)
    episodes, observation = room.begin([np.random.default_rng(9)])
    assert len(episodes) == 1
    assert np.array_equal(observation, started(1, seeds=[9])[2].observation)


def test_pickled_lanes_go_on_alike():
    lanes, _, _ = started(3, **EVERYTHING)
    copy = pickle.loads(pickle.dumps(lanes))
    one, other = (advance(room, np.ones((3, 2))) for room in (lanes, copy))
    assert np.array_equal(one.observation, other.observation) and np.array_equal(one.reward, other.reward)


@pytest.mark.parametrize("actions", [[[np.nan, 0.0]] * 3, np.full((3, 2), np.inf), np.zeros(2), np.zeros((2, 2)), "up"])
def test_lanes_refuse_actions_that_are_not_finite_numbers_of_their_shape(actions):
    with pytest.raises(InvalidInput, match=r"\(3, 2\)"):
        started()[0].accept(actions)


def test_memory_per_lane_beside_the_results_stays_small():
    lanes = TrackingEpisodeBuffer(PlanarTask(TrackingConfig()), 100, goal=False)
    arrays = [
        *lanes.state,
        *lanes.course,
        lanes._actions,
        lanes.solver.loads,
        lanes.solver.designs,
        *lanes.solver.laws[:1],
        *lanes.solver.laws[2:],
    ]
    assert sum(array.nbytes for array in arrays) / 100 < 1024
