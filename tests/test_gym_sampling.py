"""Episodes drawn from uniform numbers: ranges, processes, reachability, and lanes that do not see each other."""

import dataclasses

import numpy as np
import pytest

from rj_gym import TrackingConfig
from rj_gym.tracking.sampling import Fixed, draw_uniforms, load_forces, sample_episodes, target_paths, uniform_shapes
from rj_gym.tracking.task import TrackingTask
from rollingjoint.solve import solve_lengths, solve_tensions

EVERYTHING = {
    "start": "random",
    "load": {"process": "step"},
    "target": {"process": "path"},
    "randomization": {
        "position_noise_mm": 0.5,
        "angle_noise_rad": 0.02,
        "stiffness_spread": 0.3,
        "link_tolerance_mm": 0.1,
        "link_tolerance_rad": 0.01,
        "actuator_offset_mm": 0.5,
    },
}


def episodes(lanes, **settings):
    task = TrackingTask(TrackingConfig.from_dict({"episode_steps": 30} | settings))
    return task, task.sample([np.random.default_rng(seed) for seed in range(lanes)])


def forces(lanes, steps, **load):
    task = TrackingTask(TrackingConfig(episode_steps=steps, load=load))
    uniforms = draw_uniforms([np.random.default_rng(0)] * lanes, uniform_shapes(task.config, task.mechanism))
    return load_forces(task.config.load, uniforms, steps + 1)


def test_constant_load_is_uniform_in_direction_and_magnitude():
    force = forces(2000, 3, magnitude=(0.2, 1.5))
    assert np.all(force == force[:, :1])
    magnitude = np.linalg.norm(force[:, 0], axis=-1)
    assert magnitude.min() > 0.199 and magnitude.max() < 1.501
    assert magnitude.mean() == pytest.approx(0.85, abs=0.03)
    assert np.abs((force[:, 0] / magnitude[:, None]).mean(axis=0)).max() < 0.06


def test_step_load_jumps_at_the_stated_mean_interval():
    force = forces(300, 100, process="step", hold_steps=10)
    jumps = np.any(np.diff(force, axis=1) != 0, axis=-1)
    assert jumps.mean() == pytest.approx(0.1, abs=0.01)
    assert np.linalg.norm(force, axis=-1).max() <= 1.0


def test_ou_load_has_the_stated_spread_memory_and_bound():
    force = forces(1500, 40, process="ou", magnitude=(0, 100.0), correlation_steps=8)
    bounded = forces(1500, 40, process="ou", magnitude=(0, 1.0), correlation_steps=8)
    assert np.linalg.norm(bounded, axis=-1).max() <= 1.0 + 1e-12
    assert np.allclose(force, 100 * bounded)
    x = force[..., 0]
    assert x[:, 0].std() == pytest.approx(x[:, -1].std(), rel=0.08)
    assert 38 < x.std() < 50  # 50 before clipping
    correlation = np.mean(x[:, :-8] * x[:, 8:]) / np.mean(x**2)
    assert correlation == pytest.approx(np.exp(-1), abs=0.06)


def test_random_link_covers_every_moving_link_evenly_and_tip_only_the_tip():
    _, drawn = episodes(800)
    counts = np.bincount(drawn.links, minlength=5)
    assert counts[0] == 0 and counts[1:].min() > 150
    _, drawn = episodes(20, load={"link": "tip"})
    assert np.all(drawn.links == 4)


@pytest.mark.parametrize("mechanism", ["five_link", "two_segment"])
def test_targets_are_tips_of_unloaded_equilibria_at_log_uniform_tensions(mechanism):
    task, _ = episodes(1, mechanism=mechanism)
    uniforms = np.random.default_rng(0).random((4, 1, task.mechanism.n_tendons))
    targets = target_paths(task.config, (task.mechanism,) * 4, uniforms)
    for target, u in zip(targets, uniforms[:, 0], strict=True):
        tip = solve_tensions(task.mechanism, 6.0**u).tip  # tension range (1, 6) N
        assert np.allclose(target, tip, atol=1e-7)


