"""Random surroundings and targets: lumens, discs in the way, and a wall in the way.

Every scene depends on the generator of its own episode alone. Targets among discs and at a wall come from searches, so
that some commands reach each of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from rj_gym.surroundings.config import FAMILIES, HiddenWallConfig, LumenConfig, ObstaclesConfig
from rj_gym.surroundings.scenes import DrawnScene, centre_points
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.errors import InvalidInput
from rollingjoint.surroundings import Disc, HalfPlane, Lumen, Sleeve, Surroundings
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]
Rng = np.random.Generator

BEFORE = 10.0  # mm: from the origin of the base back to the start of a lumen
NOSE = 10.0  # mm: from the tip at rest to the first bend
AHEAD = (0.0, 8.0, 16.0, 24.0, 32.0, 40.0)  # mm: places of the centre line that can be seen ahead of the tip
LINE_BEFORE = 30.0  # mm of the line before the first bend; the tip starts NOSE before it
_LAST_PIECE = 80.0
_MOST_DRAWS = 200

NO_LINE = np.zeros((0, 2))


def lumen_scene(
    config: LumenConfig, tip: float, rng: Rng, lumen: Lumen | None = None, depth: float | None = None
) -> DrawnScene:
    """A lumen around an instrument whose tip is at the height `tip` at rest, and a target in it.

    Args:
        lumen: in place of a random one; its first piece is straight. depth: of the target, in place of a random one.
    Raises:
        InvalidInput: a target beyond the end of the line that an episode keeps.
    """
    family = FAMILIES[config.families[int(rng.integers(len(config.families)))]]
    radius, mu = (
        own if mine is None else mine for own, mine in ((family.radius, config.radius), (family.mu, config.mu))
    )
    stiffness = float(rng.uniform(*(family.stiffness if config.stiffness is None else config.stiffness)))
    values: dict[str, Any] = {}
    for _ in range(_MOST_DRAWS):
        radii, turns = np.zeros(config.most_bends), np.zeros(config.most_bends)
        lengths, curvatures = [BEFORE + tip + NOSE], [0.0]
        for bend in range(family.bends):
            side = rng.choice([-1.0, 1.0])
            radii[bend] = rng.uniform(*family.bend_radius)
            turns[bend] = side * rng.uniform(*family.angles[min(bend, len(family.angles) - 1)])
            lengths += [radii[bend] * abs(turns[bend]), rng.uniform(*family.between)]
            curvatures += [side / radii[bend], 0.0]
        lengths[-1] = _LAST_PIECE
        try:
            drawn = Lumen(lengths, curvatures, radius, (0.0, -BEFORE, np.pi / 2), stiffness=stiffness)
        except InvalidInput:  # it overlaps itself
            continue
        values = {"bend_radii": radii, "bend_angles": turns}
        break
    else:
        raise InvalidInput("families", config.families, "lumens that do not overlap themselves")
    drawn_depth = float(rng.uniform(*config.depth))
    lumen, depth = drawn if lumen is None else lumen, drawn_depth if depth is None else depth
    begin = lumen.lengths[0]
    deepest = config.depth[1] + AHEAD[-1]
    line = centre_points(lumen, begin - LINE_BEFORE, begin + deepest + 10.0)
    if lumen.radius(begin) <= config.sleeve:
        allowed = f"more than {config.sleeve:g} mm, the radius of the sleeve"
        raise InvalidInput("radius of options['lumen']", float(lumen.radius(begin)), allowed)
    if depth > deepest:
        raise InvalidInput("options['depth']", depth, f"at most {deepest:g} mm", "Set a larger depth in the settings.")
    values |= {"radius": float(lumen.radius(begin)), "stiffness": lumen.stiffness, "mu": mu, "depth": depth}
    return DrawnScene((lumen,), mu, lumen.pose(begin + depth)[:2], line, LINE_BEFORE + depth, values)


class DrawnTask(Protocol):
    """A task, as far as drawing needs it."""

    mechanism: RollingChain
    rest: Array
    config: Any

    def surroundings(self, walls: Sequence[Any], mu: float) -> Surroundings:
        """Walls around the instrument."""

    def solve(self, walls: Any, commands: Array, feed: Array, before: Any) -> Any:
        """The equilibria of B instruments."""

    def at_rest(self, walls: Any, commands: Array) -> Any:
        """The equilibria at the start."""

    def free(self, commands: Array, before: Any) -> Any:
        """The equilibria without walls."""

    def forces(self, solution: Any) -> Array:
        """The largest normal force of any contact, (B,) [N]."""


def scenes_among_discs(task: DrawnTask, rngs: Sequence[Rng], fixed: Mapping[str, Any]) -> list[DrawnScene]:
    """Targets behind discs, found by a search: a disc is before each, and one way of the commands leads there.

    It goes by one of VIAS commands, touches with 1 N at most, and takes MOST_STEPS steps at most.
    """
    config: ObstaclesConfig = task.config
    search = SEARCHES[config.search]
    if fixed:
        return [_scene_of_discs(config, fixed["discs"], fixed["target"], task.rest, task.rest) for _ in rngs]
    scenes: list[DrawnScene | None] = [None] * len(rngs)
    seeded = np.random.default_rng(0)
    vias = np.array([random_commands(task, seeded, search.pull) for _ in range(VIAS)])
    out, _ = free_way(task, vias)
    for _ in range(_MOST_DRAWS):
        active = [lane for lane, scene in enumerate(scenes) if scene is None]
        if not active:
            return [scene for scene in scenes if scene is not None]
        tried = [lane for lane in active for _ in range(GOALS)]
        goals = np.array([random_commands(task, rngs[lane]) for lane in tried])
        straight, good = free_way(task, goals)
        far = np.hypot(*(straight[-1, :, -1, :2] - straight[0, :, -1, :2]).T) >= config.reach_mm
        legs = np.abs(vias - task.rest).max(1) + np.abs(goals[:, None] - vias).max(2)
        rows, short = np.nonzero((good & far)[:, None] & (legs <= MOST_STEPS * config.action_scale_mm))
        back, _ = free_way(task, goals[rows], vias[short])
        found: list[tuple[int, DrawnScene]] = []
        for row in np.unique(rows):
            lane, here = tried[row], np.flatnonzero(rows == row)
            if search.looks and found and found[-1][0] == lane:
                continue  # nearly every find is reached
            around = np.concatenate([out[:, short[here]], back[:, here]])
            drawn = _discs_on_the_way(task, rngs[lane], straight[[0, -1], row], around, search.looks)
            if drawn is not None:
                via = vias[short[here[drawn[1]]]]
                found.append((lane, _scene_of_discs(config, drawn[0], straight[-1, row, -1, :2], goals[row], via)))
        for (lane, scene), reached in zip(found, _reached(task, [scene for _, scene in found]), strict=True):
            if reached and scenes[lane] is None:
                scenes[lane] = scene
    raise InvalidInput("obstacles", "none drawn", "targets behind discs", "Take fewer or smaller discs.")


def _scene_of_discs(
    config: ObstaclesConfig, discs: Sequence[Disc], target: Array, goal: Array, via: Array
) -> DrawnScene:
    values = {"stiffness": discs[0].stiffness, "mu": config.mu, "goal": goal, "via": via}
    return DrawnScene(discs, config.mu, target, NO_LINE, 0.0, values)


def scenes_at_a_wall(task: DrawnTask, rngs: Sequence[Rng], fixed: Mapping[str, Any]) -> list[DrawnScene]:
    """Half planes across the way of a straight change of the commands; the target is where the tip presses on that way.

    Of a "touch" with the force of the settings; of a "reach" with a drawn one, at most 0.8 of the limit.
    """
    config: HiddenWallConfig = task.config
    if fixed:
        return [_scene_of_a_wall(config, fixed["wall"], fixed["target"], task.rest) for _ in rngs]
    scenes: list[DrawnScene | None] = [None] * len(rngs)
    for _ in range(_MOST_DRAWS):
        active = [lane for lane, scene in enumerate(scenes) if scene is None]
        if not active:
            return [scene for scene in scenes if scene is not None]
        goals = np.array([random_commands(task, rngs[lane]) for lane in active])
        poses, good = free_way(task, goals)
        walls, forces = [], np.zeros(len(active))
        for row, lane in enumerate(active):
            rng = rngs[lane]
            turn, share, size = rng.uniform(-0.5, 0.5), rng.uniform(0.3, 0.7), np.log(config.stiffness)
            stiffness = float(np.exp(rng.uniform(*size)))
            forces[row] = config.touch_force if config.goal == "touch" else rng.uniform(0.3, 0.8) * config.force_limit
            walls.append(_wall_across(task, poses[:, row, :, :2], turn, share, stiffness))
        found, targets, commands = _pressing(task, walls, goals, forces)
        for row, lane in enumerate(active):
            if good[row] and found[row]:
                scenes[lane] = _scene_of_a_wall(config, walls[row], targets[row], commands[row])
    raise InvalidInput("wall", "none drawn", "a wall that the tip can press on", "Take a smaller force.")


def _scene_of_a_wall(config: HiddenWallConfig, wall: HalfPlane, target: Array, goal: Array) -> DrawnScene:
    values = {"normal": np.array(wall.normal), "offset": wall.offset, "stiffness": wall.stiffness}
    return DrawnScene((wall,), config.mu, target, NO_LINE, 0.0, values | {"mu": config.mu, "goal": goal})


_WAY = 12  # steps of a change of the commands without walls
GOALS, VIAS, MOST_STEPS = 4, 32, 45
"""Targets behind discs that are tried together, commands by way of which they are looked for, and steps of that way."""


class WaySearch(NamedTuple):
    """How a target behind discs is looked for.

    Fields: pull: the largest of the commands by way of which it goes [mm]. looks: at each of _WAY steps whether it is
    clear of the discs; 0: at every other step, where discs can be jumped.
    """

    pull: float
    looks: int


SEARCHES = {"coarse": WaySearch(7.0, 0), "fine": WaySearch(13.0, 4)}
"""By the setting `search`. Large pulls bend an instrument to an S, which leads around most discs."""


def random_commands(task: DrawnTask, rng: Rng, pull: float = 7.0) -> Array:
    """Random commands of antagonistic pairs of tendons that pull by at most `pull` [mm], (m,) [mm]."""
    return commands_of_pairs(task, rng.uniform(-pull, pull, task.mechanism.n_tendons // 2))


def commands_of_pairs(task: DrawnTask, pulls: Array) -> Array:
    """Commands (..., m) of pairs that pull by (..., pairs) [mm]: a segment bends by its own and by those passing it."""
    commands = np.repeat(pulls, 2, axis=-1) * np.tile([1.0, -1.0], pulls.shape[-1])
    commands[..., 2:] += 0.6 * commands[..., :-2]
    return np.asarray(task.rest + commands)


def free_way(task: DrawnTask, end: Array, begin: Array | None = None) -> tuple[Array, NDArray[np.bool_]]:
    """Poses on the way to commands `end`, (B, m), without walls, (steps + 1, B, n, 3); whether all were found, (B,).

    begin: commands at the beginning, default those of the start, (B, m).
    """
    begin = np.repeat(task.rest[None], len(end), axis=0) if begin is None else begin
    solution = task.free(begin, None)
    poses, good = [solution.poses], np.asarray(solution.ok)
    for share in np.arange(1, _WAY + 1) / _WAY:
        solution = task.free(begin + share * (end - begin), solution)
        poses.append(solution.poses)
        good = good & solution.ok
    return np.array(poses), good


def _discs_on_the_way(
    task: DrawnTask, rng: Rng, ends: Array, around: Array, looks: int
) -> tuple[Sequence[Disc], int] | None:
    """Discs, and the number of a way around, (steps, ways, n, 3), that is clear of all of them; None: no such found.

    The first is between the tip and the target, others are anywhere; all are clear of the instrument at both ends of
    the way, (2, n, 3).
    """
    config: ObstaclesConfig = task.config
    bars = Sleeve(config.sleeve).rows(task.mechanism.links).bars
    at_ends, besides = axes_of(bars, ends), axes_of(bars, around[::2])
    stiffness, (begin, end) = float(rng.uniform(*config.stiffness)), ends[:, -1, :2]
    discs, clear = list[Disc](), np.full(around.shape[1], np.inf)
    for _ in range(30):
        radius, share, off = float(rng.uniform(*config.disc_radius)), rng.uniform(0.3, 0.7), rng.normal(0.0, 3.0, 2)
        place = rng.uniform((-60.0, 20.0), (60.0, 90.0)) if discs else begin + share * (end - begin) + off
        disc = Disc((float(place[0]), float(place[1])), radius, stiffness=stiffness)
        if room(at_ends, disc).min() < 1.0:
            continue
        now = np.minimum(clear, room(besides, disc).min(axis=0))
        if looks and (left := now >= 0.0).any():
            closer = axes_of(bars, between(around[:, left], looks))
            now[left] = np.minimum(now[left], room(closer, disc).min(axis=0))
        if now.max() < 0.0:
            continue
        discs, clear = [*discs, disc], now
        if len(discs) == config.discs:
            return discs, int(clear.argmax())
    return None


def between(poses: Array, count: int) -> Array:
    """Poses (K, ...) with others on straight lines between them, `count` for one: ((K - 1) count + 1, ...)."""
    shares = np.arange(1, count + 1).reshape(-1, *(1,) * (poses.ndim - 1)) / count
    legs = poses[:-1, None] + shares * np.diff(poses, axis=0)[:, None]
    return np.concatenate([poses[:1], legs.reshape(-1, *poses.shape[1:])])


Axes = tuple[Array, Array, Array, Array]


def axes_of(bars: Array, poses: Array) -> Axes:
    """The axes of bars of links in poses (..., n, 3): first ends, vectors to the others, their squares, and radii."""
    at = poses[..., bars[:, 0].astype(np.int64), :]
    cos, sin = np.cos(at[..., 2]), np.sin(at[..., 2])
    first, second = (
        at[..., :2] + np.stack([cos * x - sin * y, sin * x + cos * y], -1) for x, y in (bars[:, 1:3].T, bars[:, 3:5].T)
    )
    return first, second - first, np.square(second - first).sum(-1), bars[:, 5]


def room(axes: Axes, disc: Disc) -> Array:
    """The least distance of a disc from the bars of an instrument in every pose, (...) [mm]."""
    first, way, square, radii = axes
    x, y = disc.centre[0] - first[..., 0], disc.centre[1] - first[..., 1]
    share = np.clip((x * way[..., 0] + y * way[..., 1]) / square, 0.0, 1.0)
    room: Array = (np.hypot(x - share * way[..., 0], y - share * way[..., 1]) - radii).min(axis=-1) - disc.radius
    return room


def _reached(task: DrawnTask, scenes: Sequence[DrawnScene]) -> list[bool]:
    """Whether targets are reached by way of other commands, in steps of an episode, touching with 1 N at most."""
    if not scenes:
        return []
    walls = _tables(task, [scene.walls for scene in scenes])
    goals, vias = (np.array([scene.values[name] for scene in scenes]) for name in ("goal", "via"))
    around, peak = _driven(task, walls, [np.repeat(task.rest[None], len(scenes), axis=0), vias, goals])
    errors = np.hypot(*(around.tip - [scene.target for scene in scenes]).T)
    return list(around.ok & (errors <= 1.0) & (peak <= min(1.0, task.config.force_limit)))


def _driven(task: DrawnTask, walls: Any, ends: Sequence[Array]) -> tuple[Any, Array]:
    """The equilibria at the end of a way through commands, in steps of an episode, and the largest forces, (B,) [N]."""
    solution, feed = task.at_rest(walls, ends[0]), np.zeros(len(ends[0]))
    peak, largest = task.forces(solution), task.config.action_scale_mm
    for wanted in steps_through(ends, largest):
        commands = unstretched_length(solution.lengths, solution.tensions, task.mechanism.stiffnesses)
        commands = commands + np.clip(wanted - commands, -largest, largest)
        solution = task.solve(walls, commands, feed, solution)
        peak = np.maximum(peak, task.forces(solution))
    return solution, peak


def steps_through(ends: Sequence[Array], largest: float) -> list[Array]:
    """Commands (B, m) on the way through `ends`, (B, m) each, that change by `largest` at most in a step."""
    every = []
    for begin, end in itertools.pairwise(ends):
        count = np.maximum(np.ceil(np.abs(end - begin).max(axis=1) / largest - 1e-9), 1.0)
        every.append(
            [begin + np.minimum(k / count, 1.0)[:, None] * (end - begin) for k in range(1, int(count.max()) + 1)]
        )
    return [commands for leg in every for commands in leg]


def _straight(task: DrawnTask, walls: Any, goals: Array) -> Any:
    """The equilibria on a straight change of the commands from the start, (B, m)."""
    begin = np.repeat(task.rest[None], len(goals), axis=0)
    solution, feed = task.at_rest(walls, begin), np.zeros(len(goals))
    yield solution
    for share in np.arange(1, _WAY + 1) / _WAY:
        solution = task.solve(walls, begin + share * (goals - begin), feed, solution)
        yield solution


def _tables(task: DrawnTask, walls: Sequence[Sequence[Any]]) -> Any:
    """The tables of walls of several episodes, which have equally many of each kind."""
    each = [task.surroundings(one, task.config.mu).arrays(task.mechanism) for one in walls]
    return type(each[0])(*(np.concatenate(parts) for parts in zip(*each, strict=True)))


def _wall_across(task: DrawnTask, places: Array, turn: float, share: float, stiffness: float) -> HalfPlane:
    """A wall that the tip meets at a share of its way, places (K, n, 2), turned from the direction of the way."""
    at = round(share * (len(places) - 1))
    way = places[at, -1] - places[at - 1, -1]
    angle = np.arctan2(-way[1], -way[0]) + turn
    normal = np.array([np.cos(angle), np.sin(angle)])
    offset = float(normal @ places[at, -1]) - task.config.sleeve
    return HalfPlane((float(normal[0]), float(normal[1])), offset, stiffness=stiffness)


_HALVINGS = 10


def _pressing(task: DrawnTask, walls: Sequence[HalfPlane], goals: Array, forces: Array) -> tuple[Any, Array, Array]:
    """Where the last link alone presses with a force first, on a straight change of the commands.

    Returns whether there is such a place, (B,), the tip there, (B, 2), and the commands there, (B, m).
    """
    tables = _tables(task, [(wall,) for wall in walls])
    begin = np.repeat(task.rest[None], len(goals), axis=0)
    low, high, found = np.zeros(len(goals)), np.ones(len(goals)), np.zeros(len(goals), bool)
    free = np.ones(len(goals), bool)
    for step, solution in enumerate(_straight(task, tables, goals)):
        pressed = task.forces(solution)
        if step == 0:
            free = (pressed == 0.0) & solution.ok
        new = ~found & (pressed >= forces)
        high[new], low[new] = step / _WAY, (step - 1) / _WAY
        found |= new
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        solution = task.at_rest(tables, begin + middle[:, None] * (goals - begin))
        more = task.forces(solution) >= forces
        low, high = np.where(more, low, middle), np.where(more, middle, high)
    commands = begin + high[:, None] * (goals - begin)
    solution = task.at_rest(tables, commands)
    pressed = task.forces(solution)
    others = np.abs(solution.walls.forces[:, :-1]).max(axis=(1, 2))
    near = np.abs(pressed - forces) <= 0.05 * forces
    return found & free & near & (others == 0.0) & solution.ok, solution.tip, commands
