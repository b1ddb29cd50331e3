"""rj_gym/CoDesign: both checkers, lanes and scalar environments alike, what the phases do, what is refused."""

import copy
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import rj_gym
import rollingjoint as rj
from rollingjoint import ConfigError, InvalidInput
from tests.rj_gym.rollouts import same

torch = pytest.importorskip("torch")

ID = "rj_gym/CoDesign-v0"
SMALL = {"space": {"knots": 3}, "design_steps": 2, "control_steps": 4, "targets": 2}
VARIANTS = {
    "default": {},
    "small": SMALL,
    "four tendons": {
        "space": {"mechanism": "two_segment", "height": [-2, 3]},
        "start": "reference",
        "control_steps": 5,
    },
    "in space": {"space": {"mechanism": "pitch_yaw", "azimuth": [-0.3, 0.3]}, "control_steps": 4},
}


@pytest.fixture(autouse=True, scope="module")
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def make(**settings):
    return gymnasium.make(ID, **(SMALL | settings)).unwrapped


def make_vec(lanes, **settings):
    return gymnasium.make_vec(ID, lanes, "vector_entry_point", **(SMALL | settings))


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIANTS)
def test_gymnasium_and_stable_baselines_checkers_pass_without_a_warning(name):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(ID, **VARIANTS[name]).unwrapped)
        checker.check_env(gymnasium.make(ID, **VARIANTS[name]).unwrapped)


@pytest.mark.slow
def test_the_vector_environment_passes_every_check():
    def make_env(autoreset_mode=AutoresetMode.SAME_STEP):
        return make_vec(2, render_mode="rgb_array", autoreset_mode=autoreset_mode)

    report = rj_gym.check_vector_env(make_env, n_steps=8, max_episode_steps=6, scalar=make)
    assert report.modes == tuple(AutoresetMode) and not report.skipped
    assert "equals_scalar_infos" in {outcome.check for outcome in report.passed}


def test_lanes_with_mechanisms_of_their_own_equal_scalar_environments():
    native, scalar = make_vec(4), SyncVectorEnv([make] * 4)
    assert same(native.reset(seed=3), scalar.reset(seed=3))
    rng, designs = np.random.default_rng(0), None
    for _ in range(9):
        actions = rng.uniform(-1, 1, native.action_space.shape).astype(np.float32)
        one, other = native.step(actions), scalar.step(actions)
        assert same(one, other)
        designs = one[4]["built_design"]
    assert len(np.unique(designs.round(6), axis=0)) == 4


def episode(env, act, seed=0):
    """Infos of an episode by its steps."""
    observation, info = env.reset(seed=seed)
    infos, over = [info], False
    while not over:
        observation, reward, _, over, info = env.step(act(observation, info))
        infos.append(info | {"reward": reward})
    return infos


def test_the_mechanism_is_that_of_the_design_and_the_tip_that_of_the_compiled_solver():
    env = make(force=(0.05, 0.1))
    rng = np.random.default_rng(1)
    infos = episode(env, lambda *_: 0.5 * rng.uniform(-1, 1, env.action_space.shape))
    assert [info["phase"] for info in infos] == ["design"] * 2 + ["control"] * 5
    last, force = infos[-1], infos[0]["sampled"]["force"]
    assert np.array_equal(infos[2]["built_design"], last["built_design"]) and np.any(last["command"] != 0.0)
    mechanism = env.config.space.mechanism(last["built_design"])
    rest = rj.solve_tensions(mechanism, (4.0, 4.0))
    lengths = rest.lengths - 4.0 / mechanism.stiffnesses - last["command"]
    held = rj.solve_lengths(mechanism, lengths, [rj.WorldForce(-1, tuple(force))])
    assert last["tip"] == pytest.approx(held.tip, abs=1e-5)
    assert last["tensions"] == pytest.approx(held.tensions, abs=1e-5)
    assert last["error_mm"] == pytest.approx(np.linalg.norm(last["target"] - last["tip"]))
    assert last["reward"] == pytest.approx(-last["error_mm"] / 10.0)


def test_actions_of_the_other_phase_do_nothing():
    first, second = (make() for _ in range(2))
    d = first.config.space.dimensions

    def half(part):
        def act(observation, info):
            action = np.zeros(d + 2)
            controls = observation[0] == 1.0
            action[:d], action[d:] = 0.2 * ~controls, 0.3 * controls
            action[d:] += part * ~controls
            action[:d] += part * controls
            return action

        return act

    for one, other in zip(episode(first, half(0.0)), episode(second, half(0.7)), strict=True):
        assert one["error_mm"] == other["error_mm"] and np.array_equal(one["command"], other["command"])


