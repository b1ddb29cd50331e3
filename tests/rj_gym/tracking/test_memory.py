"""Memory of own terms: per lane, begun anew where lanes restart, saved with the state; the example of the page."""

import pickle
import re
from dataclasses import replace
from pathlib import Path

import gymnasium
import numba
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from rj_gym import Entry, FlexibleArmVectorEnv, Memory, Observed, RollingJointEnv, RollingJointVectorEnv, Step, Terms
from rj_gym.vector_checker import check_vector_env
from rollingjoint.errors import ConfigError, InvalidInput
from tests.pages import rows

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "your_task.md").read_text("utf-8")
LANES, SEED = 4, 5
REWARDS = ("hold", "gain")


def page_terms():
    """HOLD of the page, with the radius of the task's first errors, so that streaks begin and break."""
    section = PAGE[PAGE.index("## Terms with memory") :]
    names: dict = {}
    exec(re.findall(r"```python\n(.*?)```", section, re.DOTALL)[0].replace("<= 0.5", "<= 40.0"), names)
    return names


def streak(step):
    """Steps in a row within 40 mm; the error, and how much smaller it is than a step ago [mm]."""
    count = np.where(step.error_mm <= 40.0, step.memory[:, 0] + 1.0, 0.0)
    return np.stack((count, step.error_mm, step.memory[:, 1] - step.error_mm), axis=1)


@numba.njit
def compiled_streak(step):
    values = np.empty(step.memory.shape)
    for lane in range(len(values)):
        values[lane, 0] = step.memory[lane, 0] + 1.0 if step.error_mm[lane] <= 40.0 else 0.0
        values[lane, 1] = step.error_mm[lane]
        values[lane, 2] = step.memory[lane, 1] - step.error_mm[lane]
    return values


def hold(step):
    return 0.5 * (step.memory[:, 0] >= 3)


def gain(step):
    return 1.0 * step.memory[:, 2]


def held(step):
    return np.minimum(step.memory[:, :1], 3) / 3


def long_held(step):
    """Ends lanes out of phase."""
    return step.memory[:, 0] >= 9


TERMS = Terms(
    rewards={"hold": hold, "gain": gain},
    observations=[Observed([Entry("held", "1", 0.0, 1.0)], held)],
    ends={"long held": long_held},
    memory=Memory((0, 0, 0), streak),
)


class Reference:
    """The two rewards and the observation of one lane, from the errors in info alone."""

    def __init__(self, first_error):
        self.errors = [first_error]

    def after(self, error):
        self.errors.append(error)
        outside = [k for k, value in enumerate(self.errors) if value > 40.0]
        count = len(self.errors) - 1 - outside[-1] if outside else len(self.errors)
        return 0.5 * (count >= 3), self.errors[-2] - error, np.float32(min(count, 3) / 3), count


def actions_of(rng):
    return rng.uniform(-1, 1, (LANES, 2)).astype(np.float32)


@pytest.mark.parametrize("update", [streak, compiled_streak], ids=["plain", "compiled"])
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_rewards_observations_and_ends_with_memory_follow_the_errors_in_info(mode, update):
    terms = replace(TERMS, memory=Memory((0, 0, 0), update))
    envs = RollingJointVectorEnv(LANES, autoreset_mode=mode, terms=terms, episode_steps=30)
    _, info = envs.reset(seed=SEED)
    lanes, rng, over = [Reference(error) for error in info["error_mm"]], np.random.default_rng(0), np.zeros(LANES, bool)
    partial = streaks = 0
    for count in range(150):
        if mode == "Disabled" and (over.any() or count % 17 == 5):
            mask = over | (np.arange(LANES) == count % LANES)
            _, info = envs.reset(options={"reset_mask": mask})
            lanes = [Reference(e) if new else old for e, new, old in zip(info["error_mm"], mask, lanes, strict=True)]
            over = np.zeros(LANES, bool)
            partial += 1
        seen, _, terminated, truncated, info = envs.step(actions_of(rng))
        ended = terminated | truncated
        final = info.get("final_info", info)
        for lane in range(LANES):
            if mode == "NextStep" and over[lane]:
                lanes[lane] = Reference(info["error_mm"][lane])
                assert seen[lane, -1] == np.float32((info["error_mm"][lane] <= 40.0) / 3)
                continue
            last = mode == "SameStep" and ended[lane]
            source, observation = (final, info["final_obs"][lane]) if last else (info, seen[lane])
            *rewards, entry, length = lanes[lane].after(source["error_mm"][lane])
            assert [source["reward_terms"][name][lane] for name in REWARDS] == rewards
            assert observation[-1] == entry
            assert source["ends"]["long held"][lane] == terminated[lane] == (length >= 9)
            streaks += rewards[0] > 0
            if last:
                lanes[lane] = Reference(info["error_mm"][lane])
                assert seen[lane, -1] == np.float32((info["error_mm"][lane] <= 40.0) / 3)
        partial += 0 < ended.sum() < LANES
        over = ended
    assert partial > 3 and streaks > 10


