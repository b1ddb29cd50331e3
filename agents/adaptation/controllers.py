"""Controllers that drive robots: opponents and policies by name, policies of run folders, and one's own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from agents.adaptation.driving import WORLD
from agents.controllers.controller import Controller, load_controller
from agents.controllers.privileged_feedback import PrivilegedFeedback
from agents.controllers.tuned import tuned_controllers
from agents.policies.file import SUFFIX
from agents.policies.loading import list_policies, load_policy, shipped_policies
from agents.policies.shipped import ShippedPolicy, entry_names
from agents.policies.trained import load_driving
from agents.results.roster import is_privileged
from agents.runs.environment import EnvConfig
from agents.runs.folder import RunFolder
from rj_gym.registry import version_of
from rj_gym.tracking.config import TaskConfig
from rollingjoint.checks import suggestion
from rollingjoint.errors import ConfigError


@dataclass(frozen=True)
class InstrumentController:
    """A controller, and the settings of Instrument-v0 that change its observation."""

    controller: Controller
    settings: Mapping[str, Any] = field(default_factory=dict)


def instrument_controllers() -> dict[str, InstrumentController]:
    """All that ship for Instrument-v0, by name: tuned opponents, policies, and the privileged teacher, so marked."""
    controllers = {name: InstrumentController(controller) for name, controller in tuned_controllers(WORLD).items()}
    for policy in shipped_policies():
        if policy.env_id == WORLD:
            controllers[policy.name] = _policy(policy.name, policy)
    return controllers | {"privileged teacher": InstrumentController(PrivilegedFeedback())}


def instrument_controller(text: str) -> InstrumentController:
    """The controller named by the text: one of `instrument_controllers`, a policy file, a run folder, or FILE.py:NAME.

    Raises:
        ConfigError: no such controller, or a policy with another observation.
        PolicyError, RunFolderError: a damaged policy or run.
    """
    controllers = instrument_controllers()
    if text in controllers:
        return controllers[text]
    if text.endswith(SUFFIX) or text in list_policies():
        return _policy(text, load_policy(text, version=version_of(WORLD) if text in list_policies() else None))
    if Path(text).is_dir():
        run = RunFolder.open(Path(text))
        return InstrumentController(load_driving(run), _sight(text, run.config().env))
    if ":" in text:
        return InstrumentController(load_controller(text))
    allowed = f"one of {', '.join(controllers)}; a policy file, a run folder, FILE.py:NAME or MODULE:NAME"
    raise ConfigError("--controller", text, allowed, suggestion(text, list(controllers)))


def marked(name: str, entry: InstrumentController) -> str:
    """The name as tables show it."""
    return f"{name} (privileged)" if is_privileged(entry.controller) else name


def _policy(name: str, policy: ShippedPolicy) -> InstrumentController:
    return InstrumentController(policy, _sight(name, policy.environment))


def _sight(name: str, env: EnvConfig) -> dict[str, Any]:
    """The settings with which Instrument-v0 has the observation of that policy's own environment."""
    allowed = f"a policy that sees what {WORLD} shows"
    if not env.is_built_in_tracking:
        raise ConfigError("--controller", name, allowed, f"It was trained in {env.id}.")
    settings: TaskConfig = env.arguments()["config"]
    sight = {"observe_history": settings.observe_history}
    world: TaskConfig = EnvConfig(WORLD, settings=sight).arguments()["config"]
    if entry_names(settings, env.has_goals) != entry_names(world, goal=False):
        raise ConfigError("--controller", name, allowed, f"It was trained in {env.id}, with other observations.")
    return sight
