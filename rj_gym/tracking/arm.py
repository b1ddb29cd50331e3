"""The task of arms and other chains in space: random episodes, gravity and payload, target frames, pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rj_gym.core.columns import ANGLE, FORCE, GRAVITY, ORIENTATION, OWN, TARGET_FRAME, TIP_FRAME
from rj_gym.core.generators import Shapes, Uniforms
from rj_gym.rendering import Screen
from rj_gym.tracking.config import ArmRandomizationConfig, FlexibleArmConfig, PayloadConfig
from rj_gym.tracking.draws import (
    TrackingDraws,
    fading_walk,
    load_shapes,
    loads_over_time,
    normal,
    over_time,
    own_series,
    shared_draws,
    symmetric,
)
from rj_gym.tracking.options import TrackingOptions
from rj_gym.tracking.render import ArmCanvas, ArmScene
from rj_gym.tracking.task import TrackingTask
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.load import SPATIAL_LOAD_COLUMNS

Array = NDArray[np.float64]

_FX, _PX = SPATIAL_LOAD_COLUMNS.index("fx"), SPATIAL_LOAD_COLUMNS.index("px")
Arm = HingeChain | SpatialChain
_COLUMNS = [0, 3, 6, 1, 4, 7]  # of a rotation matrix, row by row: its first two columns


class ArmTask(TrackingTask):
    """The tip of a chain in space, such as a hanging arm, under gravity of unknown direction and an unknown payload."""

    dimension: ClassVar[int] = 3
    own_columns: ClassVar[int] = OWN
    LOAD_COLUMNS: ClassVar[tuple[str, ...]] = SPATIAL_LOAD_COLUMNS
    config: FlexibleArmConfig
    mechanism: Arm

    def __init__(self, config: FlexibleArmConfig) -> None:
        super().__init__(config)
        self._oriented, self._gravity = config.orientation, slice(self._columns + GRAVITY, self._columns + GRAVITY + 3)

    @property
    def pictured(self) -> list[str]:
        """The entries of the tip's position, none where it is not seen; entries of its frame have no derivatives."""
        return [f"tip {axis}" for axis in "xyz"] if self.config.sensing.pose != "none" else []

    def pictured_values(self, poses: Array) -> Array:
        """Of poses (B, n, 4, 4) where tips are, if they are seen, (B, 3 or 0) [mm]."""
        return poses[:, -1, : len(self.pictured), 3].copy()

    def tips(self, poses: Array) -> Array:
        """Positions and, with orientation, frames of the tips of poses (B, n, 4, 4), (B, 3 or 12) [mm, 1]."""
        position, rotation = poses[:, -1, :3, 3], poses[:, -1, :3, :3].reshape(len(poses), 9)
        return np.concatenate([position, rotation], axis=1) if self.config.orientation else position

    def draws(self, uniforms: Uniforms, fixed: TrackingOptions) -> ArmDraws:
        """Episodes from uniform numbers, with the fixed mechanism if there is one."""
        config = self.config
        mechanisms, designs = _mechanisms(config.randomization, self.mechanism, uniforms, fixed)
        return ArmDraws(
            **shared_draws(config, mechanisms, designs, uniforms, _pose_scale),
            **self.of_designs(mechanisms, designs),
            gravity=gravity_directions(config.gravity.tilt, uniforms["gravity"]),
            payloads=payloads(config.load, uniforms)
            if config.terms.loads is None
            else own_series(config, "loads", uniforms, mechanisms, ()),
        )

    def of_designs(self, mechanisms: Sequence[Arm], designs: NDArray[np.int64]) -> dict[str, Any]:
        """The fields of ArmDraws that lanes with these designs have from their arms."""
        names = {"hinge_stiffnesses": "joint_stiffnesses", "weights": "weights"}
        joints = {own: self.kept_rows.of(mechanisms, name).take(designs, axis=0) for own, name in names.items()}
        return super().of_designs(mechanisms, designs) | joints

    def own_uniforms(self) -> tuple[Shapes, Shapes]:
        """Shapes of the uniform numbers of an episode that loads, and mechanisms, are drawn from."""
        loads = load_shapes(self.config.load, self.config.episode_steps + 1, ("magnitude",), walk=())
        joints = (self.mechanism.n_joints,)
        return {"gravity": (2,)} | loads, {"hinge": joints, "weight": joints}

    def weight_rows(self, arm: Arm, gravity: Array) -> Array:
        """The load table of an arm's weights along a direction (3,), and a last row for the payload, (n, columns)."""
        rows = np.zeros((arm.n_links, len(SPATIAL_LOAD_COLUMNS)))
        rows[:, 0] = np.append(np.arange(1, arm.n_links), arm.n_links - 1)
        rows[:-1, _PX : _PX + 3] = arm.centres
        rows[:-1, _FX : _FX + 3] = arm.weights[:, None] * gravity
        return rows

    def load_tables(self, episodes: ArmDraws, step: int) -> Array:
        """The true loads of E episodes at a step: weights, and the payload in the last row, tables (E, n, columns)."""
        rows = self.kept_rows.of(episodes.mechanisms, "weight rows", partial(self.weight_rows, gravity=np.zeros(3)))
        tables = rows.take(episodes.designs, axis=0)
        tables[:, :-1, _FX : _FX + 3] = episodes.weights[:, :, None] * episodes.gravity[:, None]
        tables[:, -1, _FX : _FX + 3] = episodes.forces[:, min(step, episodes.payloads.shape[1] - 1)]
        return tables

    def base_load_tables(self, episodes: ArmDraws) -> Array:
        """Loads of the unloaded states: weights alone, tables (E, n - 1, columns)."""
        return np.ascontiguousarray(self.load_tables(episodes, 0)[:, :-1])

    def new_loads(self, lanes: int) -> Array:
        """Load tables of lanes before they begin, (lanes, n, columns)."""
        return np.repeat(self.weight_rows(self.mechanism, np.zeros(3))[None], lanes, axis=0)

    def new_results(self, lanes: int) -> Any:
        """Room for equilibria of lanes."""
        return self.mechanism.kernels.new_results(lanes, self.mechanism.n_joints, self.action_size)

    def measured_shapes(self) -> tuple[tuple[int, ...], int]:
        """Shape of the measurement errors of a step, and how many numbers a picture has."""
        return (6,), 12

    def begin_readings(self, readings: Array, draws: ArmDraws) -> None:
        """Fill the columns of readings (B, columns) that stay the same in an episode: the link, gravity."""
        super().begin_readings(readings, draws)
        self._own(readings)[:, GRAVITY : GRAVITY + 3] = draws.gravity

    def own_sampled(self, draws: ArmDraws, targets: Array) -> dict[str, Any]:
        """Entries of info["sampled"] that only arms have, fresh arrays (B, ...)."""
        times, count = self.config.episode_steps + 1, len(draws)
        sampled = {
            "payloads": over_time(draws.payloads[..., None], times)[..., 0],
            "gravity": draws.gravity.copy(),
            "hinge_stiffnesses": draws.hinge_stiffnesses,
            "weights": draws.weights,
        }
        if self.config.orientation:
            sampled["target_rotations"] = over_time(targets[..., 3:], times).reshape(count, times, 3, 3)
        return sampled

    def scene(self, trail: Array, readings: Array, shared: dict[str, Any]) -> ArmScene:
        """The scene of a lane's picture; `shared`: the fields of a TrackingScene."""
        columns = self._own(readings)
        return ArmScene(
            **shared,
            trail=trail,
            target_frame=columns[TARGET_FRAME:OWN].reshape(3, 3) if self.config.orientation else None,
            gravity=columns[GRAVITY : GRAVITY + 3],
            payload=readings[FORCE : FORCE + 3],
        )

    def renderer(self) -> Screen[ArmScene]:
        """A renderer of the scenes."""
        return Screen(ArmCanvas(self.mechanism))

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
        reached, goals = np.asarray(achieved, dtype=float), np.asarray(desired, dtype=float)
        reward, angle = self.config.reward, goal_angles(reached[..., 3:], goals[..., 3:])
        places = super().goal_reward(reached[..., :3], goals[..., :3])
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
        """Entries of info in every step, arrays (B, ...): parts of the readings, and copies."""
        columns = self._own(readings)
        angle = {"angle_error_rad": columns[:, ANGLE]} if self.config.orientation else {}
        return super().state_info(readings) | {"gravity": columns[:, GRAVITY : GRAVITY + 3]} | angle

    def reward_info(self, readings: Array) -> dict[str, Array]:
        """The terms of the reward, (B,) each: parts of the readings."""
        terms = super().reward_info(readings)
        return terms | {"orientation": self._own(readings)[:, ORIENTATION]} if self.config.orientation else terms

    def single_info(self, readings: Array, numbers: list[float]) -> dict[str, Any]:
        """state_info and reward_info of one lane: Python numbers, `numbers`, and parts of its readings (columns,)."""
        first, info = self._columns, TrackingTask.single_info(self, readings, numbers)  # faster than super()
        if self._oriented:
            info["angle_error_rad"] = numbers[first + ANGLE]
            info["reward_terms"]["orientation"] = numbers[first + ORIENTATION]
        info["gravity"] = readings[self._gravity]
        return info

    def _with_frames(self, places: NDArray[np.float32], readings: Array, frame: int) -> NDArray[np.float32]:
        if not self.config.orientation:
            return places
        columns = self._own(readings)[..., frame : frame + 9][..., _COLUMNS]
        return np.concatenate([places, np.clip(columns, -1.0, 1.0).astype(np.float32)], axis=-1)

    def _own(self, readings: Array) -> Array:
        """The columns that only this task has."""
        return readings[..., self._columns : self._columns + OWN]


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


