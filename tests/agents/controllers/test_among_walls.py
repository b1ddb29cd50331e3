"""Controllers among walls: ways around obstacles, the pace at which they are gone, the leader's last millimetres."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest

import rj_gym  # noqa: F401
from agents.controllers.among_walls import (
    TEACHERS,
    Feedback,
    FirmLeader,
    FollowTheLeader,
    PlanAround,
    WallController,
    WayFromAnywhere,
    _neighbours,
    _paced,
)
from agents.controllers.command_tree import CommandTree
from agents.controllers.fitted_wall import FittedWall
from rj_gym import SURROUNDINGS_IDS
from rollingjoint import Disc


def ended(env_id: str, controller: WallController, options: dict[str, Any], lanes: int = 1, **settings: Any) -> Any:
    """The infos at the end of the episodes with these options."""
    envs: Any = gymnasium.make_vec(env_id, lanes, "vector_entry_point", autoreset_mode="Disabled", **settings)
    infos = envs.reset(seed=9_100_003, options=options)[1]
    controller.begin(envs.unwrapped, infos)
    for _ in range(envs.unwrapped.config.episode_steps):
        infos = envs.step(controller.act(envs.unwrapped).astype(np.float32))[-1]
    envs.close()
    return infos


def test_a_plan_leads_around_a_disc_that_stops_heavily_damped_feedback() -> None:
    discs = [Disc((-18.0, 83.5), 4.5, stiffness=2.0), Disc((50.5, 68.6), 5.4, stiffness=2.0)]
    options = {"discs": discs, "target": (-29.7, 71.9)}
    feedbacks = Feedback(aware=False), Feedback(aware=False, step_mm=8.0, damping=0.3)
    planners = PlanAround(), WayFromAnywhere()
    planned, anywhere, stuck, light = (
        ended("rj_gym/Obstacles-v0", controller, options) for controller in (*planners, *feedbacks)
    )
    for infos in planned, anywhere:
        assert infos["success"][0] and infos["peak_wall_force"][0] < 0.1
    assert stuck["error_mm"][0] > 10.0 and not stuck["success"][0]
    assert light["success"][0] and light["peak_wall_force"][0] > 0.2


def test_a_way_leads_from_where_other_actions_have_led() -> None:
    envs: Any = gymnasium.make_vec("rj_gym/Obstacles-v1", 4, "vector_entry_point", autoreset_mode="Disabled")
    infos = envs.reset(seed=6_000_000)[1]
    controller = WayFromAnywhere()
    controller.begin(envs.unwrapped, infos)
    for action in (0.6, -0.6, 0.0, 0.0), (0.0, 0.0, 0.6, -0.6):
        for _ in range(4):
            envs.step(np.tile(np.array(action, np.float32), (4, 1)))
    for _ in range(50):
        infos = envs.step(controller.act(envs.unwrapped).astype(np.float32))[-1]
    assert infos["success"].all()


def test_a_tree_of_commands_leads_around_a_disc_without_much_force() -> None:
    discs = [Disc((-18.0, 83.5), 4.5, stiffness=2.0), Disc((50.5, 68.6), 5.4, stiffness=2.0)]
    options = {"discs": discs, "target": (-29.7, 71.9)}
    infos = ended("rj_gym/Obstacles-v0", CommandTree(), options)
    assert infos["success"][0] and infos["peak_wall_force"][0] < 0.4
    none = ended("rj_gym/Obstacles-v0", CommandTree(nodes=1), options)
    assert not none["success"][0]


def test_a_way_is_gone_at_its_pace_and_to_its_end() -> None:
    places = np.array([[0.0, 0.0], [1.0, -2.5], [1.0, -2.5], [4.0, 0.0]])
    steps = _paced(places, 0.7)
    assert np.abs(np.diff(np.vstack([places[:1], steps]), axis=0)).max() <= 0.7 + 1e-9
    assert np.array_equal(steps[-1], places[-1]) and len(steps) == 8  # ways of 2.5 and 3 mm


def test_nodes_of_a_grid_have_each_neighbour_once() -> None:
    pairs = {frozenset(pair) for pair in _neighbours((3, 4)).T.tolist()}
    assert len(pairs) == _neighbours((3, 4)).shape[1] == 3 * 3 + 2 * 4 + 2 * 2 * 3
    assert frozenset((0, 5)) in pairs and frozenset((3, 4)) not in pairs


def test_the_leader_stretches_where_the_base_has_come_to_its_end() -> None:
    """A target 1 mm beyond the base's reach: it is approached without strain."""
    infos = ended("rj_gym/Lumen-v0", FollowTheLeader(), {"depth": 66.0}, families=["gentle"])
    assert infos["feed"][0] > 70.0 and infos["success"][0] and infos["peak_wall_force"][0] < 0.9


def test_the_firm_leader_ends_nearer_the_target_and_presses_harder() -> None:
    usual, firm = (
        ended("rj_gym/Lumen-v0", controller, {}, lanes=12, families=["gentle"])
        for controller in (FollowTheLeader(), FirmLeader())
    )
    assert firm["error_mm"].mean() < 0.7 * usual["error_mm"].mean()
    assert firm["success"].all() and firm["peak_wall_force"].mean() > usual["peak_wall_force"].mean()


@pytest.mark.slow
def test_a_fitted_wall_is_pressed_with_the_wanted_force_by_observations_alone() -> None:
    """Also in the second lane, whose tip is so near the target that it goes the wrong way first."""
    envs: Any = gymnasium.make_vec("rj_gym/HiddenWall-v0", 2, "vector_entry_point", episode_steps=12)
    observations, infos = envs.reset(seed=[6_000_001, 6_000_003])
    controller = FittedWall()
    controller.begin(envs.unwrapped, infos)
    assert infos["error_mm"][1] < 0.5
    for _ in range(12):
        observations, *_, infos = envs.step(controller.act(observations).astype(np.float32))
    assert np.all(infos["success"]) and np.all(np.abs(infos["wall_force"] - 0.5) < 0.1)
    assert np.all(infos["peak_wall_force"] < 0.7)


def test_every_task_among_walls_has_a_teacher() -> None:
    assert set(TEACHERS) == set(SURROUNDINGS_IDS.values())
