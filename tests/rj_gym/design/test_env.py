"""The design environments: both checkers, scalar and vector alike, what a design is worth, what is refused."""

import copy
import pickle
import warnings
from functools import partial

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import rj_gym
from rollingjoint import ConfigError, InvalidInput
from rollingjoint.chain.status import Status
from tests.rj_gym import rollouts
from tests.rj_gym.rollouts import same

torch = pytest.importorskip("torch")

ID = "rj_gym/CurvatureDesign-v0"
SMALL = {"space": {"knots": 3}, "episode_steps": 4}
ONE_DIMENSION = {
    "space": {"symmetric": True, "convexity": (0.05, 0.05), "hole": (6.0, 12.0)},
    "tensions": [(6.0, 3.0)],
    "episode_steps": 3,
}
VARIANTS = {
    "default": {"episode_steps": 4},
    "one dimension, one case": ONE_DIMENSION,
    "two links, no force, linear": {
        "space": {"knots": 3, "n_links": 2},
        "force": (0, 0),
        "start": "reference",
        "reward": {"improvement": "linear"},
        "episode_steps": 2,
    },
    "four tendons": {"space": {"mechanism": "two_segment", "height": [-2, 2]}, "episode_steps": 2},
    "in space": {"space": {"mechanism": "pitch_yaw", "azimuth": [-0.3, 0.3]}, "episode_steps": 2, "force": (0, 0.05)},
    "tubes": {"space": {"kind": "space", "n_joints": 4}, "episode_steps": 2, "force": (0, 0.05)},
    "an arm": {"space": {"mechanism": "small_arm", "height": [-2, 2]}, "episode_steps": 2},
    "links of their own": {"space": {"alike": False, "symmetric": True, "knots": 3, "n_links": 3}, "episode_steps": 2},
}
variants = pytest.mark.parametrize(
    "settings",
    [pytest.param(VARIANTS[name], marks=() if name == "default" else pytest.mark.slow, id=name) for name in VARIANTS],
)
LOW_CURVATURE = np.array([-1.0] * 6)  # of SMALL: curvatures of -0.03 /mm, surfaces that cannot roll


rollout = partial(rollouts.rollout, steps=4, largest=0.5, dtype=np.float64)


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


@variants
def test_gymnasium_and_stable_baselines_checkers_pass_without_a_warning(settings):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gymnasium.make(ID, **settings).unwrapped)
        checker.check_env(gymnasium.make(ID, **settings).unwrapped)


@pytest.mark.parametrize(
    "modes",
    [(AutoresetMode.SAME_STEP,), pytest.param(tuple(AutoresetMode), marks=pytest.mark.slow)],
    ids=["one", "all"],
)
def test_the_vector_environment_passes_every_check(modes):
    def make_env(autoreset_mode=modes[0]):
        return make_vec(2, episode_steps=2, render_mode="rgb_array", autoreset_mode=autoreset_mode)

    report = rj_gym.check_vector_env(
        make_env if len(modes) > 1 else lambda: make_env(),
        n_steps=3,
        max_episode_steps=2,
        scalar=lambda: make(episode_steps=2),
    )
    assert report.modes == modes
    assert "equals_scalar_infos" in {outcome.check for outcome in report.passed}
    assert len(modes) == 1 or not report.skipped


@pytest.mark.slow
@pytest.mark.parametrize("mode", AutoresetMode)
def test_lanes_equal_scalar_environments(mode):
    native = make_vec(4, autoreset_mode=mode)
    scalar = SyncVectorEnv([make] * 4, autoreset_mode=mode)
    assert same(native.reset(seed=3), scalar.reset(seed=3))
    rng = np.random.default_rng(0)
    for _ in range(9):
        actions = rng.uniform(-1, 1, native.action_space.shape).astype(np.float32)
        one, other = native.step(actions), scalar.step(actions)
        assert same(one, other)
        ended = one[3].copy()
        if mode is AutoresetMode.DISABLED and ended.any():
            options = {"reset_mask": ended, "forces": np.zeros((3, 2))}
            assert same(native.reset(options=dict(options)), scalar.reset(options=dict(options)))


