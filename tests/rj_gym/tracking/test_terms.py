"""Own terms of the tracking tasks: one function for scalar and vector environments, plain or compiled."""

import pickle

import gymnasium
import numba
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from rj_gym import Drawn, Entry, FlexibleArmVectorEnv, Observed, RollingJointEnv, RollingJointVectorEnv, Terms
from rj_gym.vector_checker import check_vector_env
from rollingjoint.errors import ConfigError, InvalidInput

IDS = ("rj_gym/RollingJoint-v0", "rj_gym/FlexibleArm-v0")
LANES, SEED = 3, 11


def height(step):
    return 0.01 * step.tip[:, 1]


def calm(step):
    return -0.1 * ((step.action - step.previous_action) ** 2).sum(axis=1)


@numba.njit
def compiled_height(step):
    return 0.01 * step.tip[:, 1]


def angles(step):
    return step.joint_angles[:, :2]


def taut(step):
    return step.tensions.max(axis=1) > 9.0


def around(start):
    """Targets on a circle about (0, 0.8 L), one per step."""
    turn = 2 * np.pi * (start.uniforms[:, :1] + np.linspace(0.0, 0.2, start.episode_steps + 1))
    return np.stack([10.0 * np.cos(turn), 0.8 * start.length + 10.0 * np.sin(turn)], axis=-1)


def push(start):
    """A force to the right that grows."""
    grown = start.uniforms[:, :1] * np.linspace(0.0, 1.0, start.episode_steps + 1)
    return np.stack([grown, np.zeros_like(grown)], axis=-1)


JOINTS = Observed([Entry("joint 0 angle", "rad", -1.0, 1.0), Entry("joint 1 angle", "rad", -1.0, 1.0)], angles)
ALL = Terms(rewards={"height": height, "calm": calm}, observations=[JOINTS], ends={"taut": taut})


def rollouts(env_id, terms, steps=30, **settings):
    """Of scalar environments and of a vector environment with the same seeds: what steps returned, lane by lane."""
    settings |= {"terms": terms, "action_scale_mm": 3.0}
    rng = np.random.default_rng(0)
    vector = gymnasium.make_vec(env_id, LANES, "vector_entry_point", **settings)
    alone = [gymnasium.make(env_id, disable_env_checker=True, **settings) for _ in range(LANES)]
    begun = vector.reset(seed=SEED), [env.reset(seed=SEED + lane) for lane, env in enumerate(alone)]
    for lane in range(LANES):
        assert np.array_equal(begun[0][0][lane], begun[1][lane][0])
    for _ in range(steps):
        actions = rng.uniform(-1, 1, vector.action_space.shape).astype(np.float32)
        together = vector.step(actions)
        each = [env.step(action) for env, action in zip(alone, actions, strict=True)]
        yield together, each
        if together[2].any() or together[3].any():
            return


@pytest.mark.parametrize("env_id", IDS)
def test_scalar_and_vector_environments_have_the_same_terms(env_id):
    for (seen, reward, terminated, _, infos), each in rollouts(env_id, ALL):
        for lane, one in enumerate(each):
            assert np.array_equal(seen[lane], one[0]) and reward[lane] == one[1] and terminated[lane] == one[2]
            for name in ("height", "calm", "tracking"):
                assert infos["reward_terms"][name][lane] == one[4]["reward_terms"][name]
            assert infos["ends"]["taut"][lane] == one[4]["ends"]["taut"]


def test_own_terms_are_added_to_the_reward_of_the_task():
    plain, own = Terms(), Terms(rewards={"height": height, "calm": calm})
    pairs = zip(rollouts(IDS[0], plain, steps=10), rollouts(IDS[0], own, steps=10), strict=True)
    for ((_, before, *_), _), ((_, after, *_, infos), _) in pairs:
        own = infos["reward_terms"]["height"] + infos["reward_terms"]["calm"]
        assert after == pytest.approx(before + own, abs=1e-12)
        assert infos["reward_terms"]["height"] == pytest.approx(0.01 * infos["tip"][:, 1])
        assert np.all(infos["reward_terms"]["calm"] < 0)


def test_own_terms_replace_the_reward():
    terms = Terms(rewards={"height": height}, reward="replace")
    for (_, reward, *_, infos), each in rollouts(IDS[0], terms, steps=5):
        assert reward == pytest.approx(0.01 * infos["tip"][:, 1]) and reward[0] == each[0][1]
        assert np.all(infos["reward_terms"]["tracking"] < 0)