@dataclass(kw_only=True)
class ArmDraws(TrackingDraws):
    """Random numbers of B episodes of the arm's task: see TrackingDraws, and the fields below.

    Targets are tip positions, with `orientation` followed by the rotation matrix row by row; noise is the error of the
    measured tip: position and rotation vector.

    Args:
        gravity: direction of gravity in the base frame, unit vectors (B, 3).
        payloads: weight at the tip, (B, 1 or T + 1) [N].
        hinge_stiffnesses: of the joints, (B, n - 1) [N·mm/rad]. weights: of the moving links, (B, n - 1) [N].
    """

    gravity: Array
    payloads: Array
    hinge_stiffnesses: Array
    weights: Array

    @property
    def links(self) -> NDArray[np.int64]:
        """Link that carries the payload, (B,): the tip."""
        return np.full(len(self), self.mechanisms[0].n_links - 1)

    @property
    def forces(self) -> Array:
        """The payload's force on the tip, (B, 1 or T + 1, 3) [N]."""
        return self.payloads[..., None] * self.gravity[:, None]

    @property
    def rest_causes(self) -> Array:
        """Quantities that determine the pose before the payload acts, besides the mechanism, (B, m + 3)."""
        return np.concatenate([self.start_tensions, self.gravity], axis=1)


