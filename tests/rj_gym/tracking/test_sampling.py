"""Episodes drawn from uniform numbers: ranges, processes, reachability, and lanes that do not see each other."""

import dataclasses
import pickle

import numpy as np
import pytest

from rj_gym import TrackingConfig
from rj_gym.core.generators import Generators
from rj_gym.tracking.draws import Uniforms, over_time
from rj_gym.tracking.episodes import TrackingEpisodeBuffer
from rj_gym.tracking.options import TrackingOptions
from rj_gym.tracking.planar import PlanarTask, load_forces
from rollingjoint.statics.solve import solve_lengths, solve_tensions

HARDWARE = {
    "sensing": {"period": 4, "position_bias_mm": 0.2, "encoder_noise_mm": 0.1, "tension_noise": 0.1},
    "actuation": {"play_mm": (0.5, 2.0), "sheath_friction": (0.0, 0.3)},
}
EVERYTHING = {
    "start": "random",
    "friction": {"shared": False},
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
    task = PlanarTask(TrackingConfig.from_dict({"episode_steps": 30} | settings))
    return task, task.sample([np.random.default_rng(seed) for seed in range(lanes)])


def forces(lanes, steps, **load):
    task = PlanarTask(TrackingConfig(episode_steps=steps, load=load))
    return over_time(load_forces(task.config.load, uniforms(task, [np.random.default_rng(0)] * lanes)), steps + 1)


def uniforms(task, rngs):
    return Uniforms(task._blocks, rngs)


def targets(task, lanes):
    """Targets over time of lanes with seeds 0, 1, ..., and the uniform numbers that they were drawn from."""
    rngs = [np.random.default_rng(seed) for seed in range(lanes)]
    room = TrackingEpisodeBuffer(task, lanes, goal=False)
    room.begin(rngs)
    drawn = uniforms(task, [np.random.default_rng(seed) for seed in range(lanes)])["target"]
    return over_time(room.course.targets, task.config.episode_steps + 1), drawn


def test_generators_give_the_numbers_of_each_generator_and_go_on_with_it():
    each = [np.random.default_rng(seed) for seed in (3, 4, 3)]
    generators, rows, again = Generators(each), np.empty((3, 5)), np.empty((2, 4))
    generators.fill(rows)
    expected = [np.random.default_rng(seed).random(9) for seed in (3, 4, 3)]
    assert np.array_equal(rows, np.array(expected)[:, :5])
    pickle.loads(pickle.dumps(generators)).fill(np.empty((3, 4)))  # a copy moves no other
    generators.of(np.array([2, 1])).fill(again)
    assert np.array_equal(again, np.array(expected)[[2, 1], 5:])
    assert each[0].random() == expected[0][5]


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
    for target, u in zip(*targets(task, 4), strict=True):
        tip = solve_tensions(task.mechanism, 6.0 ** u[0]).tip  # tension range (1, 6) N
        assert np.allclose(target, tip, atol=1e-7)


def test_a_path_passes_through_its_waypoints():
    task, _ = episodes(1, target={"process": "path", "waypoints": 4})
    (path,), (drawn,) = targets(task, 1)
    for k in range(4):
        assert np.allclose(path[10 * k], solve_tensions(task.mechanism, 6.0 ** drawn[k]).tip, atol=1e-7)


def test_a_path_moves_without_jumps_and_a_fixed_target_stays():
    task, _ = episodes(1, episode_steps=60, target={"process": "path"})
    moves = np.linalg.norm(np.diff(targets(task, 20)[0], axis=1), axis=-1)
    assert moves.max() < 10 and moves.sum(axis=1).min() > 5
    assert moves[:, [0, 29, 30, -1]].max() < 0.6  # at rest at each of the three waypoints
    task, _ = episodes(1)
    fixed, _ = targets(task, 3)
    assert np.all(fixed == fixed[:, :1])


def assert_lane_is_alone(many, lane, alone):
    """A lane of many draws is the only lane of others."""
    for name in (f.name for f in dataclasses.fields(alone)):
        if name == "hardware":
            assert_lane_is_alone(many.hardware, lane, alone.hardware)
        elif name not in ("mechanisms", "designs", "targets"):
            values, own = getattr(many, name), getattr(alone, name)
            assert (values is own is None) or np.array_equal(values[lane], own[0]), name


def test_a_lane_does_not_depend_on_the_lanes_beside_it():
    everything = EVERYTHING | HARDWARE
    _, many = episodes(4, **everything)
    task, _ = episodes(1, **everything)
    alone = task.sample([np.random.default_rng(2)])
    assert_lane_is_alone(many, 2, alone)
    assert np.array_equal(targets(task, 4)[0][0], targets(task, 1)[0][0])


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
    assert drawn.mechanisms == (task.mechanism,) and not drawn.designs.any()
    assert drawn.noise is None


def test_what_is_fixed_is_not_drawn():
    task, free = episodes(2)
    fixed = TrackingOptions(links=2, start_tensions=np.array([1.0, 2.0]))
    rngs = [np.random.default_rng(seed) for seed in range(2)]
    drawn = task.sample(rngs, fixed)
    assert np.all(drawn.links == 2) and np.all(drawn.start_tensions == [1.0, 2.0])
    assert np.array_equal(drawn.target_tensions, free.target_tensions)
    assert np.array_equal(drawn.forces, free.forces)


def test_start_commands_give_the_start_tensions_when_nothing_pulls():
    task, _ = episodes(1, start="random", load={"magnitude": (0, 0)})
    lanes = TrackingEpisodeBuffer(task, 3, goal=False)
    drawn, _ = lanes.begin([np.random.default_rng(seed) for seed in range(3)])
    info = lanes.task.state_info(lanes.state.readings)
    assert np.allclose(info["tensions"], drawn.start_tensions, atol=1e-7)
    again = solve_lengths(task.mechanism, info["command"][0])
    assert np.allclose(again.tensions, drawn.start_tensions[0], atol=1e-6)
    assert np.ptp(drawn.start_tensions) > 1
