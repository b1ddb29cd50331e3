"""The instrument of rolling joints in space: the arm's task with a SpatialChain."""

import copy
import dataclasses
import pickle
import re
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import yaml
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.seeding import np_random
from stable_baselines3.common.env_checker import check_env as check_for_sb3

import rj_gym
from rj_gym import FlexibleArmEnv, PitchYawConfig, PitchYawEnv, PitchYawVectorEnv
from rj_gym.rendering import SIZE
from rj_gym.tracking import tangent
from rollingjoint import (
    PointHinge,
    RollingContact,
    SpaceTendon,
    SpatialChain,
    SpatialLink,
    Status,
    WorldForce,
    solve_lengths,
    solve_tensions,
)
from rollingjoint.chain.presets import five_link, flexible_arm, pitch_yaw, pitch_yaw_two_segment
from rollingjoint.errors import ConfigError
from tests.pages import bounds, rows
from tests.rj_gym.rollouts import rollout, same

ROOT = Path(__file__).resolve().parents[3]
ID = "rj_gym/PitchYaw-v0"
BLIND = yaml.safe_load((ROOT / "configs/env/pitch_yaw_blind.yaml").read_text("utf-8"))
HEAVY = pitch_yaw_two_segment(weight=0.02)


def mixed() -> SpatialChain:
    """Rolling joints about x and hinges about y in turn, with weights off the middle of the links."""
    rolling = pitch_yaw(2).joints[0]
    assert isinstance(rolling, RollingContact)
    hinge = PointHinge((1.0, 0.0, 0.0), (0.0, 0.0, 2.5), (0.0, 0.0, -2.5), stiffness=20.0, limits=(-0.6, 0.6))
    tendons = [SpaceTendon([((x, y, -1.7), (x, y, 1.7))], -1, 10.0) for x, y in ((3, 0), (0, 3), (-3, 0), (0, -3))]
    links = [SpatialLink(), *[SpatialLink(0.02, (0.5, 0.0, 1.0))] * 6]
    return SpatialChain([rolling, hinge] * 3, tendons, links, "mixed")


def test_defaults_are_the_documented_task():
    config = PitchYawConfig()
    assert (config.mechanism, config.action_scale_mm) == ("pitch_yaw_two_segment", 0.5)
    assert (config.load.magnitude, config.gravity.tilt) == ((0.0, 0.2), (0.0, np.pi))
    assert PitchYawConfig.from_dict({"reward": {"effort": 0.0}}).reward.error_scale_mm == 10.0
    settings = yaml.safe_load((ROOT / "configs/env/pitch_yaw.yaml").read_text("utf-8"))
    assert PitchYawConfig.from_dict(settings) == config
    assert rj_gym.settings_of(ID) is PitchYawConfig


@pytest.mark.parametrize("mechanism", [flexible_arm(), five_link(), 3])
def test_other_mechanisms_are_refused(mechanism):
    with pytest.raises(ConfigError, match="SpatialChain"):
        PitchYawEnv(mechanism=mechanism)
    with pytest.raises(ConfigError, match="HingeChain"):
        FlexibleArmEnv(mechanism=pitch_yaw())


def test_a_step_is_the_equilibrium_under_commands_and_payload():
    env = PitchYawEnv(mechanism=HEAVY)
    _, info = env.reset(seed=3)
    for action in np.random.default_rng(0).uniform(-0.5, 0.5, (6, 8)).astype(np.float32):
        command = info["command"] - 0.5 * action
        *_, info = env.step(action)
        loads = [HEAVY.gravity(info["gravity"]), WorldForce(-1, info["load"]["force"])]
        expected = solve_lengths(HEAVY, command, loads, tension_limits=env.config.tension_range)
        np.testing.assert_allclose(info["tip"], expected.tip, atol=1e-8)
        np.testing.assert_allclose(info["tensions"], expected.tensions, atol=1e-8)