def test_many_lanes_agree_with_a_scalar_environment():
    native, env = make_vec(200), make()
    observations, _ = native.reset(seed=11)
    actions = np.random.default_rng(1).uniform(-1, 1, (3, *native.action_space.shape)).astype(np.float32)
    stepped = [native.step(action)[:2] for action in actions]
    for lane in (0, 77, 199):
        assert np.abs(env.reset(seed=11 + lane)[0] - observations[lane]).max() < 1e-6
        for action, (batch, rewards) in zip(actions, stepped, strict=True):
            observation, reward, *_ = env.step(action[lane])
            assert np.abs(observation - batch[lane]).max() < 1e-6
            assert reward == pytest.approx(rewards[lane], abs=1e-9)


def test_a_masked_reset_leaves_the_other_lanes_alone():
    env = make_vec(3, autoreset_mode="Disabled")
    env.reset(seed=0)
    before = env.step(np.full((3, 6), 0.1))[0]
    after, infos = env.reset(options={"reset_mask": np.array([False, True, False])})
    assert np.array_equal(before[[0, 2]], after[[0, 2]])
    assert not np.array_equal(before[1], after[1])
    assert infos["_sampled"].tolist() == [False, True, False]


def test_same_seed_gives_the_same_episode_also_after_others():
    first, second = make(), make()
    rollout(second, seed=99, steps=2)
    assert same(rollout(first, seed=5), rollout(second, seed=5))
    assert not same(first.reset(), first.reset())


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copied_environment_goes_on_alike(duplicate):
    for env in (make(render_mode="rgb_array"), make_vec(2, render_mode="rgb_array")):
        rollout(env, seed=3, steps=2)
        picture = env.render()
        other = duplicate(env)
        assert same(other.render(), picture)
        action = np.full(env.action_space.shape, 0.2)
        assert same(env.step(action), other.step(action))
        assert same(env.reset(), other.reset())


def test_the_hidden_design_has_no_error_and_improvements_add_up():
    env = make()
    _, info = env.reset(seed=4)
    target, start = info["sampled"]["target_design"], info["sampled"]["start_design"]
    begun, total = info["error_mm"], 0.0
    assert begun > 1.0
    assert np.array_equal(info["design"], start)
    for _ in range(3):
        action = np.clip(target - info["design"], -0.25, 0.25) / 0.25
        before = info["design"]
        _, reward, *_, info = env.step(action)
        assert info["design"] == pytest.approx(np.clip(before + 0.25 * action, -1, 1))
        total += info["reward_terms"]["improvement"]
        assert reward == pytest.approx(sum(info["reward_terms"].values()), abs=1e-12)
    assert total == pytest.approx(np.log((begun + 0.5) / (info["error_mm"] + 0.5)), abs=1e-9)
    _, info = env.reset(options={"design": target, "target_design": target})
    assert info["error_mm"] == 0.0 and not info["case_errors_mm"].any()


def test_the_error_is_what_the_compiled_solver_finds():
    from rollingjoint import WorldForce, solve_tensions

    env = make()
    _, info = env.reset(seed=6)
    drawn, square = info["sampled"], []
    for tensions, force, targets in zip(drawn["tensions"], drawn["forces"], drawn["targets"], strict=True):
        shapes = [
            solve_tensions(env.task.space.mechanism(x), tensions, [WorldForce(-1, tuple(force))]).require().poses
            for x in (drawn["start_design"], drawn["target_design"])
        ]
        assert shapes[1][1:, :2] == pytest.approx(targets, abs=2e-6)
        square.append(np.square(shapes[0][1:, :2] - targets).sum(-1).mean())
    assert info["error_mm"] == pytest.approx(np.sqrt(np.mean(square)), abs=1e-5)
    assert info["case_errors_mm"] == pytest.approx(np.sqrt(square), abs=1e-5)


