"""How episodes of a tracking task begin: what was drawn is entered, targets are found, tendons take their tension."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.bound_episodes import BoundEpisodes
from rj_gym.core.columns import LINK, REWARDS, STEP, TENSIONS
from rj_gym.core.draws import over_time
from rj_gym.core.episodes import Observation
from rj_gym.core.friction_steps import distinct, enter_friction
from rj_gym.core.generators import Random
from rj_gym.core.hardware_draws import enter_hardware
from rollingjoint.chain.status import Status
from rollingjoint.compiled import MU

Array = NDArray[np.float64]


class StartingEpisodes(BoundEpisodes):
    """Episodes of a tracking task that begin in the first lanes, as many as there are generators."""

    def begin(self, rngs: Random, fixed: Any = None) -> tuple[Any, Observation]:
        """New episodes in the first lanes, one per generator, with their observations, (len(rngs), entries).

        Tendons are locked at the unloaded start tensions, then the load is applied.
        """
        count, m = len(rngs), self._actions.shape[1]
        draws = self.task.sample(rngs, fixed)
        self._enter(draws)
        angles, poses, lengths = self._rest(draws)
        readings = self.state.readings[:count]
        self.state.angles[:count] = angles
        self.state.poses[:count] = poses
        self.state.actions[:count] = self._actions[:count] = 0.0
        readings[:, STEP] = -1.0
        readings[:, TENSIONS : TENSIONS + m] = draws.start_tensions
        readings[:, TENSIONS + m : TENSIONS + 2 * m] = lengths - draws.start_tensions / draws.stiffnesses
        if draws.hardware is not None:
            enter_hardware(self.hardware, draws.hardware, readings[:, TENSIONS + m : TENSIONS + 2 * m])
        if self._friction is not None:
            self._begin_histories(draws, angles)
            if draws.hardware is not None:
                self.hardware.friction[:count] = self._friction.law.tendons[:count, :, MU]
        self._laws.low[:count], self._laws.high[:count] = self.task.config.tension_range
        observations = self._advance(count)
        readings[:, REWARDS] = 0.0
        return draws, observations

    def sampled_info(self, draws: Any) -> dict[str, Any]:
        """What was drawn for the episodes that just began in the first lanes: fresh arrays (B, ...)."""
        times, count = self.task.config.episode_steps + 1, len(draws)
        rubbing = {} if self._friction is None else {"friction_mu": self._friction.law.tendons[:count, :, MU].copy()}
        names = [mechanism.name for mechanism in distinct(draws.mechanisms)]
        each = names * count if len(names) == 1 else [names[design] for design in draws.designs]
        return {
            "mechanism": np.array(each, dtype=object),
            "targets": over_time(self.course.targets[:count, :, : self.task.dimension], times),
            "link": draws.links,
            "forces": over_time(self.course.forces[:count], times),
            "start_tensions": draws.start_tensions,
            "stiffnesses": draws.stiffnesses,
            "actuator_offsets": draws.actuator_offsets,
            **rubbing,
            **({} if draws.hardware is None else draws.hardware.sampled_info()),
        }

    @abstractmethod
    def _enter_loads(self, draws: Any) -> None:
        """Put into the first lanes what loads and a task's own numbers depend on."""

    def _noise_times(self) -> int:
        """Length of the series of measurement errors: 0 without any, 1 where they are constant."""
        config = self.task.config
        return config.episode_steps + 1 if config.randomization.sensor_noise else int(config.sensing.biased)

    def _enter(self, draws: Any) -> None:
        """Put what was drawn into the first lanes."""
        count = len(draws)
        if self.mechanisms != draws.mechanisms or len(self.mechanisms) > 1:
            self._use(draws.mechanisms, draws.designs)
        course = self.course
        self.state.readings[:count, LINK] = draws.links
        course.stiffnesses[:count] = draws.stiffnesses
        course.actuator_offsets[:count] = draws.actuator_offsets
        if draws.noise is not None:
            course.noise[:count] = draws.noise
        if self._friction is not None:
            enter_friction(self._friction, draws, self.task.config.friction)
        self._enter_loads(draws)
        targets = self._aims(draws) if draws.targets is None else draws.targets
        self._widen(targets, draws.forces)
        self.course.targets[:count] = targets
        self.course.forces[:count] = draws.forces

    def _begin_histories(self, draws: Any, angles: Array) -> None:
        """Histories of the first lanes: at these poses without friction nothing has slipped."""
        count = len(draws)
        self._laws.low[:count], self._starts[:count] = draws.start_tensions, angles
        self._rub.begin(0, count)

    def _aims(self, draws: Any) -> Array:
        """Targets, (count, K, d) [mm]: tips of equilibria under the target tensions.

        They are loaded as the episode ends, if the settings want it; where that takes a joint to the end of its
        surfaces, or no such equilibrium is found, unloaded.
        """
        tensions, forces = draws.target_tensions, draws.forces[:, -1]
        aims = np.empty((*tensions.shape[:2], self.course.targets.shape[2]))
        for k in range(tensions.shape[1]):
            if not self.task.config.target.loaded:
                self._solve_at(tensions[:, k])
                aims[:, k] = self._tips(len(aims))
                continue
            self._solve_at(tensions[:, k], forces)
            aims[:, k] = self._tips(len(aims))
            lost = self._results.status[: len(aims)] != int(Status.CONVERGED)
            if lost.any():
                self._solve_at(tensions[:, k])
                aims[lost, k] = self._tips(len(aims))[lost]
        return aims

    def _rest(self, draws: Any) -> tuple[Array, Array, Array]:
        """Joint angles, poses and tendon lengths at the start tensions, without load; one row if all are alike.

        Episodes that begin alike share one solve, which is kept.
        """
        tensions, causes = draws.start_tensions, draws.rest_causes
        alike = len(self.mechanisms) == 1 and (len(causes) == 1 or bool((causes == causes[0]).all()))
        kept = (self.mechanisms[0], causes[0].tobytes())
        if alike and self._kept_rest is not None and self._kept_rest[0] == kept:
            return self._kept_rest[1]
        rows = 1 if alike else len(tensions)
        self._solve_at(tensions[:rows])
        results = self._results
        rest = results.joint_angles[:rows].copy(), results.poses[:rows].copy(), results.lengths[:rows].copy()
        if alike:
            self._kept_rest = kept, rest
        return rest
