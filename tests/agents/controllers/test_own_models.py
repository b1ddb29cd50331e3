"""Controllers with a model where every lane has its own mechanism; floors there."""

import gymnasium
import numpy as np
import pytest

from agents.controllers import DoNothing, JacobianFeedback
from agents.controllers.controller import Controller
from agents.controllers.own_models import Nominal
from agents.controllers.privileged_feedback import PrivilegedFeedback
from agents.evaluation.floor import episode_floor
from agents.evaluation.rollout import run_episodes
from agents.runs.environment import EnvConfig
from rollingjoint.errors import InvalidInput
from rollingjoint.io.mechanism_file import mechanism_to_dict

MANY = {"mechanisms": {"designs": (0, 12), "links": (3, 5)}, "episode_steps": 12}
SEEDS = range(40, 44)


def singles():
    """RollingJoint with the mechanism, target and load of every lane: settings and reset options."""
    envs = gymnasium.make_vec("rj_gym/ManyMechanisms-v0", len(SEEDS), "vector_entry_point", **MANY)
    _, info = envs.reset(seed=SEEDS.start)
    sampled = info["sampled"]
    assert len(set(sampled["n_links"])) > 1
    for lane, design in enumerate(envs.unwrapped.designs):
        load = {"link": int(sampled["link"][lane]), "force": sampled["forces"][lane]}
        yield design.mechanism, {"target": sampled["targets"][lane], "load": load}


def single_errors(controller, mechanism, options, **settings):
    """Tip errors of an episode of one mechanism, (T + 1,) [mm]."""
    envs = gymnasium.make_vec(
        "rj_gym/RollingJoint-v0", 1, "vector_entry_point", mechanism=mechanism, episode_steps=12, **settings
    )
    observation, info = envs.reset(seed=0, options=options)
    controller.begin(envs)
    errors = [info["error_mm"][0]]
    for _ in range(12):
        observation, *_, info = envs.step(controller.act(observation))
        errors.append(info["error_mm"][0])
    return errors


@pytest.mark.parametrize(
    ("kind", "settings"), [(JacobianFeedback, {}), (PrivilegedFeedback, {"privileged": "observation"})]
)
def test_every_lane_is_driven_with_the_model_of_its_own_mechanism(kind, settings):
    driven = run_episodes(EnvConfig("rj_gym/ManyMechanisms-v0", settings=MANY), kind(), SEEDS).errors
    for errors, (mechanism, options) in zip(driven, singles(), strict=True):
        np.testing.assert_allclose(errors, single_errors(kind(), mechanism, options, **settings), atol=1e-4)


def test_a_controller_with_one_model_refuses_the_task_of_many():
    envs = gymnasium.make_vec("rj_gym/ManyMechanisms-v0", 2, "vector_entry_point", **MANY)
    for controller in (JacobianFeedback(), DoNothing()):
        with pytest.raises(InvalidInput, match="OwnModels") as refused:
            controller.begin(envs)
        assert "\n" not in str(refused.value)


def test_lanes_that_begin_with_another_design_get_another_copy():
    seen = []

    class Watching(Controller):
        def bind(self, task):
            super().bind(task)
            seen.append(task.mechanism.n_links)

        def act(self, observations):
            assert observations.shape[1] == len(self.task.entries())
            return np.zeros((len(observations), 2))

    from agents.controllers.own_models import OwnModels

    envs = gymnasium.make_vec("rj_gym/ManyMechanisms-v0", 3, "vector_entry_point", **MANY).unwrapped
    observation, _ = envs.reset(seed=0, options={"design": 3})
    controller = OwnModels(Watching(), envs)
    controller.begin(envs)
    assert len(seen) == 1
    mask = np.array([False, True, False])
    observation, _ = envs.reset(options={"design": 4, "reset_mask": mask})
    controller.reset(mask)
    assert len(seen) == 3 and controller.act(observation).shape == (3, 2)


def test_a_nominal_controller_computes_with_the_plain_chain_of_as_many_links():
    bound = []

    class Watching(Controller):
        def bind(self, task):
            super().bind(task)
            bound.append(self.task)

        def act(self, observations):
            return np.zeros((len(observations), 2))

    env = EnvConfig("rj_gym/ManyMechanisms-v0", settings=MANY)
    run_episodes(env, Nominal(Watching()), SEEDS)
    config = env.arguments()["config"]
    designs = [config.mechanisms.drawn[number] for number in range(*config.mechanisms.designs)]
    assert len({task.mechanism.n_links for task in bound}) > 1
    for task in bound:
        plain = config.mechanisms.drawn.reference(task.mechanism.n_links)
        assert mechanism_to_dict(task.mechanism) == mechanism_to_dict(plain)
        assert not any(mechanism_to_dict(design.mechanism) == mechanism_to_dict(plain) for design in designs)
        assert task.config.load == config.load and task.config.sensing == config.sensing


def test_floors_are_those_of_every_episodes_own_mechanism():
    env = EnvConfig("rj_gym/ManyMechanisms-v0", settings=MANY)
    floors = episode_floor(env, SEEDS, starts=4)
    assert floors.errors.shape == (4,) and floors.joint_angles.shape == (4, 4)
    errors = run_episodes(env, JacobianFeedback(), SEEDS).final_errors
    assert (floors.errors <= errors + 1e-6).all() and floors.errors.max() < 5.0
    assert episode_floor(env, SEEDS, [0, 12], starts=2).errors.shape == (4, 2)