def test_an_invalid_design_costs_its_violation_counts_as_the_largest_error_and_can_be_left():
    env = make()
    _, start = env.reset(seed=1, options={"design": LOW_CURVATURE})
    assert not start["valid"] and start["status"] == "INVALID_INPUT"
    assert start["error_mm"] == 50.0 and np.all(start["case_errors_mm"] == 50.0)
    observation, _, terminated, _, info = env.step(np.zeros(6))
    assert not terminated and observation in env.observation_space
    assert info["reward_terms"]["improvement"] == info["reward_terms"]["failure"] == 0
    assert info["reward_terms"]["violation"] == pytest.approx(np.minimum(info["margins"], 0).sum())
    for _ in range(3):
        *_, info = env.step(np.ones(6))
    assert info["valid"] and info["error_mm"] < 50.0 and info["reward_terms"]["violation"] == 0


def test_a_failed_equilibrium_costs_the_penalty_and_counts_as_the_largest_error():
    env = make(reward={"failure": 7.0})
    env.reset(seed=1)
    shapes = env.task.shapes

    def fail_in_case_1(*arguments):
        positions, status = shapes(*arguments)
        status[:, 1] = Status.NOT_CONVERGED
        return np.where(status[..., None, None] == Status.NOT_CONVERGED, 1e6, positions), status

    env.task.shapes = fail_in_case_1
    observation, _, terminated, truncated, info = env.step(np.zeros(6))
    assert (terminated, truncated, info["status"], info["valid"]) == (False, False, "NOT_CONVERGED", True)
    assert info["reward_terms"]["failure"] == -7.0 and info["reward_terms"]["violation"] == 0
    assert info["error_mm"] == info["case_errors_mm"][1] == 50.0 > info["case_errors_mm"][0]
    assert observation in env.observation_space
    del env.task.shapes


@pytest.mark.slow
@pytest.mark.parametrize("seed", [None, 7])
@pytest.mark.parametrize("lanes", [None, 3])
def test_targets_that_no_design_can_have_are_refused_without_a_change(lanes, seed):
    env, untouched = (make_vec(lanes) if lanes else make() for _ in range(2))
    rollout(env, seed=0, steps=1), rollout(untouched, seed=0, steps=1)
    env.task.shapes = lambda designs, *_: (np.zeros((len(designs), 3, 4, 2)), np.full((len(designs), 3), 2))
    try:
        with pytest.raises(InvalidInput, match="forces"):
            env.reset(seed=seed)
    finally:
        del env.task.shapes
    assert same(env.step(np.zeros(env.action_space.shape)), untouched.step(np.zeros(env.action_space.shape)))
    assert same(env.reset(), untouched.reset())


def test_huge_forces_and_wild_actions_stay_within_the_bounds():
    env = make_vec(8, force=(0.0, 1e4), action_scale=2.0, autoreset_mode="SameStep")
    observations, _ = env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(6):
        assert observations in env.observation_space
        observations, rewards, terminated, _, infos = env.step(rng.uniform(-3, 3, (8, 6)))
        assert np.isfinite(rewards).all() and not terminated.any()
        assert np.isfinite(infos["error_mm"]).all() and infos["error_mm"].max() <= 50.0
    assert observations in env.observation_space


def test_every_corner_of_the_box_is_a_state():
    env = make_vec(64, episode_steps=1, autoreset_mode="Disabled")
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T
    env.reset(seed=0)
    env._buffer.designs[:] = corners
    observations, _, _, _, infos = env.step(np.zeros((64, 6)))
    assert observations in env.observation_space
    assert 0 < infos["valid"].sum() < 64
    for corner in corners[infos["valid"]][::4]:
        assert not env.task.space.faults(env.task.space.mechanism(corner))


