"""A person as the controller, and others in the same episode."""

import gymnasium
import numpy as np
import pytest

from agents.controllers import JacobianFeedback
from agents.evaluation.rollout import run_episodes
from agents.results.roster import opponents
from agents.runs.environment import EnvConfig
from agents.viewer.controllers import offered_controllers, worlds
from agents.viewer.drive import Drive, Repeated, filmed
from agents.viewer.play import PERSON, Match, Seat, hidden_load
from rj_gym import IDS
from rollingjoint.errors import InvalidInput

WITHOUT_POLICY = {"rj_gym/ArmInstrument-v1"}
CHAIN, ARM, BLIND = "RollingJoint-v0", "FlexibleArm-v0", "Instrument-v0"
SMALL_ARM = EnvConfig("rj_gym/FlexibleArm-v0", settings={"mechanism": "small_arm", "episode_steps": 6})


def short(world, **settings):
    return EnvConfig(worlds()[world].id, settings={"episode_steps": 6, **settings})


def test_every_tracking_environment_is_a_world():
    ids = {env.id for env in worlds().values()}
    assert ids == {each for each in IDS if not each.endswith("Goal-v0")}
    assert "RollingJoint-v0: drifting load" in worlds()


@pytest.mark.slow
@pytest.mark.parametrize("world", worlds())
def test_exactly_those_who_can_drive_are_offered_beside_a_person(world):
    env = worlds()[world]
    names = list(offered_controllers(env))
    able, _ = opponents(env)
    policies = [name for name in names if name.startswith("policy ")]
    assert names == [*policies, *able]
    assert bool(policies) == (env.id not in WITHOUT_POLICY)
    for name in policies:
        offered_controllers(env)[name].drive(3).step()


@pytest.mark.parametrize("env", [short(CHAIN), short(BLIND), SMALL_ARM], ids=["chain", "blind", "arm"])
def test_a_film_is_the_episode_of_the_scalar_environment(env):
    film = filmed("nobody", env, Repeated(np.full((1, 4 if env is SMALL_ARM else 2), 0.5)), 7)
    scalar = gymnasium.make(env.id, **env.arguments())
    _, info = scalar.reset(seed=7)
    errors = [info["error_mm"]]
    for action in film.actions:
        *_, info = scalar.step(action)
        errors.append(info["error_mm"])
    assert film.steps == 6 and not film.ended
    np.testing.assert_allclose(film.errors, errors, atol=1e-9)
    np.testing.assert_allclose(film.scenes[-1].tip, info["tip"], atol=1e-9)
    np.testing.assert_allclose(film.trail(6)[-1], info["tip"], atol=1e-9)
    assert film.last_10_mm == pytest.approx(np.mean(errors[1:]), abs=1e-9)


def test_scenes_of_a_film_stay_as_they_were():
    film = filmed("jacobian feedback", short(CHAIN), JacobianFeedback(), 2)
    assert len({scene.poses.tobytes() for scene in film.scenes}) == len(film.scenes)
    assert film.at(100) is film.scenes[-1] and film.at(0).step == 0


def test_all_share_one_episode_and_the_person_decides_only_for_itself():
    match = Match(Seat(worlds()[CHAIN], 5, "tendons", ["policy fixed_target", "jacobian feedback"]))
    alone = filmed("", worlds()[CHAIN], JacobianFeedback(), 5)
    match.person.pull([1.0, -1.0])
    while not match.over:
        match.step()
    person, policy, feedback = match.films
    assert [film.name for film in match.films] == [PERSON, "policy fixed_target", "jacobian feedback"]
    for film in match.films:
        np.testing.assert_array_equal(film.scenes[0].poses, person.scenes[0].poses)
        np.testing.assert_array_equal(film.scenes[-1].target, person.scenes[-1].target)
        assert hidden_load(film, 3) == hidden_load(person, 3)
    np.testing.assert_allclose(feedback.errors, alone.errors, atol=1e-9)
    np.testing.assert_array_equal(person.actions, [[1.0, -1.0]] * 50)
    assert policy.errors[-1] < person.errors[-1]


def test_the_error_of_a_film_is_what_controllers_are_compared_by():
    episodes = run_episodes(short(CHAIN), JacobianFeedback(), [4])
    film = filmed("", short(CHAIN), JacobianFeedback(), 4)
    assert film.last_10_mm == pytest.approx(episodes.last_errors.mean(), abs=1e-9)


@pytest.mark.parametrize("env", [short(CHAIN, episode_steps=40), SMALL_ARM], ids=["chain", "arm"])
def test_pointing_brings_the_tip_near_to_where_the_person_points(env):
    match = Match(Seat(env, 3, "point"))
    match.step()
    np.testing.assert_array_equal(match.films[0].actions[0], 0.0)
    target = match.films[0].scenes[0].target
    before = match.films[0].errors[0]
    match.person.aim_at(target)
    while not match.over:
        match.step()
    assert match.films[0].errors[-1] < 0.7 * before


@pytest.mark.parametrize("pulls", [[1.0], [np.nan, 0.0], "left"])
def test_pulls_that_are_none_are_refused(pulls):
    match = Match(Seat(short(CHAIN), way="tendons"))
    with pytest.raises(InvalidInput, match="pulls"):
        match.person.pull(pulls)


def test_a_point_in_the_wrong_space_is_refused():
    match = Match(Seat(short(CHAIN)))
    with pytest.raises(InvalidInput, match="point"):
        match.person.aim_at([1.0, 2.0, 3.0])


def test_who_is_not_known_is_refused():
    with pytest.raises(InvalidInput, match="controller"):
        Match(Seat(short(CHAIN), beside=["nobody"]))
    with pytest.raises(InvalidInput, match="way"):
        Match(Seat(short(CHAIN), way="mind"))


def test_a_task_without_a_target_is_refused():
    with pytest.raises(InvalidInput, match="tracking"):
        Drive("", EnvConfig("rj_gym/CurvatureDesign-v0"), Repeated(np.zeros((1, 2))), 0)


def test_hidden_loads_are_told_in_words():
    assert "N on link" in hidden_load(filmed("", short(CHAIN), Repeated(np.zeros((1, 2))), 1), 2)
    assert "gravity" in hidden_load(filmed("", SMALL_ARM, Repeated(np.zeros((1, 4))), 1), 2)
