"""Simulated rigs: hidden numbers drawn from their ranges, and what their motors and cameras measure along a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.batch import solve_batch
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.variations import ChainVariations
from rollingjoint.checks import as_floats, as_integer
from rollingjoint.compiled import TendonLaw
from rollingjoint.errors import InvalidInput
from rollingjoint.estimate.hidden import HiddenRanges
from rollingjoint.estimate.rig import RigSensors
from rollingjoint.estimate.wall import N_WALL, Touching, WallAround, WallRanges
from rollingjoint.load import LOAD_COLUMNS, link_index
from rollingjoint.surroundings import Outline
from rollingjoint.transmission import play_step, sheath_direction, sheath_ratio

Array = NDArray[np.float64]

_LINK, _FX = LOAD_COLUMNS.index("link"), LOAD_COLUMNS.index("fx")
_HIGHEST = 1e6  # N


@dataclass(frozen=True, eq=False)
class SimulatedRigs:
    """N rigs: their truth, and what was measured in T steps.

    Attributes:
        positions: of motors, (T, N, m) [mm]. tensions: measured, (T, N, m) [N]. pictures: (T, N, n - 1, 3) [mm, rad].
        forces: on the loaded links in the last step, (N, 2) [N]. links: these, (N,).
        offsets: (N, m) [mm]. stiffnesses: (N, m) [N/mm]. play: widths, (N, m) [mm]. friction: (N, m).
        poses: of all links, (T, N, n, 3) [mm, rad].
        usable: whether all equilibria were found, (N,).
        walls: the numbers of their walls, (N, 3), or (N, 0) without. touching: how these press in the last step.
    """

    positions: Array
    tensions: Array
    pictures: Array
    forces: Array
    links: NDArray[np.int64]
    offsets: Array
    stiffnesses: Array
    play: Array
    friction: Array
    poses: Array
    usable: NDArray[np.bool_]
    walls: Array
    touching: Touching | None = None


def simulated_rigs(
    mechanism: RollingChain,
    path: ArrayLike,
    ranges: HiddenRanges,
    sensors: RigSensors,
    links: Sequence[int] = (-1,),
    rigs: int = 1,
    seed: int = 0,
    wall: WallRanges | None = None,
    outline: Outline | None = None,
) -> SimulatedRigs:
    """Rigs with hidden numbers drawn uniformly from their ranges, forces of any direction.

    Args:
        mechanism: the nominal chain, without friction of its own.
        path: of the motors from where they were set, (T, m) [mm], zeros first; negative pulls in.
        ranges: of what hides. sensors: with a start tension, by which motors are set before the load acts.
        links: of which one is loaded. rigs: N. seed: of all draws. wall: ranges of a wall that is there once motors are
            set; None: there is none. outline: with which links touch it, as of ContactSmoother.
    Raises:
        InvalidInput: a path of another shape, or that begins elsewhere; no start tension.
    """
    path, m, J = as_floats("path", path, "numbers (T, m)"), mechanism.n_tendons, mechanism.n_joints
    if path.ndim != 2 or path.shape[1] != m:
        raise InvalidInput("shape of the path", path.shape, f"(T, {m})")
    if not len(path) or np.any(path[0] != 0.0):
        raise InvalidInput("path[0]", path[:1], "zeros", "Motors are measured first where they were set.")
    if sensors.start_tension is None:
        raise InvalidInput("start_tension", None, "a number [N]", "Motors of simulated rigs are set by it.")
    count, rng = as_integer("rigs", rigs, 1), np.random.default_rng(seed)
    shape, places = (count, m), rng.uniform(-0.5, 0.5, (count, m))
    drawn = (ranges.offset_mm, ranges.stiffness, ranges.play_mm, ranges.sheath_friction, ranges.gain, ranges.zero)
    offsets, factors, play, friction, gains, zeros = (rng.uniform(*limits, shape) for limits in drawn)
    half, stiff = 0.5 * play, mechanism.stiffnesses * factors
    sizes = np.array([ranges.surface_mm, ranges.surface_mm, ranges.surface_rad])
    surfaces = np.zeros((count, J + 1, 2, 3))
    surfaces[:, :-1, 1], surfaces[:, 1:, 0] = (sizes * rng.uniform(-1.0, 1.0, (count, J, 3)) for _ in range(2))
    varied = ChainVariations(mechanism, surfaces, np.ones(shape))
    angle, size = rng.uniform(-np.pi, np.pi, count), rng.uniform(*ranges.force, count)
    forces = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if ranges.wanders:
        forces = _clipped(rng.normal(0.0, 0.5 * ranges.force[1], (count, 2)), ranges.force[1])
    loaded = rng.choice([link_index(link, mechanism.n_links) for link in links], count)
    usable, starts = np.ones(count, bool), varied.neutral_angles
    around, walls = WallAround(mechanism, outline), np.zeros((count, 0))
    if wall is not None:
        walls = rng.uniform(*wall.ends, (count, N_WALL))

    def solved(command: Array, low: Array, high: Array, force: Array, walled: bool) -> Any:
        """The equilibria; the next solve begins where they are."""
        nonlocal starts, usable
        loads = np.zeros((count, 1, len(LOAD_COLUMNS)))
        loads[:, 0, _LINK], loads[:, 0, _FX : _FX + 2] = loaded, force
        law = TendonLaw(*map(np.ascontiguousarray, (command, stiff, low, high)))
        shapes, beside = (varied.arrays, varied.designs), around.arrays(walls) if walled else None
        each = solve_batch(type(mechanism), mechanism, *shapes, law, loads, starts.copy(), beside)
        starts, usable = each.joint_angles, usable & np.asarray(each.ok)
        return each

    def shown(tension: Array, tendons: Array, motors: Array) -> Array:
        """What load cells show."""
        place = sheath_direction(tendons, motors, half)
        ratio = 1.0 if sensors.at_tendons else sheath_ratio(friction, place)
        return gains * ratio * tension + zeros

    behind = -2.0 * places * half
    ratio = 1.0 if sensors.at_tendons else sheath_ratio(friction, sheath_direction(behind, np.zeros(shape), half))
    tension = (sensors.start_tension + sensors.start_sd * rng.standard_normal(shape) - zeros) / (gains * ratio)
    tendons = solved(np.zeros(shape), tension, tension, np.zeros((count, 2)), False).lengths - tension / stiff - offsets
    first, motors = tendons - behind, tendons - behind
    positions, tensions, pictures, poses = list[Array](), list[Array](), list[Array](), list[Array]()
    memory, walk = sensors.memory, 0.5 * ranges.force[1] * np.sqrt(1.0 - sensors.memory**2)
    for place in path:
        if memory < 1.0 and positions:
            forces = _clipped(memory * forces + walk * rng.standard_normal((count, 2)), ranges.force[1])
        positions.append(first + place)
        tendons, motors = play_step(tendons, positions[-1], half), positions[-1]
        now = solved(tendons + offsets, np.zeros(shape), np.full(shape, _HIGHEST), forces, wall is not None)
        truth = shown(now.tensions, tendons, motors)
        spread = np.hypot(sensors.tension_sd, sensors.tension_share * truth)
        tensions.append(truth + spread * rng.standard_normal(shape))
        noise = rng.standard_normal((count, J, 3)) * [*[sensors.position_sd_mm] * 2, sensors.angle_sd]
        pictures.append(now.poses[:, 1:] + noise)
        poses.append(now.poses)
    hidden = forces, loaded, offsets, stiff, play, friction, np.array(poses), usable, walls
    touching = None if wall is None else around.touching(now)
    return SimulatedRigs(np.array(positions), np.array(tensions), np.array(pictures), *hidden, touching)


def _clipped(forces: Array, largest: float) -> Array:
    """Forces (N, 2), shortened to the largest magnitude [N]."""
    sizes = np.maximum(np.linalg.norm(forces, axis=1, keepdims=True), 1e-12)
    return np.asarray(forces * np.minimum(1.0, largest / sizes))