@pytest.mark.parametrize("update", [streak, compiled_streak], ids=["plain", "compiled"])
def test_scalar_environments_have_the_memory_of_the_lanes(update):
    terms = replace(TERMS, memory=Memory((0, 0, 0), update))
    vector = RollingJointVectorEnv(LANES, autoreset_mode="Disabled", terms=terms)
    alone = [RollingJointEnv(terms=terms) for _ in range(LANES)]
    vector.reset(seed=SEED)
    for lane, env in enumerate(alone):
        env.reset(seed=SEED + lane)
    rng, over = np.random.default_rng(1), np.zeros(LANES, bool)
    for count in range(60):
        mask = over | (np.arange(LANES) == 1) if count in (20, 27) else over
        if mask.any():
            seen, _ = vector.reset(options={"reset_mask": mask})
            for lane in np.flatnonzero(mask):
                assert np.array_equal(alone[lane].reset()[0], seen[lane])
        actions = actions_of(rng)
        seen, reward, terminated, truncated, _ = vector.step(actions)
        for lane, env in enumerate(alone):
            one = env.step(actions[lane])
            assert np.array_equal(one[0], seen[lane]) and one[1] == reward[lane] and one[2] == terminated[lane]
        over = terminated | truncated


def test_the_example_of_the_page_rewards_three_steps_in_a_row():
    names = page_terms()
    envs = RollingJointVectorEnv(LANES, terms=names["HOLD"], episode_steps=20)
    _, info = envs.reset(seed=SEED)
    lanes, rng, over = [Reference(error) for error in info["error_mm"]], np.random.default_rng(0), False
    bonuses = 0
    for _ in range(60):
        seen, _, _, truncated, info = envs.step(actions_of(rng))
        if over:
            lanes, over = [Reference(error) for error in info["error_mm"]], False
            continue
        for lane in range(LANES):
            bonus, _, entry, _ = lanes[lane].after(info["error_mm"][lane])
            assert info["reward_terms"]["hold"][lane] == bonus and seen[lane, -1] == entry
            bonuses += bonus > 0
        over = truncated.any()
    assert bonuses > 10


def test_the_table_of_the_page_has_every_field_of_a_step_with_its_shape():
    cells = rows(PAGE, "| `memory` | `Step` |")[1:]
    shapes = {name.strip(" `"): shape for names, shape, *_ in cells for name in names.split(",")}
    records = []
    envs = RollingJointVectorEnv(LANES, terms=Terms(rewards={"r": lambda s: records.append(s) or s.reward}))
    envs.reset(seed=0)
    assert set(shapes) == set(Step._fields)
    sizes = {"B": LANES, "m": 2, "d": 2, "n": 5, "n − 1": 4, "3": 3, "width": 0}
    for name, shape in shapes.items():
        words = shape.split("), of arms")[0].strip("(),")
        assert getattr(records[-1], name).shape == tuple(sizes[word] for word in words.split(", "))


