"""The task's functions on batches: commands, tensions, reward terms, observation, end."""

import numpy as np
import pytest

import rj_gym.tracking.task as task_module
from rj_gym import TrackingConfig, observation_entries
from rj_gym.tracking.task import TrackingTask
from rollingjoint.equilibrium import Status
from rollingjoint.load import WorldForce
from rollingjoint.solve import solve_lengths


def started(lanes=3, **settings):
    task = TrackingTask(TrackingConfig.from_dict(settings))
    episodes = task.sample([np.random.default_rng(seed) for seed in range(lanes)])
    return task, episodes, task.begin(episodes)


def test_a_step_is_the_elastic_equilibrium_of_the_moved_commands_under_the_load():
    task, episodes, state = started(load={"magnitude": (0.5, 1.5)})
    after = task.advance(episodes, state, np.array([[1.0, -0.5], [0.2, 0.3], [-1.0, 1.0]]))
    for lane, action in enumerate([(1.0, -0.5), (0.2, 0.3), (-1.0, 1.0)]):
        command = state.commands[lane] - np.array(action)
        load = WorldForce(int(episodes.links[lane]), tuple(episodes.forces[lane, 1]))
        eq = solve_lengths(task.mechanism, command, [load], tension_limits=(0.5, 15.0))
        assert np.allclose(after.poses[lane], eq.poses, atol=1e-7)
        assert np.allclose(after.tensions[lane], eq.tensions, atol=1e-7)
        assert np.allclose(after.commands[lane], command, atol=1e-9)


def test_every_solve_starts_from_the_last_pose_of_the_episode(monkeypatch):
    task, episodes, state = started()
    solve, starts = task_module.solve_lengths_batch, []

    def watched(mechanism, lengths, loads, start, limits):
        starts.append(start)
        return solve(mechanism, lengths, loads, start, limits)

    monkeypatch.setattr(task_module, "solve_lengths_batch", watched)
    after = task.advance(episodes, state, np.ones((3, 2)))
    task.advance(episodes, after, np.ones((3, 2)))
    assert np.array_equal(starts[0], state.joint_angles) and np.array_equal(starts[1], after.joint_angles)


def test_pulling_tendons_in_raises_tension_and_shortens_commands():
    task, episodes, state = started()
    after = task.advance(episodes, state, np.ones((3, 2)))
    assert np.all(after.commands < state.commands) and np.all(after.tensions > state.tensions)


@pytest.mark.parametrize(("action", "limit"), [(1.0, 15.0), (-1.0, 0.5)])
def test_commands_do_not_wind_up_at_a_tension_limit(action, limit):
    task, episodes, state = started(load={"magnitude": (0, 0)})
    for _ in range(30):
        state = task.advance(episodes, state, np.full((3, 2), action))
    assert np.allclose(state.tensions, limit)
    back = task.advance(episodes, state, np.full((3, 2), -0.1 * action))
    assert np.all(np.abs(back.tensions - limit) > 0.1)  # answers at once
    assert np.all((back.tensions >= 0.5) & (back.tensions <= 15.0))


def test_actions_beyond_the_box_are_clipped():
    task, episodes, state = started()
    assert np.array_equal(
        task.advance(episodes, state, np.full((3, 2), 7.0)).poses,
        task.advance(episodes, state, np.ones((3, 2))).poses,
    )


def test_reward_terms_follow_their_definition():
    task, episodes, state = started(reward={"effort": 0.2, "smoothness": 0.3, "error_scale_mm": 5.0})
    first = task.advance(episodes, state, np.full((3, 2), 0.5))
    second = task.advance(episodes, first, np.array([[0.5, -0.5]] * 3))
    terms = task.reward_terms(second)
    error = np.linalg.norm(second.poses[:, -1, :2] - episodes.targets[:, 2], axis=-1)
    assert np.allclose(terms["tracking"], -error / 5.0)
    assert np.allclose(terms["effort"], -0.2 * np.mean((second.tensions / 15.0) ** 2, axis=1))
    assert np.allclose(terms["smoothness"], -0.3 * 0.5)
    assert np.all(terms["failure"] == 0.0)


def test_a_lane_without_equilibrium_ends_with_its_last_good_pose_and_the_penalty(monkeypatch):
    task, episodes, state = started(reward={"failure_penalty": 7.0})
    solve = task_module.solve_lengths_batch

    def failing(*arguments):
        result = solve(*arguments)
        result.status[1] = Status.NOT_CONVERGED
        result.poses[1] += 100.0
        return result

    monkeypatch.setattr(task_module, "solve_lengths_batch", failing)
    after = task.advance(episodes, state, np.ones((3, 2)))
    terminated, truncated = task.end(after)
    assert terminated.tolist() == [False, True, False] and not truncated.any()
    assert np.array_equal(after.poses[1], state.poses[1]) and np.array_equal(after.commands[1], state.commands[1])
    assert np.all(after.commands[[0, 2]] < state.commands[[0, 2]])
    assert task.reward_terms(after)["failure"].tolist() == [0.0, -7.0, 0.0]


