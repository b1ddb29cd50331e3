"""Controllers of the tasks among walls, which read the true state of an environment: opponents of policies.

Each is begun with a vector environment after its reset, and then gives the actions of every step. What each knows that
a policy does not see stands in its docstring.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from rj_gym.surroundings.drawing import axes_of, commands_of_pairs, free_way, room, steps_through
from rj_gym.surroundings.task import Response
from rollingjoint import Disc, Sleeve

Array = NDArray[np.float64]

_DAMPING = 2.0


class WallController(ABC):
    """Gives actions for all lanes of a native vector environment of the tasks among walls."""

    reads_environment = True

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:  # noqa: B027 (most of them plan nothing)
        """Begin the episodes that `envs` has just begun, with the infos of that reset."""

    @abstractmethod
    def act(self, envs: Any) -> Array:
        """The actions, (B, m), in [-1, 1]."""


class Still(WallController):
    """Does nothing."""

    def act(self, envs: Any) -> Array:
        """No increments."""
        return np.zeros(envs.action_space.shape)


class FreeSpacePlan(WallController):
    """Open loop: the commands and feed that put the tip at the target in free space, approached in a straight line.

    It knows the mechanism and the target, and neither walls nor what happens.

    Args:
        share: of the episode that the approach takes.
    """

    def __init__(self, share: float = 0.8) -> None:
        self.share = share

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """Find the commands by Jacobian steps of a twin without walls."""
        task, config = envs.task, envs.config
        response: Response = envs.tangent()
        commands, feed = response.commands.copy(), response.feed.copy()
        self._start = commands.copy(), feed.copy()
        equilibria = None
        for _ in range(80):
            equilibria = task.free(commands, equilibria)
            free = task.response(equilibria, feed, response.scenes)
            step = damped(free.tip_rates, free.target - free.tip)
            step /= np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True))
            commands = commands - config.action_scale_mm * step[:, : task.m]
            if config.FEEDS:
                feed = np.clip(feed + config.feed_scale_mm * step[:, -1], *config.feed_range)
        self._end, self._step = (commands, feed), 0

    def act(self, envs: Any) -> Array:
        """A straight change, over a share of the episode."""
        config, steps = envs.config, self.share * envs.config.episode_steps
        self._step += 1
        share = 1.0 if self._step <= steps else 0.0
        (begin, from_feed), (end, to_feed) = self._start, self._end
        actions = share * (begin - end) / (steps * config.action_scale_mm)
        if config.FEEDS:
            actions = np.column_stack([actions, share * (to_feed - from_feed) / (steps * config.feed_scale_mm)])
        return np.clip(actions, -1.0, 1.0)


class SearchedWay(WallController):
    """The commands with which the target was found when the episode was drawn (privileged): the floor.

    Of tasks whose info["sampled"] has them: Obstacles and HiddenWall.
    """

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """Take the commands over."""
        sampled, rest = infos["sampled"], np.repeat(envs.task.rest[None], envs.num_envs, axis=0)
        ends = [rest, *(sampled[name] for name in ("via", "goal") if name in sampled)]
        self._steps = steps_through(ends, envs.config.action_scale_mm)

    def act(self, envs: Any) -> Array:
        """To the next commands."""
        wanted = self._steps.pop(0) if len(self._steps) > 1 else self._steps[0]
        return np.clip((envs.tangent().commands - wanted) / envs.config.action_scale_mm, -1.0, 1.0)


class CommandGrid:
    """A grid of commands, and how commands change along it between discs, by the model without contact.

    Attributes:
        nodes: commands, (K, m) [mm]. tips: where they bring the tip, (K, 2) [mm]. start: the node nearest to rest.

    Args:
        envs: a native vector environment of Obstacles. most, spacing: of the grid [mm]. deepest: nodes deeper in a disc
            are closed [mm]. room: distance from discs that a way need not exceed [mm]. caution: weight of the square of
            the room that is lacking [1/mm²].
    """

    def __init__(
        self, envs: Any, most: float, spacing: float, deepest: float, room: float = 1.5, caution: float = 3.0
    ) -> None:
        task, self.deepest, self.room, self.caution = envs.task, deepest, room, caution
        axis = np.arange(-most, most + 1e-9, spacing)
        places = np.stack(np.meshgrid(*[axis] * (task.m // 2), indexing="ij"), -1)
        self.nodes = commands_of_pairs(task, places.reshape(-1, places.shape[-1]))
        poses, self._found = free_way(task, self.nodes)
        self._axes = axes_of(Sleeve(envs.config.sleeve).rows(task.mechanism.links).bars, poses[-1])
        self.tips, self._edges = poses[-1, :, -1, :2], _neighbours(places.shape[:-1])
        self._lengths = np.abs(self.nodes[self._edges[0]] - self.nodes[self._edges[1]]).max(axis=1)
        self.start = int(np.abs(self.nodes - task.rest).max(axis=1).argmin())
        self._places = poses[-1, ..., :2].reshape(len(self.nodes), -1)
        self._squares = np.square(self._places).sum(axis=1)

    def graph(self, discs: Array) -> csr_array:
        """What it costs to go from node to node between discs with (x, y, radius), (d, 3) [mm]."""
        space = np.min([room(self._axes, Disc((x, y), radius)) for x, y, radius in discs.tolist()], axis=0)
        prices = 1.0 + self.caution * np.square(np.maximum(self.room - space, 0.0))
        prices[~self._found | (space < self.deepest)] = np.inf
        costs = self._lengths * (prices[self._edges[0]] + prices[self._edges[1]]) / 2.0
        is_open = np.isfinite(costs)
        return csr_array((costs[is_open], self._edges[:, is_open]), shape=2 * (len(self.nodes),))

    def distances(self, poses: Array) -> Array:
        """How far links in poses (B, n, 3) are from where the nodes bring them without walls, (B, K) [mm²]: squares."""
        places = poses[..., :2].reshape(len(poses), -1)
        return np.asarray(np.square(places).sum(axis=1)[:, None] - 2.0 * places @ self._places.T + self._squares)

    def way_to(self, target: Array, graph: csr_array) -> tuple[int, NDArray[np.int64]]:
        """The node that brings the tip to a target, (2,) [mm], at little cost; the node before each, (K,)."""
        distances, before = dijkstra(graph, directed=False, indices=self.start, return_predecessors=True)
        return int((np.hypot(*(self.tips - target).T) + 0.02 * distances).argmin()), before


class PlanAround(WallController):
    """The shortest way around the discs in a grid of commands, by the model without contact, then feedback on the tip.

    Of Obstacles. It knows the mechanism, the discs and the target, and no force: what a policy sees, and a model.

    Args:
        fast: share of the largest step that it takes. room, caution: see CommandGrid.
    """

    grid: ClassVar[Mapping[str, float]] = {"most": 8.0, "spacing": 0.5, "deepest": -0.8}

    def __init__(self, fast: float = 1.0, room: float = 1.5, caution: float = 3.0) -> None:
        self.fast, self.room, self.caution = fast, room, caution
        self._feedback = Feedback(aware=False)

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """Find a way for every lane."""
        grid, response, ways = CommandGrid(envs, **self.grid, room=self.room, caution=self.caution), envs.tangent(), []
        for discs, target in zip(response.scenes.walls.discs[..., :3], response.target, strict=True):
            end, before = grid.way_to(target, grid.graph(discs))
            way = [end]
            while way[0] != grid.start:
                way.insert(0, int(before[way[0]]))
            places = np.array([envs.task.rest, *grid.nodes[way[1:]]])
            ways.append(_paced(places, self.fast * envs.config.action_scale_mm))
        self._ways, self._step = ways, 0

    def act(self, envs: Any) -> Array:
        """To the next commands; after the last ones feedback."""
        wanted = np.array([way[min(self._step, len(way) - 1)] for way in self._ways])
        arrived = np.array([self._step >= len(way) for way in self._ways])
        self._step += 1
        on = np.clip((envs.tangent().commands - wanted) / envs.config.action_scale_mm, -1.0, 1.0)
        return np.where(arrived[:, None], self._feedback.act(envs), on)


class WayFromAnywhere(WallController):
    """As PlanAround, from where the links are: its actions depend on poses, commands, discs and the target alone.

    So a policy can imitate it wherever its own actions lead.

    Args:
        hops: how many nodes further on it goes to. near: distance from the target at which feedback on the tip
            begins [mm].
    """

    grid: ClassVar[Mapping[str, float]] = {"most": 12.0, "spacing": 0.4, "deepest": -1.0}

    def __init__(self, hops: int = 4, near: float = 4.0) -> None:
        self.hops, self.near = hops, near
        self._feedback = Feedback(aware=False)
        self._grid: CommandGrid | None = None

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """The way on from every node, in every lane."""
        grid = self._grid = self._grid or CommandGrid(envs, **self.grid)
        response = envs.tangent()
        itself = np.arange(len(grid.nodes))
        self._is_open, self._onward = [], []
        for discs, target in zip(response.scenes.walls.discs[..., :3], response.target, strict=True):
            graph = grid.graph(discs)
            end = grid.way_to(target, graph)[0]
            costs, before = dijkstra(graph, directed=False, indices=end, return_predecessors=True)
            following, onward = np.where(before < 0, itself, before), itself
            for _ in range(self.hops):
                onward = following[onward]
            self._is_open.append(np.isfinite(costs))
            self._onward.append(onward)

    def act(self, envs: Any) -> Array:
        """On the way from the nearest open node; near the target feedback."""
        assert self._grid is not None  # begin makes it
        response: Response = envs.tangent()
        nearest = np.where(self._is_open, self._grid.distances(response.poses), np.inf).argmin(axis=1)
        nodes = np.array([onward[node] for onward, node in zip(self._onward, nearest, strict=True)])
        on = (response.commands - self._grid.nodes[nodes]) / envs.config.action_scale_mm
        arrived = np.hypot(*(response.target - response.tip).T) < self.near
        return np.where(arrived[:, None], self._feedback.act(envs), np.clip(on, -1.0, 1.0))


def _neighbours(shape: tuple[int, ...]) -> NDArray[np.int64]:
    """Pairs of neighbours in a grid, diagonal ones too, each once: numbers of nodes, (2, edges)."""
    numbers = np.arange(np.prod(shape)).reshape(shape)
    pairs = []
    for way in itertools.product((-1, 0, 1), repeat=len(shape)):
        if way > (0,) * len(shape):
            here = numbers[tuple(slice(max(-k, 0), size - max(k, 0)) for k, size in zip(way, shape, strict=True))]
            there = numbers[tuple(slice(max(k, 0), size - max(-k, 0)) for k, size in zip(way, shape, strict=True))]
            pairs.append(np.stack([here.ravel(), there.ravel()]))
    return np.concatenate(pairs, axis=1)


def _paced(places: Array, step: float) -> Array:
    """Commands on the way through places (K, m), (steps, m), whose entries change by at most `step` at a time."""
    lengths = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(places, axis=0)).max(axis=1))])
    at = np.append(np.arange(step, lengths[-1], step), lengths[-1])
    return np.stack([np.interp(at, lengths, column) for column in places.T], axis=-1)


class Feedback(WallController):
    """Jacobian feedback on the true tip.

    Args:
        aware: whether its Jacobian is that with contact, which no instrument can know (privileged); else it is that of
            the chain in free space, at the true pose and tensions.
        step_mm: of the error that a step tries to remove, at most.
        damping: of the least squares [mm²].
    """

    def __init__(self, aware: bool, step_mm: float = 3.0, damping: float = _DAMPING) -> None:
        self.aware, self.step_mm, self.damping = aware, step_mm, damping

    def act(self, envs: Any) -> Array:
        """Damped least squares towards the target."""
        response: Response = envs.tangent()
        rates = response.tip_rates if self.aware else response.free_tip_rates
        error = response.target - response.tip
        size = np.hypot(*error.T)
        error = error * np.minimum(1.0, self.step_mm / np.maximum(size, 1e-9))[:, None]
        return within(damped(rates, error, self.damping))


class SeekForce(WallController):
    """Feedback to the target, and from `near` on the pull goes on until the wall presses with the wanted force.

    Privileged: it is told the tip and the force of the wall. Of HiddenWall with the goal "touch".

    Args:
        gain: of the force that is lacking [mm/N in a step]. near: distance from the target at which it begins [mm].
    """

    def __init__(self, gain: float = 0.4, near: float = 1.0) -> None:
        self.gain, self.near = gain, near

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """The direction to go on in is that from the start to the target."""
        self._way = infos["target"] - infos["tip"]
        self._pressing = np.zeros(len(self._way), bool)

    def act(self, envs: Any) -> Array:
        """Both tendons of a pair move against each other: together they would only stiffen it."""
        response: Response = envs.tangent()
        pairs = np.kron(np.eye(envs.task.m // 2), [[1.0], [-1.0]])
        rates, away = response.free_tip_rates @ pairs, response.target - response.tip
        self._pressing |= np.hypot(*away.T) < self.near
        onward = np.sign(np.einsum("bx,bxa->ba", self._way, rates))
        lacking = (envs.config.touch_force - response.wall_force) / envs.config.action_scale_mm
        press = self.gain * lacking[:, None] * onward
        return within(np.where(self._pressing[:, None], press, damped(rates, away)) @ pairs.T)


class FollowTheLeader(WallController):
    """Keeps every link and the nose on the centre line and the tip going along it.

    Privileged: it knows the line and the contact. Near the target the tip alone counts more and more, as long as no
    wall presses; once the base cannot be moved on the tendons stretch for the rest of the way.

    Args:
        rate: how far the tip goes on along the line in a step [mm].
        gain: share of the links' distances from the line that a step removes.
        damping: of the least squares [mm²].
        relax: share by which links count less where the tip is at the target.
    """

    reach, nose_weight = 10.0, 2.0  # mm from the target, where the tip counts more; of the nose
    tip_weight, onward_weight = 3.0, 0.0  # more weight of the tip there, across the line and along it
    calm, strain = (0.05, 0.3), (0.3, 0.9)  # N: walls press so hard that it no longer relaxes, and stretches

    def __init__(self, rate: float = 2.0, gain: float = 0.4, damping: float = 0.2, relax: float = 0.5) -> None:
        self.rate, self.gain, self.damping, self.relax = rate, gain, damping, relax

    def act(self, envs: Any) -> Array:
        """Damped least squares: links and nose across the line to 0, the tip along it by the rate."""
        response, config = envs.tangent(), envs.config
        points, rates = response.with_nose(np.array(envs.task.mechanism.links[-1].child.start))
        offsets, tangents, remaining = envs.task.on_the_line(points, response.scenes)
        normals = np.stack([-tangents[..., 1], tangents[..., 0]], -1)
        near = np.clip(1.0 - np.abs(remaining[:, -2]) / self.reach, 0.0, 1.0) * _below(self.calm, response.wall_force)
        weights = np.repeat((1.0 - self.relax * near)[:, None], points.shape[1] - 2, axis=1)  # links 0, 1: at the base
        weights[:, -1] *= self.nose_weight
        weights[:, -2] = 1.0 + self.tip_weight * near
        stuck = (config.feed_range[1] - response.feed < 0.5 * config.feed_scale_mm) & (remaining[:, -2] > 0.0)
        rates[..., -1] *= ~stuck[:, None, None]
        across = np.einsum("bkx,bkxa->bka", normals, rates)[:, 2:]
        onward = 3.0 * (1.0 + self.onward_weight * near)
        forward = onward[:, None] * np.einsum("bx,bxa->ba", tangents[:, -2], rates[:, -2])
        way = onward * np.clip(remaining[:, -2], -self.rate, self.rate)
        way *= np.where(stuck, _below(self.strain, response.wall_force), 1.0)
        rows = np.concatenate([weights[..., None] * across, forward[:, None]], axis=1)
        wanted = np.column_stack([-self.gain * weights * offsets[:, 2:], way])
        return within(damped(rows, wanted, self.damping))


class FirmLeader(FollowTheLeader):
    """A FollowTheLeader for which hardly anything but the tip counts near the target, until walls press with 1 N.

    It ends nearer wherever a policy has led, and presses harder: a teacher before other learners weigh force.
    """

    tip_weight, onward_weight, calm = 10.0, 2.0, (0.3, 1.0)

    def __init__(self, rate: float = 2.0, gain: float = 0.4, damping: float = 0.2, relax: float = 0.9) -> None:
        super().__init__(rate, gain, damping, relax)


def _below(band: tuple[float, float], values: Array) -> Array:
    """1 below a band, 0 above it, and a straight line between."""
    low, high = band
    return np.asarray(np.clip((high - values) / (high - low), 0.0, 1.0))


TEACHERS: dict[str, dict[str, Callable[[], WallController]]] = {
    "Lumen": {"follow the leader": FollowTheLeader, "firm leader": FirmLeader},
    "Obstacles": {"searched way": SearchedWay, "plan around": PlanAround, "way from anywhere": WayFromAnywhere},
    "HiddenWall": {"seek the force": SeekForce},
}
TEACHERS["ObstaclesV1"] = TEACHERS["Obstacles"]
"""Controllers that policies can imitate, by name, of every task among walls: rj_gym/Lumen-v0 is "Lumen"."""


def damped(rates: Array, wanted: Array, damping: float = _DAMPING) -> Array:
    """Actions (B, a) of least squares for d rows / d action (B, r, a) and wanted changes of the rows (B, r)."""
    transposed = np.swapaxes(rates, 1, 2)
    square = transposed @ rates + damping * np.eye(rates.shape[2])
    return np.asarray(np.linalg.solve(square, transposed @ wanted[..., None])[..., 0], float)


def within(actions: Array) -> Array:
    """Actions scaled so that none exceeds 1."""
    return np.asarray(actions / np.maximum(1.0, np.abs(actions).max(axis=1, keepdims=True)))
