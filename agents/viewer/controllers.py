"""Which controllers can drive in which tracking environments."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial

from agents.controllers import NEED_POSES, untuned_controllers
from agents.controllers.controller import Array, Controller
from agents.controllers.tuned import world_of
from agents.evaluation.rollout import run_episodes
from agents.policies.loading import load_policy, shipped_policies
from agents.policies.shipped import ShippedPolicy
from agents.results.environment import episodes_key
from agents.results.roster import candidates
from agents.runs.environment import EnvConfig
from agents.viewer.drive import Drive, Film, filmed
from rj_gym import IDS
from rj_gym.registry import version_of

POLICY = "policy "  # before the names of shipped policies


@dataclass(frozen=True)
class OfferedController:
    """A controller and its environment.

    Args:
        name: of the controller. env: the environment; controllers of one task may have different observations.
        make: a new controller.
    """

    name: str
    env: EnvConfig
    make: Callable[[], Controller]

    def drive(self, seed: int) -> Drive:
        """The episode of this seed, which begins; raises RollingJointError as Drive does."""
        return Drive(self.name, self.env, self.make(), seed)

    def film(self, seed: int) -> Film:
        """The whole episode of this seed; raises RollingJointError as Drive does."""
        return filmed(self.name, self.env, self.make(), seed)

    def errors(self, seeds: Sequence[int]) -> Array:
        """Mean tip error over the last 10 steps of every episode, (E,) [mm]; raises as Drive does."""
        controller = self.make()
        errors: Array = run_episodes(self.env, controller, seeds).last_errors.mean(axis=1)
        return errors


@cache
def worlds() -> Mapping[str, EnvConfig]:
    """The tracking environments by a title: the environments of rj_gym, and the ones of shipped policies."""
    environments = {name.removeprefix("rj_gym/"): EnvConfig(name) for name in IDS if not EnvConfig(name).has_goals}
    keys = {episodes_key(env) for env in environments.values()}
    for policy, key in _policies():
        if key not in keys:
            title = f"{policy.env_id.removeprefix('rj_gym/')}: {policy.name.replace('_', ' ')}"
            environments[title] = policy.environment
    return environments


def offered_controllers(env: EnvConfig) -> dict[str, OfferedController]:
    """The controllers that can drive in an environment, by name: shipped policies, then those without learning."""
    key = episodes_key(env)
    policies = [policy for policy, other in _policies() if other == key]
    untuned, sees_all = untuned_controllers(), env.arguments()["config"].sees_all
    kinds = () if sees_all else [type(untuned[name]) for name in NEED_POSES]  # others of these names estimate poses
    others = [name for name, controller in candidates(world_of(env)).items() if type(controller) not in kinds]
    learned = [
        OfferedController(
            f"{POLICY}{p.name}", p.environment, partial(load_policy, p.name, version=version_of(p.env_id))
        )
        for p in policies
    ]
    offered = [*learned, *(OfferedController(name, env, partial(_candidate, world_of(env), name)) for name in others)]
    return {controller.name: controller for controller in offered}


@cache
def _policies() -> list[tuple[ShippedPolicy, str]]:
    """The shipped policies, and the keys of their episodes."""
    return [(policy, episodes_key(policy.environment)) for policy in shipped_policies()]


def _candidate(world: str, name: str) -> Controller:
    return candidates(world)[name]
