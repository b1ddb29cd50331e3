"""The vector environment of the planar tracking tasks in torch tensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from torch import Tensor

from rj_gym.core.arguments import checked_autoreset_mode, checked_count, checked_mask, checked_seeds, used_alone
from rj_gym.core.columns import FORCE, REWARD, STATUS, STEP
from rj_gym.core.generators import Generators
from rj_gym.core.info import spread_info
from rj_gym.core.settings import made_settings
from rj_gym.core.spaces import observation_space
from rj_gym.registry import settings_of
from rj_gym.torch_env import infos as tensor_infos
from rj_gym.torch_env.host import HostEpisodes
from rj_gym.torch_env.lanes import Lanes
from rj_gym.torch_env.observing import Observer, goal_reward, goals, reached
from rj_gym.torch_env.refusals import check_mechanism, check_task, checked_device, checked_id
from rj_gym.torch_env.sensing import Sensors
from rj_gym.torch_env.stepping import Prepared, Solved, finished, prepare, revised
from rj_gym.tracking.kernels import REVISIONS
from rj_gym.tracking.planar import PlanarTask
from rollingjoint.differentiable import Settled, SideBySide
from rollingjoint.errors import InvalidInput

Mask = NDArray[np.bool_]
Rows = NDArray[np.int64]


class TorchTrackingEnv(VectorEnv[Any, Tensor, Tensor]):
    """A planar tracking task in `num_envs` lanes on a device; everything that goes in and comes out is a tensor there.

    Lanes, spaces, seeds, autoreset and numbers are as in the native vector environment,
    `gymnasium.make_vec(env_id, num_envs, "vector_entry_point")`. Observations are float32, rewards float64, ends
    booleans. Infos have the same names; a status is the number of a rollingjoint Status, `final_obs` one tensor with
    zeros where `_final_obs` is False, and `sampled` leaves out the mechanisms' names.

    The host draws and begins episodes, with all noise that they will meet, and then copies them to the device. A step
    waits for the device once: to hear whether all actions are finite, and whether lanes are left to the compiled solver
    on the host (`host_solves` counts them); with limits at motors also after every round in which pulls are revised.
    Friction in the chain and mechanisms with springs are refused, and so are settings and weights of the reward that
    are not known here. There are no pictures.

    Args:
        env_id: id of a planar tracking task.
        num_envs: number of lanes, 1 to 2^20.
        device: "cpu", "cuda" or a torch.device.
        config, overrides: as for the scalar environment.
        autoreset_mode: an AutoresetMode or its value ("NextStep", "SameStep", "Disabled").
    Raises:
        InvalidInput, ConfigError: arguments that cannot be used.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012 (Gymnasium's own form)

    def __init__(
        self,
        env_id: str = "rj_gym/RollingJoint-v0",
        num_envs: int = 1,
        device: torch.device | str = "cpu",
        config: Any = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **overrides: Any,
    ) -> None:
        self._calls: dict[str, Any] = {}
        row = checked_id(env_id)
        self.num_envs = checked_count(num_envs)
        self.device = checked_device(device)
        self.goal = bool(row.env_class.goal)
        self.task = PlanarTask(made_settings(settings_of(env_id), config, overrides, self.goal))
        check_task(self.task)
        self.autoreset_mode = checked_autoreset_mode(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self.single_action_space = spaces.Box(-1.0, 1.0, (self.task.action_size,), np.float32)
        self.single_observation_space = observation_space(self.task, self.goal)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.host_solves = 0
        self._rules = self.task.rules(self.goal)
        self._observer = Observer.of(self._rules, self.device)
        self._sensors = Sensors.of(self._rules, self.device)
        limits = self.task.config.tension_range
        self._limits = tuple(torch.tensor(limit, dtype=torch.float64, device=self.device) for limit in limits)
        self._generators = Generators([None] * self.num_envs)
        self._host = HostEpisodes(self.task, self.num_envs, self.goal)
        self._lanes: Lanes | None = None
        self._tables: tuple[Any, Rows] | None = None
        self._solver: Any = None
        self._nowhere = torch.zeros(self.num_envs, dtype=torch.bool, device=self.device)
        self._over: Mask = np.ones(self.num_envs, bool)
        self._steps = np.zeros(self.num_envs, np.int64)

    @property
    def config(self) -> Any:
        """The settings."""
        return self.task.config

    @used_alone
    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Observations and infos of new episodes.

        Args:
            seed: lane i gets seed + i; or one seed per lane, None leaving a lane's random numbers as they are.
            options: as for the native vector environment, "reset_mask" too; tensors or arrays.
        Raises:
            InvalidInput: seeds or options that cannot be used; the state is unchanged then.
        """
        arguments = _on_host(options or {})
        mask = checked_mask(arguments.pop("reset_mask", None), self.num_envs, self._lanes is not None)
        fixed = self.task.checked_options(arguments)
        if fixed.mechanism is not None:
            check_mechanism("options['mechanism']", fixed.mechanism, self.task)
        replaced = self._seed(checked_seeds(seed, self.num_envs), mask)
        try:
            sampled = self._begin(np.flatnonzero(mask), fixed)
        except InvalidInput:
            for lane, rng in replaced.items():
                self._generators[lane] = rng
            raise
        self._over = self._over & ~mask
        lanes = self._running()
        info = self._state_info(lanes.readings.clone()) | {"sampled": sampled}
        return self._observation(lanes), tensor_infos.masked_info(info, self._tensor(mask))

    @used_alone
    def step(self, actions: Any) -> tuple[Any, Tensor, Tensor, Tensor, dict[str, Any]]:
        """Observations, rewards, terminations, truncations and infos after one step of every lane.

        Args:
            actions: (num_envs, m), a tensor on any device or an array.
        Raises:
            InvalidInput: actions that are not of the space's shape or not finite; the state is unchanged then.
            gymnasium.error.ResetNeeded: before the first reset; with autoreset disabled, while an ended lane waits.
        """
        if self._lanes is None:
            raise ResetNeeded("No episode is running: call reset() before step().")
        fresh = np.flatnonzero(self._over)
        if len(fresh) and self.autoreset_mode is AutoresetMode.DISABLED:
            raise ResetNeeded(f"Lanes {fresh.tolist()} have ended: reset them with options={{'reset_mask': ...}}.")
        failed = self._advance(self._accepted(actions))
        sampled = self._begin(fresh) if len(fresh) else None
        failed[fresh] = False
        lanes, restarted = self._running(), self._tensor(self._over) if len(fresh) else self._nowhere
        readings = lanes.readings.clone()
        terminated = (readings[:, STATUS] > self.task.last_status) & ~restarted
        truncated = readings[:, STEP] >= self.config.episode_steps
        observations = self._observation(lanes)
        rewards, terms = self._rewards(observations, readings)
        rewards = torch.where(restarted, 0.0, rewards)
        infos = self._infos(readings, terms, sampled, restarted)
        self._over = failed | (self._steps >= self.config.episode_steps)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            observations, infos = self._restart(observations, infos)
        return observations, rewards, terminated, truncated, infos

    def compute_reward(self, achieved_goal: Tensor, desired_goal: Tensor, info: Any) -> Tensor:
        """Reward of the task with goals for goals (..., 2), (...); info is not used."""
        return goal_reward(self.task, achieved_goal, desired_goal)

    def _accepted(self, actions: Any) -> Tensor:
        """The actions as numbers of 64 bits on the device; InvalidInput unless their shape is right."""
        try:
            values = torch.as_tensor(actions, device=self.device).to(torch.float64)
        except (TypeError, ValueError, RuntimeError):
            raise InvalidInput("actions", actions, self._allowed) from None
        if values.shape != self.action_space.shape:
            raise InvalidInput("shape of actions", tuple(values.shape), self._allowed)
        return values

    @property
    def _allowed(self) -> str:
        return f"finite numbers in [-1, 1] of shape {self.action_space.shape}"

    def _advance(self, actions: Tensor) -> Mask:
        """One step of all lanes, those that have ended too; which lanes failed, (B,).

        Raises:
            InvalidInput: actions that are not finite; the state is unchanged then.
        """
        lanes = self._running()
        prepared = prepare(self._rules, lanes, actions)
        settled = self._settled(lanes, prepared)
        refused = ~torch.isfinite(actions).all()
        refused, some_left = torch.stack([refused, ~settled.arrived.all()]).cpu().numpy().tolist()  # the wait of a step
        if refused:
            raise InvalidInput("actions", actions, self._allowed)
        solved, failed = Solved.of(settled), np.zeros(self.num_envs, bool)
        if some_left:
            solved = self._solved_by_host(~settled.arrived, prepared, solved, failed)
        if self._rules.hardware.limits_pulls:
            prepared, solved = self._pulls_revised(lanes, prepared, solved, failed)
        self._lanes = self._sensors.measured(finished(self._rules, lanes, prepared, solved))
        self._steps += 1
        return failed

    def _settled(self, lanes: Lanes, prepared: Prepared, rows: Tensor | None = None) -> Settled:
        """The device's solve; of some lanes, (B,), alone."""
        low, high = self._limits
        limits = low, prepared.highest(high)
        return self._solver.solve(prepared.commands, lanes.stiffnesses, limits, prepared.loads, prepared.starts, rows)

    def _pulls_revised(self, lanes: Lanes, prepared: Prepared, solved: Solved, failed: Mask) -> tuple[Prepared, Solved]:
        """Inputs and solve in which pulls end as was solved for. The device is waited for in every round."""
        for _ in range(REVISIONS):
            prepared, wrong = revised(lanes, prepared, solved)
            if not wrong.any():
                break
            settled = self._settled(lanes, prepared, wrong)
            solved = solved.with_lanes(wrong, Solved.of(settled))
            solved = self._solved_by_host(wrong & ~settled.arrived, prepared, solved, failed)
        return prepared, solved

    def _solved_by_host(self, where: Tensor, prepared: Prepared, solved: Solved, failed: Mask) -> Solved:
        """The solve, in which these lanes, (B,), are left to the compiled solver; those that fail are noted.

        Ended lanes, which begin anew, are not solved.
        """
        rows = np.flatnonzero(where.cpu().numpy() & ~self._over)
        if not len(rows):
            return solved
        self.host_solves += len(rows)
        at = self._tensor(rows)
        highest = prepared.highest(self._limits[1]).expand_as(prepared.commands)
        inputs = prepared.commands, highest, prepared.readings[:, FORCE : FORCE + 2], prepared.starts
        solutions = self._host.solve_lanes(rows, *(values.index_select(0, at).cpu().numpy() for values in inputs))
        parts = {name: getattr(solved, name).index_copy(0, at, self._tensor(part)) for name, part in solutions.items()}
        failed[rows] = solutions["status"] > self.task.last_status
        return replace(solved, **parts)

    def _begin(self, rows: Rows, fixed: Any = None) -> dict[str, Any]:
        """New episodes in these lanes; their random draws, spread over all lanes."""
        is_all = len(rows) == self.num_envs
        sampled, _ = self._host.restart(rows, self._generators if is_all else self._generators.of(rows), fixed)
        self._lanes = Lanes.of(self._host, self.device) if self._lanes is None else self._lanes.begun(rows, self._host)
        self._steps[rows] = 0
        self._follow_tables(rows)
        return tensor_infos.on_device(spread_info(sampled, rows, self.num_envs), self.device)

    def _follow_tables(self, rows: Rows) -> None:
        """Have the device use the mechanisms of the host, which may be new in these lanes."""
        arrays, designs = self._host.tables
        tables = self._tables
        if tables is None or tables[0] is not arrays or not np.array_equal(tables[1], designs):
            self._solver = SideBySide(arrays, designs, self.device)
            self._tables = arrays, designs.copy()
        elif self._host.varies:
            self._solver.put(rows, arrays)

    def _restart(self, observations: Any, infos: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Same-step autoreset: ended lanes restart; their last observations and infos go to final_obs, final_info."""
        ended, some_go_on = self._tensor(self._over), not self._over.all()
        sampled = self._begin(np.flatnonzero(self._over))
        self._over = np.zeros(self.num_envs, bool)
        lanes = self._running()
        base = self._state_info(lanes.readings.clone())
        last = tensor_infos.unmasked_info(infos)
        restarted = tensor_infos.whole_info(base, torch.ones_like(ended))
        if some_go_on:
            stepped = {key: value for key, value in last.items() if key not in base}
            restarted |= tensor_infos.masked_info(stepped, ~ended)
        restarted |= tensor_infos.masked_info(
            {"sampled": sampled, "final_info": last, "final_obs": observations}, ended
        )
        return self._observation(lanes), restarted

    def _infos(self, readings: Tensor, terms: dict[str, Tensor], sampled: Any, fresh: Tensor) -> dict[str, Any]:
        """Infos of a step in which the lanes of a mask have begun."""
        everywhere: dict[str, Any] = self._state_info(readings)
        stepped: dict[str, Any] = {"reward_terms": terms}
        if self.goal:
            stepped["is_success"] = reached(self.task, readings)
        if sampled is None:
            return tensor_infos.whole_info(everywhere | stepped, ~fresh)
        infos = tensor_infos.whole_info(everywhere, torch.ones_like(fresh))
        infos |= tensor_infos.masked_info({"sampled": sampled}, fresh)
        return infos if self._over.all() else infos | tensor_infos.masked_info(stepped, ~fresh)

    def _state_info(self, readings: Tensor) -> dict[str, Any]:
        """The info of every step, parts of the readings, which are read-only from here on."""
        info = tensor_infos.state_info(readings, self.task.action_size)
        if self.config.privileged == "info":
            info["privileged"] = self._observer.privileged(readings)
        return info

    def _rewards(self, observations: Any, readings: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        """Rewards and their terms, (B,) each."""
        if not self.goal:
            return readings[:, REWARD].clone(), tensor_infos.reward_info(readings)
        rewards = goal_reward(self.task, observations["achieved_goal"], observations["desired_goal"])
        return rewards, {"tracking": rewards.clone()}

    def _observation(self, lanes: Lanes) -> Any:
        vectors = self._observer.vectors(lanes)
        if self.config.privileged == "observation":
            return {"observation": vectors, "privileged": self._observer.privileged(lanes.readings)}
        return {"observation": vectors, **goals(self.task, lanes.readings)} if self.goal else vectors

    def _seed(self, seeds: Sequence[int | None], mask: Mask) -> dict[int, np.random.Generator | None]:
        """New generators where lanes to reset have a seed, or none yet; those that they replace."""
        replaced = {}
        for lane, seed in enumerate(seeds):
            if mask[lane] and (seed is not None or self._generators[lane] is None):
                replaced[lane] = self._generators[lane]
                self._generators[lane] = seeding.np_random(seed)[0]
        return replaced

    def _running(self) -> Lanes:
        assert self._lanes is not None
        return self._lanes

    def _tensor(self, array: NDArray[Any]) -> Tensor:
        return torch.tensor(array, device=self.device)


def _on_host(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options with arrays in place of tensors."""
    return {
        key: _on_host(value) if isinstance(value, dict) else value.cpu().numpy() if isinstance(value, Tensor) else value
        for key, value in options.items()
    }