def test_a_path_passes_through_its_waypoints():
    task, _ = episodes(1, target={"process": "path", "waypoints": 4})
    uniforms = np.random.default_rng(0).random((1, 4, 2))
    (path,) = target_paths(task.config, (task.mechanism,), uniforms)
    for k in range(4):
        assert np.allclose(path[10 * k], solve_tensions(task.mechanism, 6.0 ** uniforms[0, k]).tip, atol=1e-7)


def test_a_path_moves_without_jumps_and_a_fixed_target_stays():
    _, drawn = episodes(20, episode_steps=60, target={"process": "path"})
    moves = np.linalg.norm(np.diff(drawn.targets, axis=1), axis=-1)
    assert moves.max() < 10 and moves.sum(axis=1).min() > 5
    assert moves[:, [0, 29, 30, -1]].max() < 0.6  # at rest at each of the three waypoints
    _, drawn = episodes(3)
    assert np.all(drawn.targets == drawn.targets[:, :1])


def test_a_lane_does_not_depend_on_the_lanes_beside_it():
    _, many = episodes(4, **EVERYTHING)
    task, _ = episodes(1, **EVERYTHING)
    alone = task.sample([np.random.default_rng(2)])
    for name in ("targets", "links", "forces", "start_tensions", "surface_offsets", "actuator_offsets", "noise"):
        assert np.array_equal(getattr(many, name)[2], getattr(alone, name)[0]), name
    assert np.array_equal(many.stiffnesses[2], alone.stiffnesses[0])


def test_randomisation_leaves_loads_and_start_of_a_seed_as_they_are():
    _, plain = episodes(3, **(EVERYTHING | {"randomization": {}}))
    _, varied = episodes(3, **EVERYTHING)
    for name in ("links", "forces", "start_tensions"):
        assert np.array_equal(getattr(plain, name), getattr(varied, name)), name


def test_randomised_mechanisms_stay_within_the_stated_ranges():
    task, drawn = episodes(30, **EVERYTHING)
    assert np.all(np.abs(drawn.stiffnesses / 5.0 - 1) <= 0.3) and np.ptp(drawn.stiffnesses) > 1
    offset = np.array(drawn.mechanisms[0].links[1].parent.start) - task.mechanism.links[1].parent.start
    assert np.allclose(offset, drawn.surface_offsets[0, 1, 0, :2])
    assert np.abs(drawn.surface_offsets[..., :2]).max() <= 0.1 and np.abs(drawn.surface_offsets[..., 2]).max() <= 0.01
    assert np.abs(drawn.actuator_offsets).max() <= 0.5
    assert drawn.noise[..., :2].std() == pytest.approx(0.5, rel=0.05)
    assert drawn.noise[..., 2].std() == pytest.approx(0.02, rel=0.05)


def test_without_randomisation_every_lane_has_the_nominal_mechanism_itself():
    task, drawn = episodes(3)
    assert all(mechanism is task.mechanism for mechanism in drawn.mechanisms)
    assert drawn.noise is None


def test_what_is_fixed_is_not_drawn():
    task, free = episodes(2)
    fixed = Fixed(links=2, start_tensions=np.array([1.0, 2.0]))
    rngs = [np.random.default_rng(seed) for seed in range(2)]
    uniforms = draw_uniforms(rngs, uniform_shapes(task.config, task.mechanism))
    drawn = sample_episodes(task.config, task.mechanism, uniforms, fixed)
    assert np.all(drawn.links == 2) and np.all(drawn.start_tensions == [1.0, 2.0])
    assert np.array_equal(drawn.targets, free.targets) and np.array_equal(drawn.forces, free.forces)


def test_start_commands_give_the_start_tensions_when_nothing_pulls():
    task, drawn = episodes(3, start="random", load={"magnitude": (0, 0)})
    state = task.begin(drawn)
    assert np.allclose(state.tensions, drawn.start_tensions, atol=1e-7)
    again = solve_lengths(task.mechanism, state.commands[0])
    assert np.allclose(again.tensions, drawn.start_tensions[0], atol=1e-6)
    assert dataclasses.is_dataclass(state)
