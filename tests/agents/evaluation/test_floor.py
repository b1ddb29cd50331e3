import dataclasses

import gymnasium
import numpy as np
import pytest
from scipy.optimize import least_squares

import rj_gym  # noqa: F401  (registers its ids)
from agents.evaluation.floor import STARTS, episode_floor, floor, why_no_floor
from agents.runs.environment import EnvConfig
from rollingjoint import CapstanFriction
from rollingjoint.chain.presets import preset, small_arm
from rollingjoint.errors import ConfigError, InvalidInput, SolverError
from rollingjoint.load import WorldForce, load_table, spatial_load_table
from rollingjoint.statics.solve import solve_lengths_batch, solve_tensions, solve_tensions_batch

HEAVY_TIP = {"load": {"link": "tip", "magnitude": [1.0, 1.5]}}
MOVING = {"load": {"process": "ou"}, "target": {"process": "path"}, "episode_steps": 30}
TWO_SEGMENT = {"mechanism": "two_segment"}
RANDOMISED = {
    "episode_steps": 60,
    "start": "random",
    "randomization": {
        "position_noise_mm": 0.2,
        "stiffness_spread": 0.2,
        "link_tolerance_mm": 0.1,
        "link_tolerance_rad": 0.01,
        "actuator_offset_mm": 0.5,
    },
}
TENSIONS = (0.5, 15.0)


HARD_ARM = {
    "start": "random",
    "gravity": {"tilt": [0.5, 1.0]},
    "load": {"magnitude": [0.5, 1.5], "process": "step"},
    "randomization": {
        "position_noise_mm": 1.0,
        "stiffness_spread": 0.2,
        "hinge_stiffness_spread": 0.1,
        "weight_spread": 0.1,
        "actuator_offset_mm": 0.5,
    },
}


def drive(config, seeds, act):
    """Tip errors (episodes, steps + 1) [mm] with actions act(info), info["sampled"] included."""
    envs = gymnasium.make_vec(
        config.id, len(seeds), "vector_entry_point", autoreset_mode="Disabled", **config.arguments()
    )
    _, info = envs.reset(seed=list(seeds))
    sampled, errors = info["sampled"], [info["error_mm"]]
    for _ in range(envs.unwrapped.config.episode_steps):
        info = envs.step(act(info | {"sampled": sampled}))[-1]
        errors.append(info["error_mm"])
    envs.close()
    return np.array(errors).T


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("RollingJoint-v0", {}),
        ("RollingJointGoal-v0", HEAVY_TIP),
        ("RollingJoint-v0", RANDOMISED),
        ("RollingJoint-v0", TWO_SEGMENT),
        ("FlexibleArm-v0", {}),
        ("FlexibleArmGoal-v0", HARD_ARM | {"orientation": True}),
    ],
    ids=["default", "heavy tip", "randomised", "two segments", "arm", "randomised arm"],
)
def test_a_controller_that_knows_the_best_command_arrives_exactly_at_the_floor(name, settings):
    config, seeds = EnvConfig(f"rj_gym/{name}", settings=settings), range(20000, 20020)
    best = episode_floor(config, seeds)

    def act(info):
        way = info["command"] + info["sampled"]["actuator_offsets"] - best.commands
        return np.clip(way, -1.0, 1.0)

    regret = drive(config, seeds, act)[:, -1] - best.errors
    assert np.abs(regret).max() < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "settings"),
    [("RollingJoint-v0", {}), ("FlexibleArm-v0", {"mechanism": "small_arm", "tension_range": [1.0, 5.0]})],
)
def test_no_controller_is_ever_below_the_floor_of_moving_targets_and_drifting_loads(name, settings):
    config = EnvConfig(f"rj_gym/{name}", settings=MOVING | settings)
    seeds, steps, m = range(30), [0, 1, 10, 29, 30], 2 if settings == {} else 4
    best, rng = episode_floor(config, seeds, steps), np.random.default_rng(0)
    assert best.errors.shape == (30, 5) and best.tensions.shape == (30, 5, m)

    def chase(info):
        return np.clip(info["command"] - best.commands[:, -1], -1.0, 1.0)

    for act in (chase, lambda info: rng.uniform(-1.0, 1.0, (30, m))):
        regret = drive(config, seeds, act)[:, steps] - best.errors
        assert regret.min() > -1e-8
        assert act is not chase or np.mean(regret[:, -1] < 1e-8) > 0.9
    np.testing.assert_array_equal(best.errors[:, -1], episode_floor(config, seeds).errors)


