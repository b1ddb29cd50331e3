"""Running episodes of the task of designing and then controlling, and their pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.columns import ERROR, STATUS, STEP
from rj_gym.core.episodes import NO_ROWS, Observation, Rows
from rj_gym.core.generators import Random
from rj_gym.design.codesign import TERMS, CoDesignDraws, CoDesignTask, DesignPose, blank_draws
from rj_gym.design.episodes import DrawnEpisodeBuffer
from rj_gym.design.render import CASE_COLORS, DesignCanvas
from rj_gym.rendering import INK, TARGET, Screen
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.status import Status

if TYPE_CHECKING:
    import pygame

Array = NDArray[np.float64]


class CoDesignEpisodeBuffer(DrawnEpisodeBuffer):
    """Room for B episodes of designing and then controlling."""

    task: CoDesignTask
    draws: CoDesignDraws

    def __init__(self, task: CoDesignTask, capacity: int, goal: bool = False) -> None:
        super().__init__(task, capacity, goal)
        self.draws = blank_draws(task.config, capacity)
        self.readings = np.zeros((capacity, task.columns["angles"].stop))
        self._bounds = task.observation_bounds()

    def advance(self, ended: Rows = NO_ROWS) -> Observation:
        """One step of the lanes that have not ended; fresh observations of all, (B, entries)."""
        rows = np.delete(np.arange(self.capacity), ended)
        designs = self.readings[rows, STEP] < self.task.config.design_steps
        self.readings[rows, STEP] += 1
        actions = np.clip(self._actions, -1.0, 1.0)
        if designs.any():
            self._design(rows[designs], actions[rows[designs]])
        if not designs.all():
            self._control(rows[~designs], actions[rows[~designs]])
        return self.observe()

    def _design(self, rows: Rows, actions: Array) -> None:
        """Change designs; one that can be built and rests in an equilibrium becomes the mechanism."""
        task, reward = self.task, self.task.config.reward
        readings = self.readings[rows]
        changes = task.config.design_scale * actions[:, : task.space.dimensions]
        designs = np.clip(task.part(readings, "design") + changes, -1.0, 1.0)
        margins = task.margins(designs)
        valid = (margins >= 0.0).all(-1)
        failed = np.zeros(len(rows), bool)
        self._put(rows, design=designs, margins=margins)
        self.readings[rows, STATUS] = Status.INVALID_INPUT
        if valid.any():
            pose = task.at_rest(designs[valid])
            failed[valid] = ~pose.ok
            self.readings[rows[valid], STATUS] = pose.status
            stands = rows[valid][pose.ok]
            self._put(stands, built=designs[valid][pose.ok], rest=pose.lengths[pose.ok])
            self._stand(stands, pose.rows(pose.ok))
        terms = np.zeros((len(rows), len(TERMS)))
        terms[:, 2] = -reward.violation * np.maximum(-margins, 0.0).sum(-1)
        terms[:, 3] = -reward.failure * failed
        self._finish(rows, terms + 0.0)

    def _control(self, rows: Rows, actions: Array) -> None:
        """Move the motors; a command without an equilibrium is not carried out."""
        task, config = self.task, self.task.config
        readings = self.readings[rows]
        moves = config.step_mm * actions[:, task.space.dimensions :]
        largest = config.command_range_mm
        command = np.clip(task.part(readings, "command") + moves, -largest, largest)
        lengths = task.part(readings, "rest") - command
        built, angles = task.part(readings, "built"), task.part(readings, "angles")
        pose = task.moved(built, lengths, self.draws.force[rows], angles)
        self.readings[rows, STATUS] = pose.status
        good = rows[pose.ok]
        self._put(good, command=command[pose.ok])
        self._stand(good, pose.rows(pose.ok))
        terms = np.zeros((len(rows), len(TERMS)))
        error = self._errors(rows)
        terms[:, 0] = -error / config.reward.error_scale_mm
        terms[:, 1] = -config.reward.effort * task.part(self.readings[rows], "tensions").mean(-1)
        terms[:, 3] = -config.reward.failure * ~pose.ok
        self._finish(rows, terms + 0.0)

    def restart(self, rows: Rows, rngs: Random, fixed: Any = None) -> tuple[dict[str, Any], Observation]:
        """New episodes in these lanes, one per generator. Where it raises, these episodes are unchanged."""
        draws = self.task.sample(rngs, fixed)
        self._draw(rows, draws)
        pose = self.task.at_rest(draws.design)
        self.readings[rows] = 0.0
        self.readings[rows, STATUS] = pose.status
        margins = self.task.margins(draws.design)
        self._put(rows, design=draws.design, built=draws.design, margins=margins, rest=pose.lengths)
        self._stand(rows, pose)
        self._finish(rows, np.zeros((len(rows), len(TERMS))))
        return draws._asdict(), self.observe()[rows]

    def observe(self) -> Observation:
        """The current observations of all lanes, (B, entries)."""
        return np.clip(self.task.observation(self.readings, self.draws), *self._bounds).astype(np.float32)

    def scene(self, trail: Array, lane: int = 0) -> CoDesignScene:
        """The scene of one lane; it has no trail."""
        task, row = self.task, self.readings[lane : lane + 1]
        mechanism = task.mechanism(task.part(row, "built")[0])
        return CoDesignScene(
            mechanism,
            mechanism.poses(task.part(row, "angles")[0]),
            self.draws.targets[lane],
            task.part(row, "target")[0],
            self.draws.force[lane],
            float(row[0, ERROR]),
            int(row[0, STEP]),
            task.config.design_steps,
        )

    def renderer(self) -> Screen[CoDesignScene]:
        """A renderer of the scenes."""
        return Screen(CoDesignCanvas(self.task.length))

    def _put(self, rows: Rows, **parts: Array) -> None:
        for name, values in parts.items():
            start, stop, _ = self.task.columns[name]
            self.readings[rows, start:stop] = values.reshape(len(rows), -1)

    def _stand(self, rows: Rows, pose: DesignPose) -> None:
        self._put(rows, angles=pose.angles, tip=pose.tip, tensions=pose.tensions)

    def _errors(self, rows: Rows) -> Array:
        """The errors of these lanes, which become readings with their targets, (len(rows),) [mm]."""
        target = self.task.target(self.readings[rows, STEP] - 1.0, self._drawn(rows))
        miss = np.linalg.norm(target - self.task.part(self.readings[rows], "tip"), axis=-1)
        error: Array = np.minimum(miss, self.task.config.largest_error_mm)
        self._put(rows, target=target, error=error)
        return error

    def _finish(self, rows: Rows, terms: Array) -> None:
        self._errors(rows)
        self._put(rows, terms=terms, reward=terms.sum(-1))

    def _allowed(self, shape: tuple[int, ...]) -> str:
        return f"finite numbers in [-1, 1] of shape {shape}, one per dimension of the design, then one per tendon"


@dataclass(frozen=True)
class CoDesignScene:
    """Contents of a picture.

    Args:
        mechanism: that is built now. poses: of its links, (n, 3), in space (n, 4, 4) [mm, rad].
        targets: all, (k, 2 or 3) [mm]. target: of now [mm]. force: at the tip [N]. error: [mm].
        step: taken. design_steps: of the design phase.
    """

    mechanism: AnyChain
    poses: Array
    targets: Array
    target: Array
    force: Array
    error: float
    step: int
    design_steps: int


class CoDesignCanvas(DesignCanvas):
    """The drawing of the task; the view is fixed, so pictures of a run line up."""

    def draw(self, scene: Any) -> pygame.Surface:
        """The scene at the picture's size."""
        in_control = scene.step >= scene.design_steps
        color = CASE_COLORS[int(in_control)]
        plane = scene.mechanism if isinstance(scene.mechanism, RollingChain) else None
        self.begin(plane.links[0] if plane else None)
        if plane is not None:
            self._links(plane, scene.poses, color)
        axis = self._origins(scene.poses)
        self._axis(axis, color)
        for target in self.seen(scene.targets):
            self.ring(target, 2.0, 0.7, TARGET)
        if in_control:
            self._force(axis[-1], self.seen(scene.force))
            self.aim(axis[-1], self.seen(scene.target))
        phase = f"control, step {scene.step - scene.design_steps}" if in_control else f"design, step {scene.step}"
        self.captions((phase, INK), (f"error {scene.error:.2f} mm", TARGET))
        return self.finished()
