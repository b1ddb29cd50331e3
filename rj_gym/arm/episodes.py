"""Running episodes of the arm's task."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rj_gym.arm import kernels
from rj_gym.arm.columns import GRAVITY, TARGET_FRAME
from rj_gym.arm.kernels import FX, Course, RunningEpisodes
from rj_gym.arm.render import ArmCanvas, ArmScene
from rj_gym.arm.sampling import ArmDraws
from rj_gym.arm.task import ArmTask
from rj_gym.core.columns import FORCE, TENSIONS
from rj_gym.core.draws import over_time
from rj_gym.core.hardware_draws import new_hardware
from rj_gym.core.kernels import AT_LIMIT
from rj_gym.core.tracking_episodes import TrackingEpisodeBuffer
from rj_gym.rendering.canvas import Screen
from rollingjoint.chain.batch import free_joints, stiffnesses
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.load import SPATIAL_LOAD_COLUMNS

Array = NDArray[np.float64]


class ArmEpisodeBuffer(TrackingEpisodeBuffer):
    """Room for B episodes of the arm's task."""

    _compiled: ClassVar[Any] = kernels
    _FORCE: ClassVar[slice] = slice(FX, FX + 3)
    _LOAD_COLUMNS: ClassVar[tuple[str, ...]] = SPATIAL_LOAD_COLUMNS
    task: ArmTask
    mechanisms: tuple[HingeChain, ...]
    course: Course
    state: RunningEpisodes

    def scene(self, trail: Array, lane: int = 0) -> ArmScene:
        """What a picture of one lane shows; trail (steps, 3) [mm] is where its tip has been."""
        readings, own = self.readings[lane], TENSIONS + 2 * self._actions.shape[1]
        frame = readings[own + TARGET_FRAME : own + TARGET_FRAME + 9].reshape(3, 3)
        return ArmScene(
            **self._shared_scene(trail, lane),
            target_frame=frame if self.task.config.orientation else None,
            gravity=readings[own + GRAVITY : own + GRAVITY + 3],
            payload=readings[FORCE : FORCE + 3],
        )

    def renderer(self) -> Screen[ArmScene]:
        """A renderer of the scenes."""
        return Screen(ArmCanvas(self.task.mechanism))

    def sampled_info(self, draws: Any) -> dict[str, Any]:
        """What was drawn for the episodes that just began in the first lanes: fresh arrays (B, ...)."""
        times, count = self.task.config.episode_steps + 1, len(draws)
        drawn = {
            "payloads": over_time(draws.payloads[..., None], times)[..., 0],
            "gravity": draws.gravity.copy(),
            "hinge_stiffnesses": draws.hinge_stiffnesses,
            "weights": draws.weights,
        }
        if self.task.config.orientation:
            rotations = over_time(self.course.targets[:count, :, 3:], times)
            drawn["target_rotations"] = rotations.reshape(count, times, 3, 3)
        return super().sampled_info(draws) | drawn

    def _rates(self, d: int) -> Array:
        """By the implicit function theorem: a linear system costs less than the solves of forward differences."""
        batches = self._batches()
        if len(batches) > 1:
            return super()._rates(d)
        self._solve_near(self._held())
        results, eye = self._results, np.eye(self._actions.shape[1])
        H, torques = stiffnesses(self._kernels, batches[0], self._friction)
        usable, free = results.status <= AT_LIMIT, free_joints(batches[0])
        free &= usable[:, None]
        H = np.where(free[:, :, None] & free[:, None], H, np.eye(H.shape[1]))
        try:
            angles = np.linalg.solve(H, np.where(free[..., None], torques * results.elastic[:, None], 0.0))
        except np.linalg.LinAlgError:  # one lane at the edge of buckling
            return super()._rates(d)
        lengths = np.swapaxes(results.rates, 1, 2) @ angles
        tensions = results.elastic[..., None] * (lengths - eye)
        tips = self._tip_rates(batches[0]) @ angles
        rates = np.concatenate([tips, tensions, lengths, tips[:, : len(self.task.pictured)]], axis=1)
        return np.where(usable[:, None, None], rates, 0.0)

    def _tip_rates(self, solved: Any) -> Array:
        """d tip / d joint angle, (B, 3, J) [mm/rad]."""
        poses, axes = solved.results.poses, solved.chain.axes[solved.designs]
        turning = (poses[:, :-1, :3, :3] @ axes[..., None])[..., 0]
        return np.swapaxes(np.cross(turning, poses[:, -1:, :3, 3] - poses[:, :-1, :3, 3]), 1, 2)

    def _make_room(self) -> None:
        capacity, config, arm = self.capacity, self.task.config, self.task.mechanism
        n, m, times = arm.n_links, arm.n_tendons, config.episode_steps + 1
        self.course = Course(
            np.zeros((capacity, times if config.target.process == "path" else 1, 12 if config.orientation else 3)),
            np.zeros((capacity, 1 if config.load.process == "constant" else times, 3)),
            np.zeros((capacity, m)),
            np.zeros((capacity, m)),
            np.zeros((capacity, self._noise_times(), 6)),
        )
        self.state = RunningEpisodes(
            np.zeros((capacity, n - 1)),
            np.zeros((capacity, n, 4, 4)),
            np.zeros((capacity, 2, m)),
            np.zeros((capacity, self.task.columns)),
        )
        self.hardware = new_hardware(config, capacity, m, 12, self.task.dimension)
        self._loads = np.repeat(self.task.weight_rows(arm, np.zeros(3))[None], capacity, axis=0)
        self._results = self._kernels.new_results(capacity, n - 1, m)

    def _enter_loads(self, draws: ArmDraws) -> None:
        count, own = len(draws), TENSIONS + 2 * self._actions.shape[1]
        self.state.readings[:count, own + GRAVITY : own + GRAVITY + 3] = draws.gravity
        self._loads[:count] = self.task.load_tables(draws, 0)

    def _tips(self, count: int) -> Array:
        tips = self._results.poses[:count, -1]
        position, rotation = tips[:, :3, 3], tips[:, :3, :3].reshape(count, 9)
        return np.concatenate([position, rotation], axis=1) if self.task.config.orientation else position

    def _pictured(self, poses: Array) -> Array:
        return poses[:, -1, : len(self.task.pictured), 3].copy()
