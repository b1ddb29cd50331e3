"""Controllers without tuned settings: what each is for, on seeds on which none was tuned, and shared pieces."""

from functools import cache

import numpy as np
import pytest
import yaml
from scipy.optimize import least_squares

from agents.controllers import DoNothing, JacobianFeedback, LoadEstimate, OpenLoop, Predictive, untuned_controllers
from agents.controllers.controller import Reading
from agents.controllers.measured import estimated_loads, measured_equilibrium
from agents.controllers.steps import bounded_step, length_responses, nearest_tensions, tension_response
from agents.evaluation.floor import episode_floor
from agents.evaluation.rollout import run_episodes
from agents.runs.environment import EnvConfig
from agents.runs.seeds import TUNING
from rj_gym.registry import task_of
from rj_gym.tracking.config import FlexibleArmConfig, TrackingConfig
from rj_gym.tracking.vector import RollingJointVectorEnv
from rollingjoint import BodyWrench, solve_lengths_batch, solve_tensions, solve_tensions_batch
from rollingjoint.chain.presets import preset, small_arm, uniform
from rollingjoint.errors import InvalidInput
from rollingjoint.load import load_table
from rollingjoint.statics.sensitivity import dposes_dtensions

SEEDS = range(9000, 9040)
UNLOADED = {"load": {"magnitude": (0.0, 0.0)}}
FEEDBACK = [JacobianFeedback, LoadEstimate, Predictive]


def final_errors(controller, seeds=SEEDS, env_id="rj_gym/RollingJoint-v0", **settings):
    return run_episodes(EnvConfig(env_id, settings=settings), controller, seeds).final_errors


@cache
def floors():
    return episode_floor(EnvConfig(), SEEDS).errors


def stepped(steps=15, lanes=60, **settings):
    """What is seen after some steps of Jacobian feedback, and the info of that moment."""
    env = RollingJointVectorEnv(lanes, **settings)
    observation, info = env.reset(seed=9000)
    controller = JacobianFeedback()
    controller.begin(env.task, lanes)
    for _ in range(steps):
        observation, *_, info = env.step(controller.act(observation))
    return Reading(observation, env.task), info


def test_doing_nothing_misses_the_target():
    errors = run_episodes(EnvConfig(settings=UNLOADED), DoNothing(), range(10)).errors
    assert np.median(errors[:, -1]) > 5
    assert np.allclose(errors, errors[:, :1], atol=1e-6)


def test_open_loop_reaches_the_target_where_there_is_no_load():
    assert final_errors(OpenLoop(), range(10), **UNLOADED).max() < 0.5


def test_open_loop_rests_at_the_tension_that_was_best_on_tuning_seeds():
    """Measured over 300 of them: 2.69 mm at 3 N, 1.07 at 13 N, 1.08 at 15 N."""
    seeds = TUNING[:60]
    errors = [final_errors(OpenLoop(rest), seeds).mean() for rest in (3.0, 10.0, None)]
    assert errors[2] < 0.98 * errors[1] < 0.7 * errors[0]
    np.testing.assert_array_equal(final_errors(OpenLoop(13.0), seeds[:3]), final_errors(OpenLoop(), seeds[:3]))


def test_open_loop_keeps_its_rest_tension_within_the_range_of_the_task():
    controller = OpenLoop(50.0)
    controller.begin(task_of(TrackingConfig(tension_range=(1.0, 8.0))), 2)
    np.testing.assert_array_equal(controller.rest, 8.0)
    with pytest.raises(InvalidInput, match="rest_tension = 0"):
        OpenLoop(0.0)


def test_open_loop_follows_a_moving_target():
    settings = UNLOADED | {"target": {"process": "path"}, "episode_steps": 200}
    errors = run_episodes(EnvConfig(settings=settings), OpenLoop(), range(3)).errors
    assert np.median(errors[:, -50:]) < 1.0


def test_open_loop_does_not_look_at_the_load():
    lengths = []
    for force in ((0.0, 0.0), (0.5, -0.5)):
        env, controller = RollingJointVectorEnv(1), OpenLoop()
        load = {"link": 4, "force": force}
        observation, _ = env.reset(seed=3, options={"target": (-40.0, 65.0), "load": load})
        controller.begin(env.task, 1)
        controller.act(observation)
        lengths.append(controller.lengths)
    np.testing.assert_array_equal(lengths[0], lengths[1])


@pytest.mark.slow
@pytest.mark.parametrize("controller", FEEDBACK)
def test_feedback_ends_near_the_floor(controller):
    """Measured for these seeds: mean regret 0.0024 mm, the largest 0.01 mm; docs/training.md has 1,000 episodes."""
    regret = final_errors(controller()) - floors()
    assert regret.mean() < 0.01
    assert regret.max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("controller", FEEDBACK)
