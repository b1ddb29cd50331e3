"""rj_gym/ManyMechanisms-v0: every lane is RollingJoint with the mechanism of its design, in its own units."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import seeding
from gymnasium.utils.env_checker import check_env

import rj_gym
from rj_gym.many.episodes import runs_of
from rj_gym.many.kernels import ABSENT
from rollingjoint import five_link
from rollingjoint.design import DesignSpace
from rollingjoint.errors import ConfigError, InvalidInput, MechanismError

ID = "rj_gym/ManyMechanisms-v0"
FEW = {"designs": (0, 12), "links": (3, 5)}
TALL = {"space": {"symmetric": False, "height": (16.0, 24.0)}, "designs": (0, 3), "links": (3, 4)}
INSIDE = {  # settings that reach the observation in different ways
    "plain": {"mechanisms": FEW},
    "heights": {"mechanisms": TALL, "observe_load": True},
    "hidden": {"mechanisms": FEW, "sensing": {"pose": "none"}, "observe_history": 2, "privileged": "info"},
    "truth": {"mechanisms": TALL, "privileged": "observation", "randomization": {"position_noise_mm": 0.3}},
}


def lanes(count: int, **settings):
    return gymnasium.make_vec(ID, count, "vector_entry_point", **settings)


def one_like(lane_seed: int, design, settings):
    """RollingJoint with the mechanism of a design, and the random numbers of a lane behind its first."""
    env = gymnasium.make(
        "rj_gym/RollingJoint-v0", mechanism=design.mechanism, **{k: v for k, v in settings.items() if k != "mechanisms"}
    ).unwrapped
    generator = seeding.np_random(lane_seed)[0]
    generator.random()
    env.reset()
    env._np_random = generator
    return env, env.reset()[0]


def parts(observation):
    return observation.values() if isinstance(observation, dict) else [observation]


@pytest.mark.parametrize("settings", INSIDE.values(), ids=INSIDE)
def test_every_lane_is_rolling_joint_with_its_own_mechanism(settings):
    envs, rng = lanes(3, **settings), np.random.default_rng(0)
    observations, infos = envs.reset(seed=5)
    designs, task = envs.unwrapped.designs, envs.unwrapped.task
    assert len({design.n_links for design in designs}) > 1
    singles = [one_like(5 + lane, design, settings) for lane, design in enumerate(designs)]
    for _ in range(6):
        for lane, ((_, expected), design) in enumerate(zip(singles, designs, strict=True)):
            row = (
                {k: v[lane : lane + 1] for k, v in observations.items()}
                if isinstance(observations, dict)
                else observations[lane : lane + 1]
            )
            own = task.own_observations(row, design.n_links)
            for mine, theirs in zip(parts(own), parts(expected), strict=True):
                np.testing.assert_allclose(mine[0], theirs, rtol=1e-6, atol=2e-6)
        actions = rng.uniform(-1, 1, (3, 2)).astype(np.float32)
        observations, rewards, _, _, infos = envs.step(actions)
        stepped = [env.step(action) for (env, _), action in zip(singles, actions, strict=True)]
        assert rewards.tolist() == [step[1] for step in stepped]
        assert infos["error_mm"].tolist() == [step[4]["error_mm"] for step in stepped]
        if "privileged" in infos:
            truths = [infos["privileged"][i, task.truth_places[d.n_links]] for i, d in enumerate(designs)]
            for truth, step in zip(truths, stepped, strict=True):
                np.testing.assert_allclose(truth, step[4]["privileged"], rtol=1e-6, atol=2e-6)
        singles = [(env, step[0]) for (env, _), step in zip(singles, stepped, strict=True)]


def test_lanes_equal_scalar_environments_through_restarts_of_some():
    settings = {"mechanisms": FEW, "episode_steps": 5}
    envs, singles = lanes(4, **settings), [gymnasium.make(ID, **settings) for _ in range(4)]
    envs.reset(seed=0)
    for lane, env in enumerate(singles):
        env.reset(seed=lane)
    rng, over = np.random.default_rng(1), np.zeros(4, bool)
    for step in range(22):
        if step in (3, 9, 13):
            mask = rng.random(4) < 0.5
            mask[step % 4] = True
            envs.reset(options={"reset_mask": mask})
            for lane in np.flatnonzero(mask):
                singles[lane].reset()
            over &= ~mask
        actions = rng.uniform(-1, 1, (4, 2)).astype(np.float32)
        observations, rewards, terminated, truncated, _ = envs.step(actions)
        for lane, env in enumerate(singles):
            if over[lane]:
                assert np.array_equal(env.reset()[0], observations[lane])
                continue
            observation, reward, *ends, _ = env.step(actions[lane])
            assert np.array_equal(observation, observations[lane])
            assert (reward, *ends) == (rewards[lane], terminated[lane], truncated[lane])
        over = terminated | truncated


def test_a_state_continues_elsewhere_to_the_last_bit():
    first, second = (lanes(4, mechanisms=FEW, episode_steps=4) for _ in range(2))
    first.reset(seed=3)
    actions = np.random.default_rng(0).uniform(-1, 1, (12, 4, 2)).astype(np.float32)
    for action in actions[:6]:
        first.step(action)
    first.reset(options={"reset_mask": [True, False, False, True]})
    second.unwrapped.set_state(first.unwrapped.get_state())
    for action in actions[6:]:
        a, b = first.step(action), second.step(action)
        assert np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])
    assert [d.number for d in first.unwrapped.designs] == [d.number for d in second.unwrapped.designs]


def test_a_state_continues_where_more_mechanisms_are_known_than_there_are_lanes():
    first, second = (lanes(1, mechanisms={"links": (4, 4), "designs": (0, 5)}).unwrapped for _ in range(2))
    for design in range(5):
        first.reset(seed=design, options={"design": design})
    second.set_state(first.get_state())
    assert second.designs[0].number == 4
    action = np.float32([[0.3, -0.8]])
    assert np.array_equal(first.step(action)[0], second.step(action)[0])


def test_links_that_are_not_there_have_no_privileged_state():
    envs = lanes(3, mechanisms=FEW, privileged="info", episode_steps=2)
    task, seen = envs.unwrapped.task, set()
    _, infos = envs.reset(seed=0)
    for _ in range(40):
        for lane, design in enumerate(envs.unwrapped.designs):
            absent = np.delete(infos["privileged"][lane], task.truth_places[design.n_links])
            assert not absent.any()
            seen.add((lane, design.n_links))
        infos = envs.step(np.zeros((3, 2), np.float32))[4]
    assert len(seen) > 5  # lanes have had mechanisms of several sizes


def test_every_entry_is_in_one_run():
    assert runs_of(np.array([0, 1, 4, 5, 7]), 9).tolist() == [
        [0, 0, 2],
        [2, ABSENT, 2],
        [4, 2, 2],
        [6, ABSENT, 1],
        [7, 4, 1],
        [8, ABSENT, 1],
    ]


def test_a_state_that_does_not_fit_changes_nothing():
    envs = lanes(3, mechanisms=FEW)
    envs.reset(seed=0)
    state = envs.unwrapped.get_state()
    before = [array.copy() for array in state["episodes"]["lanes"].values()]
    bad = {**state, "episodes": {**state["episodes"], "lanes": {"3": np.array([0, 0, 1])}}}
    with pytest.raises(InvalidInput, match="lanes"):
        envs.unwrapped.set_state(bad)
    assert all(map(np.array_equal, before, envs.unwrapped.get_state()["episodes"]["lanes"].values()))


def test_gymnasiums_checker_passes():
    check_env(gymnasium.make(ID, mechanisms=FEW).unwrapped, skip_render_check=True)


def test_the_checker_of_vector_environments_passes():
    def make(autoreset_mode):
        return lanes(3, mechanisms=FEW, episode_steps=4, autoreset_mode=autoreset_mode)

    rj_gym.check_vector_env(make, n_steps=10, scalar=lambda: gymnasium.make(ID, mechanisms=FEW, episode_steps=4))


def test_a_design_is_the_same_everywhere_and_others_differ():
    drawn = rj_gym.MechanismsConfig(**FEW).drawn
    again = rj_gym.MechanismsConfig(designs=(0, 1000), links=(3, 5)).drawn
    assert drawn[4] is again[4] and drawn[4].mechanism is not drawn[5].mechanism
    assert {drawn[k].n_links for k in range(12)} == {3, 4, 5}


def test_the_description_of_a_design_is_its_own_and_0_for_links_that_are_not_there():
    env = gymnasium.make(ID, mechanisms={"links": (3, 5)}).unwrapped
    observation, info = env.reset(seed=0, options={"mechanism": five_link()})
    names = {entry.name: place for place, entry in enumerate(env.task.entries())}
    assert info["sampled"]["design"] == -1 and info["sampled"]["n_links"] == 5
    assert observation[names["length"]] == pytest.approx(1.0)
    below, above = five_link().links[1:3]
    relative = above.parent.curvature(0.0) - below.child.curvature(0.0)
    assert observation[names["joint 2 middle convexity"]] == pytest.approx(relative / 0.1)
    assert relative > 0.0
    number = next(k for k in range(50) if env.task.design(k).n_links == 3)
    observation, _ = env.reset(options={"design": number})
    assert observation[names["link 2 is there"]] == 1.0
    absent = [place for name, place in names.items() if name.split()[:2] in (["link", "3"], ["joint", "4"])]
    assert len(absent) > 8 and not observation[absent].any()


def test_the_tangent_of_every_lane_is_that_of_its_own_mechanism():
    settings = {"mechanisms": TALL}
    envs = lanes(3, **settings)
    envs.reset(seed=2)
    action = np.full((3, 2), [0.5, -0.7], np.float32)
    envs.step(action)
    whole, task = envs.unwrapped.tangent(), envs.unwrapped.task
    for lane, design in enumerate(envs.unwrapped.designs):
        single, _ = one_like(2 + lane, design, settings)
        single.step(action[lane])
        own = single._buffer.tangent()
        np.testing.assert_allclose(whole.tip_rates[lane], own.tip_rates[0], atol=1e-6)
        places = task.pictured_places[design.n_links]
        entries = np.array([1.0 if "angle" in name else task.length for name in task.pictured])[places]
        theirs = np.array([1.0 if "angle" in name else design.mechanism.length for name in single.task.pictured])
        np.testing.assert_allclose(
            whole.pose_rates[lane, places] / entries[:, None], own.pose_rates[0] / theirs[:, None], atol=1e-6
        )


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"mechanisms": {"links": (8, 3)}}, "links"),
        ({"mechanisms": {"links": (3, 40)}}, "2 to 16"),
        ({"mechanisms": {"designs": (5, 5)}}, "designs"),
        ({"mechanisms": {"space": {"n_links": 4}}}, "mechanisms.links"),
        ({"mechanisms": {"space": {"knotz": 5}}}, "knots"),
        ({"mechanisms": {"space": "five_link"}}, "DesignSpace"),
        ({"mechanisms": {"spaces": {}}}, "space"),
        ({"mechanism": "five_link"}, "mechanisms"),
        ({"friction": {"mu": 0.1}}, "friction"),
        ({"randomization": {"stiffness_spread": 0.1}}, "designs"),
    ],
)
def test_bad_settings_are_refused_in_a_line(settings, words):
    with pytest.raises(ConfigError, match=words) as refused:
        gymnasium.make(ID, **settings)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "options",
    [
        {"design": -1},
        {"design": 1, "mechanism": five_link()},
        {"mechanism": "two_segment"},
        {"mechanism": 3},
        {"load": {"link": 4, "force": (0, 1)}},
        {"desing": 1},
    ],
)
def test_bad_options_are_refused_and_change_nothing(options):
    env = gymnasium.make(ID, mechanisms=FEW).unwrapped
    env.reset(seed=0)
    before = env.get_wrapper_attr("designs")
    with pytest.raises((InvalidInput, MechanismError)) as refused:
        env.reset(options=options)
    assert "\n" not in str(refused.value) and env.designs == before


def test_a_space_is_given_by_its_fields_or_as_an_object():
    given = rj_gym.ManyMechanismsConfig(mechanisms={"space": DesignSpace(symmetric=False, knots=3)})
    assert given.mechanisms.space == {"knots": 3, "symmetric": False}
    assert given == rj_gym.ManyMechanismsConfig(mechanisms={"space": {"symmetric": False, "knots": 3}})