def _pose_scale(mm: float, rad: float) -> list[float]:
    """The scale of a position and a rotation vector, (6,)."""
    return [mm] * 3 + [rad] * 3


def _mechanisms(
    randomization: ArmRandomizationConfig, nominal: Arm, uniforms: Uniforms, fixed: TrackingOptions
) -> tuple[tuple[Arm, ...], NDArray[np.int64]]:
    """Mechanisms and designs of ArmDraws."""
    lanes = len(uniforms)
    if fixed.mechanism is not None or not randomization.varies_mechanism:
        return (fixed.mechanism or nominal,), np.zeros(lanes, np.int64)
    spreads = randomization.hinge_stiffness_spread, randomization.stiffness_spread, randomization.weight_spread
    drawn = (uniforms[name] for name in ("hinge", "stiffness", "weight"))
    factors = [1 + symmetric(spread, numbers) for spread, numbers in zip(spreads, drawn, strict=True)]
    return tuple(nominal.scaled(*scales) for scales in zip(*factors, strict=True)), np.arange(lanes)


def gravity_directions(tilt: tuple[float, float], uniforms: Array) -> Array:
    """Unit vectors (B, 3), uniform over the directions with an angle to (0, 0, 1) in the range, from (B, 2)."""
    low, high = math.cos(tilt[1]), math.cos(tilt[0])
    z = low + (high - low) * uniforms[:, 0]
    across, azimuth = np.sqrt(np.maximum(1 - z * z, 0.0)), 2 * math.pi * uniforms[:, 1]
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), z], axis=-1)


def payloads(config: PayloadConfig, uniforms: Uniforms) -> Array:
    """Payloads at the tip, (B, 1 or T + 1) [N]."""
    low, high = config.magnitude
    if config.process == "ou":
        walk = fading_walk(normal(uniforms["walk"]), config.correlation_steps)
        return np.clip(0.5 * (low + high) + 0.25 * (high - low) * walk, low, high)
    return loads_over_time(config, low + (high - low) * uniforms["magnitude"], uniforms)
