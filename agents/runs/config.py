"""The configuration of a training run: frozen, checked once when built, read from YAML."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any

from agents.runs.additions import Addition, additions, are_scalar, check_wrappers, of_policy, tracker
from agents.runs.algorithms import (
    CONVOLVING,
    GAINS,
    ON_POLICY,
    OWN,
    PARAMETERS,
    check_hindsight,
    checked_parameters,
)
from agents.runs.checks import (
    Check,
    boolean,
    check_fields,
    choice,
    episode_count,
    integer,
    integers,
    number,
    optional,
    prefixed,
    seed_number,
    step_count,
)
from agents.runs.environment import EnvConfig
from agents.runs.ready_made import ENV, configuration_file
from rollingjoint.checked_yaml import mapping, parse_yaml, read_yaml
from rollingjoint.checked_yaml import text as checked_text
from rollingjoint.errors import ConfigError

PRIVILEGED = "privileged"  # the name of the true state in rj_gym
GAIN = "gain"  # the form of policies whose actions vanish with the tip error
_WIDTH = integer(1, 4096)
_WIDTHS = integers(1, 4096, most=16)


@dataclass(frozen=True)
class PolicyConfig:
    """The networks.

    Args:
        hidden: widths of the hidden layers; with a memory, of the layers behind it.
        value_hidden: the same of the value functions; null: as in the policy.
        activation: activation of the hidden layers.
        log_std_init: logarithm of the first standard deviation of the actions (`ppo`, `recurrent_ppo`).
        memory: width of the LSTM (`recurrent_ppo`), or of all layers (`apg`, `distill`); null: no memory, but `hidden`
            layers (`apg`, `distill`).
        form: plain, or `gain` (`ppo`, `sac`; `apg` and `distill` without memory): actions that vanish with the tip
            error, where that is observed.
        frames: number of observations, the newest ones, that the policy sees at once (`ppo`, `sac`, `tqc`, `crossq`).
        critic: input of the value function in training (`ppo`, `recurrent_ppo`): the observation, or the true state of
            the environment as well. The policy always sees the observation alone.
        convolution: width of a temporal convolution over past readings, before the hidden layers (`ppo`, `sac`,
            `tqc`, `crossq`); null: the hidden layers see all readings at once.
    """

    hidden: Annotated[Sequence[int], _WIDTHS] = (64, 64)
    value_hidden: Annotated[Sequence[int] | None, optional(_WIDTHS)] = None
    activation: Annotated[str, choice("tanh", "relu", "elu")] = "tanh"
    log_std_init: Annotated[float, number(-10.0, 3.0)] = 0.0
    memory: Annotated[int | None, optional(_WIDTH)] = 128
    form: Annotated[str, choice("plain", GAIN)] = "plain"
    frames: Annotated[int, integer(1, 1000)] = 1
    critic: Annotated[str, choice("observation", PRIVILEGED)] = "observation"
    convolution: Annotated[int | None, optional(_WIDTH)] = None

    def __post_init__(self) -> None:
        check_fields(self, "policy.")

    @property
    def critic_is_privileged(self) -> bool:
        """Whether the value function sees more than the policy."""
        return self.critic == PRIVILEGED


@dataclass(frozen=True)
class HerConfig:
    """Hindsight experience replay.

    Args:
        goals: relabelled transitions to every real one.
        strategy: the states of the episode that become goals.
    Source: Andrychowicz et al., Hindsight Experience Replay, 2017.
    """

    goals: Annotated[int, integer(1, 100)] = 4
    strategy: Annotated[str, choice("future", "final", "episode")] = "future"

    def __post_init__(self) -> None:
        check_fields(self, "her.")


@dataclass(frozen=True)
class NormaliseConfig:
    """Running normalisation by VecNormalize.

    Args:
        observation: running normalisation of observations.
        reward: running normalisation of rewards.
    """

    observation: Annotated[bool, boolean] = True
    reward: Annotated[bool, boolean] = True

    def __post_init__(self) -> None:
        check_fields(self, "normalise.")


@dataclass(frozen=True)
class EvaluationConfig:
    """Evaluation during training, always in the same episodes.

    Args:
        every: steps of all environments together between two evaluations.
        episodes: number of episodes.
        seed: seed of the first episode; the others have the next ones.
    """

    every: Annotated[int, step_count] = 50_000
    episodes: Annotated[int, episode_count] = 40
    seed: Annotated[int, seed_number] = 1_000_000

    def __post_init__(self) -> None:
        check_fields(self, "evaluation.")

    @property
    def seeds(self) -> range:
        """The seeds of its episodes."""
        return range(self.seed, self.seed + self.episodes)


@dataclass(frozen=True)
class TrainConfig:
    """Everything that a training run depends on.

    Args:
        algorithm: the learner.
        total_timesteps: steps of all environments together.
        seed: seed of the policy, of the training environments (`seed`, `seed + 1`, ...) and of torch.
        env: the environment.
        parameters: arguments of the learner by name; Stable-Baselines3's or our own defaults apply otherwise.
        policy: the networks.
        normalise: running normalisation.
        her: hindsight experience replay (`sac`, `tqc`); null: none.
        residual: name of the controller with actions to which the policy adds its own; null: the policy acts alone.
        wrappers: Gymnasium's wrappers of the environment, the first one innermost.
        callbacks: Stable-Baselines3's callbacks of the training.
        tracker: where the figures of logs/ go as well.
        start_from: folder of an earlier run with the best policy to start from (`apg`, `distill`), relative to the
            working directory; null: a fresh policy.
        evaluation: evaluation during training.
        checkpoint_every: steps of all environments together between two checkpoints.
        torch_threads: threads of torch; small networks are fastest with one.
    """

    algorithm: Annotated[str, choice(*PARAMETERS)] = "ppo"
    total_timesteps: Annotated[int, step_count] = 1_000_000
    seed: Annotated[int, seed_number] = 0
    env: EnvConfig = field(default_factory=EnvConfig)
    parameters: Mapping[str, Any] = field(default_factory=dict)
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    normalise: NormaliseConfig = field(default_factory=NormaliseConfig)
    her: HerConfig | None = None
    residual: Annotated[str | None, optional(Check(checked_text, "a name"))] = None
    wrappers: Annotated[Sequence[Addition], additions] = ()
    callbacks: Annotated[Sequence[Addition], additions] = ()
    tracker: Annotated[Addition | None, tracker] = None
    start_from: Annotated[str | None, optional(Check(checked_text, "a folder"))] = None
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    checkpoint_every: Annotated[int, step_count] = 250_000
    torch_threads: Annotated[int, integer(1, 256)] = 1

    def __post_init__(self) -> None:
        check_fields(self)
        parameters = checked_parameters(self.algorithm, self.parameters, self.env.n_envs)
        object.__setattr__(self, "parameters", parameters)
        if self.wrappers:
            self._check_wrappers()
        if self.her is not None:
            check_hindsight(self.algorithm, self.parameters, self.env.n_envs, self.env.episode_steps)
        if self.residual is not None:
            self._check_residual()
        if self.start_from is not None:
            self._check_start()
        if self.policy.critic_is_privileged:
            self._check_privileged_critic()
        if self.policy.convolution is not None:
            self._check_convolution()
        if self.policy.memory is None:
            self._check_without_memory()
        if self.policy.form == GAIN:
            self._check_gain()
        if self.policy.frames > 1:
            self._check_frames()

    def _check_wrappers(self) -> None:
        check_wrappers(self.wrappers)
        names = [name for each in self.wrappers for name in each]
        apart: dict[str, bool] = {
            f"algorithm: {self.algorithm}, which plays episodes of rj_gym's own": self.algorithm in OWN,
            "residual": self.residual is not None,
            "her, which relabels rewards of the environment": self.her is not None,
            f"policy.critic: {PRIVILEGED}": self.policy.critic_is_privileged,
            "policy.convolution": self.policy.convolution is not None,
            f"policy.form: {GAIN}": self.policy.form == GAIN,
        }
        for key, used in apart.items():
            if used:
                raise ConfigError("wrappers", names, f"[] with {key}")
        if not are_scalar(self.wrappers) and not self.env.is_native:
            raise ConfigError("wrappers", names, f"wrappers of scalar environments with env.id: {self.env.id}")

    def _check_start(self) -> None:
        if self.algorithm not in OWN:
            raise ConfigError("start_from", self.start_from, f"null, or a run folder with {' or '.join(OWN)}")

    def _check_residual(self) -> None:
        if self.algorithm == "distill" or self.parameters.get("lessons", 0.0) > 0.0:
            allowed = "null with distill, and with apg that has lessons"
            raise ConfigError("residual", self.residual, allowed, "A teacher shows whole actions.")
        if self.her is not None or not self.env.is_tracking:
            allowed = "null with her, and where the environment is not a tracking task of rj_gym"
            raise ConfigError("residual", self.residual, allowed, "There controllers have nothing to act on.")

    def _check_privileged_critic(self) -> None:
        what, critic = "policy.critic", self.policy.critic
        if self.algorithm not in ON_POLICY:
            hint = f"Critics of {self.algorithm} see the observation."
            raise ConfigError(what, critic, f"observation, or {PRIVILEGED} with {' or '.join(ON_POLICY)}", hint)
        if not self.env.is_tracking or self.env.has_goals:
            allowed = f"observation, or {PRIVILEGED} in a tracking environment without goals"
            raise ConfigError(what, critic, allowed, "Only there the true state can be read.")

    def _check_convolution(self) -> None:
        what, width = "policy.convolution", self.policy.convolution
        if self.algorithm not in CONVOLVING:
            raise ConfigError(what, width, f"null, or a width with {', '.join(CONVOLVING)}", "Others have a memory.")
        if not self.env.is_tracking or not self.env.observes_past:
            hint = "Set env.settings.observe_history."
            raise ConfigError(what, width, "null where no past readings are observed", hint)
        if self.residual is not None:
            raise ConfigError(what, width, "null with residual")

    def _check_without_memory(self) -> None:
        if self.algorithm == "recurrent_ppo":
            raise ConfigError("policy.memory", None, "a width with recurrent_ppo", "ppo has no memory.")
        if self.algorithm in OWN and not self.policy.hidden:
            raise ConfigError("policy.hidden", [], "at least one width without memory")
        weight = self.parameters.get("estimate_weight", 0.0)
        if weight > 0.0:
            raise ConfigError("parameters.estimate_weight", weight, "0 without memory", "There it has no readout.")

    def _check_gain(self) -> None:
        policy, what, allowed = self.policy, "policy.form", f"plain, or {GAIN} with {', '.join(GAINS)}"
        if self.algorithm not in GAINS:
            raise ConfigError(what, GAIN, allowed)
        if self.algorithm in OWN and policy.memory is not None:
            raise ConfigError("policy.memory", policy.memory, f"null with policy.form: {GAIN}")
        apart = {"policy.critic": policy.critic_is_privileged, "policy.convolution": policy.convolution is not None}
        apart |= {"policy.frames": policy.frames > 1, "use_sde": self.parameters.get("use_sde", False)}
        for key, used in apart.items():
            if used:
                raise ConfigError(what, GAIN, f"plain with {key}")
        if not policy.hidden:
            raise ConfigError("policy.hidden", [], f"at least one width with policy.form: {GAIN}")
        if not self.env.is_tracking:
            raise ConfigError(what, GAIN, "plain where the environment is not a tracking task of rj_gym")

    def _check_frames(self) -> None:
        what, frames = "policy.frames", self.policy.frames
        if self.algorithm not in CONVOLVING:
            raise ConfigError(what, frames, f"1, or more with {', '.join(CONVOLVING)}", "Others have a memory.")
        if self.policy.critic_is_privileged or self.env.has_goals:
            raise ConfigError(what, frames, "1 where observations are in parts")
        for key, used in {"residual": self.residual, "policy.convolution": self.policy.convolution}.items():
            if used is not None:
                raise ConfigError(what, frames, f"1 with {key}")

    @property
    def training_env(self) -> EnvConfig:
        """The environment as the learner steps it: `env`, with the privileged state if its critic sees that."""
        if not self.policy.critic_is_privileged:
            return self.env
        return replace(self.env, settings={**self.env.settings, PRIVILEGED: "observation"})

    @property
    def policy_wrappers(self) -> tuple[Addition, ...]:
        """The wrappers through which the policy acts, wherever it does."""
        return of_policy(self.wrappers)

    @property
    def why_scalar(self) -> str:
        """Why scalar environments are stepped in turn, one line; empty where they are not."""
        if not (are_scalar(self.wrappers) and self.env.is_native):
            return self.env.why_scalar
        return f"{self.env.id}: scalar environments are stepped in turn, for these wrappers are of scalar environments."

    @property
    def seeds(self) -> dict[str, range]:
        """The seeds that the run uses."""
        environments = range(self.seed, self.seed + self.env.n_envs)
        return {"training_environments": environments, "evaluation_during_training": self.evaluation.seeds}

    def use_of(self, seeds: range) -> str | None:
        """The purpose for which the run uses one of these seeds; None without one."""
        return next((use for use, used in self.seeds.items() if overlap(used, seeds)), None)

    def check_unused(self, seeds: range) -> None:
        """Raise ConfigError unless these are seeds, at least one, that training has not used."""
        episode_count("--episodes", len(seeds))
        seed_number("--seed", seeds.start)
        if self.use_of(seeds):
            hint = "The run's seeds.json lists them; give another --seed."
            raise ConfigError("--seed", seeds.start, "seeds that training has not used", hint)

    @classmethod
    def from_dict(cls, values: Any) -> TrainConfig:
        """The configuration in plain values; raises ConfigError naming the key."""
        values = dict(mapping("top level", values, [f.name for f in fields(cls)]))
        for name, section in SECTIONS.items():
            if name in values and not (name == "her" and values[name] is None):
                values[name] = section(**mapping(name, values[name], [f.name for f in fields(section)]))
        return cls(**values)

    def to_dict(self) -> dict[str, Any]:
        """Plain values, ready for YAML; from_dict gives the same configuration back."""
        values = asdict(self)
        for name in ("hidden", "value_hidden"):
            widths = values["policy"][name]
            values["policy"][name] = None if widths is None else list(widths)
        for name in ("wrappers", "callbacks"):
            values[name] = list(values[name])
        return values

    def content(self) -> dict[str, Any]:
        """Plain values of all that it means: defaults of the environment written in, a mechanism as its numbers."""
        values = self.to_dict()
        values["env"]["settings"] = self.env.complete_settings()
        return values


SECTIONS: dict[str, type] = {
    "env": EnvConfig,
    "policy": PolicyConfig,
    "normalise": NormaliseConfig,
    "her": HerConfig,
    "evaluation": EvaluationConfig,
}


def overlap(first: range, second: range) -> bool:
    """Whether two ranges of seeds have one in common."""
    return first.start < second.stop and second.start < first.stop


def load_config(path: str | Path, overrides: Sequence[str] = ()) -> TrainConfig:
    """The configuration in a YAML file, with "section.key=value" overrides on top.

    `env.file` names a YAML file of environment settings, relative to this file, or a ready-made one; `env.settings`
    goes on top of it.
    `start_from`, as run folders elsewhere, is relative to the working directory.
    Raises ConfigError that names the file, the key and the nearest valid key.
    """
    path = Path(path)
    values = filled(path)
    with prefixed(f"{path} with --set: " if overrides else f"{path}: "):
        values = apply_overrides(values, overrides)
        if isinstance(values.get("env"), dict):
            values["env"] = _resolve_env(values["env"], path.parent)
        if isinstance(values.get("start_from"), str):
            values["start_from"] = str(Path(values["start_from"]).resolve())
        return TrainConfig.from_dict(values)


def filled(path: Path) -> dict[str, Any]:
    """The keys and values of a YAML file; ConfigError where there are none."""
    values = _section(read_yaml(path), str(path))
    if not values:
        keys = ", ".join(key.name for key in fields(TrainConfig))
        raise ConfigError(str(path), None, f"keys and values, with the keys {keys}")
    return values


def apply_overrides(values: dict[str, Any], overrides: Sequence[str]) -> dict[str, Any]:
    """A copy of nested values with each "section.key=value" set; the value is read as YAML."""
    values = copy.deepcopy(values)
    for text in overrides:
        keys, equals, value = text.partition("=")
        *sections, key = keys.strip().split(".")
        if not equals or not key or not all(sections):
            raise ConfigError("--set", text, "section.key=value, for example parameters.gamma=0.9")
        place = values
        for section in sections:
            if place.get(section) is None:  # not there, or off
                place[section] = {}
            if not isinstance(place[section], dict):
                raise ConfigError("--set", text, f"a key of a section; '{section}' is a value")
            place = place[section]
        place[key] = parse_yaml(value, f"--set {text}")
    return values


def _resolve_env(env: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The env section with the settings of `env.file` read in and paths of mechanism files resolved."""
    env = dict(mapping("env", env, ["file", *(f.name for f in fields(EnvConfig))]))
    name = env.pop("file", None)
    settings = _with_mechanism(env.get("settings"), folder)
    if name is not None:
        if not isinstance(name, str):
            raise ConfigError("env.file", name, "the path of a YAML file, or the name of a ready-made one")
        settings = _merged(env_settings(configuration_file(ENV, name, folder)), settings)
    return env | {"settings": settings}


def env_settings(path: Path) -> dict[str, Any]:
    """The settings of an environment in a YAML file, paths of mechanism files resolved."""
    return _with_mechanism(_section(read_yaml(path), str(path)), path.parent)


def _section(values: object, where: str) -> dict[str, Any]:
    """A copy of a mapping read from YAML; an empty one for None."""
    if values is not None and not isinstance(values, dict):
        raise ConfigError(where, values, "a mapping of keys to values")
    return dict(values or {})


def _with_mechanism(settings: Any, folder: Path) -> dict[str, Any]:
    """The settings; a `mechanism` that names a file in `folder` gets its whole path."""
    settings = _section(settings, "env.settings")
    mechanism = settings.get("mechanism")
    if isinstance(mechanism, str) and (folder / mechanism).is_file():
        settings["mechanism"] = str((folder / mechanism).resolve())
    return settings


def _merged(below: dict[str, Any], above: dict[str, Any]) -> dict[str, Any]:
    values = dict(below)
    for key, value in above.items():
        nested = isinstance(value, dict) and isinstance(values.get(key), dict)
        values[key] = _merged(values[key], value) if nested else value
    return values
