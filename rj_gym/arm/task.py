"""The arm's task: the tip of a hanging arm, under gravity of an unknown direction and an unknown payload."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.arm.columns import ANGLE, GRAVITY, ORIENTATION, OWN, TARGET_FRAME, TIP_FRAME
from rj_gym.arm.config import FlexibleArmConfig
from rj_gym.arm.kernels import FX, Rules
from rj_gym.arm.observation import arm_observation_entries, arm_privileged_entries
from rj_gym.arm.options import NOTHING_FIXED, ArmOptions, checked_options
from rj_gym.arm.sampling import ArmDraws, sample_episodes, uniform_blocks
from rj_gym.core import info
from rj_gym.core.draws import Block, Uniforms
from rj_gym.core.generators import Random
from rj_gym.core.observation import Entry, load_scale
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.load import SPATIAL_LOAD_COLUMNS

Array = NDArray[np.float64]

_PZ = SPATIAL_LOAD_COLUMNS.index("pz")
_COLUMNS = [0, 3, 6, 1, 4, 7]  # of a rotation matrix, row by row: its first two columns


class ArmTask(TrackingTask):
    """The arm's task."""

    dimension: ClassVar[int] = 3
    own_columns: ClassVar[int] = OWN
    config: FlexibleArmConfig
    mechanism: HingeChain

    def entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the observation vector; `goal` leaves target and errors out."""
        return arm_observation_entries(self.config, self.mechanism, goal)

    @property
    def pictured(self) -> list[str]:
        """The entries of the tip's position, none where it is not seen; those of its frame have no derivatives."""
        return [f"tip {axis}" for axis in "xyz"] if self.config.sensing.pose != "none" else []

    def privileged_entries(self) -> list[Entry]:
        """The entries of the privileged state, whether or not the settings show it."""
        return arm_privileged_entries(self.config, self.mechanism)

    def rules(self, goal: bool = False) -> Rules:
        """The parameters that all lanes share, as the kernels take them."""
        return Rules(
            angle_scale=self.config.reward.angle_scale_rad,
            payload_scale=load_scale(self.config),
            orientation=self.config.orientation,
            observe_tip=self.config.sees_all,
            **self._shared_rules(goal),
        )

    def sample(self, rngs: Random, fixed: ArmOptions | None = None) -> ArmDraws:
        """One episode per generator; each draws the same count of numbers."""
        uniforms = Uniforms(self._blocks, rngs)
        return sample_episodes(self.config, self.mechanism, uniforms, fixed or NOTHING_FIXED)

    def weight_rows(self, arm: HingeChain, gravity: Array) -> Array:
        """The load table of an arm's weights along a direction (3,), and a last row for the payload, (n, columns)."""
        rows = np.zeros((arm.n_links, len(SPATIAL_LOAD_COLUMNS)))
        rows[:, 0] = np.append(np.arange(1, arm.n_links), arm.n_links - 1)
        rows[:-1, _PZ] = [-0.5 * bead.spacing for bead in arm.beads]
        rows[:-1, FX : FX + 3] = np.array([bead.weight for bead in arm.beads])[:, None] * gravity
        return rows

    def load_tables(self, episodes: ArmDraws, step: int) -> Array:
        """The true loads of E episodes at a step: weights, and the payload in the last row, tables (E, n, columns)."""
        nowhere = np.zeros(3)
        tables = np.array([self.weight_rows(arm, nowhere) for arm in episodes.mechanisms])[episodes.designs]
        tables[:, :-1, FX : FX + 3] = episodes.weights[:, :, None] * episodes.gravity[:, None]
        tables[:, -1, FX : FX + 3] = episodes.forces[:, min(step, episodes.payloads.shape[1] - 1)]
        return tables

    def base_load_tables(self, episodes: ArmDraws) -> Array:
        """Loads of the unloaded states: weights alone, tables (E, n - 1, columns)."""
        return np.ascontiguousarray(self.load_tables(episodes, 0)[:, :-1])

    def checked_options(self, options: Mapping[str, Any] | None) -> ArmOptions:
        """What the options of a reset hold fixed; raises InvalidInput for those that cannot be used."""
        return checked_options(options, self.config, self.mechanism)

    def goal_bounds(self) -> Array:
        """Largest size of every entry of a goal: position and, with orientation, two columns of a rotation matrix."""
        return np.append(super().goal_bounds(), np.ones(6 if self.config.orientation else 0))

    def achieved_goals(self, readings: Array) -> NDArray[np.float32]:
        """Where tips are, from readings (..., columns)."""
        return self._with_frames(super().achieved_goals(readings), readings, TIP_FRAME)

    def desired_goals(self, readings: Array) -> NDArray[np.float32]:
        """Where they should be."""
        return self._with_frames(super().desired_goals(readings), readings, TARGET_FRAME)

    def goal_reward(self, achieved: ArrayLike, desired: ArrayLike) -> Array:
        """Reward of the Goal environment for goals (..., 3 or 9), (...)."""
        if not self.config.orientation:
            return super().goal_reward(achieved, desired)
        reached, wanted = np.asarray(achieved, dtype=float), np.asarray(desired, dtype=float)
        reward, angle = self.config.reward, goal_angles(reached[..., 3:], wanted[..., 3:])
        places = super().goal_reward(reached[..., :3], wanted[..., :3])
        if reward.goal == "sparse":
            return np.minimum(places, -(angle > reward.goal_tolerance_rad).astype(float))
        return places - angle / reward.angle_scale_rad

    def reached(self, readings: Array) -> Any:
        """Whether the target is reached within the tolerances, from readings (..., columns)."""
        near = super().reached(readings)
        if not self.config.orientation:
            return near
        return near & (self._own(readings)[..., ANGLE] <= self.config.reward.goal_tolerance_rad)

    def state_info(self, readings: Array) -> dict[str, Any]:
        """What info says in every step, arrays (B, ...): parts of the readings, and copies."""
        said = info.state_info(readings, self._places)
        return said | self._own_info(readings) | self.truth_info(readings) | self.friction_info(readings)

    def reward_info(self, readings: Array) -> dict[str, Array]:
        """The terms of the reward, (B,) each: parts of the readings."""
        terms = super().reward_info(readings)
        return terms | {"orientation": self._own(readings)[:, ORIENTATION]} if self.config.orientation else terms

    def single_info(self, readings: Array, numbers: list[float]) -> dict[str, Any]:
        """state_info and reward_info of one lane: Python numbers, `numbers`, and parts of its readings (columns,)."""
        own = self._columns
        said = info.single_info(readings, numbers, self._parts)
        if self.config.orientation:
            said["angle_error_rad"] = numbers[own + ANGLE]
            said["reward_terms"]["orientation"] = numbers[own + ORIENTATION]
        said["gravity"] = readings[own + GRAVITY : own + GRAVITY + 3]
        if len(numbers) == own + OWN:
            return said
        row = readings[None]
        return said | info.only_lane(self.truth_info(row) | self.friction_info(row))

    def _own_info(self, readings: Array) -> dict[str, Any]:
        own = self._own(readings)
        said = {"gravity": own[:, GRAVITY : GRAVITY + 3]}
        return said | {"angle_error_rad": own[:, ANGLE]} if self.config.orientation else said

    def _with_frames(self, places: NDArray[np.float32], readings: Array, frame: int) -> NDArray[np.float32]:
        if not self.config.orientation:
            return places
        columns = self._own(readings)[..., frame : frame + 9][..., _COLUMNS]
        return np.concatenate([places, np.clip(columns, -1.0, 1.0).astype(np.float32)], axis=-1)

    def _own(self, readings: Array) -> Array:
        """The columns that only this task has."""
        return readings[..., self._columns : self._columns + OWN]

    def _uniform_blocks(self) -> dict[str, Block]:
        return uniform_blocks(self.config, self.mechanism)


def goal_angles(first: Array, second: Array) -> Array:
    """Angles (...) between rotations given by their first two columns, (..., 6) [rad].

    From the distance of the matrices, |R1 - R2| = 2 sqrt(2) sin(angle / 2): exact to rounding near 0, too.
    """
    distance = np.linalg.norm(_whole(first) - _whole(second), axis=-1)
    return 2 * np.arcsin(np.minimum(distance / np.sqrt(8.0), 1.0))


def _whole(columns: Array) -> Array:
    """All three columns of rotation matrices, (..., 9)."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(columns, -1, 0).reshape(2, 3, *columns.shape[:-1])
    third = np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
    return np.concatenate([columns, third], axis=-1)
