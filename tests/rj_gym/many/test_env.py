"""Many mechanisms: every lane is RollingJoint, or PitchYaw, with the mechanism of its design, in its own units."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils import seeding
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_of_sb3

import rj_gym
from rj_gym.many import episodes
from rj_gym.many.episodes import runs_of
from rj_gym.many.kernels import ABSENT
from rollingjoint import five_link
from rollingjoint.design import DesignSpace, SpatialDesignSpace
from rollingjoint.errors import ConfigError, InvalidInput, MechanismError
from rollingjoint.friction import CapstanFriction
from rollingjoint.io.mechanism_file import load_mechanism

ID, IN_SPACE = "rj_gym/ManyMechanisms-v0", "rj_gym/ManyMechanismsInSpace-v0"
BOTH = pytest.mark.parametrize("env_id", [ID, IN_SPACE], ids=["plane", "space"])
ONE = {ID: "rj_gym/RollingJoint-v0", IN_SPACE: "rj_gym/PitchYaw-v0"}
TENDONS = {ID: 2, IN_SPACE: 4}
FEW = {"designs": (0, 12), "links": (3, 5)}
TALL = {"space": {"symmetric": False, "height": (16.0, 24.0)}, "designs": (0, 3), "links": (3, 4)}
RINGS = {"space": {"ends": [2, 4]}, "designs": (0, 12), "links": (3, 5)}
AROUND = {  # one mechanism, with changes
    ID: {"mechanism": "two_segment", "hole_radius": [-0.5, 0.5]},
    IN_SPACE: {"mechanism": "pitch_yaw_two_segment", "height": [-0.5, 0.5], "azimuth": [-0.1, 0.1]},
}
ARM = {"space": {"mechanism": "small_arm", "hole_radius": [-0.5, 0.5]}, "designs": (0, 4)}
INSIDE = {  # settings that reach the observation in different ways
    "plain": {"mechanisms": FEW},
    "heights": {"mechanisms": TALL, "observe_load": True},
    "hidden": {"mechanisms": FEW, "sensing": {"pose": "none"}, "observe_history": 2, "privileged": "info"},
    "truth": {"mechanisms": TALL, "privileged": "observation", "randomization": {"position_noise_mm": 0.3}},
}
EVERYWHERE = [(ID, settings) for settings in INSIDE.values()] + [
    (IN_SPACE, settings)
    for settings in (
        INSIDE["plain"],
        {"mechanisms": RINGS, "observe_load": True, "orientation": True},
        INSIDE["hidden"],
        {**INSIDE["truth"], "mechanisms": FEW},
    )
]


def lanes(count: int, env_id: str = ID, **settings):
    return gymnasium.make_vec(env_id, count, "vector_entry_point", **settings)


def one_like(lane_seed: int, design, settings, env_id: str = ID):
    """RollingJoint or PitchYaw with the mechanism of a design, and the random numbers of a lane behind its first."""
    settings = {k: v for k, v in settings.items() if k != "mechanisms"}
    if env_id == IN_SPACE:
        settings = {"target": {"loaded": True}, "load": {"magnitude": (0.0, 1.0)}, **settings}
    env = gymnasium.make(ONE[env_id], mechanism=design.mechanism, **settings).unwrapped
    generator = seeding.np_random(lane_seed)[0]
    generator.random()
    env.reset()
    env._np_random = generator
    return env, env.reset()[0]


def parts(observation):
    return observation.values() if isinstance(observation, dict) else [observation]


@pytest.mark.parametrize(("env_id", "settings"), EVERYWHERE)
def test_every_lane_is_the_task_with_its_own_mechanism(env_id, settings):
    envs, rng = lanes(3, env_id, **settings), np.random.default_rng(0)
    observations, infos = envs.reset(seed=5)
    designs, task = envs.unwrapped.designs, envs.unwrapped.task
    assert len({design.n_links for design in designs}) > 1
    singles = [one_like(5 + lane, design, settings, env_id) for lane, design in enumerate(designs)]
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
        actions = rng.uniform(-1, 1, (3, task.action_size)).astype(np.float32)
        observations, rewards, _, _, infos = envs.step(actions)
        stepped = [env.step(action) for (env, _), action in zip(singles, actions, strict=True)]
        assert rewards.tolist() == [step[1] for step in stepped]
        assert infos["error_mm"].tolist() == [step[4]["error_mm"] for step in stepped]
        if "privileged" in infos:
            truths = [infos["privileged"][i, task.truth_places[d.n_links]] for i, d in enumerate(designs)]
            for truth, step in zip(truths, stepped, strict=True):
                np.testing.assert_allclose(truth, step[4]["privileged"], rtol=1e-6, atol=2e-6)
        singles = [(env, step[0]) for (env, _), step in zip(singles, stepped, strict=True)]


@BOTH
def test_lanes_equal_scalar_environments_through_restarts_of_some(env_id):
    settings = {"mechanisms": FEW, "episode_steps": 5}
    envs, singles = lanes(4, env_id, **settings), [gymnasium.make(env_id, **settings) for _ in range(4)]
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
        actions = rng.uniform(-1, 1, (4, TENDONS[env_id])).astype(np.float32)
        observations, rewards, terminated, truncated, _ = envs.step(actions)
        for lane, env in enumerate(singles):
            if over[lane]:
                assert np.array_equal(env.reset()[0], observations[lane])
                continue
            observation, reward, *ends, _ = env.step(actions[lane])
            assert np.array_equal(observation, observations[lane])
            assert (reward, *ends) == (rewards[lane], terminated[lane], truncated[lane])
        over = terminated | truncated


@BOTH
@pytest.mark.parametrize("left", ["to threads", "to the general solver"])
def test_steps_that_the_kernel_leaves(env_id, left, monkeypatch):
    apart, step_apart = [], episodes._Size.step_apart
    monkeypatch.setattr(episodes._Size, "step_apart", lambda *given: apart.append(given) or step_apart(*given))
    force = {} if left == "to threads" else {"load": {"magnitude": (200.0, 600.0)}}
    settings = {"mechanisms": FEW, **force}
    singles = [gymnasium.make(env_id, **settings) for _ in range(6)]
    for lane, env in enumerate(singles):
        env.reset(seed=lane)
    if left == "to threads":
        monkeypatch.setattr(episodes, "runs_at_once", lambda *_: False)
    envs, rng = lanes(6, env_id, **settings), np.random.default_rng(2)
    envs.reset(seed=0)
    n_apart = 0
    for _ in range(6):
        actions = rng.uniform(-1, 1, (6, TENDONS[env_id])).astype(np.float32)
        apart.clear()
        observations, rewards, *_ = envs.step(actions)
        n_apart += len(apart)
        alone = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        assert np.array_equal(observations, [each[0] for each in alone])
        assert rewards.tolist() == [each[1] for each in alone]
    assert n_apart > 0


@BOTH
def test_lanes_that_go_on_keep_their_observations_where_others_begin(env_id):
    envs = lanes(60, env_id, mechanisms=FEW)
    envs.reset(seed=0)
    before = envs.step(np.full((60, TENDONS[env_id]), 0.5, np.float32))[0]
    mask = np.arange(60) >= 40
    assert np.array_equal(envs.reset(options={"reset_mask": mask})[0][~mask], before[~mask])


@BOTH
def test_a_state_continues_elsewhere_to_the_last_bit(env_id):
    first, second = (lanes(4, env_id, mechanisms=FEW, episode_steps=4) for _ in range(2))
    first.reset(seed=3)
    actions = np.random.default_rng(0).uniform(-1, 1, (12, 4, TENDONS[env_id])).astype(np.float32)
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
    own = state["episodes"]["lanes"]
    for wrong in ({"3": np.array([0, 0, 1])}, {n: rows[:, None] for n, rows in own.items()}, dict.fromkeys(own, 1)):
        with pytest.raises(InvalidInput, match="lanes"):
            envs.unwrapped.set_state({**state, "episodes": {**state["episodes"], "lanes": wrong}})
    with pytest.raises(InvalidInput, match="lanes"):
        envs.unwrapped.set_state({**state, "episodes": {**state["episodes"], "episodes": 3}})
    assert all(map(np.array_equal, before, envs.unwrapped.get_state()["episodes"]["lanes"].values()))


@BOTH
@pytest.mark.filterwarnings("ignore:.*Box observation space.*")
def test_the_checkers_of_gymnasium_and_stable_baselines_pass(env_id):
    env = gymnasium.make(env_id, mechanisms=FEW).unwrapped
    check_env(env, skip_render_check=True)
    check_env_of_sb3(env, warn=False)


@BOTH
def test_the_checker_of_vector_environments_passes(env_id):
    def make(autoreset_mode):
        return lanes(3, env_id, mechanisms=FEW, episode_steps=4, autoreset_mode=autoreset_mode)

    rj_gym.check_vector_env(make, n_steps=10, scalar=lambda: gymnasium.make(env_id, mechanisms=FEW, episode_steps=4))


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


@BOTH
def test_the_tangent_of_every_lane_is_that_of_its_own_mechanism(env_id):
    settings, within = {"mechanisms": TALL if env_id == ID else FEW}, {ID: 1e-6, IN_SPACE: 5e-5}[env_id]  # differences
    envs = lanes(3, env_id, **settings)
    envs.reset(seed=2)
    action = np.full((3, TENDONS[env_id]), np.resize([0.5, -0.7], TENDONS[env_id]), np.float32)
    envs.step(action)
    whole, task = envs.unwrapped.tangent(), envs.unwrapped.task
    for lane, design in enumerate(envs.unwrapped.designs):
        single, _ = one_like(2 + lane, design, settings, env_id)
        single.step(action[lane])
        own = single._buffer.tangent()
        np.testing.assert_allclose(whole.tip_rates[lane], own.tip_rates[0], atol=within)
        places = task.pictured_places[design.n_links]
        entries = np.array([1.0 if "angle" in name else task.length for name in task.pictured])[places]
        theirs = np.array([1.0 if "angle" in name else design.mechanism.length for name in single.task.pictured])
        np.testing.assert_allclose(
            whole.pose_rates[lane, places] / entries[:, None], own.pose_rates[0] / theirs[:, None], atol=within
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
        ({"mechanisms": {"space": {"kind": "space"}}}, "chains in the plane"),
        ({"mechanisms": {"space": {"mechanism": "pitch_yaw"}}}, "chains in the plane"),
        ({"mechanisms": {"space": {"mechanism": "five_link"}}}, r"\(5, 5\)"),
    ],
)
def test_bad_settings_are_refused_in_a_line(settings, words):
    with pytest.raises(ConfigError, match=words) as refused:
        gymnasium.make(ID, **settings)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"mechanisms": {"space": {"kind": "plane"}}}, "chains in space"),
        ({"mechanisms": {"space": {"mechanism": "five_link"}}}, "chains in space"),
        ({"mechanisms": {"space": {"n_joints": 4}}}, "mechanisms.links"),
        ({"mechanisms": {"space": {"ends": [2, 4]}}}, "ends"),  # designs have 7 joints at most
        ({"mechanisms": {"space": {"ends": [6, 7]}}}, "ends"),  # those with 2 joints would have 2 rings to the tip
        ({"mechanisms": {"space": {"ends": 7}}}, "ends"),
        ({"mechanism": "pitch_yaw"}, "mechanisms"),
        ({"randomization": {"weight_spread": 0.1}}, "designs"),
        ({"friction": {"mu": 0.1}}, "friction"),
    ],
)
def test_bad_settings_in_space_are_refused_in_a_line(settings, words):
    with pytest.raises(ConfigError, match=words) as refused:
        gymnasium.make(IN_SPACE, **settings)
    assert "\n" not in str(refused.value)


@BOTH
def test_designs_around_a_mechanism_have_its_tendons_and_where_they_end(env_id):
    links = {ID: 7, IN_SPACE: 15}[env_id]
    mechanisms = {"space": AROUND[env_id], "links": (links, links), "designs": (0, 3)}
    envs = lanes(3, env_id, mechanisms=mechanisms, episode_steps=5)
    observations, _ = envs.reset(seed=0)
    task, base = envs.unwrapped.task, load_mechanism(AROUND[env_id]["mechanism"])
    assert task.action_size == base.n_tendons and observations.shape == (3, len(task.entries()))
    names = {entry.name: place for place, entry in enumerate(task.entries())}
    axes = {ID: [""], IN_SPACE: [" x", " y", " z"]}[env_id]
    for lane, design in enumerate(envs.unwrapped.designs):
        assert design.mechanism.last_links == base.last_links
        for j, last in enumerate(base.last_links):
            for k in range(1, links):
                places = observations[lane, [names[f"link {k} hole {j}{axis}"] for axis in axes]]
                assert places.any() == (k <= last)
    for _ in range(6):
        envs.step(np.zeros((3, base.n_tendons), np.float32))


def test_designs_around_a_mechanism_keep_its_weights_and_it_may_not_rub():
    base = five_link()
    heavy = base.replace(links=[replace(link, weight=0.5) for link in base.links])
    drawn = rj_gym.MechanismsConfig(space=DesignSpace.of(heavy), links=(5, 5)).drawn
    assert [link.weight for link in drawn[7].mechanism.links] == [0.5] * 5
    rough = base.replace(friction=CapstanFriction(0.1))
    with pytest.raises(ConfigError, match="without friction"):
        rj_gym.ManyMechanismsConfig(mechanisms={"space": DesignSpace.of(rough), "links": (5, 5)})


def test_rings_of_tendons_end_at_the_same_shares_of_the_joints():
    drawn = rj_gym.MechanismsInSpaceConfig(**RINGS).drawn
    ends = {drawn[k].n_links: set(drawn[k].mechanism.last_links) for k in range(12)}
    assert ends == {3: {1, 2}, 4: {2, 3}, 5: {2, 4}}


def test_a_hinge_is_described_by_the_largest_convexity():
    links = load_mechanism("small_arm").n_links
    env = gymnasium.make(IN_SPACE, mechanisms={**ARM, "links": (links, links)}).unwrapped
    observation, _ = env.reset(seed=0)
    names = {entry.name: place for place, entry in enumerate(env.task.entries())}
    assert observation[names["joint 1 middle convexity"]] == 5.0
    axis = observation[[names["joint 1 axis x"], names["joint 1 axis y"]]]
    assert np.hypot(*axis) == pytest.approx(1.0, abs=1e-6)


def test_a_picture_shows_the_mechanism_of_its_episode():
    env = gymnasium.make(IN_SPACE, mechanisms=FEW, render_mode="rgb_array").unwrapped
    pictures = []
    for number in range(2):
        env.reset(seed=0, options={"design": number})
        pictures.append(env.render())
    assert pictures[0].shape == pictures[1].shape and (pictures[0] != pictures[1]).any()
    env.close()


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


def test_a_space_around_a_mechanism_may_be_an_object():
    space = DesignSpace.of("two_segment", hole_radius=(-0.5, 0.5))
    given = rj_gym.MechanismsConfig(space=space, links=(space.n_links, space.n_links))
    named = rj_gym.MechanismsConfig(space={"mechanism": "two_segment", "hole_radius": (-0.5, 0.5)}, links=given.links)
    assert given.space.keys() >= named.space.keys()
    np.testing.assert_array_equal(given.drawn[3].mechanism.neutral_lengths, named.drawn[3].mechanism.neutral_lengths)
    tubes = rj_gym.MechanismsInSpaceConfig(space=SpatialDesignSpace(n_joints=7, ends=(3, 7)))
    assert tubes.space == {"ends": [3, 7]}
    assert rj_gym.MechanismsInSpaceConfig(space=SpatialDesignSpace(alike=False)).space == {"alike": False}
