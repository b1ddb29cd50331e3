"""Episodes as pure functions of uniform random numbers, one row per episode.

A generator is asked once per episode (`draw_uniforms`); everything after that is arithmetic on (B, ...) arrays. So an
episode depends on its own row alone, whatever the batch around it, and a scalar and a native vector environment share
this code. What randomisation needs comes last: switching it on leaves the loads of a seed as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rj_gym.config import LoadConfig, RandomizationConfig, TrackingConfig
from rj_gym.tracking.solve import solve_each
from rollingjoint.errors import MechanismError
from rollingjoint.profile import Surface
from rollingjoint.rolling_chain import Link, RollingChain
from rollingjoint.solve import solve_tensions_batch

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fixed:
    """What the caller of reset holds fixed, the same in every lane; None is drawn.

    Shapes as in Episodes without the lane axis. A fixed mechanism is not randomised.
    """

    mechanism: RollingChain | None = None
    targets: Array | None = None
    links: int | None = None
    forces: Array | None = None
    start_tensions: Array | None = None


NOTHING_FIXED = Fixed()


@dataclass(frozen=True)
class Episodes:
    """Everything that is fixed when B episodes begin; T is the number of steps, time 0 the start.

    Args:
        mechanisms: the mechanism of every lane (the same object where nothing is randomised).
        targets: tip targets over time, (B, T + 1, 2) [mm].
        links: link that the load pulls, (B,).
        forces: load over time, (B, T + 1, 2) [N].
        start_tensions: tensions before the load acts, (B, m) [N].
        surface_offsets: displacement (x, y, angle) of every link's parent and child surface, (B, n, 2, 3) [mm, rad].
        actuator_offsets: what the motors add to every length command, (B, m) [mm].
        noise: measurement error of the moving links' poses (x, y, angle), (B, T + 1, n - 1, 3) [mm, rad], or None.
    """

    mechanisms: tuple[RollingChain, ...]
    targets: Array
    links: NDArray[np.int64]
    forces: Array
    start_tensions: Array
    surface_offsets: Array
    actuator_offsets: Array
    noise: Array | None = None

    @cached_property
    def stiffnesses(self) -> Array:
        """Tendon stiffnesses, (B, m) [N/mm]."""
        return np.array([mechanism.stiffnesses for mechanism in self.mechanisms])


def uniform_shapes(config: TrackingConfig, mechanism: RollingChain) -> dict[str, tuple[int, ...]]:
    """Shapes of the uniform numbers that one episode needs, by name, in the order in which they are drawn."""
    times, moving, m = config.episode_steps + 1, mechanism.n_links - 1, mechanism.n_tendons
    shapes: dict[str, tuple[int, ...]] = {
        "target": (config.target.waypoints if config.target.process == "path" else 1, m),
        "link": (1,),
    }
    if config.load.process == "ou":
        shapes["walk"] = (times, 2, 2)
    else:
        draws = times if config.load.process == "step" else 1
        shapes |= {"direction": (draws,), "magnitude": (draws,)}
    if config.load.process == "step":
        shapes["jump"] = (times,)
    shapes |= {"start": (m,), "stiffness": (m,), "actuator": (m,), "surface": (mechanism.n_links, 2, 3)}
    if config.randomization.sensor_noise:
        shapes["noise"] = (times, moving, 3, 2)
    return shapes


def draw_uniforms(rngs: Sequence[np.random.Generator], shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Array]:
    """Uniform numbers in [0, 1) for one episode per generator, each (B, *shape)."""
    counts = [math.prod(shape) for shape in shapes.values()]
    rows = np.stack([rng.random(sum(counts)) for rng in rngs])
    blocks = np.split(rows, np.cumsum(counts)[:-1], axis=1)
    return {name: block.reshape(len(rows), *shape) for (name, shape), block in zip(shapes.items(), blocks, strict=True)}


def sample_episodes(
    config: TrackingConfig, nominal: RollingChain, uniforms: Mapping[str, Array], fixed: Fixed = NOTHING_FIXED
) -> Episodes:
    """B episodes of the task, with what `fixed` holds in place of what was drawn.

    Args:
        config: the settings.
        nominal: the mechanism before randomisation.
        uniforms: from draw_uniforms.
        fixed: what is not drawn.
    """
    randomization = config.randomization
    tolerance = _pose_scale(randomization.link_tolerance_mm, randomization.link_tolerance_rad)
    offsets = _symmetric(tolerance, uniforms["surface"])
    factors = 1 + _symmetric(randomization.stiffness_spread, uniforms["stiffness"])
    if fixed.mechanism is None:
        mechanisms = tuple(varied_mechanism(nominal, *variation) for variation in zip(offsets, factors, strict=True))
    else:
        mechanisms, offsets = (fixed.mechanism,) * len(offsets), np.zeros_like(offsets)
    drawn = Episodes(
        mechanisms,
        target_paths(config, mechanisms, uniforms["target"]),
        load_links(config.load, nominal.n_links, uniforms["link"]),
        load_forces(config.load, uniforms, config.episode_steps + 1),
        start_tensions(config, uniforms["start"]),
        surface_offsets=offsets,
        actuator_offsets=_symmetric(randomization.actuator_offset_mm, uniforms["actuator"]),
        noise=_sensor_noise(randomization, uniforms["noise"]) if randomization.sensor_noise else None,
    )
    return _hold(drawn, fixed)


def _hold(drawn: Episodes, fixed: Fixed) -> Episodes:
    lanes = len(drawn.mechanisms)
    series = {name: getattr(fixed, name) for name in ("targets", "links", "forces", "start_tensions")}
    held: dict[str, Any] = {
        name: np.stack([np.asarray(value)] * lanes) for name, value in series.items() if value is not None
    }
    return replace(drawn, **held) if held else drawn


def target_paths(config: TrackingConfig, mechanisms: Sequence[RollingChain], uniforms: Array) -> Array:
    """Tip positions of unloaded equilibria at the drawn log tensions, (B, T + 1, 2) [mm].

    A path moves from one of its waypoints (B, W, m) to the next with a smoothstep in log tension, so it stays in the
    drawn range and is at rest at each of them.
    """
    tensions = _log_uniform(uniforms, config.target.tension_range)
    if config.target.process == "path":
        position = np.linspace(0.0, tensions.shape[1] - 1, config.episode_steps + 1)
        before = np.minimum(position.astype(int), tensions.shape[1] - 2)
        u = (position - before)[:, None]
        blend = u * u * (3 - 2 * u)
        logs = np.log(tensions)
        tensions = np.exp((1 - blend) * logs[:, before] + blend * logs[:, before + 1])
    tips = unloaded_tips(mechanisms, tensions)
    return np.ascontiguousarray(np.broadcast_to(tips, (len(tips), config.episode_steps + 1, 2)))


def unloaded_tips(mechanisms: Sequence[RollingChain], tensions: Array) -> Array:
    """Tip positions of the unloaded equilibria at tensions (B, K, m), (B, K, 2) [mm]."""
    lanes, count, m = tensions.shape
    solved = solve_each(
        mechanisms,
        lambda mechanism, rows: solve_tensions_batch(mechanism, tensions[rows].reshape(-1, m), (), None),
    )
    return solved.poses[:, -1, :2].reshape(lanes, count, 2)


def load_links(config: LoadConfig, n_links: int, uniforms: Array) -> NDArray[np.int64]:
    """Link that the load pulls, (B,): the tip, or uniform over the moving links."""
    if config.link == "tip":
        return np.full(len(uniforms), n_links - 1)
    return 1 + (uniforms[:, 0] * (n_links - 1)).astype(np.int64)


def load_forces(config: LoadConfig, uniforms: Mapping[str, Array], times: int) -> Array:
    """Load over time, (B, T + 1, 2) [N]."""
    if config.process == "ou":
        return _ornstein_uhlenbeck(config, _normal(uniforms["walk"]))
    low, high = config.magnitude
    angle = 2 * np.pi * uniforms["direction"]
    magnitude = low + (high - low) * uniforms["magnitude"]
    drawn = magnitude[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    if config.process == "constant":
        return np.ascontiguousarray(np.broadcast_to(drawn, (len(drawn), times, 2)))
    jumps = uniforms["jump"] < 1 / config.hold_steps
    jumps[:, 0] = False
    current: NDArray[np.int64] = np.cumsum(jumps, axis=1, dtype=np.int64)  # which draw holds at each time
    return np.take_along_axis(drawn, current[..., None], axis=1)


def _ornstein_uhlenbeck(config: LoadConfig, normal: Array) -> Array:
    """Force with exponentially fading memory, (B, T + 1, 2) [N], started in its stationary distribution."""
    largest = config.magnitude[1]
    keep = math.exp(-1 / config.correlation_steps)
    walk = normal.copy()
    for t in range(1, walk.shape[1]):
        walk[:, t] = keep * walk[:, t - 1] + math.sqrt(1 - keep * keep) * normal[:, t]
    walk *= largest / 2
    magnitude = np.linalg.norm(walk, axis=-1, keepdims=True)
    return walk * np.minimum(1.0, largest / np.maximum(magnitude, 1e-12))


def varied_mechanism(mechanism: RollingChain, offsets: Array, factors: Array) -> RollingChain:
    """The mechanism with displaced contact surfaces and other tendon stiffnesses; itself where nothing changes.

    Offsets under which the mechanism could not be built are halved until it can.

    Args:
        offsets: x, y, angle of every link's parent and child surface, (n, 2, 3) [mm, rad].
        factors: of the tendon stiffnesses, (m,).
    """
    if np.any(factors != 1):
        tendons = tuple(
            replace(tendon, stiffness=tendon.stiffness * float(factor))
            for tendon, factor in zip(mechanism.tendons, factors, strict=True)
        )
        mechanism = replace(mechanism, tendons=tendons)
    while np.any(np.abs(offsets) > 1e-6):
        links = tuple(
            Link(_displaced(link.parent, parent), _displaced(link.child, child))
            for link, (parent, child) in zip(mechanism.links, offsets, strict=True)
        )
        try:
            return replace(mechanism, links=links)
        except MechanismError:  # tendon holes that would cross: a workshop would scrap the part; halve the error
            offsets = 0.5 * offsets
    return mechanism


def _displaced(surface: Surface, offset: Array) -> Surface:
    (x, y), (dx, dy, turn) = surface.start, offset
    return replace(surface, start=(x + dx, y + dy), angle=surface.angle + turn)


def start_tensions(config: TrackingConfig, uniforms: Array) -> Array:
    """Tensions before the load acts, (B, m) [N]."""
    if config.start == "random":
        return _log_uniform(uniforms, config.start_tension_range)
    return np.full_like(uniforms, config.start_tension)


def _sensor_noise(config: RandomizationConfig, uniforms: Array) -> Array:
    return _pose_scale(config.position_noise_mm, config.angle_noise_rad) * _normal(uniforms)


def _pose_scale(mm: float, rad: float) -> Array:
    """The scale of x, y, angle, (3,)."""
    return np.array([mm, mm, rad])


def _symmetric(bound: float | Array, uniforms: Array) -> Array:
    """Uniform numbers in [-bound, bound)."""
    return 2 * bound * uniforms - bound


def _log_uniform(uniforms: Array, limits: tuple[float, float]) -> Array:
    low, high = limits
    return low * (high / low) ** uniforms


def _normal(uniforms: Array) -> Array:
    """Standard normal numbers from pairs of uniform ones, (..., 2) -> (...) (Box and Muller 1958)."""
    return np.sqrt(-2 * np.log1p(-uniforms[..., 0])) * np.cos(2 * np.pi * uniforms[..., 1])
