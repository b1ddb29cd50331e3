"""Running episodes of the planar task."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.columns import FORCE, LINK
from rj_gym.core.hardware_draws import new_hardware
from rj_gym.core.state import checked_array, checked_parts
from rj_gym.core.tracking_episodes import TrackingEpisodeBuffer
from rj_gym.planar import kernels
from rj_gym.planar.kernels import Course, RunningEpisodes
from rj_gym.planar.render import PlanarCanvas, PlanarScene
from rj_gym.planar.sampling import PlanarDraws
from rj_gym.planar.task import PlanarTask
from rj_gym.rendering.canvas import Screen
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.variations import ChainVariations
from rollingjoint.errors import InvalidInput
from rollingjoint.load import LOAD_COLUMNS

Array = NDArray[np.float64]

_LINK = LOAD_COLUMNS.index("link")


class PlanarEpisodeBuffer(TrackingEpisodeBuffer):
    """Room for B episodes of the planar task."""

    _compiled: ClassVar[Any] = kernels
    _FORCE: ClassVar[slice] = slice(kernels.FX, kernels.FY + 1)
    _LOAD_COLUMNS: ClassVar[tuple[str, ...]] = LOAD_COLUMNS
    task: PlanarTask
    mechanisms: tuple[RollingChain, ...]
    course: Course
    state: RunningEpisodes

    def scene(self, trail: Array, lane: int = 0) -> PlanarScene:
        """What a picture of one lane shows; trail (steps, 2) [mm] is where its tip has been."""
        readings = self.readings[lane]
        return PlanarScene(
            **self._shared_scene(trail, lane), force=readings[FORCE : FORCE + 2], link=int(readings[LINK])
        )

    def renderer(self) -> Screen[PlanarScene]:
        """A renderer of the scenes."""
        return Screen(PlanarCanvas(self.task.length))

    def sampled_info(self, draws: Any) -> dict[str, Any]:
        """What was drawn for the episodes that just began in the first lanes: fresh arrays (B, ...)."""
        return super().sampled_info(draws) | {"surface_offsets": draws.surface_offsets}

    def _varied(self, state: Any) -> ChainVariations:
        nominal = self.task.mechanism
        parts = checked_parts(state, ("offsets", "factors"), "state: mechanisms")
        like = {"offsets": (nominal.n_links, 2, 3), "factors": (nominal.n_tendons,)}
        for name, shape in like.items():
            values = checked_array(name, parts[name], np.empty((self.capacity, *shape)))
            if not np.isfinite(values).all() or (name == "factors" and values.min() <= 0.0):
                raise InvalidInput(f"state: {name}", values, "finite offsets and positive factors")
        return ChainVariations(nominal, **parts)

    def _make_room(self) -> None:
        capacity, config = self.capacity, self.task.config
        n, m, times = self.task.mechanism.n_links, self.task.mechanism.n_tendons, config.episode_steps + 1
        self.course = Course(
            np.zeros((capacity, times if config.target.process == "path" else 1, 2)),
            np.zeros((capacity, 1 if config.load.process == "constant" else times, 2)),
            np.zeros((capacity, m)),
            np.zeros((capacity, m)),
            np.zeros((capacity, self._noise_times(), n - 1, 3)),
        )
        truths = capacity if config.privileged != "off" else 0
        self.state = RunningEpisodes(
            np.zeros((capacity, n - 1)),
            np.zeros((capacity, n - 1, m)),
            np.zeros((capacity, n, 3)),
            np.zeros((capacity, 2, m)),
            np.zeros((capacity, self.task.columns)),
            np.zeros((truths, 2, m)),
        )
        self.hardware = new_hardware(config, capacity, m, 3 * (n - 1), self.task.dimension)
        self._loads = np.zeros((capacity, 1, len(LOAD_COLUMNS)))
        self._results = self._kernels.new_results(capacity, n - 1, m, contacts=truths > 0, responses=True)

    def _enter_loads(self, draws: PlanarDraws) -> None:
        count = len(draws)
        self._loads[:count, 0, _LINK] = draws.links
        self.state.responses[:count] = 0.0
        self.state.tip_rates[:count] = 0.0

    def _tips(self, count: int) -> Array:
        return self._results.poses[:count, -1, :2]

    def _pictured(self, poses: Array) -> Array:
        seen = poses[:, 1 + self._rules.first_seen :]
        columns = seen[..., 0], seen[..., 1], np.cos(seen[..., 2]), np.sin(seen[..., 2])
        return np.stack(columns, axis=-1).reshape(len(poses), -1)
