"""A shipped policy: network, environment, recorded score; a Controller that runs with NumPy alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, cast

import gymnasium
import numpy as np

from agents.controllers.controller import Controller, Mask, plain
from agents.evaluation.rollout import run_episodes
from agents.evaluation.score import Score
from agents.policies.base import PolicyNetwork, memory_after_reset
from agents.policies.content import located, network_in
from agents.policies.errors import PolicyError
from agents.policies.file import content_hash, pack, unpack
from agents.policies.layers import Vectors
from agents.policies.recorded_score import RecordedScore
from agents.runs.checks import integer, prefixed
from agents.runs.environment import EnvConfig, plain_settings
from rj_gym import IDS, MANY_IDS, SURROUNDINGS_IDS, Terms
from rj_gym.registry import making_arguments, registered_settings, registration_of, row_of, task_of
from rj_gym.tracking.config import TaskConfig
from rj_gym.tracking.task import TrackingTask
from rollingjoint.chain.chain import AnyChain
from rollingjoint.checked_yaml import mapping, text
from rollingjoint.io.mechanism_file import mechanism_from_dict, mechanism_to_dict


@dataclass
class _EpisodeMemory:
    """The memory of a policy in the episodes that it drives, (B, memory); None before their first step."""

    values: Vectors | None = None


@dataclass(frozen=True, repr=False)
class ShippedPolicy(Controller):
    """A trained policy as it is shipped: network, normaliser, the environment that it was trained for, its score.

    Call it with an observation, or use it as a Controller. A policy with memory advances it at every call, so one
    object drives one batch of episodes at a time, and reset() begins the next.

    Args:
        name: of the policy.
        algorithm: of its training, "ppo" for example.
        network: its forward pass.
        env_id: id of its environment, one of rj_gym, or one that is registered elsewhere for a class of rj_gym.
        settings: of that environment, standalone.
        entries: of the observation vector, as entry_names gives them.
        training: plain values about its training: `config`, `steps`, `seed`, `versions`.
        score: on fixed episodes; None for a policy without a score.
    Raises:
        PolicyError: a network that does not fit the environment, or an environment that rj_gym does not have.
    """

    one_mechanism = False

    name: str
    algorithm: str
    network: PolicyNetwork
    env_id: str
    settings: TaskConfig
    entries: tuple[str, ...]
    training: Mapping[str, Any]
    score: RecordedScore | None = None

    def __post_init__(self) -> None:
        check_has_policies(self.env_id)
        task: Any = task_of(self.settings)
        inputs = {}
        if self.goal:
            size = len(task.goal_bounds())
            inputs = {"achieved_goal": size, "desired_goal": size, "observation": len(self.entries)}
        if dict(self.network.inputs) != inputs or (not inputs and self.network.entries != len(self.entries)):
            raise PolicyError("inputs", self.network.inputs or self.network.entries, f"{inputs or len(self.entries)}")
        if len(self.network.low) != task.action_size:
            raise PolicyError("actions", len(self.network.low), f"{task.action_size}, one per tendon, and of the feed")
        self._check_entries(self.settings)

    def __repr__(self) -> str:
        sizes = [len(self.entries), *self.network.hidden, len(self.network.low)]
        kind = f"{self.algorithm}, {self.network.KIND}, {' - '.join(map(str, sizes))}"
        return f"<ShippedPolicy {self.name!r} for {self.env_id}: {kind}>"

    @property
    def goal(self) -> bool:
        """Whether it is a policy of the goal environment."""
        return is_goal(self.env_id)

    @property
    def mechanism(self) -> AnyChain:
        """The mechanism that it was trained on."""
        return _mechanism_of(self.settings)

    @property
    def sha256(self) -> str:
        """The hash of all its content."""
        return content_hash(self.to_dict(), self.network.tensors())

    @property
    def environment(self) -> EnvConfig:
        """The environment that it was trained for, as agents.evaluation.rollout wants it."""
        return EnvConfig(self.env_id, settings={"mechanism": self.mechanism} | self._plain_settings())

    def make_env(self, **arguments: Any) -> gymnasium.Env[Any, Any]:
        """The environment that it was trained for; arguments, such as render_mode, go to gymnasium.make."""
        return gymnasium.make(self.env_id, **making_arguments(self.env_id, self.settings), **arguments)

    @property
    def has_memory(self) -> bool:
        """Whether an action depends on earlier observations since reset()."""
        return self.network.start(1) is not None

    def reset(self, episodes: int | Mask | None = None) -> None:
        """Begin an episode, or several side by side; without effect on a policy without memory.

        Args:
            episodes: number of observations of every call, or a mask (B,) of the episodes that begin; None leaves
                the number to the first call.
        Raises:
            PolicyError: a number of episodes below one.
        """
        if isinstance(episodes, np.ndarray):
            self._memory.values = memory_after_reset(self.network, self._memory.values, episodes)
            return
        with prefixed("", PolicyError):
            count = None if episodes is None else integer(1)("episodes", episodes)
        self._memory.values = None if count is None else self.network.start(count)

    def __call__(self, observation: Any) -> Vectors:
        """The action, (m,) or (B, m) in [-1, 1]; the same as the deterministic action of the trained policy.

        Args:
            observation: (entries,) or (B, entries), or such a dictionary of the goal environment.
        Raises:
            PolicyError: another shape, a missing key, numbers that are not finite, or, with memory, another number of
                observations than before: reset() begins other episodes.
        """
        action, self._memory.values = self.network.advance(observation, self._memory.values)
        return action

    @cached_property
    def _memory(self) -> _EpisodeMemory:
        return _EpisodeMemory()

    def bind(self, task: TrackingTask | None) -> None:
        """Take over a task; raises PolicyError unless observation, action and mechanism are as trained."""
        hint = "policy.make_env() makes the environment of this policy."
        if task is None and not self._tracks:
            return  # controllers are bound to tracking tasks alone
        if task is None:
            raise PolicyError("environment", "not one of rj_gym", self.env_id, hint)
        if _numbers_of(task.mechanism) != _numbers_of(self.mechanism):
            allowed = f"the mechanism that {self.name!r} was trained on, {self.mechanism.name!r}, in every number"
            raise PolicyError("mechanism", task.mechanism.name, allowed, hint)
        self._check_version(task.config)
        scale = task.config.action_scale_mm
        if scale != self.settings.action_scale_mm:
            raise PolicyError("action_scale_mm", scale, f"{self.settings.action_scale_mm:g}, as in training", hint)
        self._check_entries(replace(task.config, mechanism=task.mechanism), hint)

    def act(self, observations: Any) -> Vectors:
        """The actions, (B, m)."""
        return self(plain(observations))

    def score_on(self, seeds: range) -> Score:
        """Its score in the episodes with these seeds."""
        return Score.of(run_episodes(self.environment, self, seeds))

    def rescore(self) -> Score:
        """Its present score in the episodes of its recorded score; raises PolicyError if it has none."""
        if self.score is None:
            raise PolicyError("score", None, "a policy that was scored when it was exported")
        return self.score_on(self.score.seeds)

    def _plain_settings(self) -> dict[str, Any]:
        """The settings as plain values, without the terms that an id registered elsewhere brings."""
        brings_terms = self._tracks and self.env_id not in IDS
        return plain_settings(replace(self.settings, terms=Terms()) if brings_terms else self.settings)

    def _check_version(self, settings: TaskConfig) -> None:
        """Raise PolicyError for settings of another version of environments, with other motors and sensors."""
        row, version = registration_of(settings), self._version
        if row is not None and row.version != version:
            hint = f"Train one for {row.env_id} with rj train, or load one that ships for it."
            raise PolicyError("environment", row.env_id, f"{self.env_id}, as {self.name!r} was trained", hint)

    @property
    def _tracks(self) -> bool:
        row = row_of(self.env_id)
        return row is not None and row.tracks

    @property
    def _version(self) -> int:
        """The version of the class of its environment."""
        row = row_of(self.env_id)
        return 0 if row is None else row.version

    def _check_entries(self, settings: TaskConfig, hint: str = "") -> None:
        names = entry_names(settings, self.goal)
        if names != self.entries:
            differences = [name for name in names if name not in self.entries] or [f"{len(names)} entries"]
            allowed = f"the {len(self.entries)} observation entries that {self.name!r} was trained on"
            raise PolicyError("observation", ", ".join(differences), allowed, hint)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for JSON: all but the arrays."""
        settings = {"mechanism": mechanism_to_dict(self.mechanism)} | self._plain_settings()
        return {
            "name": self.name,
            "algorithm": self.algorithm,
            "network": self.network.description(),
            "environment": {"id": self.env_id, "settings": settings, "entries": list(self.entries)},
            "training": dict(self.training),
            "score": asdict(self.score) if self.score else None,
        }

    def to_bytes(self) -> bytes:
        """The policy file."""
        return pack(self.to_dict(), self.network.tensors())

    @classmethod
    def from_bytes(cls, data: bytes, source: str = "policy file") -> ShippedPolicy:
        """The policy in the bytes of a policy file.

        Args:
            source: name of the file in messages.
        Raises:
            PolicyError: no policy file, a damaged one, or one with parts that do not fit together.
        """
        content, tensors = unpack(data, source)
        if "steps" in content:
            hint = "Load it where it lies in its run folder, or write such a file by rj export-policy RUN --name NAME."
            raise PolicyError(source, "policy.safetensors of a run folder", "a file that rj export-policy wrote", hint)
        with located(source):
            return cls(**_fields(content, tensors))