def test_a_compiled_term_gives_what_the_plain_one_gives():
    plain = rollouts(IDS[0], Terms(rewards={"height": height}), steps=5)
    compiled = rollouts(IDS[0], Terms(rewards={"height": compiled_height}), steps=5)
    for ((_, first, *_), _), ((_, second, *_), _) in zip(plain, compiled, strict=True):
        assert np.array_equal(first, second)


def test_own_entries_follow_those_of_the_task_and_are_clipped():
    env, plain = RollingJointEnv(terms=ALL), RollingJointEnv()
    size = plain.observation_space.shape[0]
    seen, _ = env.reset(seed=1)
    assert env.observation_space.shape == (size + 2,) and np.array_equal(seen[:size], plain.reset(seed=1)[0])
    assert [entry.name for entry in env.task.entries()][size:] == ["joint 0 angle", "joint 1 angle"]
    narrow = Observed([Entry("tip height", "mm", 0.0, 1.0)], lambda step: step.tip[:, 1:2])
    seen, _ = RollingJointEnv(terms=Terms(observations=[narrow])).reset(seed=1)
    assert seen[-1] == 1.0


def test_an_own_end_terminates_and_the_next_step_restarts():
    envs = RollingJointVectorEnv(4, terms=Terms(ends={"third": lambda step: step.step >= 3.0}))
    envs.reset(seed=0)
    for count in range(1, 6):
        *_, terminated, _, infos = envs.step(np.zeros((4, 2), np.float32))
        assert np.all(terminated == (count == 3))
        if count == 3:
            assert np.all(infos["ends"]["third"])
    env = RollingJointEnv(terms=Terms(ends={"never": lambda step: step.step > 100.0}))
    env.reset(seed=0)
    *_, terminated, _, info = env.step([0.0, 0.0])
    assert terminated is False and info["ends"] == {"never": False}


def test_targets_per_step_are_drawn_from_the_generator_of_the_episode():
    terms = Terms(targets=Drawn(around, uniforms=1))
    for (*_, infos), each in rollouts(IDS[0], terms, steps=8):
        for lane, one in enumerate(each):
            assert np.array_equal(infos["target"][lane], one[4]["target"])
            assert np.hypot(*(one[4]["target"] - (0.0, 80.0))) == pytest.approx(10.0)
    env = RollingJointEnv(terms=terms)
    _, info = env.reset(seed=3)
    assert info["sampled"]["targets"].shape == (51, 2)
    _, other = env.reset(seed=4)
    assert not np.allclose(info["sampled"]["targets"], other["sampled"]["targets"])
    _, held = env.reset(seed=3, options={"target": [5.0, 70.0]})
    assert np.allclose(held["sampled"]["targets"], [5.0, 70.0])


def test_targets_from_tensions_are_tips_of_equilibria():
    pull = Drawn(lambda start: np.stack([2.0 + start.uniforms, 3.0 + 0.0 * start.uniforms], axis=-1), uniforms=1)
    env = RollingJointEnv(terms=Terms(target_tensions=pull), load={"magnitude": (0.0, 0.0)})
    _, info = env.reset(seed=3)
    target = info["sampled"]["targets"][0]
    assert np.linalg.norm(target) > 50.0
    assert not np.allclose(target, env.reset(seed=4)[1]["sampled"]["targets"][0])


def test_loads_in_the_plane_and_on_arms():
    env = RollingJointEnv(terms=Terms(loads=Drawn(push, uniforms=1)))
    _, info = env.reset(seed=3)
    forces = info["sampled"]["forces"]
    assert np.all(np.diff(forces[:, 0]) > 0) and np.all(forces[:, 1] == 0)
    for count in range(1, 4):
        *_, info = env.step([0.0, 0.0])
        assert info["load"]["force"] == pytest.approx(forces[count])
    weight = Drawn(lambda start: 0.5 + 0.1 * start.uniforms, uniforms=1)
    arms = FlexibleArmVectorEnv(2, terms=Terms(loads=weight))
    _, info = arms.reset(seed=0)
    assert np.all((info["sampled"]["payloads"] >= 0.5) & (info["sampled"]["payloads"] <= 0.6))


def test_own_draws_leave_those_of_the_task_as_they_are():
    plain, own = RollingJointEnv(), RollingJointEnv(terms=Terms(targets=Drawn(around, uniforms=1)))
    first, second = (env.reset(seed=5)[1]["sampled"] for env in (plain, own))
    assert np.array_equal(first["forces"], second["forces"]) and first["link"] == second["link"]


