"""The tracking task as pure functions on batches: begin, advance, observe, reward, end.

Only `sample` touches random numbers, nothing touches Gymnasium. The scalar environment is a batch of one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.config import TrackingConfig
from rj_gym.tracking.observation import POSITION_BOUND, observation_entries, observation_vector
from rj_gym.tracking.sampling import (
    NOTHING_FIXED,
    Episodes,
    Fixed,
    draw_uniforms,
    sample_episodes,
    uniform_shapes,
)
from rj_gym.tracking.solve import Solved, force_table, solve_each
from rollingjoint.equilibrium import Status
from rollingjoint.mechanism_file import load_mechanism
from rollingjoint.rolling_chain import RollingChain
from rollingjoint.solve import solve_lengths_batch, solve_tensions_batch

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """Where B running episodes are.

    Args:
        step: steps taken, (B,).
        commands: unstretched tendon lengths that the motors believe they leave, (B, m) [mm].
        joint_angles: (B, n - 1) [rad]; the solver's next start.
        poses: link poses, (B, n, 3) [mm, rad].
        tensions: (B, m) [N].
        actions, previous_actions: the last two actions, within [-1, 1], (B, m).
        targets: where the tips should be now, (B, 2) [mm].
        forces: the loads that act now, (B, 2) [N].
        status: Status of the last solve, (B,).
        usable: whether that is a stable equilibrium, (B,).
    """

    step: NDArray[np.int64]
    commands: Array
    joint_angles: Array
    poses: Array
    tensions: Array
    actions: Array
    previous_actions: Array
    targets: Array
    forces: Array
    status: NDArray[np.int64]
    usable: NDArray[np.bool_]

    @property
    def tips(self) -> Array:
        """True tip positions, (B, 2) [mm]."""
        return self.poses[:, -1, :2]

    @cached_property
    def errors(self) -> Array:
        """Distances of the true tips from their targets, (B,) [mm]."""
        miss = self.tips - self.targets
        return np.hypot(miss[:, 0], miss[:, 1])


class TrackingTask:
    """The tracking task of one configuration; no method changes anything.

    Raises:
        ConfigError, MechanismError: a mechanism that cannot be loaded.
    """

    def __init__(self, config: TrackingConfig) -> None:
        self.config = config
        chosen = config.mechanism
        self.mechanism: RollingChain = load_mechanism(chosen) if isinstance(chosen, str) else chosen
        self.length = float(self.mechanism.length)
        self.neutral_lengths: Array = np.array(self.mechanism.neutral_lengths, dtype=float)
        self._bounds = {goal: self._entry_bounds(goal) for goal in (False, True)}

    def observation_bounds(self, goal: bool = False) -> tuple[Array, Array]:
        """Lowest and highest value of every observation entry, (entries,) each."""
        return self._bounds[goal]

    def _entry_bounds(self, goal: bool) -> tuple[Array, Array]:
        entries = observation_entries(self.config, self.mechanism, goal)
        return np.array([entry.low for entry in entries]), np.array([entry.high for entry in entries])

    def sample(self, rngs: Sequence[np.random.Generator], fixed: Fixed = NOTHING_FIXED) -> Episodes:
        """One episode per generator; each takes the same count of numbers from its own."""
        uniforms = draw_uniforms(rngs, uniform_shapes(self.config, self.mechanism))
        return sample_episodes(self.config, self.mechanism, uniforms, fixed)

    def begin(self, episodes: Episodes) -> State:
        """The state at time 0: tendons locked at the unloaded start tensions, then the load applied."""
        tensions = episodes.start_tensions
        unloaded = solve_each(
            episodes.mechanisms, lambda mechanism, rows: solve_tensions_batch(mechanism, tensions[rows], (), None)
        )
        commands = unloaded.lengths - tensions / episodes.stiffnesses
        still = np.zeros_like(tensions)
        start = State(
            np.full(len(tensions), -1),
            commands,
            unloaded.joint_angles,
            unloaded.poses,
            tensions,
            still,
            still,
            episodes.targets[:, 0],
            episodes.forces[:, 0],
            unloaded.status,
            Status.usable(unloaded.status),
        )
        return self._settle(episodes, start, commands, still)

    def advance(self, episodes: Episodes, state: State, actions: Array) -> State:
        """The state one step later: actions (B, m) pull tendons in, the load moves on, the mechanism settles.

        A lane without a usable equilibrium keeps its pose, tensions and commands, and says so in `status`.
        """
        actions = np.minimum(np.maximum(actions, -1.0), 1.0)
        commands = state.commands - self.config.action_scale_mm * actions
        return self._settle(episodes, state, commands, actions)

    def _settle(self, episodes: Episodes, state: State, commands: Array, actions: Array) -> State:
        """The state after `state`: the equilibrium under `commands` and the load of the next time.

        Where a tension is at a limit the motor holds or gives way and its command follows, l_cmd = l - tension / k,
        so that commands never wind up; elsewhere that is the command itself.
        """
        step, lanes = state.step + 1, np.arange(len(commands))
        forces = episodes.forces[lanes, step]
        loads = force_table(episodes.links, forces)
        actual = commands + episodes.actuator_offsets
        solved = solve_each(
            episodes.mechanisms,
            lambda mechanism, rows: solve_lengths_batch(
                mechanism, actual[rows], loads[rows], state.joint_angles[rows], self.config.tension_range
            ),
        )
        held = solved.lengths - solved.tensions / episodes.stiffnesses - episodes.actuator_offsets
        usable = Status.usable(solved.status)
        if not usable.all():
            solved, held = _last_good(usable, solved, held, state)
        return State(
            step,
            held,
            solved.joint_angles,
            solved.poses,
            solved.tensions,
            actions,
            state.actions,
            episodes.targets[lanes, step],
            forces,
            solved.status,
            usable,
        )

    def observe(self, episodes: Episodes, state: State, goal: bool = False) -> NDArray[np.float32]:
        """The observation within its bounds, (B, entries); `goal` leaves out target and tip error."""
        measured = state.poses[:, 1:]
        if episodes.noise is not None:
            measured = measured + episodes.noise[np.arange(len(state.step)), state.step]
        vector = observation_vector(
            self.config,
            self.length,
            measured,
            state.commands - self.neutral_lengths,
            state.tensions,
            None if goal else state.targets,
            state.forces,
            episodes.links,
        )
        low, high = self._bounds[goal]
        return np.minimum(np.maximum(vector, low), high).astype(np.float32)

    def reward_terms(self, state: State) -> dict[str, Array]:
        """The terms whose sum is the reward, (B,) each."""
        reward, m = self.config.reward, self.mechanism.n_tendons
        effort = np.square(state.tensions / self.config.tension_range[1]).sum(axis=1) / m
        change = np.square(state.actions - state.previous_actions).sum(axis=1) / m
        return {
            "tracking": -state.errors / reward.error_scale_mm,
            "effort": -reward.effort * effort,
            "smoothness": -reward.smoothness * change,
            "failure": np.where(state.usable, 0.0, -reward.failure_penalty),
        }

    def goals(self, positions: Array) -> NDArray[np.float32]:
        """Positions (..., 2) [mm] in units of the length, within the bounds of the goal spaces."""
        return np.clip(positions / self.length, -POSITION_BOUND, POSITION_BOUND).astype(np.float32)

    def goal_reward(self, achieved: ArrayLike, desired: ArrayLike) -> Array:
        """Reward of the Goal environment for goals (..., 2), (...)."""
        reward = self.config.reward
        difference = np.asarray(achieved, dtype=float) - np.asarray(desired, dtype=float)
        error = self.length * np.linalg.norm(difference, axis=-1)
        if reward.goal == "sparse":
            return -(error > reward.goal_tolerance_mm).astype(float)
        return -error / reward.error_scale_mm

    def end(self, state: State) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """(terminated, truncated), (B,) each: there is no usable equilibrium; the steps are used up."""
        return ~state.usable, state.step >= self.config.episode_steps


def _last_good(usable: NDArray[np.bool_], solved: Solved, held: Array, state: State) -> tuple[Solved, Array]:
    """Solution and commands with the lanes that are not usable taken from the state before; their status stays."""

    def chosen(new: Array, old: Array) -> Array:
        return np.where(usable.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    kept = Solved(
        chosen(solved.joint_angles, state.joint_angles),
        chosen(solved.poses, state.poses),
        chosen(solved.tensions, state.tensions),
        solved.lengths,
        solved.status,
    )
    return kept, chosen(held, state.commands)