@pytest.mark.parametrize("action", [[np.nan] * 6, [np.inf] * 6, [0.1] * 5, 0.3, "up", [None] * 6])
def test_an_invalid_action_is_refused_before_anything_changes(action):
    env, untouched = make(), make()
    rollout(env, seed=2, steps=1), rollout(untouched, seed=2, steps=1)
    with pytest.raises(InvalidInput, match=r"action = .*shape \(6,\)"):
        env.step(action)
    assert same(env.step(np.ones(6)), untouched.step(np.ones(6)))


@pytest.mark.parametrize(
    "options",
    [
        {"designs": np.zeros(6)},
        {"design": np.zeros(5)},
        {"design": np.full(6, 1.1)},
        {"design": np.full(6, np.nan)},
        {"target_design": LOW_CURVATURE},
        {"forces": np.zeros((2, 2))},
        {"forces": np.full((3, 2), np.inf)},
        {"tensions": np.zeros((3, 2))},
        {"tensions": "high"},
        [],
    ],
)
def test_bad_reset_options_are_refused_before_anything_changes(options):
    env, untouched = make(), make()
    rollout(env, seed=2, steps=1), rollout(untouched, seed=2, steps=1)
    with pytest.raises(InvalidInput, match="expected"):
        env.reset(seed=7, options=options)
    assert same(env.step(np.ones(6)), untouched.step(np.ones(6)))
    assert same(env.reset(), untouched.reset())


def test_sampled_values_put_back_as_options_repeat_the_episode():
    env = make()
    first = rollout(env, seed=8)
    sampled = first[0][1]["sampled"]
    options = {key: sampled[key] for key in ("target_design", "forces", "tensions")}
    options["design"] = sampled["start_design"]
    env.reset(seed=1234)
    rng = np.random.default_rng(8)
    again = [env.reset(options=options)] + [env.step(rng.uniform(-0.5, 0.5, 6)) for _ in range(4)]
    assert same(first, again)


def test_options_and_settings_change_what_they_name():
    env = make(start="reference", force=(0.1, 0.2))
    _, info = env.reset(seed=0, options={"tensions": [(2, 2), (5, 1), (1, 5)]})
    assert np.array_equal(info["design"], env.task.space.reference())
    assert np.array_equal(info["sampled"]["tensions"], [(2, 2), (5, 1), (1, 5)])
    sizes = np.linalg.norm(info["sampled"]["forces"], axis=-1)
    assert ((sizes >= 0.1) & (sizes <= 0.2)).all()
    assert env.config.space.knots == 3 and not env.config.space.symmetric


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"episode_step": 3}, "episode_steps"),
        ({"episode_steps": 0}, "from 1 to 100000"),
        ({"space": {"knot": 3}}, "knots"),
        ({"space": {"knots": 4}}, "odd"),
        ({"space": 3}, "DesignSpace"),
        ({"tensions": []}, "pairs"),
        ({"tensions": [(1, 2, 3)]}, "pairs"),
        ({"tensions": [(1, 0)]}, "above 0"),
        ({"force": (1, 0)}, "low <= high"),
        ({"reward": {"improvement": "cubic"}}, "log"),
        ({"reward": {"weight": 1}}, "violation"),
        ({"start": "best"}, "reference"),
        ({"action_scale": 0.0}, "from 1e-06 to 2"),
    ],
)
def test_bad_settings_are_refused_and_say_what_is_allowed(settings, words):
    with pytest.raises(ConfigError, match=words):
        gymnasium.make(ID, **settings)