def test_episodes_end_by_truncation_after_their_steps():
    task, episodes, state = started(episode_steps=3)
    ends = []
    for _ in range(3):
        state = task.advance(episodes, state, np.zeros((3, 2)))
        ends.append([bool(np.all(end)) for end in task.end(state)])
    assert ends == [[False, False], [False, False], [False, True]]


@pytest.mark.parametrize("goal", [False, True])
@pytest.mark.parametrize("mechanism", ["five_link", "two_segment"])
@pytest.mark.parametrize("shown", [False, True])
def test_entries_name_every_number_of_the_observation(goal, mechanism, shown):
    settings = {"observe_load": shown, "observe_tensions": not shown, "mechanism": mechanism}
    task, episodes, state = started(2, **settings)
    entries = observation_entries(task.config, task.mechanism, goal)
    observation = task.observe(episodes, state, goal)
    assert observation.shape == (2, len(entries)) and observation.dtype == np.float32
    assert len({entry.name for entry in entries}) == len(entries)
    named = dict(zip([entry.name for entry in entries], observation[0], strict=True))
    tip = task.mechanism.n_links - 1
    assert named[f"link {tip} x"] * task.length == pytest.approx(state.tips[0, 0], abs=1e-4)
    angle = np.arctan2(named["link 1 sin angle"], named["link 1 cos angle"])
    assert angle == pytest.approx(state.poses[0, 1, 2], abs=1e-6)
    command = state.commands[0, 1] - task.mechanism.neutral_lengths[1]
    assert named["tendon 1 command"] * 20.0 == pytest.approx(command, abs=1e-5)
    assert ("tendon 0 tension" in named) == (not shown) and ("load x" in named) == shown
    if shown:
        assert named["load y"] == pytest.approx(state.forces[0, 1], abs=1e-6)
        pulled = [k for k in range(1, tip + 1) if named[f"load on link {k}"] == 1.0]
        assert pulled == [episodes.links[0]]
    else:
        assert named["tendon 0 tension"] * 15 == pytest.approx(state.tensions[0, 0], abs=1e-5)
    if goal:
        assert "target x" not in named and "tip error x" not in named
    else:
        assert named["target y"] * task.length == pytest.approx(state.targets[0, 1], abs=1e-4)
        assert named["tip error x"] * 10 == pytest.approx(state.targets[0, 0] - state.tips[0, 0], abs=1e-4)


def test_sensor_noise_is_seen_but_does_not_move_the_mechanism():
    plain = started(2)
    noisy = started(2, randomization={"position_noise_mm": 1.0, "angle_noise_rad": 0.1})
    assert np.array_equal(plain[2].poses, noisy[2].poses)
    seen = [task.observe(episodes, state) for task, episodes, state in (plain, noisy)]
    assert 0.1 < np.abs(seen[0] - seen[1]).max() * 100 < 60


def test_actuator_offset_moves_the_mechanism_but_not_what_the_motors_believe():
    task, episodes, state = started(2, randomization={"actuator_offset_mm": 1.0}, load={"magnitude": (0, 0)})
    after = task.advance(episodes, state, np.full((2, 2), 0.25))
    stretch = after.tensions / 5.0
    lengths = task.mechanism.tendon_lengths(after.joint_angles)
    assert np.allclose(lengths - stretch, after.commands + episodes.actuator_offsets, atol=1e-7)
    assert np.allclose(after.commands, state.commands - 0.25, atol=1e-9)


def test_lanes_of_a_batch_equal_episodes_of_their_own():
    settings = {"randomization": {"link_tolerance_mm": 0.1, "stiffness_spread": 0.2}, "load": {"process": "ou"}}
    task, episodes, state = started(3, **settings)
    actions = np.random.default_rng(0).uniform(-1, 1, (5, 3, 2))
    for action in actions:
        state = task.advance(episodes, state, action)
    for lane in range(3):
        alone = task.sample([np.random.default_rng(lane)])
        single = task.begin(alone)
        for action in actions:
            single = task.advance(alone, single, action[lane : lane + 1])
        assert np.array_equal(single.poses[0], state.poses[lane])
        assert np.array_equal(task.observe(alone, single)[0], task.observe(episodes, state)[lane])