def best_of_grids(mechanism, target, loads):
    """Smallest tip error [mm] over tensions held within TENSIONS, from ever finer grids over their level and ratio."""
    low, high = np.log(TENSIONS)
    levels = np.linspace(low, high, 40)
    for _ in range(6):
        middle, width = np.zeros(len(levels)), 1.0
        for _ in range(7):
            ratios = np.clip(middle[:, None] + width * np.linspace(-1, 1, 41), -1, 1)
            top = np.broadcast_to(levels[:, None], ratios.shape)
            logs = np.stack([top - (top - low) * np.maximum(side * ratios, 0) for side in (1, -1)], axis=-1)
            tips = solve_tensions_batch(mechanism, np.exp(logs.reshape(-1, 2)), loads).tip
            errors = np.linalg.norm(tips - target, axis=1).reshape(ratios.shape)
            middle, width = ratios[np.arange(len(levels)), errors.argmin(axis=1)], 0.1 * width
        best = errors.min(axis=1).argmin()
        step = levels[1] - levels[0]
        levels = np.clip(np.linspace(levels[best] - step, levels[best] + step, 21), low, high)
    return errors.min()


def test_ever_finer_grids_over_held_tensions_find_the_same_minima():
    mechanism, rng = preset("five_link"), np.random.default_rng(1)
    loads = [[WorldForce(int(rng.integers(1, 5)), tuple(rng.uniform(-1.0, 1.0, 2)))] for _ in range(12)]
    targets = np.array([solve_tensions(mechanism, np.exp(rng.uniform(0.0, 1.8, 2))).tip for _ in loads])
    ours = floor(mechanism, targets, np.array([load_table(load, 5) for load in loads]), TENSIONS).errors
    theirs = np.array([best_of_grids(mechanism, *problem) for problem in zip(targets, loads, strict=True)])
    assert np.sum(ours > 0.01) > 3
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_the_floor_is_held_by_its_command_within_the_tension_range():
    mechanism, rng = preset("two_segment"), np.random.default_rng(2)
    loads = np.array([load_table([WorldForce(-1, tuple(force))], 7) for force in rng.uniform(-1.0, 1.0, (30, 2))])
    targets = mechanism.poses(rng.uniform(-0.5, 0.5, (30, 6)))[:, -1, :2]
    best = floor(mechanism, targets, loads, TENSIONS)
    held = solve_lengths_batch(mechanism, best.commands, loads, best.joint_angles, TENSIONS)
    assert np.all(held.status == best.status) and np.all(held.ok)
    assert np.all((best.tensions > TENSIONS[0] - 1e-8) & (best.tensions < TENSIONS[1] + 1e-8))
    np.testing.assert_allclose(held.tip, best.tips, atol=1e-9)
    np.testing.assert_allclose(held.tensions, best.tensions, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(best.tips - targets, axis=1), best.errors, atol=1e-12)
    assert 0 < np.mean(best.errors > 1e-6) < 1


@pytest.mark.slow
def test_bounded_least_squares_over_held_tensions_find_the_same_minima_for_an_arm():
    arm, rng, limits = small_arm(), np.random.default_rng(3), (0.5, 4.0)
    weights = [arm.gravity((0.3, 0.1, 1.0))]
    targets = np.array([solve_tensions(arm, np.exp(rng.uniform(-0.7, 1.4, 4)), weights).tip for _ in range(6)])
    loads = [[*weights, WorldForce(-1, tuple(rng.uniform(-0.3, 0.3, 3)), point=(0.0, 0.0, 0.0))] for _ in targets]
    tables = np.array([spatial_load_table(some, 5) for some in loads])
    ours = floor(arm, targets, tables, limits).errors
    theirs = [
        min(_least_miss(arm, target, some, limits, start) for start in rng.uniform(*limits, (12, 4)))
        for target, some in zip(targets, loads, strict=True)
    ]
    assert np.all(ours > 1e-3)
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def _least_miss(arm, target, loads, limits, start):
    """Smallest tip error [mm] that SciPy finds over held tensions from one start."""
    found = least_squares(
        lambda tensions: solve_tensions(arm, tensions, loads).tip - target, start, bounds=limits, xtol=1e-12, ftol=1e-14
    )
    return np.linalg.norm(found.fun)


def test_without_a_load_the_floor_is_zero_and_the_same_at_every_step():
    config = EnvConfig(settings={"load": {"magnitude": [0.0, 0.0]}})
    best = episode_floor(config, range(30), [0, 50])
    assert best.errors.max() < 1e-8
    np.testing.assert_array_equal(best.tensions[:, 0], best.tensions[:, 1])


