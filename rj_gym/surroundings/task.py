"""The tasks among walls: a step of many instruments, what it is worth, and whether it is a success."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.columns import ERROR, STATUS
from rj_gym.core.generators import Random, blocks_of
from rj_gym.core.info import STATUS_NAMES
from rj_gym.core.task import Entry, Task
from rj_gym.surroundings.config import HiddenWallConfig, LumenConfig, ObstaclesConfig, SurroundingsConfig
from rj_gym.surroundings.drawing import lumen_scene, scenes_among_discs, scenes_at_a_wall
from rj_gym.surroundings.observation import noisy_entries, surroundings_observation_entries
from rj_gym.surroundings.options import MOST_PIECES, lumen_options, obstacles_options, wall_options
from rj_gym.surroundings.scenes import SPACING, DrawnScene, Scenes, along, padded, places
from rollingjoint import Disc, HalfPlane, Lumen, Sleeve, Surroundings, solve_lengths_batch
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.solution import Solution
from rollingjoint.io.mechanism_file import load_mechanism
from rollingjoint.statics.sensitivity import dposes_dbase, dposes_dlengths
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]


class Response(NamedTuple):
    """The state of B lanes among walls and how it answers actions, of a action entries; fresh arrays.

    Poses and the target are in the frame of the base at the start [mm, rad]. With friction, rates hold for steps in
    which contacts that stick go on sticking, and the others sliding. A tendon at a limit has rates of 0.
    """

    poses: Array  # (B, n, 3)
    scenes: Scenes  # with the targets, (B, 2), and the walls
    commands: Array  # (B, m) mm
    feed: Array  # (B,) mm
    wall_force: Array  # largest normal force of any contact, (B,) N
    pose_rates: Array  # d poses / d action, (B, n, 3, a)
    free_tip_rates: Array  # d tip / d action without the walls at this pose and these tensions, (B, 2, a)
    solution: Any  # the equilibria, poses in the frame of the base; its arrays are read-only

    @property
    def tip(self) -> Array:
        """Where the tip is, (B, 2) [mm]."""
        return self.poses[:, -1, :2]

    @property
    def target(self) -> Array:
        """Where the tip should be, (B, 2) [mm]."""
        return self.scenes.target

    @property
    def tip_rates(self) -> Array:
        """d tip / d action, (B, 2, a)."""
        return self.pose_rates[:, -1, :2]

    def with_nose(self, nose: Array) -> tuple[Array, Array]:
        """Origins of the links, and a body point of the last one, (B, n + 1, 2), and their rates, (B, n + 1, 2, a)."""
        cos, sin = np.cos(self.poses[:, -1, 2]), np.sin(self.poses[:, -1, 2])
        arm = np.stack([cos * nose[0] - sin * nose[1], sin * nose[0] + cos * nose[1]], -1)
        turning = np.stack([-arm[:, 1], arm[:, 0]], -1)[..., None] * self.pose_rates[:, -1, 2, None]
        points = np.concatenate([self.poses[..., :2], (self.tip + arm)[:, None]], axis=1)
        return points, np.concatenate([self.pose_rates[:, :, :2], (self.tip_rates + turning)[:, None]], axis=1)


TERMS = ("tracking", "progress", "force", "smoothness", "failure")


class SurroundingsTask(Task):
    """A task among walls; no method changes anything. The frame is that of the base at the start.

    Attributes:
        config: its settings. mechanism: the instrument. m: number of its tendons.
        rest: unstretched lengths of the tendons at the start tension, (m,) [mm].
        columns: where the parts of readings are; the first are common to all tasks.
    Raises:
        ConfigError, MechanismError: a mechanism that cannot be loaded, or none in the plane.
    """

    dimension: ClassVar[int] = 2
    config: Any

    def __init__(self, config: SurroundingsConfig) -> None:
        self.config = config
        mechanism = config.mechanism
        self.mechanism = load_mechanism(mechanism, RollingChain) if isinstance(mechanism, str) else mechanism
        self.length, self.m = float(self.mechanism.length), self.mechanism.n_tendons
        self.action_size = self.m + int(config.FEEDS)
        self.rest = self.mechanism.neutral_lengths - config.start_tension / self.mechanism.stiffnesses
        self._template = self.surroundings(self._sample_walls(), 0.0).arrays(self.mechanism)
        links = self.mechanism.n_links
        self.columns = blocks_of(
            {
                **dict.fromkeys(("step", "status", "error", "reward"), (1,)),
                "terms": (4,),
                "tip": (3,),
                "target": (3,),
                "failure": (1,),
                **dict.fromkeys(("way", "wall_force", "peak_wall_force", "path_ratio", "success"), (1,)),
                **dict.fromkeys(("feed", "insertion_force"), (1,)),
                "tensions": (self.m,),
                "commands": (self.m,),
                "action": (self.action_size,),
                "poses": (links, 3),
            }
        )

    def part(self, readings: Array, name: str) -> Array:
        """A part of the readings (B, columns), (B, ...), not copied; numbers are (B,)."""
        start, stop, shape = self.columns[name]
        block = readings[:, start:stop]
        return block[:, 0] if shape == (1,) else block.reshape(-1, *shape)

    def entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the observation vector."""
        return surroundings_observation_entries(self.config)

    def state_info(self, readings: Array) -> dict[str, Any]:
        """The info of every step, arrays (B, ...): parts of the readings, and copies."""
        numbers = ("wall_force", "peak_wall_force", "path_ratio", "feed", "insertion_force", "tensions", "commands")
        return {
            "error_mm": readings[:, ERROR],
            **{name: self.part(readings, name) for name in numbers},
            "success": self.part(readings, "success") > 0.5,
            "status": STATUS_NAMES[readings[:, STATUS].astype(np.intp)],
            "tip": self.part(readings, "tip")[:, :2],
            "target": self.part(readings, "target")[:, :2],
            "poses": self.part(readings, "poses"),
        }

    def reward_info(self, readings: Array) -> dict[str, Array]:
        """The terms of the reward, (B,) each: parts of the readings."""
        values = [*self.part(readings, "terms").T, self.part(readings, "failure")]
        return dict(zip(TERMS, values, strict=True))

    def surroundings(self, walls: Sequence[Any], mu: float) -> Surroundings:
        """Walls around the instrument in its sleeve."""
        return Surroundings(walls, Sleeve(self.config.sleeve), self.config.friction(mu))

    def solve(self, walls: Any, commands: Array, feed: Array, before: Solution | None) -> Any:
        """The equilibria of B instruments among tables of walls, from those before, or at rest without a memory.

        commands: unstretched lengths, (B, m) [mm]. feed: (B,) [mm].
        """
        base = np.zeros((len(feed), 3))
        base[:, 1] = feed
        past = {"history" if self._rubs() else "starts": before}
        limits = self.config.tension_range
        return solve_lengths_batch(
            self.mechanism, commands, (), tension_limits=limits, surroundings=walls, base=base, **past
        )

    def at_rest(self, walls: Any, commands: Array) -> Any:
        """The equilibria at the start, with a memory of contacts that have not slipped."""
        feed = np.zeros(len(commands))
        return self.solve(walls, commands, feed, self.solve(walls, commands, feed, None))

    def free(self, commands: Array, before: Solution | None) -> Any:
        """The equilibria under commands, (B, m) [mm], without walls, in the frame of the base."""
        return solve_lengths_batch(self.mechanism, commands, (), before, self.config.tension_range)

    def forces(self, solution: Any) -> Array:
        """The largest normal force of any contact in every lane, (B,) [N]."""
        if solution.walls is None:
            return np.zeros(len(solution.poses))
        return np.asarray(solution.walls.normals.max(axis=1, initial=0.0))

    def response(self, solution: Any, feed: Array, scenes: Scenes) -> Response:
        """How equilibria at these feeds, (B,) [mm], answer actions.

        Raises:
            SolverError: one that is not a stable equilibrium.
        """
        free = solution if solution.walls is None else replace(solution, walls=None)
        poses = solution.poses.copy()
        poses[..., 1] += feed[:, None]
        commands = unstretched_length(solution.lengths, solution.tensions, self.mechanism.stiffnesses)
        free_rates = self._pose_rates(free)
        rates = free_rates if free is solution else self._pose_rates(solution)
        forces = self.forces(solution)
        return Response(poses, scenes, commands, feed.copy(), forces, rates, free_rates[:, -1, :2], solution)

    def _pose_rates(self, solution: Any) -> Array:
        """d poses in the frame of the base at the start / d action, (B, n, 3, a)."""
        rates = -self.config.action_scale_mm * dposes_dlengths(solution)
        if self.config.FEEDS:
            on = np.zeros(solution.poses.shape) if solution.walls is None else dposes_dbase(solution)[..., 1].copy()
            on[..., 1] += 1.0
            rates = np.concatenate([rates, self.config.feed_scale_mm * on[..., None]], axis=-1)
        return rates

    def sample(self, rngs: Random, fixed: Any = None) -> tuple[Scenes, dict[str, Any]]:
        """Scenes, one per generator, and what of them is in info["sampled"]."""
        generators: list[Any] = [rngs[lane] for lane in range(len(rngs))]
        drawn = self._scenes(generators, fixed or {})
        tables = [self.surroundings(scene.walls, scene.mu).arrays(self.mechanism) for scene in drawn]
        each = [padded(table, self._template) for table in tables]
        walls = type(self._template)(*(np.concatenate(parts) for parts in zip(*each, strict=True)))
        noise = np.zeros((len(drawn), 0, 0))
        if count := noisy_entries(self.config):
            shape = (self.config.episode_steps + 1, count)
            noise = np.array([rng.standard_normal(shape) for rng in generators])
        target, line = np.array([scene.target for scene in drawn]), np.array([scene.line for scene in drawn])
        goal, zeros = np.array([scene.goal for scene in drawn]), np.zeros(len(drawn))
        sampled = {name: np.array([scene.values[name] for scene in drawn]) for name in drawn[0].values}
        return Scenes(walls, target, line, goal, zeros, noise), sampled

    def way(self, tips: Array, scenes: Scenes) -> Array:
        """How far it is from tips (B, 2) to the targets, (B,) [mm]."""
        return np.hypot(*(scenes.target - tips).T)

    def excess(self, force: Array) -> Array:
        """The force of contacts that the reward counts, (B,) [N]."""
        return np.maximum(force - self.config.reward.free_force, 0.0)

    def succeeds(self, error: Array, force: Array, peak: Array) -> NDArray[np.bool_]:
        """Whether an episode that ends here is a success, (B,)."""
        return (error <= self.config.success_mm) & (peak <= self.config.force_limit)

    def _rubs(self) -> bool:
        return bool(self.config.mu)

    @abstractmethod
    def _scenes(self, rngs: Sequence[np.random.Generator], fixed: Mapping[str, Any]) -> list[DrawnScene]:
        """A scene per generator."""

    @abstractmethod
    def _sample_walls(self) -> Sequence[Any]:
        """Walls with as many rows in every table as any episode has."""


