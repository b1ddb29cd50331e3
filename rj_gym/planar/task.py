"""The planar tracking task: the tip of a rolling-contact chain under an unknown force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rj_gym.core import info
from rj_gym.core.draws import Block, Uniforms
from rj_gym.core.generators import Random
from rj_gym.core.observation import Entry, load_scale
from rj_gym.core.tracking_task import TrackingTask
from rj_gym.planar.config import TrackingConfig
from rj_gym.planar.kernels import Rules
from rj_gym.planar.observation import first_seen, observation_entries, pictured_entries, planar_privileged_entries
from rj_gym.planar.options import NOTHING_FIXED, PlanarOptions, checked_options
from rj_gym.planar.sampling import PlanarDraws, sample_episodes, uniform_blocks
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.load import LOAD_COLUMNS

Array = NDArray[np.float64]

_LINK, _FX = LOAD_COLUMNS.index("link"), LOAD_COLUMNS.index("fx")


class PlanarTask(TrackingTask):
    """The planar tracking task."""

    dimension: ClassVar[int] = 2
    config: TrackingConfig
    mechanism: RollingChain

    def entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the observation vector; `goal` leaves target and tip error out."""
        return observation_entries(self.config, self.mechanism, goal)

    @property
    def pictured(self) -> list[str]:
        """The entries of the observed links' poses."""
        return [entry.name for entry in pictured_entries(self.config, self.mechanism)]

    def privileged_entries(self) -> list[Entry]:
        """The entries of the privileged state, whether or not the settings show it."""
        return planar_privileged_entries(self.config, self.mechanism)

    def state_info(self, readings: Array) -> dict[str, Any]:
        """What info says in every step, arrays (B, ...): parts of the readings, and copies."""
        said = info.state_info(readings, self._places)
        return said | self.truth_info(readings) | self.friction_info(readings)

    def single_info(self, readings: Array, numbers: list[float]) -> dict[str, Any]:
        """state_info and reward_info of one lane: Python numbers, `numbers`, and parts of its readings (columns,)."""
        said = info.single_info(readings, numbers, self._parts)
        if len(numbers) == self._columns:
            return said
        row = readings[None]
        return said | info.only_lane(self.truth_info(row) | self.friction_info(row))

    def rules(self, goal: bool = False) -> Rules:
        """The parameters that all lanes share, as the kernels take them."""
        unseen = first_seen(self.config, self.mechanism)
        return Rules(force_scale=load_scale(self.config), first_seen=unseen, **self._shared_rules(goal))

    def sample(self, rngs: Random, fixed: PlanarOptions | None = None) -> PlanarDraws:
        """One episode per generator; each draws the same count of numbers."""
        uniforms = Uniforms(self._blocks, rngs)
        return sample_episodes(self.config, self.mechanism, uniforms, fixed or NOTHING_FIXED)

    def load_tables(self, episodes: PlanarDraws, step: int) -> Array:
        """The true loads of E episodes at a step, tables (E, 1, 11)."""
        tables = np.zeros((len(episodes), 1, len(LOAD_COLUMNS)))
        tables[:, 0, _LINK] = episodes.links
        tables[:, 0, _FX : _FX + 2] = episodes.forces[:, min(step, episodes.forces.shape[1] - 1)]
        return tables

    def base_load_tables(self, episodes: PlanarDraws) -> Array:
        """Loads of the unloaded states: none, tables (E, 0, 11)."""
        return np.zeros((len(episodes), 0, len(LOAD_COLUMNS)))

    def checked_options(self, options: Mapping[str, Any] | None) -> PlanarOptions:
        """What the options of a reset hold fixed; raises InvalidInput for those that cannot be used."""
        return checked_options(options, self.config, self.mechanism)

    def _uniform_blocks(self) -> dict[str, Block]:
        return uniform_blocks(self.config, self.mechanism)