def test_a_design_that_cannot_be_built_leaves_the_last_one_standing():
    env = make(start="reference", design_scale=2.0)
    _, info = env.reset(seed=0)
    flat = np.zeros(env.action_space.shape)
    flat[: env.config.space.dimensions] = -1.0
    _, reward, _, _, after = env.step(flat)
    assert not after["valid"] and after["status"] == "INVALID_INPUT" and reward < 0.0
    assert np.array_equal(after["built_design"], info["design"]) and np.array_equal(after["tip"], info["tip"])
    assert after["reward_terms"]["violation"] == reward


@pytest.mark.slow
def test_pulling_towards_the_target_brings_the_tip_nearer():
    env = make(control_steps=24, targets=1, force=(0.0, 0.0), start="reference")
    names = [entry.name for entry in env.task.entries()]
    error = names.index("error x")

    def pull(observation, info):
        action = np.zeros(env.action_space.shape)
        action[-2:] = np.array([-1.0, 1.0]) * np.clip(2.0 * observation[error], -1.0, 1.0)
        return action

    gains = [(infos[0]["error_mm"], infos[-1]["error_mm"]) for infos in (episode(env, pull, seed) for seed in range(6))]
    assert np.mean([after for _, after in gains]) < 0.5 * np.mean([before for before, _ in gains])


def test_targets_are_the_same_for_all_designs_and_options_fix_an_episode():
    env = make()
    _, info = env.reset(seed=5)
    chosen = env.config.space.reference()
    _, again = env.reset(seed=5, options={"design": chosen})
    assert np.array_equal(info["sampled"]["targets"], again["sampled"]["targets"])
    assert np.array_equal(again["built_design"], chosen)
    places = np.array([[0.0, 90.0], [10.0, 85.0]])
    infos = [env.reset(options={"targets": places, "force": (0.0, 0.02)})[1]]
    for _ in range(6):
        infos.append(env.step(np.zeros(env.action_space.shape))[4])
    assert [info["target"].tolist() for info in infos[3:]] == [places[0].tolist()] * 2 + [places[1].tolist()] * 2


def test_a_copied_environment_and_a_restored_state_go_on_alike():
    env = make_vec(2)
    env.reset(seed=3)
    actions = np.full(env.action_space.shape, 0.2)
    env.step(actions)
    other, state = copy.deepcopy(env), env.get_state()
    expected = [env.step(actions) for _ in range(3)]
    assert same(expected, [other.step(actions) for _ in range(3)])
    env.set_state(state)
    assert same(expected, [env.step(actions) for _ in range(3)])


def test_pictures_differ_between_the_phases():
    for space in ({"knots": 3}, {"mechanism": "pitch_yaw", "azimuth": (-0.2, 0.2)}):
        env = make(render_mode="rgb_array", space=space)
        env.reset(seed=0)
        pictures = [env.render()]
        for _ in range(4):
            env.step(np.full(env.action_space.shape, 0.3))
            pictures.append(env.render())
        assert all(picture.shape == (600, 720, 3) for picture in pictures)
        assert not np.array_equal(pictures[0], pictures[-1])


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"space": 3}, "DesignSpace"),
        ({"space": {"mechanism": "five_lnk"}}, "five_link"),
        ({"design_steps": 0}, "design_steps"),
        ({"targets": 99}, "targets"),
        ({"start": "best"}, "random"),
        ({"target_tensions": (5.0, 3.0)}, "Write"),
        ({"pretension": -1.0}, "pretension"),
        ({"reward": {"effort": -1.0}}, "effort"),
        ({"step": 1.0}, "step_mm"),
    ],
)
def test_wrong_settings_are_refused(settings, words):
    with pytest.raises(ConfigError, match=words):
        gymnasium.make(ID, **settings)


@pytest.mark.parametrize(
    "options",
    [{"colour": 1}, {"design": np.full(6, -1.0)}, {"design": [0.0]}, {"targets": [[0.0, 1.0]]}, {"force": (np.nan, 0)}],
)
def test_wrong_options_are_refused(options):
    env = make()
    env.reset(seed=0)
    before = env.step(np.zeros(env.action_space.shape))
    with pytest.raises(InvalidInput):
        env.reset(options=options)
    env.reset(seed=0)
    assert same(before, env.step(np.zeros(env.action_space.shape)))


def test_wrong_actions_are_refused_and_change_nothing():
    env = make()
    env.reset(seed=0)
    for action in (np.zeros(3), np.full(env.action_space.shape, np.nan)):
        with pytest.raises(InvalidInput, match="per dimension of the design, then one per tendon"):
            env.step(action)
    assert env.step(np.zeros(env.action_space.shape))[4]["phase"] == "design"
