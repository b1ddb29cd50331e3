"""The state of a model in training in plain values and arrays, and a freshly built model that goes on from it.

Only lanes of rj_gym have such a state; in others new episodes begin.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecFrameStack, VecMonitor, VecNormalize

from agents.learners.demonstrations import Demonstrations
from agents.policies.parameters import running_averages, set_running_averages
from agents.runs.state_file import StateError
from agents.training.residual import ResidualVecEnv
from rj_gym.core.vector import TaskVectorEnv

Plain = dict[str, Any]

_COUNTS = (
    "num_timesteps", "_total_timesteps", "_num_timesteps_at_start", "_episode_num", "_n_updates", "n_updates",
    "_current_progress_remaining",
)  # fmt: skip
_SEEN = ("_last_obs", "_last_original_obs", "_last_episode_starts", "ep_info_buffer", "ep_success_buffer")
_MONITORED = ("episode_count", "t_start", "episode_returns", "episode_lengths")
_NORMALISED = ("returns", "old_obs", "old_reward")


def state_of(model: BaseAlgorithm) -> Plain:
    """The state of a model at the start of a rollout, without its replay buffer."""
    memory = getattr(model, "_last_lstm_states", None)
    return {
        "parameters": model.get_parameters(),
        "tensors": {name: getattr(model, name) for name in model._get_torch_save_params()[1]},
        "counts": _held(model, _COUNTS),
        "seen": _held(model, _SEEN),
        "memory": None if memory is None else [tuple(part) for part in memory],
        "demonstrations": [dict(vars(demonstration)) for demonstration in getattr(model, "demonstrations", ())],
        "actions": model.action_space.np_random.bit_generator.state,
        "lanes": [_lanes_state(env) for env in _wrapped(model.env)],
    }


def restore(model: Any, state: Plain) -> bool:
    """Give a fresh model a state; whether its lanes go on where they were. Else new episodes have begun in them.

    Raises:
        StateError, InvalidInput, or whatever comes of values that do not fit: LookupError, TypeError, ValueError,
        RuntimeError, AttributeError.
    """
    model.set_parameters(state["parameters"], exact_match=True, device="cpu")
    for name, tensor in state["tensors"].items():
        with torch.no_grad():
            getattr(model, name).copy_(tensor)
    _hold(model, state["counts"], _COUNTS)
    _hold(model, state["seen"], _SEEN)
    if state["memory"] is not None:
        model._last_lstm_states = type(model._last_lstm_states)(*state["memory"])
    if state["demonstrations"]:
        model.demonstrations = [Demonstrations(**values) for values in state["demonstrations"]]
    model.action_space.np_random.bit_generator.state = state["actions"]
    lanes = list(zip(_wrapped(model.env), state["lanes"], strict=True))
    goes_on = all([_restore_lanes(env, saved) for env, saved in lanes])
    if not goes_on:
        _begin_anew(model)
    return goes_on


def buffer_state(buffer: Any) -> Plain:
    """The state of a replay buffer: its rows that are filled."""
    arrays = {name: _filled(array, buffer.pos, buffer.full) for name, array in _arrays(buffer).items()}
    return {"position": buffer.pos, "full": buffer.full, "arrays": arrays}


def restore_buffer(buffer: Any, state: Plain) -> None:
    """Give a fresh replay buffer a state; raises as `restore`."""
    position, full = int(state["position"]), bool(state["full"])
    for name, array in _arrays(buffer).items():
        rows, saved = _filled(array, position, full), state["arrays"][name]
        _check_like(name, saved, rows)
        rows[...] = saved
    buffer.pos, buffer.full = position, full


def _arrays(buffer: Any) -> dict[str, NDArray[Any]]:
    """The arrays of a replay buffer by name, for observations in parts too."""
    flat: dict[str, NDArray[Any]] = {}
    for name, value in vars(buffer).items():
        parts = value if isinstance(value, dict) else {"": value}
        arrays = {f"{name}.{key}": part for key, part in parts.items() if isinstance(part, np.ndarray)}
        flat |= {key: array for key, array in arrays.items() if array.dtype != object}  # infos, which are unused
    return flat


def _filled(array: NDArray[Any], position: int, full: bool) -> NDArray[Any]:
    """The rows that are filled, and the one to come, which may hold an observation; a vector has one entry per lane."""
    return array if full or array.ndim == 1 else array[: position + 1]


def _lanes_state(env: VecEnv) -> Any:
    """The state of one wrapper, or of the lanes inside; None for lanes that are not of rj_gym."""
    if isinstance(env, VecNormalize):
        return {"averages": running_averages(env), "held": _held(env, _NORMALISED)}
    if isinstance(env, VecMonitor):
        return _held(env, _MONITORED)
    if isinstance(env, VecFrameStack):
        return env.stacked_obs.stacked_obs
    if isinstance(env, ResidualVecEnv):
        return env.get_state()
    native = _native(env)
    return None if native is None else {"native": native.get_state() if native.has_begun else None}


def _restore_lanes(env: Any, state: Any) -> bool:
    """Give a wrapper, or the lanes inside, their state; False where it is None."""
    if isinstance(env, VecNormalize):
        set_running_averages(env, state["averages"])
        _hold(env, state["held"], _NORMALISED)
    elif isinstance(env, VecMonitor):
        _hold(env, state, _MONITORED)
    elif isinstance(env, VecFrameStack):
        _check_like("frames", state, env.stacked_obs.stacked_obs)
        env.stacked_obs.stacked_obs = state
    elif isinstance(env, ResidualVecEnv):
        env.set_state(state)
    elif state is None:
        return False
    elif state["native"] is not None:
        native = _native(env)
        if native is None:
            raise StateError("lanes", type(env).__name__, "a native vector environment of rj_gym")
        native.set_state(state["native"])
    return True


def _begin_anew(model: Any) -> None:
    """New episodes begin in all lanes, with random numbers that the run has not used."""
    model.env.seed(model.seed + model.num_timesteps)
    buffer: Any = getattr(model, "replay_buffer", None)
    if hasattr(buffer, "truncate_last_trajectory"):  # hindsight: the episode has ended
        buffer.truncate_last_trajectory()
    model._last_obs = model.env.reset()
    model._last_episode_starts = np.ones(model.n_envs, bool)
    if model._vec_normalize_env is not None:
        model._last_original_obs = model._vec_normalize_env.get_original_obs()


def _wrapped(env: VecEnv | None) -> Iterator[VecEnv]:
    """The wrappers of the lanes, outermost first, and the lanes inside."""
    while isinstance(env, VecEnvWrapper):
        yield env
        env = env.venv
    if env is not None:
        yield env


def _native(env: VecEnv) -> TaskVectorEnv | None:
    native = getattr(env, "env", None)
    return native if isinstance(native, TaskVectorEnv) else None


def _held(owner: Any, names: tuple[str, ...]) -> Plain:
    """The attributes with these names, where the owner has them."""
    return {name: getattr(owner, name) for name in names if hasattr(owner, name)}


def _hold(owner: Any, values: Mapping[str, Any], names: tuple[str, ...]) -> None:
    """Set attributes; raises StateError for a name that is not in `names`."""
    if not set(values) <= set(names):
        raise StateError("state", sorted(values), f"some of {', '.join(names)}")
    vars(owner).update(values)


def _check_like(name: str, saved: Any, like: NDArray[Any]) -> None:
    if not isinstance(saved, np.ndarray) or (saved.shape, saved.dtype) != (like.shape, like.dtype):
        raise StateError(name, np.shape(saved), f"an array {like.dtype.name} {like.shape}", "Another configuration?")