def test_stronger_motors_never_raise_the_floor():
    floors = [
        episode_floor(EnvConfig(settings=HEAVY_TIP | {"tension_range": limits}), range(50)).errors
        for limits in ([1.0, 8.0], [0.5, 8.0], [0.5, 15.0], [0.0, 30.0])
    ]
    assert np.diff(floors, axis=0).max() < 1e-6
    assert np.diff(np.mean(floors, axis=1)).max() < -0.01


@pytest.mark.parametrize(
    ("name", "settings"), [("RollingJoint-v0", RANDOMISED), ("FlexibleArm-v0", HARD_ARM | {"mechanism": "small_arm"})]
)
def test_an_episode_has_the_same_floor_alone_and_among_others(name, settings):
    config = EnvConfig(f"rj_gym/{name}", settings=settings)
    together, alone = episode_floor(config, [3, 4, 5]), episode_floor(config, [4])
    for field in dataclasses.fields(together):
        np.testing.assert_allclose(getattr(alone, field.name)[0], getattr(together, field.name)[1], atol=1e-6)


def test_a_load_that_nothing_can_hold_is_reported():
    mechanism = preset("five_link")
    loads = load_table([WorldForce(-1, (1e13, 0.0))], 5)[None]
    with pytest.raises(SolverError, match="no start has an equilibrium"):
        floor(mechanism, np.zeros((1, 2)), loads, TENSIONS)


@pytest.mark.parametrize("steps", [[51], [-1, 3]])
def test_a_step_that_does_not_exist_is_refused(steps):
    with pytest.raises(InvalidInput, match="from 0 to 50"):
        episode_floor(EnvConfig(), range(2), steps)


def test_an_environment_without_a_tracking_task_has_no_floor():
    with pytest.raises(ConfigError, match="a tracking environment"):
        episode_floor(EnvConfig("Pendulum-v1"), range(2))


def gain_of_more_starts(settings, episodes, starts, name="RollingJoint-v0"):
    """How much lower the floors are with more starts than the usual ones, (E,) [mm]."""
    config, seeds = EnvConfig(f"rj_gym/{name}", settings=settings), range(episodes)
    more = episode_floor(config, seeds, starts=starts)
    return episode_floor(config, seeds).errors - more.errors


def test_twice_the_starts_find_nothing_better():
    assert gain_of_more_starts({"load": {"link": "tip"}}, 100, starts=2 * STARTS).max() < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {"load": {"magnitude": [0.5, 0.75]}},
        {"tension_range": [0.5, 5.0]},
        {"gravity": {"tilt": [0.5, 1.0]}, "load": {"magnitude": [1.0, 2.0]}},
    ],
    ids=str,
)
def test_three_times_the_starts_find_nothing_better_for_the_arm(settings):
    better = gain_of_more_starts(settings, 200, starts=3 * STARTS, name="FlexibleArm-v0")
    print(f"at most {better.max():.1e} mm better in 200: {settings}")
    assert better.max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"load": {"link": "tip"}},
        {"load": {"magnitude": [1.0, 1.5]}},
        HEAVY_TIP,
        TWO_SEGMENT,
        TWO_SEGMENT | HEAVY_TIP,
        {"mechanism": "uniform"},
        {"tension_range": [0.0, 15.0]},
    ],
    ids=str,
)
def test_four_times_the_starts_find_next_to_nothing_better(settings):
    better = gain_of_more_starts(settings, 500, starts=4 * STARTS)
    print(f"more than 1e-6 mm better in {np.sum(better > 1e-6)} of 500, at most {better.max():.1e} mm: {settings}")
    assert np.mean(better > 1e-4) <= 0.004


@pytest.mark.parametrize("settings", [{"friction": {"mu": [0.0, 0.1]}}, {"mechanism": "rubbed"}], ids=["set", "own"])
def test_with_friction_no_floor_is_claimed(settings):
    if "mechanism" in settings:
        settings = {"mechanism": preset("five_link").replace(friction=CapstanFriction(0.0, constant=0.1))}
    env = EnvConfig(settings=settings)
    assert "depends on the moves before it" in why_no_floor(env)
    with pytest.raises(ConfigError, match="every path"):
        episode_floor(env, [0])


def test_friction_that_does_nothing_leaves_the_floors_as_they_are():
    seeds = range(4)
    env, plain = EnvConfig(settings={"friction": {"mu": 0.0}}), EnvConfig()
    assert why_no_floor(env) == why_no_floor(plain) == ""
    np.testing.assert_array_equal(episode_floor(env, seeds).errors, episode_floor(plain, seeds).errors)