class LumenTask(SurroundingsTask):
    """The tip along a bent lumen."""

    config: LumenConfig

    def checked_options(self, options: Mapping[str, Any] | None) -> dict[str, Any]:
        """The values that the options of a reset fix; raises InvalidInput for unusable ones."""
        return lumen_options(options)

    def way(self, tips: Array, scenes: Scenes) -> Array:
        """Along the centre line, and across it, (B,) [mm]."""
        arc, distance = along(scenes.line, tips)
        return np.hypot(scenes.goal - arc, distance)

    def on_the_line(self, points: Array, scenes: Scenes) -> tuple[Array, Array, Array]:
        """Points (B, k, 2) beside the centre line.

        Returns offsets to its left, (B, k) [mm], its unit tangents there, (B, k, 2), and how far it is along the line
        from there to the target, (B, k) [mm].
        """
        count = points.shape[1]
        lines = np.repeat(scenes.line, count, axis=0)
        flat = points.reshape(-1, 2)
        arcs, _ = along(lines, flat)
        ends = places(lines, arcs[:, None] + (-0.5 * SPACING, 0.5 * SPACING))
        tangents = ends[:, 1] - ends[:, 0]
        tangents /= np.hypot(*tangents.T)[:, None]
        arm = flat - places(lines, arcs[:, None])[:, 0]
        offsets = tangents[:, 0] * arm[:, 1] - tangents[:, 1] * arm[:, 0]
        remaining = scenes.goal[:, None] - arcs.reshape(-1, count)
        return offsets.reshape(-1, count), tangents.reshape(-1, count, 2), remaining

    def _rubs(self) -> bool:
        return self.config.family_mu(self.config.families[0]) > 0.0

    def _scenes(self, rngs: Sequence[np.random.Generator], fixed: Mapping[str, Any]) -> list[DrawnScene]:
        tip = float(self.mechanism.poses(self.mechanism.neutral_angles)[-1, 1])
        return [lumen_scene(self.config, tip, rng, **fixed) for rng in rngs]

    def _sample_walls(self) -> Sequence[Any]:
        return (Lumen([1.0] * MOST_PIECES, [0.0] * MOST_PIECES, 10.0),)