@pytest.mark.parametrize("env_id", ["rj_gym/RollingJoint-v0", "rj_gym/RollingJointGoal-v0"])
def test_feedback_works_with_four_tendons_and_on_the_goal_environment(controller, env_id):
    assert final_errors(controller(), SEEDS[:20], env_id, mechanism="two_segment").max() < 0.5


@pytest.mark.parametrize("controller", FEEDBACK)
def test_feedback_works_on_another_mechanism_without_observed_tensions(controller):
    errors = final_errors(controller(), SEEDS[:20], mechanism=uniform(4, radius=30.0), observe_tensions=False)
    assert np.median(errors) < 0.2
    assert errors.max() < 1.0


@pytest.mark.parametrize("controller", FEEDBACK)
def test_feedback_survives_noise_tolerances_offsets_and_a_drifting_load(controller):
    with open("configs/env/tracking_randomised.yaml", encoding="utf-8") as stream:
        settings = yaml.safe_load(stream)
    assert np.median(final_errors(controller(), SEEDS, **settings)) < 0.6


@pytest.mark.slow
@pytest.mark.parametrize("controller", FEEDBACK)
def test_feedback_keeps_up_with_a_moving_target(controller):
    settings = {"target": {"process": "path"}, "episode_steps": 100, "load": {"magnitude": (0.0, 0.5)}}
    errors = run_episodes(EnvConfig(settings=settings), controller(), SEEDS[:10]).errors
    assert np.median(errors[:, 40:]) < 0.15


def test_feedback_keeps_tensions_away_from_slack_and_from_yielding():
    seen, _ = stepped(steps=40, load={"magnitude": (1.0, 1.5)})
    tensions = seen.tensions
    assert tensions.min() > 1.0
    assert tensions.max() < 14.5
    assert np.median(tensions.max(axis=1)) > 13.5


@pytest.mark.slow
@pytest.mark.parametrize("name", untuned_controllers())
@pytest.mark.parametrize(
    "config",
    [TrackingConfig(), TrackingConfig(mechanism="two_segment"), FlexibleArmConfig(orientation=True)],
    ids=["five_link", "two_segment", "flexible_arm"],
)
def test_actions_are_finite_and_within_bounds_whatever_is_seen(name, config):
    task, controller = task_of(config), untuned_controllers()[name]
    controller.begin(task, 50)
    low, high = task.observation_bounds()
    rng = np.random.default_rng(0)
    for _ in range(5):
        observation = rng.uniform(low, high, (50, len(low))).astype(np.float32)
        actions = controller.act(Reading(observation, task))
        assert actions.shape == (50, task.mechanism.n_tendons)
        assert np.all(np.abs(actions) <= 1 + 1e-12)


def test_the_model_is_at_the_measured_pose_and_tensions():
    seen, _ = stepped()
    model = measured_equilibrium(seen.task.mechanism, seen)
    np.testing.assert_allclose(model.poses, seen.poses, atol=1e-4)
    np.testing.assert_allclose(model.tensions, seen.tensions, atol=1e-4)


def test_pose_and_tensions_tell_the_load_at_the_tip():
    """Measured: within 1e-4 N in 95 % of the lanes where nothing passes for noise; by default the link in all."""
    seen, info = stepped(load={"link": "tip", "magnitude": (0.5, 1.0)})
    measured = measured_equilibrium(seen.task.mechanism, seen)
    exact, cautious = estimated_loads(measured, noise=0.03), estimated_loads(measured)
    missed = np.linalg.norm(exact[:, 0, 3:5] - info["load"]["force"], axis=1)
    assert np.percentile(missed, 95) < 1e-3
    assert np.all(cautious[:, 0, 0] == 4)


def test_the_model_under_the_estimated_load_is_near_the_measured_pose():
    """It has that load once; measured: within 0.02 mm and 0.0005 rad in every lane."""
    seen, _ = stepped()
    controller = LoadEstimate()
    controller.begin(seen.task, len(seen.tip))
    model, loads = controller.measured.loaded(seen)
    np.testing.assert_array_equal(model.loads, loads)
    np.testing.assert_allclose(model.poses, seen.poses, atol=0.05)


@pytest.mark.parametrize("name", ["five_link", "two_segment"])
def test_the_model_inverse_puts_the_unloaded_tip_on_reachable_targets(name):
    mechanism, rng = preset(name), np.random.default_rng(0)
    targets = solve_tensions_batch(mechanism, rng.uniform(1.5, 5.0, (20, mechanism.n_tendons))).tip
    rest = np.full((20, mechanism.n_tendons), 3.0)
    tensions = nearest_tensions(mechanism, targets, (0.5, 15.0), rest, rest)
    assert np.all((tensions >= 0.5 - 1e-12) & (tensions <= 15.0 + 1e-12))
    assert np.linalg.norm(solve_tensions_batch(mechanism, tensions).tip - targets, axis=1).max() < 0.05