def test_memory_is_updated_first_and_only_by_steps():
    calls = []

    def noted(name, values):
        def function(step):
            calls.append((name, step.step.tolist(), step.memory[:, 0].tolist()))
            return values(step)

        return function

    envs = RollingJointVectorEnv(
        3,
        autoreset_mode="Disabled",
        terms=Terms(
            rewards={"r": noted("reward", lambda step: step.step)},
            ends={"e": noted("end", lambda step: step.step < 0)},
            observations=[Observed([Entry("o", "1", 0.0, 9.0)], noted("observation", lambda step: step.memory))],
            memory=Memory([7], noted("update", lambda step: step.memory[:, 0] + 1)),
        ),
    )
    envs.reset(seed=0)
    start = [("update", [0] * 3, [7] * 3), *((name, [0] * 3, [8] * 3) for name in ("reward", "end", "observation"))]
    assert calls == start
    envs.step(np.zeros((3, 2)))
    calls.clear()
    seen, _ = envs.reset(options={"reset_mask": np.array([False, True, False])})
    assert calls[0] == ("update", [0], [7]) and [name for name, *_ in calls].count("update") == 1
    assert seen[:, -1].tolist() == [9, 8, 9]


def test_a_state_and_a_pickle_go_on_with_the_memory():
    first, other = (RollingJointVectorEnv(LANES, terms=TERMS) for _ in range(2))
    first.reset(seed=0), other.reset(seed=9)
    rng = np.random.default_rng(0)
    for _ in range(4):
        first.step(actions_of(rng))
    state = first.get_state()
    first.step(actions_of(rng))
    other.set_state(state)
    first.set_state(state)
    copies = [other, pickle.loads(pickle.dumps(first))]
    held = 0
    for _ in range(8):
        actions = actions_of(rng)
        expected = first.step(actions)
        held += (expected[4]["reward_terms"]["hold"] > 0).sum() if "reward_terms" in expected[4] else 0
        for env in copies:
            result = env.step(actions)
            assert np.array_equal(result[0], expected[0]) and np.array_equal(result[1], expected[1])
    assert held > 0


def test_arms_friction_and_a_privileged_state_leave_the_memory_alone():
    settings = {"friction": {"mu": (0.1, 0.1)}, "privileged": "info", "episode_steps": 20}
    counting = Terms(rewards={"steps": lambda step: step.memory[:, 0]}, memory=Memory([-1], lambda s: s.memory + 1))
    for envs in (RollingJointVectorEnv(2, terms=counting, **settings), FlexibleArmVectorEnv(2, terms=counting)):
        envs.reset(seed=0)
        for count in range(1, 4):
            info = envs.step(np.zeros(envs.action_space.shape))[4]
            assert info["reward_terms"]["steps"].tolist() == [count, count]


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ["rj_gym/RollingJoint-v0", "rj_gym/FlexibleArm-v0"])
def test_the_checkers_pass(env_id):
    check_env(gymnasium.make(env_id, terms=TERMS).unwrapped, skip_render_check=True)

    def make(autoreset_mode):
        return gymnasium.make_vec(env_id, LANES, "vector_entry_point", terms=TERMS, autoreset_mode=autoreset_mode)

    check_vector_env(make, n_steps=120, scalar=lambda: gymnasium.make(env_id, terms=TERMS))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Memory([], streak), "at least one finite number"),
        (lambda: Memory([np.nan], streak), "at least one finite number"),
        (lambda: Memory(3.0, streak), "at least one finite number"),
        (lambda: Memory([0.0], 3.0), "a function"),
        (lambda: Terms(memory=streak), r"Memory\(start, update\)"),
    ],
)
def test_a_memory_that_cannot_be_used_is_refused_in_one_line(make, message):
    with pytest.raises(ConfigError, match=message) as refusal:
        make()
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("values", [np.zeros(3), np.full((1, 2), np.inf), np.zeros((2, 1))])
def test_an_update_that_gives_other_numbers_is_named(values):
    env = RollingJointEnv(terms=Terms(memory=Memory([0, 0], lambda step: values)))
    with pytest.raises(InvalidInput, match=r"terms.memory .* shape \(1, 2\)"):
        env.reset(seed=0)


def test_functions_cannot_write_into_the_memory():
    def clumsy(step):
        step.memory[:, 0] += 1
        return step.memory

    with pytest.raises(ValueError, match="read-only"):
        RollingJointEnv(terms=Terms(memory=Memory([0], clumsy))).reset(seed=0)
