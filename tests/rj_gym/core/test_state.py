"""States of native vector environments: what goes on from one equals what was never interrupted; others are refused."""

import copy

import gymnasium
import numpy as np
import pytest

from agents.runs.state_file import packed, unpacked
from rj_gym import IDS
from rollingjoint import five_link
from rollingjoint.errors import InvalidInput
from tests.rj_gym.rollouts import same

VARIED = {
    "planar tolerances": ("RollingJoint-v0", {"randomization": {"link_tolerance_mm": 0.1, "stiffness_spread": 0.1}}),
    "arm stiffnesses": ("FlexibleArm-v0", {"randomization": {"stiffness_spread": 0.1}}),
    "friction": ("RollingJoint-v0", {"friction": {"mu": [0.02, 0.1]}}),
    "moving": ("RollingJoint-v0", {"target": {"process": "path"}, "load": {"process": "ou"}}),
    "plain": ("RollingJoint-v0", {}),
    "goal": ("RollingJointGoal-v0", {}),
    "hidden": ("InstrumentShift-v0", {}),
    "late": ("LatePose-v0", {}),
    "arm": ("ArmInstrument-v0", {}),
    "lumen": ("Lumen-v0", {}),
    "hidden wall": ("HiddenWall-v0", {}),
    "design": ("CurvatureDesign-v0", {"episode_steps": 4}),
}


def lanes(name, count=3, **settings):
    identifier, config = VARIED[name]
    return gymnasium.make_vec(
        f"rj_gym/{identifier}", count, "vector_entry_point", config=config | {"episode_steps": 6} | settings
    )


def steps(envs, count, seed=0):
    rng = np.random.default_rng(seed)
    return [envs.step(rng.uniform(-1, 1, envs.action_space.shape).astype(np.float32)) for _ in range(count)]


@pytest.mark.slow
@pytest.mark.parametrize("name", VARIED)
def test_an_environment_that_is_given_a_state_goes_on_to_the_bit(name):
    first, second = lanes(name), lanes(name)
    first.reset(seed=5)
    steps(first, 3)
    first.reset(options={"reset_mask": np.array([True, False, True])})
    steps(first, 2)
    state = unpacked(packed(first.get_state()), "state")
    expected = steps(first, 12)
    second.set_state(state)
    assert same(steps(second, 12), expected)
    first.set_state(state)  # back in time
    assert same(steps(first, 12), expected)


def test_mechanisms_that_options_have_set_are_part_of_the_state():
    first, second = lanes("plain", 2), lanes("plain", 2)
    first.reset(seed=1, options={"mechanism": five_link().replace(name="own")})
    second.set_state(unpacked(packed(first.get_state()), "state"))
    assert same(steps(second, 4), steps(first, 4))


def test_every_environment_has_a_state_of_plain_values():
    named = {f"rj_gym/{identifier}" for identifier, _ in VARIED.values()}
    for identifier in set(IDS) - named:
        envs = gymnasium.make_vec(identifier, 1, "vector_entry_point")
        envs.reset(seed=0)
        envs.set_state(unpacked(packed(envs.get_state()), "state"))


def test_a_state_is_a_copy():
    envs = lanes("plain")
    envs.reset(seed=1)
    before = envs.get_state()
    kept = copy.deepcopy(before)
    steps(envs, 2)
    assert same(before, kept)


def test_there_is_no_state_before_the_first_reset():
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        lanes("plain").get_state()


def changed(*path, value):
    def change(state):
        for key in path[:-1]:
            state = state[key]
        state[path[-1]] = value(state[path[-1]]) if callable(value) else value

    return change


def set_to(column, number):
    def put(array):
        array = array.copy()
        array[1, ..., column] = number
        return array

    return put


ARRAYS = ("episodes", "arrays")
WRONG = {
    "no mapping": (lambda state: state.clear(), "keys"),
    "another key": (changed("more", value=1), "keys"),
    "fewer lanes": (changed("over", value=np.zeros(2, bool)), "over"),
    "another type": (changed(*ARRAYS, "state.angles", value=lambda a: a.astype(np.float32)), "state.angles"),
    "another shape": (changed(*ARRAYS, "state.poses", value=lambda a: a[:, :-1]), "state.poses"),
    "no array": (changed(*ARRAYS, "loads", value=[[0.0]]), "loads"),
    "an array less": (lambda state: state["episodes"]["arrays"].pop("loads"), "keys"),
    "another length": (changed(*ARRAYS, "course.targets", value=lambda a: a.repeat(5, axis=1)), "targets"),
    "a design too many": (changed("episodes", "designs", value=np.full(3, 7)), "designs"),
    "a design below zero": (changed("episodes", "designs", value=np.full(3, -1)), "designs"),
    "a step beyond the episode": (changed(*ARRAYS, "state.readings", value=set_to(0, 1e6)), "steps"),
    "a step that is no number": (changed(*ARRAYS, "state.readings", value=set_to(0, np.nan)), "steps"),
    "half a link": (changed(*ARRAYS, "state.readings", value=set_to(14, 1.5)), "links"),
    "a load on no link": (changed(*ARRAYS, "loads", value=set_to(0, 99.0)), "link"),
    "a mechanism of code": (changed("episodes", "mechanisms", value="os.system"), "mechanisms"),
    "no mechanisms": (changed("episodes", "mechanisms", value=[]), "mechanisms"),
    "fewer generators": (changed("generators", value=[None]), "generators"),
    "a generator of another kind": (changed("generators", 0, "bit_generator", value="MT19937"), "PCG64"),
    "a generator of text": (changed("generators", 0, "state", "state", value="1"), "generators"),
    "a generator too large": (changed("generators", 0, "state", "inc", value=2**128), "generators"),
}


@pytest.mark.parametrize(("change", "words"), WRONG.values(), ids=WRONG)
def test_what_does_not_fit_is_refused_in_one_line_and_changes_nothing(change, words):
    envs, twin = lanes("plain"), lanes("plain")
    for each in (envs, twin):
        each.reset(seed=3)
        steps(each, 2)
    state = copy.deepcopy(envs.get_state())
    change(state)
    with pytest.raises(InvalidInput, match=words) as refused:
        envs.set_state(state)
    assert "\n" not in str(refused.value) and "get_state()" in str(refused.value)
    assert same(steps(envs, 6, seed=1), steps(twin, 6, seed=1))


def test_variations_that_cannot_be_built_are_refused():
    envs = lanes("planar tolerances")
    envs.reset(seed=3)
    state = envs.get_state()
    state["episodes"]["mechanisms"]["factors"][0] = -1.0
    with pytest.raises(InvalidInput, match="positive factors"):
        envs.set_state(state)