@pytest.mark.parametrize("loaded", [False, True])
def test_targets_are_tips_without_payload_or_with_it(loaded):
    env = PitchYawEnv(mechanism="pitch_yaw", target={"loaded": loaded}, load={"magnitude": (0.2, 0.2)})
    for seed in range(8):
        _, info = env.reset(seed=seed)
        draws = env.task.sample([np_random(seed)[0]])
        assert draws.target_tensions.min() >= 2.0 and draws.target_tensions.max() <= 8.0
        force = info["load"]["force"] if loaded else np.zeros(3)
        expected = solve_tensions(env.task.mechanism, draws.target_tensions[0, 0], [WorldForce(-1, force)])
        if expected.status == Status.CONVERGED or not loaded:
            np.testing.assert_allclose(info["target"], expected.tip, atol=1e-7)


def test_gravity_has_any_direction():
    task = PitchYawEnv().task
    draws = task.sample([np.random.default_rng(seed) for seed in range(400)])
    assert np.abs(draws.gravity.mean(axis=0)).max() < 0.1
    np.testing.assert_allclose((draws.gravity**2).mean(axis=0), 1 / 3, atol=0.05)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        BLIND,
        {"mechanism": mixed(), "orientation": True},
        {"mechanism": HEAVY, "randomization": {"hinge_stiffness_spread": 0.3, "weight_spread": 0.3}},
        {"friction": {"mu": 0.1}},
    ],
    ids=["plain", "blind", "mixed", "varied", "friction"],
)
def test_a_batch_equals_scalar_environments_and_goes_on_from_copies(settings):
    envs = PitchYawVectorEnv(3, config=settings | {"episode_steps": 5})
    scalars = [PitchYawEnv(config=settings | {"episode_steps": 5}) for _ in range(3)]
    observations, _ = envs.reset(seed=7)
    for lane, env in enumerate(scalars):
        assert np.array_equal(env.reset(seed=7 + lane)[0], observations[lane])
    rng = np.random.default_rng(1)
    for _ in range(3):
        actions = rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)
        observations, rewards, *_ = envs.step(actions)
        for lane, env in enumerate(scalars):
            observation, reward, *_ = env.step(actions[lane])
            assert np.array_equal(observation, observations[lane]) and reward == rewards[lane]
    other = PitchYawVectorEnv(3, config=settings | {"episode_steps": 5})
    other.set_state(envs.get_state())
    copies = [envs, other, copy.deepcopy(envs), pickle.loads(pickle.dumps(envs))]
    outcomes = [env.step(actions) for env in copies]
    assert all(same(outcome, outcomes[0]) for outcome in outcomes)
    assert observations.shape[1] == len(rj_gym.observation_entries(envs.config, envs.task.mechanism))


@pytest.mark.slow
@pytest.mark.parametrize("settings", [{}, BLIND], ids=["plain", "blind"])
def test_checkers_are_silent(settings):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(ID, disable_env_checker=True, **settings).unwrapped, skip_render_check=True)
        check_for_sb3(PitchYawEnv(config=settings))
        rj_gym.check_vector_env(
            lambda autoreset_mode: PitchYawVectorEnv(
                3, config=settings | {"episode_steps": 5}, autoreset_mode=autoreset_mode, render_mode="rgb_array"
            ),
            n_steps=15,
            max_episode_steps=5,
            scalar=lambda: PitchYawEnv(config=settings | {"episode_steps": 5}),
        )


def test_a_batch_of_scaled_chains_equals_chains_that_are_built_anew():
    chain, rng = mixed(), np.random.default_rng(2)
    joints, tendons, weights = rng.uniform(0.7, 1.3, 6), rng.uniform(0.7, 1.3, 4), rng.uniform(0.7, 1.3, 6)
    scaled = chain.scaled(joints, tendons, weights)
    built = chain.replace(
        joints=[dataclasses.replace(j, stiffness=j.stiffness * f) for j, f in zip(chain.joints, joints, strict=True)],
        tendons=[
            dataclasses.replace(t, stiffness=t.stiffness * f) for t, f in zip(chain.tendons, tendons, strict=True)
        ],
        links=[
            dataclasses.replace(link, weight=link.weight * f)
            for link, f in zip(chain.links, [1.0, *weights], strict=True)
        ],
    )
    assert scaled.links == built.links and scaled.joints == built.joints and scaled.tendons == built.tendons
    down = (0.0, 0.0, 1.0)
    first, second = (solve_lengths(each, chain.neutral_lengths - 0.3, [each.gravity(down)]) for each in (scaled, built))
    assert np.array_equal(first.poses, second.poses) and np.array_equal(first.tensions, second.tensions)


