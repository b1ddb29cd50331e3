"""A tree of commands that grows at random through the model with contact: an opponent among discs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.controllers.among_walls import CommandGrid, PlanAround
from rj_gym.surroundings.drawing import commands_of_pairs
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


class Tree(NamedTuple):
    """The K nodes of a tree.

    Fields: equilibria; the node before each, -1: none, (K,); steps from the start, (K,); distance of the tip from the
    target, (K,) [mm]; commands of the steps that have led there, (K, hop, m) [mm].
    """

    solution: Any
    before: Rows
    steps: Rows
    distances: Array
    legs: Array


class CommandTree(PlanAround):
    """A tree of commands through the model with contact (RRT) that ends near the target, then feedback on the tip.

    Of Obstacles. It knows the mechanism, the discs, their stiffness and friction, and the target. Samples are random
    commands, or those that bring the tip near the target without walls; the nearest node goes towards each for a few
    steps, and becomes a node where no wall has pressed harder than allowed. Source: LaValle, Rapidly-Exploring Random
    Trees, 1998.

    Args:
        nodes: of a tree at most. hop: steps of an episode from node to node.
        towards: share of samples near the target.
        force: largest force of a wall on the way [N].
        near: distance from the target at which a tree ends [mm].
        seed: of the samples.
    """

    batch, most, pairs_alone, goals = 40, 9.0, 0.7, 8  # samples at a time; of commands [mm]; in pairs; near the target

    def __init__(
        self,
        nodes: int = 3000,
        hop: int = 3,
        towards: float = 0.25,
        force: float = 0.3,
        near: float = 2.0,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self.nodes, self.hop, self.towards, self.force, self.near, self.seed = nodes, hop, towards, force, near, seed

    def begin(self, envs: Any, infos: Mapping[str, Any]) -> None:
        """Grow a tree for every lane."""
        grid, response, rng = CommandGrid(envs, **self.grid), envs.tangent(), np.random.default_rng(self.seed)
        self._ways, self._step = [], 0
        for lane, target in enumerate(response.target):
            walls = type(response.scenes.walls)(*(table[lane : lane + 1] for table in response.scenes.walls))
            near = grid.nodes[np.hypot(*(grid.tips - target).T).argsort()[: self.goals]]
            self._ways.append(self._way(envs, walls, target, near, rng))

    def _way(self, envs: Any, walls: Any, target: Array, near: Array, rng: np.random.Generator) -> Array:
        """Commands of every step of the way to the node whose tip is nearest to the target, (steps, m)."""
        task = envs.task
        start = task.at_rest(walls, task.rest[None])
        legs = np.repeat(task.rest[None, None], self.hop, axis=1)
        tree = Tree(start, np.array([-1]), np.array([0]), np.hypot(*(start.tip - target).T), legs)
        while len(tree.distances) < self.nodes and tree.distances.min() > self.near:
            fresh = self._grown(envs, walls, target, tree, self._samples(task, near, rng))
            parts = zip(tree[1:], fresh[1:], strict=True)
            tree = Tree(_joined([tree.solution, fresh.solution]), *(np.concatenate(part) for part in parts))
        node, way = int(tree.distances.argmin()), list[Array]()
        while node >= 0:
            way.insert(0, tree.legs[node])
            node = int(tree.before[node])
        return np.concatenate(way[1:] or way)

    def _samples(self, task: Any, near: Array, rng: np.random.Generator) -> Array:
        """Commands to grow towards, (batch, m) [mm]."""
        pairs = commands_of_pairs(task, rng.uniform(-self.most, self.most, (self.batch, task.m // 2)))
        single = task.rest + rng.uniform(-self.most, self.most, (self.batch, task.m))
        samples = np.where(rng.uniform(size=(self.batch, 1)) < self.pairs_alone, pairs, single)
        towards = rng.uniform(size=(self.batch, 1)) < self.towards
        return np.where(towards, near[rng.integers(len(near), size=self.batch)], samples)

    def _grown(self, envs: Any, walls: Any, target: Array, tree: Tree, samples: Array) -> Tree:
        """The nodes that the nearest ones lead to."""
        task, largest = envs.task, envs.config.action_scale_mm
        every = _commands(task, tree.solution)
        open_ones = tree.steps + self.hop < envs.config.episode_steps
        squares = np.square(samples[:, None] - every).sum(axis=2)
        nearest = np.where(open_ones, squares, np.inf).argmin(axis=1)
        tables = type(walls)(*(np.repeat(table, len(samples), axis=0) for table in walls))
        solution, feed = _rows(tree.solution, nearest), np.zeros(len(samples))
        good, legs = np.ones(len(samples), bool), list[Array]()
        for _ in range(self.hop):
            commands = _commands(task, solution)
            legs.append(commands + np.clip(samples - commands, -largest, largest))
            solution = task.solve(tables, legs[-1], feed, solution)
            good &= np.asarray(solution.ok) & (task.forces(solution) <= self.force)
        good &= np.square(_commands(task, solution) - every[nearest]).sum(axis=1) > 0.05
        rows = np.flatnonzero(good)
        distances = np.hypot(*(solution.tip[rows] - target).T)
        steps, before = tree.steps[nearest[rows]] + self.hop, nearest[rows]
        return Tree(_rows(solution, rows), before, steps, distances, np.stack(legs, 1)[rows])


def _commands(task: Any, solution: Any) -> Array:
    """The unstretched lengths of tendons, (K, m) [mm]."""
    return np.asarray(unstretched_length(solution.lengths, solution.tensions, task.mechanism.stiffnesses))


_APART = ("mechanism", "friction", "walls")


def _rows(solution: Any, rows: Rows) -> Any:
    """Some of many equilibria in the same walls."""
    return _changed(solution, lambda arrays: arrays[0][rows], [solution])


def _joined(solutions: Sequence[Any]) -> Any:
    """Equilibria of several batches in the same walls as one batch."""
    return _changed(solutions[0], np.concatenate, solutions)


def _changed(like: Any, change: Any, solutions: Sequence[Any]) -> Any:
    """Equilibria with the arrays that `change` makes of those of `solutions`."""
    steps = [solution.walls for solution in solutions]
    names = "base", "gaps", "normals", "states", "forces", "work", "jumped", "parts"
    walls = {name: change([np.asarray(getattr(step, name)) for step in steps]) for name in names}
    memory = type(steps[0].memory)(*map(change, zip(*(step.memory for step in steps), strict=True)))
    around = replace(steps[0], which=np.zeros(len(walls["base"]), np.int64), memory=memory, **walls)
    array_names = [entry.name for entry in fields(like) if entry.name not in _APART]
    values = {name: change([np.asarray(getattr(solution, name)) for solution in solutions]) for name in array_names}
    return replace(like, walls=around, **values)