def test_every_id_has_its_settings():
    assert rj_gym.settings_of(ID) is rj_gym.DesignConfig
    tracking = [rj_gym.settings_of(env_id) for env_id in rj_gym.IDS]
    worlds = [rj_gym.InstrumentConfig, rj_gym.InstrumentShiftConfig, rj_gym.SlowCameraConfig, rj_gym.LatePoseConfig]
    worlds += [rj_gym.ArmInstrumentConfig]
    worlds += [getattr(rj_gym, kind.__name__.replace("Config", "V1Config")) for kind in worlds]
    assert tracking == [rj_gym.TrackingConfig] * 2 + [rj_gym.FlexibleArmConfig] * 2 + [rj_gym.PitchYawConfig] + worlds
    with pytest.raises(ConfigError, match="CurvatureDesign"):
        rj_gym.settings_of("rj_gym/CurvatureDesign-v9")


def test_a_space_without_valid_designs_is_refused_when_the_environment_is_made(monkeypatch):
    monkeypatch.setattr("rollingjoint.design.box._MOST_DRAWN", 1000)
    with pytest.raises(InvalidInput, match="Narrow the ranges"):
        make(space={"n_links": 2, "symmetric": True, "convexity": (-0.05, -0.01)})


def test_stepping_drawing_and_ended_episodes_want_a_reset():
    env, envs = make(render_mode="rgb_array", episode_steps=1), make_vec(2, autoreset_mode="Disabled", episode_steps=1)
    for call in (lambda: env.step(np.zeros(6)), env.render, lambda: envs.step(np.zeros((2, 6)))):
        with pytest.raises(ResetNeeded):
            call()
    env.reset(seed=0), envs.reset(seed=0)
    assert env.step(np.zeros(6))[3] is True
    assert envs.step(np.zeros((2, 6)))[3].all()
    for step in (lambda: env.step(np.zeros(6)), lambda: envs.step(np.zeros((2, 6)))):
        with pytest.raises(ResetNeeded, match="reset"):
            step()


def test_pictures_show_the_design_and_those_of_lanes_equal_those_of_scalar_environments():
    env, envs = make(render_mode="rgb_array"), make_vec(3, render_mode="rgb_array", render_lanes=[2])
    env.reset(seed=6), envs.reset(seed=4)
    before = env.render()
    env.step(np.full(6, 0.5)), envs.step(np.full((3, 6), 0.5))
    after = env.render()
    assert before.shape == (600, 720, 3) and before.dtype == np.uint8 and not np.array_equal(before, after)
    (picture,) = envs.render()
    assert np.array_equal(picture, after)
    env.reset(options={"design": LOW_CURVATURE})
    assert not np.array_equal(env.render(), after)
    env.close(), envs.close()


def test_a_window_opens_and_closes():
    env = make(render_mode="human")
    env.reset(seed=0)
    env.step(np.zeros(6))
    env.close()


@pytest.mark.slow
def test_torch_threads_stay_as_they_are_and_importing_rj_gym_loads_no_torch(run_python):
    env = make()
    rollout(env, seed=0, steps=1)
    assert torch.get_num_threads() == 1
    program = "import rj_gym, sys; t = lambda: 'torch' in sys.modules; print(t(), rj_gym.CurvatureDesignEnv and t())"
    assert run_python("-c", program) == "False True\n"


def test_adapter_for_stable_baselines_equals_dummy_vec_env():
    vec_env = pytest.importorskip("stable_baselines3.common.vec_env")
    from rj_gym.sb3 import make_sb3_env

    native = make_sb3_env(ID, 3, **SMALL)
    dummy = vec_env.DummyVecEnv([make] * 3)
    native.seed(7), dummy.seed(7)
    assert np.array_equal(native.reset(), dummy.reset())
    for _ in range(5):
        actions = np.full((3, 6), 0.3, np.float32)
        one, other = native.step(actions), dummy.step(actions)
        assert (
            np.array_equal(one[0], other[0]) and np.array_equal(one[1], other[1]) and np.array_equal(one[2], other[2])
        )
        for info, expected in zip(one[3], other[3], strict=True):
            assert info.get("TimeLimit.truncated", False) is expected["TimeLimit.truncated"]
            assert same(info.get("terminal_observation"), expected.get("terminal_observation"))