class ObstaclesTask(SurroundingsTask):
    """The tip to a target behind discs."""

    config: ObstaclesConfig

    def checked_options(self, options: Mapping[str, Any] | None) -> dict[str, Any]:
        """The values that the options of a reset fix; raises InvalidInput for unusable ones."""
        return obstacles_options(options, self.config.discs)

    def _scenes(self, rngs: Sequence[np.random.Generator], fixed: Mapping[str, Any]) -> list[DrawnScene]:
        return scenes_among_discs(self, rngs, fixed)

    def _sample_walls(self) -> Sequence[Any]:
        return [Disc((1e3, 1e3), 1.0)] * self.config.discs


class HiddenWallTask(SurroundingsTask):
    """The tip to a place on a wall that is not known."""

    config: HiddenWallConfig

    def checked_options(self, options: Mapping[str, Any] | None) -> dict[str, Any]:
        """The values that the options of a reset fix; raises InvalidInput for unusable ones."""
        return wall_options(options)

    def excess(self, force: Array) -> Array:
        """The force of contacts that the reward counts, (B,) [N]; of a touch the distance from its force."""
        if self.config.goal == "touch":
            return np.abs(force - self.config.touch_force)
        return super().excess(force)

    def succeeds(self, error: Array, force: Array, peak: Array) -> NDArray[np.bool_]:
        """Whether an episode that ends here is a success, (B,)."""
        good = super().succeeds(error, force, peak)
        if self.config.goal == "touch":
            good &= np.abs(force - self.config.touch_force) <= self.config.force_margin
        return good

    def _scenes(self, rngs: Sequence[np.random.Generator], fixed: Mapping[str, Any]) -> list[DrawnScene]:
        return scenes_at_a_wall(self, rngs, fixed)

    def _sample_walls(self) -> Sequence[Any]:
        return [HalfPlane((1, 0), -1e3)]
