"""Learning algorithms: their classes, and the hyper-parameters that a configuration may set.

Hyper-parameters have the names of the Stable-Baselines3 constructors; one that is not set keeps the default there.
Left out are arguments that are Python objects (buffers, noise) or that other keys of the configuration fill (env,
policy, seed, device, logging).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from agents.runs.checks import Check, boolean, choice, integer, number, optional
from agents.runs.schedules import built, schedule
from rollingjoint.checked_yaml import mapping, text
from rollingjoint.errors import ConfigError

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm


def _entropy(what: str, value: Any) -> Any:
    """Accept a number, or "auto" or "auto_0.1" (learned, with that first value)."""
    if not isinstance(value, str):
        return number()(what, value)
    first = value.removeprefix("auto").removeprefix("_") or "1"
    if not value.startswith("auto") or not first.replace(".", "", 1).isdigit() or float(first) == 0:
        raise ConfigError(what, value, "a number, auto, or auto_X with X > 0")
    return value


_ENTROPY = Check(_entropy, "any number; `auto`; `auto_X` with X > 0")
_NAME = Check(text, "a name")
MOST_KEPT = 10_000_000
"""Steps that a rollout of all environments, or a replay buffer, may hold: some gigabytes."""
_MOST_LEARNT = 1_000_000  # steps in a batch, updates in a row
_kept, _count, _positive, _share = integer(1, MOST_KEPT), integer(1, _MOST_LEARNT), number(0.0), number(0.0, 1.0)

_COMMON: dict[str, Check] = {
    "learning_rate": schedule(),
    "batch_size": integer(2, _MOST_LEARNT),
    "gamma": _share,
    "use_sde": boolean,
    "sde_sample_freq": integer(-1, _MOST_LEARNT),
    "stats_window_size": _count,
}
_OFF_POLICY: dict[str, Check] = _COMMON | {
    "buffer_size": _kept,
    "learning_starts": integer(0, 10**12),
    "train_freq": _count,
    "gradient_steps": integer(-1, _MOST_LEARNT),
    "n_steps": integer(1, 1000),
    "ent_coef": _ENTROPY,
    "target_entropy": _ENTROPY,
    "use_sde_at_warmup": boolean,
}
_TARGETS: dict[str, Check] = {"tau": _share, "target_update_interval": _count}
_ON_POLICY: dict[str, Check] = _COMMON | {
    "n_steps": integer(2, MOST_KEPT),
    "n_epochs": _count,
    "gae_lambda": _share,
    "clip_range": schedule(),
    "clip_range_vf": optional(schedule()),
    "normalize_advantage": boolean,
    "ent_coef": _positive,
    "vf_coef": _positive,
    "max_grad_norm": _positive,
    "target_kl": optional(_positive),
}
_LESSONS: dict[str, Check] = {
    "learning_rate": schedule(),
    "optimizer": choice("adam", "muon"),
    "teacher": optional(_NAME),
    "taught": _share,
    "delta": number(1e-6),
    "gradient_steps": _count,
    "batch_size": _count,
    "kept_rollouts": _count,
    "max_grad_norm": _positive,
    "stats_window_size": _count,
}
PARAMETERS: dict[str, dict[str, Check]] = {
    "ppo": _ON_POLICY,
    "recurrent_ppo": _ON_POLICY,
    "sac": _OFF_POLICY | _TARGETS,
    "tqc": _OFF_POLICY | _TARGETS | {"top_quantiles_to_drop_per_net": integer(0, 24)},
    "crossq": _OFF_POLICY | {"policy_delay": _count},
    "apg": _LESSONS
    | {
        "lessons": _share,
        "lessons_rate": optional(schedule()),
        "settled_steps": _count,
        "whole_weight": _positive,
        "force_weight": _positive,
        "estimate_weight": _positive,
        "lane_gradient": optional(_positive),
        "short": _share,
        "short_steps": _count,
    },
    "distill": _LESSONS,
}
HINDSIGHT = ("sac", "tqc")
CONVOLVING = ("ppo", "sac", "tqc", "crossq")
"""Those whose networks may begin with a convolution over past readings."""
GAINS = ("ppo", "sac", "apg", "distill")
"""Those whose policies may have actions that vanish with the tip error."""
ON_POLICY = {"ppo": (2048, 64), "recurrent_ppo": (128, 128)}
"""Algorithms that learn from whole rollouts, with their default n_steps and batch_size."""
OWN = ("apg", "distill")
"""Those of agents.learners, which train on whole episodes of all lanes, with memory if wanted."""
_SCHEDULES = ("learning_rate", "lessons_rate", "clip_range", "clip_range_vf")


def algorithm_class(name: str) -> type[BaseAlgorithm]:
    """The class of an algorithm: in Stable-Baselines3, in its contributions, or our own in agents.learners."""
    if name == "apg":
        from agents.learners.apg import APG

        return APG
    if name == "distill":
        from agents.learners.distill import Distill

        return Distill
    if name in (contributions := {"tqc": "TQC", "crossq": "CrossQ", "recurrent_ppo": "RecurrentPPO"}):
        import sb3_contrib

        contributed: type[BaseAlgorithm] = getattr(sb3_contrib, contributions[name])
        return contributed
    import stable_baselines3

    classes: dict[str, type[BaseAlgorithm]] = {"ppo": stable_baselines3.PPO, "sac": stable_baselines3.SAC}
    return classes[name]


def checked_parameters(algorithm: str, parameters: Any, n_envs: int) -> dict[str, Any]:
    """The hyper-parameters in their plain form; raises ConfigError for one that `algorithm` does not take."""
    checks = PARAMETERS[algorithm]
    values = mapping("parameters", parameters, list(checks))
    checked = {name: checks[name](f"parameters.{name}", value) for name, value in values.items()}
    if algorithm in ON_POLICY:
        _check_batches(algorithm, checked, n_envs)
    return checked


def check_hindsight(algorithm: str, parameters: Mapping[str, Any], n_envs: int, episode_steps: int | None) -> None:
    """Raise ConfigError unless hindsight replay has whole episodes to relabel and learns from single steps."""
    if algorithm not in HINDSIGHT:
        raise ConfigError("her", algorithm, f"one of the algorithms {', '.join(HINDSIGHT)}", "Else leave `her` out.")
    if parameters.get("n_steps", 1) > 1:
        raise ConfigError("parameters.n_steps", parameters["n_steps"], "1 with her", "It learns from single steps.")
    if episode_steps is not None:
        steps = n_envs * episode_steps
        _check_at_least(parameters, "learning_starts", 100, steps, "n_envs x episode_steps: one episode of every copy")
        _check_at_least(parameters, "buffer_size", 1_000_000, 2 * steps, "2 x n_envs x episode_steps: two episodes")


def _check_at_least(parameters: Mapping[str, Any], name: str, default: int, low: int, reason: str) -> None:
    if parameters.get(name, default) < low:
        allowed = f"an integer >= {low} ({reason})"
        raise ConfigError(f"parameters.{name}", parameters.get(name, default), allowed, "Hindsight needs them whole.")


def constructor_arguments(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments for the constructor: checked parameters with schedules built."""
    return dict(parameters) | schedules(parameters)


def schedules(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters that may be schedules, built."""
    return {name: built(parameters[name]) for name in _SCHEDULES if name in parameters}


def _check_batches(algorithm: str, parameters: Mapping[str, Any], n_envs: int) -> None:
    steps, size = ON_POLICY[algorithm]
    rollout = parameters.get("n_steps", steps) * n_envs
    if rollout > MOST_KEPT:
        allowed = f"at most {MOST_KEPT:,} steps of a rollout: parameters.n_steps x env.n_envs"
        raise ConfigError("n_steps x n_envs", rollout, allowed)
    batch = parameters.get("batch_size", size)
    if rollout % batch:
        allowed = f"a divisor of n_steps x n_envs = {rollout}"
        raise ConfigError("parameters.batch_size", batch, allowed, "Else the last batch of every epoch is cut short.")