@pytest.mark.parametrize("settings", [{}, {"mechanism": mixed()}], ids=["rolling", "mixed"])
def test_rates_of_the_tip_are_those_of_forward_differences(settings, monkeypatch):
    """Levers are about contact points: about link origins the tip's rates would be off by 7 %."""
    taut = {"start_tension": 15.0, "tension_range": (0.5, 60.0)}
    envs = gymnasium.make_vec(ID, 5, "vector_entry_point", **settings, **taut).unwrapped
    envs.reset(seed=5)
    for action in np.random.default_rng(0).uniform(-0.3, 0.3, (4, *envs.action_space.shape)):
        envs.step(action)
    rates = envs.tangent()
    with monkeypatch.context() as patched:
        patched.setattr(tangent, "_implicit_rates", lambda *lanes: None)
        differences = envs.tangent()
    for name in ("tip_rates", "tension_rates", "length_rates"):
        np.testing.assert_allclose(getattr(rates, name), getattr(differences, name), rtol=2e-3, atol=2e-3)


def test_the_privileged_state_has_joint_angles_and_the_payload():
    env = PitchYawEnv(privileged="info", load={"magnitude": (0.2, 0.2)})
    _, info = env.reset(seed=1)
    names = [entry.name for entry in env.task.privileged_entries()]
    truth = dict(zip(names, info["privileged"], strict=True))
    angles = [truth[f"joint {i} angle"] for i in range(14)]
    np.testing.assert_allclose(env.task.mechanism.poses(angles)[-1, :3, 3], info["tip"], atol=1e-3)
    assert truth["payload"] == pytest.approx(1.0)


def test_random_actions_find_an_equilibrium_in_every_step():
    envs = PitchYawVectorEnv(64)
    envs.reset(seed=0)
    rng = np.random.default_rng(3)
    for _ in range(50):
        _, _, terminated, _, info = envs.step(rng.uniform(-1, 1, (64, 8)).astype(np.float32))
        assert not terminated.any()
        assert set(info["status"]) <= {Status.CONVERGED.name, Status.AT_LIMIT.name}


@pytest.mark.parametrize("mechanism", ["pitch_yaw_two_segment", mixed()], ids=["tube", "mixed"])
def test_pictures_show_every_link(mechanism):
    env = PitchYawEnv(render_mode="rgb_array", mechanism=mechanism)
    rollout(env, seed=1, steps=2)
    picture = env.render()
    assert picture.shape == (SIZE[1], SIZE[0], 3) and len(np.unique(picture.reshape(-1, 3), axis=0)) > 200


def test_the_docstring_tables_every_entry_with_its_bounds():
    table = bounds(PitchYawEnv.__doc__)
    for entry in PitchYawEnv().task.entries():
        name = re.sub(r"(tendon) \d", r"\1 j", entry.name)
        assert table[name] == (f"{entry.low:g}", f"{entry.high:g}"), entry.name


def test_the_page_has_every_default_that_differs_from_the_arms():
    page = (ROOT / "docs/arm_environment.md").read_text("utf-8")
    cells = rows(page, "## An instrument of rolling joints")
    (_, *defaults) = [row for row in cells if len(row) == 2]
    table = {key: yaml.safe_load(value) for key, value in defaults}
    ours, arms = (flat(dataclasses.asdict(config)) for config in (PitchYawConfig(), rj_gym.FlexibleArmConfig()))
    assert table == {key: value for key, value in ours.items() if value != arms[key]}


def flat(settings, section=""):
    """Values of nested settings by their dotted names; ranges are lists."""
    values = {}
    for key, value in settings.items():
        if isinstance(value, dict):
            values |= flat(value, f"{section}{key}.")
        else:
            values[section + key] = list(value) if isinstance(value, tuple) else value
    return values
