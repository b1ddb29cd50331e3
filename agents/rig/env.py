"""RigEnv: a rig as the environment of a simulated task, so that a policy that was trained there runs unchanged."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from agents.rig.loop import Rig, RigState
from agents.rig.protocols import Array, RigError
from rj_gym.core.columns import STEP, TARGET, TENSIONS
from rj_gym.core.spaces import observation_space
from rj_gym.registry import task_of
from rj_gym.tracking.arrays import POSITION, TENSION
from rj_gym.tracking.config import TaskConfig
from rj_gym.tracking.episodes import TrackingEpisodeBuffer
from rj_gym.tracking.task import TrackingTask
from rollingjoint.errors import InvalidInput

MOST_LOOKS = 400  # at the rig, until every tendon has the tension of the start
_NEAR = 0.2  # N
_SOFTER = 0.5  # of the way that a tendon's stiffness asks for


class RigEnv(gymnasium.Env[Any, Any]):
    """A rig with the spaces and the observations of a tracking task in which the tip is not seen.

    Observations come from the compiled function of the simulation: readings of the rig are put where the simulation
    puts its measurements. There is no reward (0), and info has no truth: `motors` [mm], `tensions` [N], `interventions`
    of the guard, and, with a tracker, `tip` and `error_mm`.

    Args:
        settings: of the task, such as those of a policy. rig: connected and homed.
    Raises:
        InvalidInput: a task whose observation has poses, or with another number of tendons.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 (Gymnasium's own form)

    def __init__(self, settings: TaskConfig, rig: Rig) -> None:
        self.task = task_of_rigs(settings)
        self.config = self.task.config
        m = self.task.action_size
        if len(rig.guard.home) != m:
            raise InvalidInput("tendons of the rig", len(rig.guard.home), f"{m}, as of the task")
        self.rig = rig
        self.action_space = spaces.Box(-1.0, 1.0, (m,), np.float32)
        self.observation_space = observation_space(self.task, False)
        self._buffer = TrackingEpisodeBuffer(self.task, 1)
        self._episodes = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Bring every tendon to the tension of the start and begin an episode.

        Args:
            seed: of targets that are drawn. options: "target": (2,) or (T + 1, 2) [mm].
        Raises:
            InvalidInput: other options. RigError: tensions that do not settle.
        """
        if unknown := sorted((options or {}).keys() - {"target"}):
            raise InvalidInput("options", unknown, "'target': on a rig all else is as it is")
        super().reset(seed=seed)
        self._buffer.begin([self.np_random], self.task.checked_options(options))
        self._step = 0
        self._episodes += 1
        self.rig.begin(f"{self._episodes}")
        state = settle_tensions(self.rig, np.full(self.task.action_size, self.config.start_tension))
        self._buffer.state.actions[:] = 0.0
        return self.observed(state), self._info(state)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step of the rig; InvalidInput, after motors hold, for an action that is not finite."""
        given = np.asarray(action, float)
        if given.shape != self.action_space.shape or not np.isfinite(given).all():
            self.rig.motors.hold()
            raise InvalidInput("action", action, f"{self.task.action_size} finite numbers in [-1, 1]", "Motors hold.")
        clipped = np.clip(given, -1.0, 1.0)
        actions = self._buffer.state.actions[0]
        actions[1], actions[0] = actions[0].copy(), clipped
        self._step += 1
        goal = self.rig.goal - self.config.action_scale_mm * clipped
        state = self.rig.step(goal, action=clipped, target=self._target)
        return self.observed(state), 0.0, False, self._step >= self.config.episode_steps, self._info(state)

    def observed(self, state: RigState) -> Any:
        """The observation after these readings."""
        self.enter(state.motors, state.tensions)
        return self._buffer.observe()[0].copy()

    def enter(self, motors: Array, tensions: Array) -> None:
        """Put readings where the simulation has its measurements, and into the ring of past ones."""
        buffer, m = self._buffer, self.task.action_size
        readings, hardware, step = buffer.state.readings[0], buffer.hardware, self._step
        readings[STEP] = step
        d = self.task.dimension
        targets = buffer.course.targets[0]
        self._target = targets[min(step, len(targets) - 1), :d].copy()
        readings[TARGET : TARGET + d] = self._target
        shown = np.maximum(tensions, 0.0)
        readings[TENSIONS : TENSIONS + m], readings[TENSIONS + m : TENSIONS + 2 * m] = shown, motors
        hardware.measured[0, POSITION], hardware.measured[0, TENSION] = motors, shown
        past = hardware.past[0]
        if step > 0:
            past[(step - 1) % len(past), :m] = buffer.state.actions[0, 0]
        slots = slice(None) if step == 0 else step % len(past)
        past[slots, : 3 * m] = np.concatenate([np.zeros(m), motors, shown])

    def _info(self, state: RigState) -> dict[str, Any]:
        info: dict[str, Any] = {"motors": state.motors.copy(), "tensions": state.tensions.copy()}
        info["interventions"] = list(self.rig.guard.interventions)
        if state.tip is not None:
            info |= {"tip": state.tip.copy(), "error_mm": float(np.linalg.norm(state.tip - self._target))}
        return info

    def close(self) -> None:
        """Hold, and leave the rig."""
        self.rig.close()


def task_of_rigs(settings: TaskConfig) -> TrackingTask:
    """The task of these settings; raises InvalidInput for one whose observation has poses."""
    task: TrackingTask = task_of(settings)
    if task.config.sensing.pose != "none" or not task.config.is_instrumented:
        raise InvalidInput("settings", task.config.sensing.pose, 'a task with sensing.pose "none", as Instrument-v1')
    return task


def settle_tensions(rig: Rig, wanted: Array, near: float = _NEAR) -> RigState:
    """The state of a rig after all tendons were brought to measured tensions, (m,) [N], guarded, a little at a time.

    Raises:
        RigError: tensions that are still off after MOST_LOOKS steps.
    """
    stiffness = 4.0  # N/mm: of a tendon and its mechanism, roughly; the loop corrects it
    state = rig.state
    for _ in range(MOST_LOOKS):
        missing = wanted - state.tensions
        if (np.abs(missing) < near).all():
            return state
        state = rig.step(rig.goal - np.clip(_SOFTER * missing / stiffness, -0.3, 0.3))
    tensions = np.round(state.tensions, 2).tolist()
    raise RigError(
        f"tensions {tensions} N did not come to {np.asarray(wanted).tolist()} N: is a tendon loose or caught?"
    )