def test_the_model_inverse_finds_what_scipy_finds_one_by_one():
    """Targets on the unloaded curve and up to 10 mm beside it; measured: tensions within 0.2 %."""
    mechanism, rng = preset("five_link"), np.random.default_rng(1)
    targets = solve_tensions_batch(mechanism, rng.uniform(1.0, 6.0, (20, 2))).tip + rng.uniform(-10, 10, (20, 2))
    rest = np.full((20, 2), 3.0)
    expected = [_scipy_tensions(mechanism, target) for target in targets]
    np.testing.assert_allclose(nearest_tensions(mechanism, targets, (0.5, 15.0), rest, rest), expected, rtol=5e-3)


def _scipy_tensions(mechanism, target):
    """As before the search was batched: bounded least squares over log tensions, their mean drawn to log 3 N."""
    middle, weight = np.log(3.0), 0.1

    def misfit(logs):
        return np.append(solve_tensions(mechanism, np.exp(logs)).tip - target, weight * (logs.mean() - middle))

    def slope(logs):
        tips = dposes_dtensions(solve_tensions(mechanism, np.exp(logs)))[-1, :2] * np.exp(logs)
        return np.vstack([tips, np.full(2, weight / 2)])

    return np.exp(least_squares(misfit, np.full(2, middle), slope, bounds=np.log([0.5, 15.0])).x)


@pytest.mark.parametrize(
    ("mechanism", "loads"), [(preset("two_segment"), []), (small_arm(), [small_arm().gravity((0.2, 0.0, 1.0))])]
)
def test_responses_are_central_differences(mechanism, loads):
    rng = np.random.default_rng(2)
    lengths = mechanism.neutral_lengths - rng.uniform(0.5, 3.0, (5, 4))
    found = solve_lengths_batch(mechanism, lengths, loads)
    tips, tensions = length_responses(found)
    by_tension = tension_response(found)
    for j in range(4):
        step = 1e-5 * np.eye(4)[j]
        ahead, behind = (solve_lengths_batch(mechanism, lengths + way, loads, found) for way in (step, -step))
        np.testing.assert_allclose(tips[:, :, j], (ahead.tip - behind.tip) / 2e-5, atol=1e-4)
        np.testing.assert_allclose(tensions[:, :, j], (ahead.tensions - behind.tensions) / 2e-5, atol=1e-4)
        ahead, behind = (solve_tensions_batch(mechanism, found.tensions + w, loads, found) for w in (step, -step))
        np.testing.assert_allclose(by_tension[:, :, j], (ahead.tip - behind.tip) / 2e-5, atol=1e-4)


def test_without_a_usable_equilibrium_tendons_only_stretch():
    mechanism = preset("five_link")
    fine, hopeless = (load_table([BodyWrench(4, force)], 5) for force in ((0.1, 0.0), (np.nan, 0.0)))
    lengths = np.repeat(mechanism.neutral_lengths[None] - 1.0, 2, axis=0)
    tips, tensions = length_responses(solve_lengths_batch(mechanism, lengths, np.stack([fine, hopeless])))
    assert np.abs(tips[0]).max() > 0.1
    np.testing.assert_array_equal(tips[1], 0.0)
    np.testing.assert_array_equal(tensions[1], -np.diag(mechanism.stiffnesses))


def test_a_bounded_step_is_the_best_beside_the_entries_at_their_bounds():
    rng = np.random.default_rng(3)
    roots = rng.normal(size=(200, 4, 4))
    hessian, slope = roots @ np.swapaxes(roots, 1, 2) + 0.5 * np.eye(4), 0.4 * rng.normal(size=(200, 4))
    low, high = np.full((200, 4), -0.3), np.full((200, 4), 0.2)
    step = bounded_step(hessian, slope, low, high)
    inside = (step > low) & (step < high)
    assert np.all((step >= low) & (step <= high))
    assert 0.1 < inside.mean() < 0.9
    np.testing.assert_allclose((slope + (hessian @ step[..., None])[..., 0])[inside], 0.0, atol=1e-6)


def test_a_bounded_step_survives_a_singular_hessian():
    hessian = 1e15 * np.ones((1, 2, 2))
    assert np.all(np.isfinite(bounded_step(hessian, np.array([[1.0, 1.0]]), -np.ones((1, 2)), np.ones((1, 2)))))
