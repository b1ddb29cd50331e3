"""Stable-Baselines3 on the native vector environments: a VecEnv, since SB3 does not take a Gymnasium VectorEnv."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper

from rj_gym.core.info import every_lane
from rollingjoint.errors import InvalidInput, naming_extras

with naming_extras():
    from stable_baselines3.common.vec_env.base_vec_env import VecEnv, VecEnvIndices, VecEnvObs, VecEnvStepReturn


class SB3VecEnv(VecEnv):
    """A native vector environment as Stable-Baselines3 wants it.

    Ended lanes restart in the same step; their info is the whole last info, with `terminal_observation` and
    `TimeLimit.truncated`. The other lanes' infos are empty. Attributes and methods come from the outermost wrapper
    that has them.

    Args:
        env: a native vector environment with same-step autoreset, or wrappers of Gymnasium around one. Gymnasium itself
            refuses its wrappers of observations there; wrappers of SB3, such as VecNormalize, go around this.
    Raises:
        InvalidInput: another autoreset mode.
    """

    def __init__(self, env: VectorEnv[Any, Any, Any]) -> None:
        mode = env.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise InvalidInput("autoreset_mode", mode, "AutoresetMode.SAME_STEP, which SB3 expects")
        self._layers = list(_layers(env))
        self.env = env
        self.render_mode = env.render_mode
        self._actions = np.zeros(env.action_space.shape or 0)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> VecEnvObs:
        """First observations of all lanes; seeds and options set by `seed` and `set_options` are used once."""
        options = {"lanes": self._options} if any(self._options) else None
        observations, infos = self.env.reset(seed=self._seeds, options=options)  # type: ignore[arg-type]
        self.reset_infos = every_lane(infos, range(self.num_envs))
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Remember the actions for step_wait."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Observations, rewards, dones and infos of all lanes."""
        observations, rewards, terminated, truncated, vector_infos = self.env.step(self._actions)
        dones = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            rows = np.flatnonzero(dones).tolist()
            cut = (truncated & ~terminated)[dones].tolist()
            finals = zip(rows, every_lane(vector_infos["final_info"], rows), cut, strict=True)
            for lane, info, was_cut in finals:
                info["terminal_observation"] = vector_infos["final_obs"][lane]
                info["TimeLimit.truncated"] = was_cut
                infos[lane] = info
        return observations, rewards.astype(np.float32), dones, infos

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Pictures of the lanes that the environment draws."""
        pictures: Any = self.env.render()
        return pictures or []

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the environment, once per lane."""
        return [getattr(self._having(attr_name), attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the environment, which all lanes share."""
        setattr(self._having(attr_name), attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Call a method of the environment once; its result for every lane (hindsight relabelling: compute_reward)."""
        result = getattr(self._having(method_name), method_name)(*args, **kwargs)
        return [result] * len(list(self._get_indices(indices)))

    def env_is_wrapped(self, wrapper_class: type, indices: VecEnvIndices = None) -> list[bool]:
        """Lanes are not wrapped."""
        return [False] * len(list(self._get_indices(indices)))

    def _having(self, name: str) -> Any:
        """The outermost layer with an attribute; the environment itself where none has it."""
        return next((layer for layer in self._layers if hasattr(layer, name)), self._layers[-1])


def _layers(env: VectorEnv[Any, Any, Any]) -> Iterator[VectorEnv[Any, Any, Any]]:
    """An environment's wrappers, the outermost first, and the environment within."""
    while isinstance(env, VectorWrapper):
        yield env
        env = env.env
    yield env


def make_sb3_env(env_id: str, num_envs: int, **arguments: Any) -> SB3VecEnv:
    """`num_envs` lanes of a registered environment for Stable-Baselines3; arguments as for gymnasium.make.

    Raises:
        InvalidInput, ConfigError: arguments that the environment refuses.
        gymnasium.error.Error: an id that is not registered.
    """
    import gymnasium

    env = gymnasium.make_vec(
        env_id, num_envs, "vector_entry_point", autoreset_mode=AutoresetMode.SAME_STEP, **arguments
    )
    return SB3VecEnv(env)