@pytest.mark.slow
@pytest.mark.parametrize("env_id", IDS)
def test_the_checkers_pass(env_id):
    check_env(gymnasium.make(env_id, terms=ALL).unwrapped, skip_render_check=True)

    def make(autoreset_mode):
        return gymnasium.make_vec(env_id, LANES, "vector_entry_point", terms=ALL, autoreset_mode=autoreset_mode)

    check_vector_env(make, n_steps=120, scalar=lambda: gymnasium.make(env_id, terms=ALL))


def test_a_state_goes_on_with_own_terms():
    first, second = (RollingJointVectorEnv(3, terms=ALL) for _ in range(2))
    first.reset(seed=0), second.reset(seed=9)
    actions = np.random.default_rng(0).uniform(-1, 1, (4, 3, 2)).astype(np.float32)
    first.step(actions[0])
    second.set_state(first.get_state())
    for action in actions[1:]:
        one, other = first.step(action), second.step(action)
        assert np.array_equal(one[0], other[0]) and np.array_equal(one[1], other[1])


def test_environments_with_named_functions_are_pickled():
    env = RollingJointEnv(terms=ALL)
    env.reset(seed=0)
    again = pickle.loads(pickle.dumps(env))
    assert again.step([0.5, -0.5])[1] == env.step([0.5, -0.5])[1]


def wrong(step):
    return np.zeros(7)


def unknown(step):
    return np.full(len(step.tip), np.nan)


@pytest.mark.parametrize(
    ("terms", "said"),
    [
        (Terms(rewards={"wrong": wrong}), r"terms.rewards\['wrong'\] .* shape \(1,\)"),
        (Terms(rewards={"unknown": unknown}), r"terms.rewards\['unknown'\] .* finite"),
        (Terms(ends={"wrong": wrong}), r"terms.ends\['wrong'\] .* shape \(1,\)"),
        (
            Terms(observations=[Observed([Entry("e", "1", 0.0, 1.0)], wrong)]),
            r"terms.observations\['e'\] .* shape \(1, 1\)",
        ),
        (Terms(targets=Drawn(lambda start: np.zeros((1, 2, 2)))), r"terms.targets .* \(1, 1, 2\) or \(1, 51, 2\)"),
        (Terms(loads=Drawn(lambda start: np.full((1, 1, 2), np.inf))), "terms.loads .* finite"),
    ],
)
def test_a_function_that_gives_other_numbers_is_named(terms, said):
    env = RollingJointEnv(terms=terms)
    with pytest.raises(InvalidInput, match=said):
        env.reset(seed=0)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"rewards": [height]}, "a dictionary of functions by name"),
        ({"rewards": {"tracking": height}}, "a name other than tracking"),
        ({"rewards": {"height": 3.0}}, "a function"),
        ({"reward": "instead"}, "add, replace|add.*replace"),
        ({"reward": "replace"}, "without own rewards"),
        ({"observations": [height]}, "a list of Observed"),
        ({"targets": around}, "Drawn"),
        ({"targets": Drawn(around), "target_tensions": Drawn(around)}, "None beside targets"),
        ({"reward_terms": {}}, "rewards"),
    ],
)
def test_settings_that_cannot_be_used_are_refused_in_one_line(settings, said):
    with pytest.raises(ConfigError, match=said) as refusal:
        RollingJointEnv(terms=settings)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("entries", [[], [("tip", "mm", 1.0, 0.0)], [("tip", "mm")], None, [("tip", "mm", "a", 1.0)]])
def test_entries_that_cannot_be_used_are_refused_in_one_line(entries):
    with pytest.raises(ConfigError, match=r"Entry\(name, unit, low, high\)"):
        Observed(entries, angles)


def test_goals_have_their_own_reward():
    with pytest.raises(ConfigError, match="none in a Goal environment"):
        gymnasium.make("rj_gym/RollingJointGoal-v0", terms=ALL)
    env = gymnasium.make("rj_gym/RollingJointGoal-v0", terms=Terms(observations=[JOINTS]))
    assert env.reset(seed=0)[0]["observation"][-2:].shape == (2,)


def test_functions_cannot_write_into_the_environment():
    def clumsy(step):
        step.tip[:] = 0.0
        return step.error_mm

    with pytest.raises(ValueError, match="read-only"):
        RollingJointEnv(terms=Terms(rewards={"clumsy": clumsy})).reset(seed=0)
