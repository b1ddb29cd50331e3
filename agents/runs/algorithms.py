"""Hyper-parameters a configuration may set, by algorithm: names of the Stable-Baselines3 constructors.

Arguments that are Python objects (buffers, noise) or that other keys of the configuration fill (env, policy,
seed, device, logging) are left out. Parameters that a configuration does not set keep Stable-Baselines3's default.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from agents.runs.schedules import check_boolean, check_integer, check_number, check_schedule, schedule
from rollingjoint.checked_yaml import mapping
from rollingjoint.errors import ConfigError

Check = Callable[[str, Any], None]


def _optional(check: Check) -> Check:
    return lambda what, value: None if value is None else check(what, value)


def _entropy(what: str, value: Any) -> None:
    """Accept a number, or "auto" or "auto_0.1" (learned, with that first value)."""
    if isinstance(value, str):
        first = value.removeprefix("auto").removeprefix("_") or "1"
        if not value.startswith("auto") or not first.replace(".", "", 1).isdigit() or float(first) == 0:
            raise ConfigError(what, value, "a number, auto, or auto_X with X > 0")
    else:
        check_number(what, value)


_count = partial(check_integer, low=1)
_from_zero = partial(check_number, low=0.0)
_share = partial(check_number, low=0.0, high=1.0)

_COMMON: dict[str, Check] = {
    "learning_rate": check_schedule,
    "batch_size": partial(check_integer, low=2),
    "gamma": _share,
    "use_sde": check_boolean,
    "sde_sample_freq": partial(check_integer, low=-1),
    "stats_window_size": _count,
}
_OFF_POLICY: dict[str, Check] = _COMMON | {
    "buffer_size": _count,
    "learning_starts": partial(check_integer, low=0),
    "train_freq": _count,
    "gradient_steps": partial(check_integer, low=-1),
    "n_steps": _count,
    "ent_coef": _entropy,
    "target_entropy": _entropy,
    "use_sde_at_warmup": check_boolean,
}
_TARGETS: dict[str, Check] = {"tau": _share, "target_update_interval": _count}
PARAMETERS: dict[str, dict[str, Check]] = {
    "ppo": _COMMON
    | {
        "n_steps": partial(check_integer, low=2),
        "n_epochs": _count,
        "gae_lambda": _share,
        "clip_range": check_schedule,
        "clip_range_vf": _optional(check_schedule),
        "normalize_advantage": check_boolean,
        "ent_coef": _from_zero,
        "vf_coef": _from_zero,
        "max_grad_norm": _from_zero,
        "target_kl": _optional(_from_zero),
    },
    "sac": _OFF_POLICY | _TARGETS,
    "tqc": _OFF_POLICY | _TARGETS | {"top_quantiles_to_drop_per_net": partial(check_integer, low=0, high=24)},
    "crossq": _OFF_POLICY | {"policy_delay": _count},
}
HINDSIGHT = ("sac", "tqc")
_SCHEDULES = ("learning_rate", "clip_range", "clip_range_vf")


def check_parameters(algorithm: str, parameters: Any, n_envs: int) -> None:
    """Accept hyper-parameters that Stable-Baselines3's `algorithm` takes, each in its range."""
    checks = PARAMETERS[algorithm]
    for name, value in mapping("parameters", parameters, list(checks)).items():
        checks[name](f"parameters.{name}", value)
    if algorithm == "ppo":
        _check_batches(parameters, n_envs)


def check_hindsight(algorithm: str, parameters: Mapping[str, Any], n_envs: int, episode_steps: int | None) -> None:
    """Accept what hindsight experience replay works with: whole episodes to relabel, single steps to learn from."""
    if algorithm not in HINDSIGHT:
        raise ConfigError("her", algorithm, f"one of the algorithms {', '.join(HINDSIGHT)}", "Else leave `her` out.")
    if parameters.get("n_steps", 1) > 1:
        raise ConfigError("parameters.n_steps", parameters["n_steps"], "1 with her", "It learns from single steps.")
    if episode_steps is not None:
        steps = n_envs * episode_steps
        _check_at_least(parameters, "learning_starts", 100, steps, "n_envs x episode_steps: one episode in every lane")
        _check_at_least(parameters, "buffer_size", 1_000_000, 2 * steps, "2 x n_envs x episode_steps: two episodes")


def _check_at_least(parameters: Mapping[str, Any], name: str, default: int, low: int, reason: str) -> None:
    if parameters.get(name, default) < low:
        allowed = f"an integer >= {low} ({reason})"
        raise ConfigError(f"parameters.{name}", parameters.get(name, default), allowed, "Hindsight needs them whole.")


def constructor_arguments(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments for the constructor: checked parameters with schedules built."""
    return {name: schedule(value) if name in _SCHEDULES else value for name, value in parameters.items()}


def _check_batches(parameters: Mapping[str, Any], n_envs: int) -> None:
    rollout = parameters.get("n_steps", 2048) * n_envs
    batch = parameters.get("batch_size", 64)
    if rollout % batch:
        allowed = f"a divisor of n_steps x n_envs = {rollout}"
        raise ConfigError("parameters.batch_size", batch, allowed, "Else the last batch of every epoch is cut short.")
