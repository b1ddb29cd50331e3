"""The opponents that can drive in an environment: its observation has every entry that they need."""

from __future__ import annotations

from agents.controllers.controller import Controller, env_for
from agents.controllers.privileged_feedback import PrivilegedFeedback
from agents.controllers.residual import controllers_in
from agents.controllers.tuned import WORLDS, world_of
from agents.results.environment import changed
from agents.results.record import World
from agents.runs.environment import EnvConfig, make_vector_env
from agents.runs.seeds import VALIDATION
from rollingjoint.errors import InvalidInput


def candidates(world: str) -> dict[str, Controller]:
    """New controllers to compare learned ones with in this world, by name; some cannot drive in it."""
    controllers = controllers_in(world)
    return controllers | {"privileged teacher": PrivilegedFeedback()} if world in WORLDS else controllers


def opponents(env: EnvConfig) -> tuple[dict[str, Controller], dict[str, str]]:
    """The controllers that need no training and can drive here, by name; and why others cannot."""
    able: dict[str, Controller] = {}
    impossible: dict[str, str] = {}
    for name, controller in candidates(world_of(env)).items():
        why = why_impossible(env_for(env, controller), controller)
        if why:
            impossible[name] = why
        else:
            able[name] = controller
    return able, impossible


def is_privileged(controller: object) -> bool:
    """True for a controller that sees the true state, which no robot shows: it has a true attribute `privileged`."""
    return bool(getattr(controller, "privileged", False))


def can_drive(env: EnvConfig, world: World, controller: Controller) -> bool:
    """Whether a controller that drives in an environment also does where its settings are changed."""
    return not (world.changes and why_impossible(changed(env, world.changes), controller))


def why_impossible(env: EnvConfig, controller: Controller) -> str:
    """The controller's complaint about the first observation of an episode, one line; empty if it acts."""
    envs = make_vector_env(env, 1)
    try:
        observation, _ = envs.reset(seed=[VALIDATION.start])  # type: ignore[arg-type]
        controller.begin(getattr(envs, "task", None), 1)
        controller.act(observation)
    except InvalidInput as error:
        return str(error)
    finally:
        envs.close()
    return ""