def check_has_policies(env_id: str) -> None:
    """Raise PolicyError unless the id is one of rj_gym's tasks of tendons, or registered for the class of one."""
    row = row_of(env_id)
    if row is None or not row.has_policies:
        hint = "Import the module that registers it first, with an entry point in rj_gym."
        allowed = f"one of {', '.join([*IDS, *MANY_IDS, *SURROUNDINGS_IDS])}"
        raise PolicyError("environment", env_id, allowed, "" if row else hint)


def is_goal(env_id: str) -> bool:
    """Whether an id names an environment of rj_gym with goals."""
    row = row_of(env_id)
    return row is not None and row.has_goals


def standalone(settings: TaskConfig) -> TaskConfig:
    """The settings with the mechanism itself in place of its name or file."""
    return settings.updated({"mechanism": _mechanism_of(settings)})


def entry_names(settings: TaskConfig, goal: bool) -> tuple[str, ...]:
    """The entries of the observation vector, with their units: "target x [L]"."""
    return tuple(f"{entry.name} [{entry.unit}]" for entry in task_of(settings).entries(goal))


def _mechanism_of(settings: TaskConfig) -> AnyChain:
    mechanism: AnyChain = task_of(settings).mechanism
    return mechanism


def _fields(content: Mapping[str, Any], tensors: Mapping[str, Any]) -> dict[str, Any]:
    """The fields of the policy from the plain values and arrays of its file."""
    keys = ("name", "algorithm", "network", "environment", "training", "score")
    content = mapping("top level", content, keys, keys)
    environment = mapping("environment", content["environment"], *[("id", "settings", "entries")] * 2)
    training = mapping("training", content["training"], *[("config", "steps", "seed", "versions")] * 2)
    settings = dict(environment["settings"])
    mechanism = mechanism_from_dict(settings.pop("mechanism"))
    integer(0)("training.steps", training["steps"])
    env_id = text("environment.id", environment["id"])
    if env_id not in IDS:
        EnvConfig(env_id)  # refuses code that is not allowed
        check_has_policies(env_id)
    return {
        "name": text("name", content["name"]),
        "algorithm": text("algorithm", content["algorithm"]),
        "network": network_in(content["network"], tensors),
        "env_id": env_id,
        "settings": cast(TaskConfig, registered_settings(env_id, settings | {"mechanism": mechanism})),
        "entries": tuple(environment["entries"]),
        "training": training,
        "score": None if content["score"] is None else RecordedScore(**content["score"]),
    }


def _numbers_of(mechanism: AnyChain) -> dict[str, Any]:
    """A mechanism as plain values, without its name."""
    return mechanism_to_dict(mechanism) | {"name": ""}
