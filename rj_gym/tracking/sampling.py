"""Episodes as pure functions of uniform random numbers, one row per episode.

A generator is asked once per episode (`Uniforms`); everything after that is arithmetic on (B, ...) arrays. So an
episode depends on its own row alone, whatever the batch around it, and a scalar and a native vector environment share
this code. What randomisation needs comes last: switching it on leaves the loads of a seed as they are.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from rj_gym.config import LoadConfig, RandomizationConfig, TaskConfig, TrackingConfig
from rj_gym.tracking.generators import Generators
from rollingjoint.errors import MechanismError
from rollingjoint.profile import Surface
from rollingjoint.rolling_chain import Link, RollingChain

Array = NDArray[np.float64]
_E = TypeVar("_E")


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
    """What was drawn for B episodes; T is the number of steps, time 0 the start.

    A series has one entry where it does not change over time.

    Args:
        mechanisms: the mechanisms that occur: one, or one per lane.
        designs: which of them each lane has, (B,).
        targets: tip targets, (B, 1 or T + 1, 2) [mm]; or None: the tips of the unloaded equilibria at target_tensions.
        target_tensions: (B, 1 or T + 1, m) [N].
        links: link that the load pulls, (B,).
        forces: loads, (B, 1 or T + 1, 2) [N].
        start_tensions: tensions before the load acts, (B, m) [N].
        stiffnesses: of the tendons, (B, m) [N/mm].
        surface_offsets: displacement (x, y, angle) of every link's parent and child surface, (B, n, 2, 3) [mm, rad].
        actuator_offsets: what the motors add to every length command, (B, m) [mm].
        noise: measurement error of the moving links' poses (x, y, angle), (B, T + 1, n - 1, 3) [mm, rad], or None.
    """

    mechanisms: tuple[RollingChain, ...]
    designs: NDArray[np.int64]
    targets: Array | None
    target_tensions: Array
    links: NDArray[np.int64]
    forces: Array
    start_tensions: Array
    stiffnesses: Array
    surface_offsets: Array
    actuator_offsets: Array
    noise: Array | None

    def __len__(self) -> int:
        return len(self.links)

    @property
    def rest_causes(self) -> Array:
        """Numbers on which the pose before the load acts depends, beside the mechanism, (B, m)."""
        return self.start_tensions


class Block(NamedTuple):
    """Where one quantity's uniform numbers stand in the row of an episode, and their shape."""

    start: int
    stop: int
    shape: tuple[int, ...]


class Uniforms:
    """Uniform numbers in [0, 1): one row per episode, the blocks of it by name, (B, *shape) each, to be read only.

    Args:
        blocks: from uniform_blocks.
        rngs: one generator per episode; each is asked once.
    """

    def __init__(self, blocks: Mapping[str, Block], rngs: Sequence[np.random.Generator] | Generators) -> None:
        self._blocks = blocks
        self._rows: Array = np.empty((len(rngs), next(reversed(blocks.values())).stop))
        if isinstance(rngs, Generators):
            rngs.fill(self._rows)
        else:
            for rng, row in zip(rngs, self._rows, strict=True):
                rng.random(out=row)

    def __getitem__(self, name: str) -> Array:
        start, stop, shape = self._blocks[name]
        return self._rows[:, start:stop].reshape(-1, *shape)

    def __len__(self) -> int:
        return len(self._rows)


def uniform_blocks(config: TrackingConfig, mechanism: RollingChain) -> dict[str, Block]:
    """The blocks of uniform numbers that one episode needs, in the order in which they are drawn."""
    return blocks_of(_uniform_shapes(config, mechanism))


def blocks_of(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Block]:
    """Blocks of these shapes, one after the other."""
    stops = list(itertools.accumulate(map(math.prod, shapes.values())))
    return dict(zip(shapes, map(Block, [0, *stops], stops, shapes.values()), strict=False))


def _uniform_shapes(config: TrackingConfig, mechanism: RollingChain) -> dict[str, tuple[int, ...]]:
    times, moving, m = config.episode_steps + 1, mechanism.n_links - 1, mechanism.n_tendons
    shapes: dict[str, tuple[int, ...]] = {"target": target_shape(config, m), "link": (1,)}
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


def target_shape(config: TaskConfig, n_tendons: int) -> tuple[int, int]:
    """Shape of the uniform numbers from which targets come, (waypoints, m)."""
    return config.target.waypoints if config.target.process == "path" else 1, n_tendons


def sample_episodes(
    config: TrackingConfig, nominal: RollingChain, uniforms: Uniforms, fixed: Fixed = NOTHING_FIXED
) -> Episodes:
    """B episodes of the task, with what `fixed` holds in place of what was drawn.

    Args:
        config: the settings.
        nominal: the mechanism before randomisation.
        uniforms: of the same configuration and mechanism.
        fixed: what is not drawn.
    """
    randomization = config.randomization
    mechanisms, designs, offsets = _mechanisms(randomization, nominal, uniforms, fixed)
    drawn = Episodes(
        mechanisms,
        designs,
        None,
        target_tensions(config, uniforms["target"]),
        load_links(config.load, nominal.n_links, uniforms["link"]),
        load_forces(config.load, uniforms),
        start_tensions(config, uniforms["start"]),
        np.array([mechanism.stiffnesses for mechanism in mechanisms]).take(designs, axis=0),
        offsets,
        symmetric(randomization.actuator_offset_mm, uniforms["actuator"]),
        _sensor_noise(randomization, uniforms["noise"]) if randomization.sensor_noise else None,
    )
    return hold(drawn, fixed, ("targets", "links", "forces", "start_tensions"))


def hold(drawn: _E, fixed: Any, names: Sequence[str]) -> _E:
    """Episodes with what is fixed among these fields, the same in every lane."""
    held = {name: value for name in names if (value := getattr(fixed, name)) is not None}
    if not held:
        return drawn
    lanes = len(drawn)  # type: ignore[arg-type]
    repeated = {name: np.stack([np.asarray(value)] * lanes) for name, value in held.items()}
    return replace(drawn, **repeated)  # type: ignore[type-var]


def _mechanisms(
    randomization: RandomizationConfig, nominal: RollingChain, uniforms: Uniforms, fixed: Fixed
) -> tuple[tuple[RollingChain, ...], NDArray[np.int64], Array]:
    """Mechanisms, designs and surface offsets of Episodes."""
    lanes = len(uniforms)
    if fixed.mechanism is not None or not randomization.varies_mechanism:
        chosen = fixed.mechanism or nominal
        return (chosen,), np.zeros(lanes, np.int64), np.zeros((lanes, nominal.n_links, 2, 3))
    tolerance = _pose_scale(randomization.link_tolerance_mm, randomization.link_tolerance_rad)
    offsets = symmetric(tolerance, uniforms["surface"])
    factors = 1 + symmetric(randomization.stiffness_spread, uniforms["stiffness"])
    varied = [varied_mechanism(nominal, *variation) for variation in zip(offsets, factors, strict=True)]
    return tuple(varied), np.arange(lanes), offsets


def target_tensions(config: TaskConfig, uniforms: Array) -> Array:
    """Tensions whose unloaded equilibria have their tips at the targets, (B, 1 or T + 1, m) [N].

    A path moves from one of its waypoints (B, W, m) to the next with a smoothstep in log tension, so it stays in the
    drawn range and is at rest at each of them.
    """
    tensions = log_uniform(uniforms, config.target.tension_range)
    if config.target.process == "fixed":
        return tensions
    position = np.linspace(0.0, tensions.shape[1] - 1, config.episode_steps + 1)
    before = np.minimum(position.astype(int), tensions.shape[1] - 2)
    u = (position - before)[:, None]
    blend = u * u * (3 - 2 * u)
    logs = np.log(tensions)
    return np.exp((1 - blend) * logs[:, before] + blend * logs[:, before + 1])


def load_links(config: LoadConfig, n_links: int, uniforms: Array) -> NDArray[np.int64]:
    """Link that the load pulls, (B,): the tip, or uniform over the moving links."""
    if config.link == "tip":
        return np.full(len(uniforms), n_links - 1)
    return 1 + (uniforms[:, 0] * (n_links - 1)).astype(np.int64)


def load_forces(config: LoadConfig, uniforms: Uniforms) -> Array:
    """Loads, (B, 1 or T + 1, 2) [N]."""
    if config.process == "ou":
        return _ornstein_uhlenbeck(config, normal(uniforms["walk"]))
    low, high = config.magnitude
    angle = 2 * math.pi * uniforms["direction"]
    magnitude = low + (high - low) * uniforms["magnitude"]
    drawn = np.empty((*angle.shape, 2))
    drawn[..., 0], drawn[..., 1] = magnitude * np.cos(angle), magnitude * np.sin(angle)
    if config.process == "constant":
        return drawn
    return np.take_along_axis(drawn, held_draws(uniforms["jump"], config.hold_steps)[..., None], axis=1)


def held_draws(uniforms: Array, hold_steps: float) -> NDArray[np.int64]:
    """Which draw holds at each time, (B, T + 1), where the next one comes after `hold_steps` on average."""
    jumps = uniforms < 1 / hold_steps
    jumps[:, 0] = False
    return np.cumsum(jumps, axis=1, dtype=np.int64)


def _ornstein_uhlenbeck(config: LoadConfig, normal: Array) -> Array:
    """Force with exponentially fading memory, (B, T + 1, 2) [N], started in its stationary distribution."""
    largest = config.magnitude[1]
    walk = fading_walk(normal, config.correlation_steps)
    walk *= largest / 2
    magnitude = np.linalg.norm(walk, axis=-1, keepdims=True)
    return walk * np.minimum(1.0, largest / np.maximum(magnitude, 1e-12))


def fading_walk(normal: Array, correlation_steps: float) -> Array:
    """Ornstein-Uhlenbeck processes of standard deviation 1, (B, T + 1, ...), from normal numbers of that shape."""
    keep = math.exp(-1 / correlation_steps)
    walk = normal.copy()
    for t in range(1, walk.shape[1]):
        walk[:, t] = keep * walk[:, t - 1] + math.sqrt(1 - keep * keep) * normal[:, t]
    return walk


def varied_mechanism(mechanism: RollingChain, offsets: Array, factors: Array) -> RollingChain:
    """The mechanism with displaced contact surfaces and other tendon stiffnesses; itself where nothing changes.

    Offsets under which the mechanism could not be built are halved until it can.

    Args:
        offsets: x, y, angle of every link's parent and child surface, (n, 2, 3) [mm, rad].
        factors: of the tendon stiffnesses, (m,).
    """
    changes: dict[str, object] = {}
    if np.any(factors != 1):
        changes["tendons"] = tuple(
            replace(tendon, stiffness=tendon.stiffness * float(factor))
            for tendon, factor in zip(mechanism.tendons, factors, strict=True)
        )
    while np.any(np.abs(offsets) > 1e-6):
        links = tuple(
            Link(_displaced(link.parent, parent), _displaced(link.child, child))
            for link, (parent, child) in zip(mechanism.links, offsets, strict=True)
        )
        try:
            return mechanism.replace(links=links, **changes)
        except MechanismError:  # tendon holes that would cross: a workshop would scrap the part; halve the error
            offsets = 0.5 * offsets
    return mechanism.replace(**changes) if changes else mechanism


def _displaced(surface: Surface, offset: Array) -> Surface:
    (x, y), (dx, dy, turn) = surface.start, offset
    return replace(surface, start=(x + dx, y + dy), angle=surface.angle + turn)


def start_tensions(config: TaskConfig, uniforms: Array) -> Array:
    """Tensions before the load acts, (B, m) [N]."""
    if config.start == "random":
        return log_uniform(uniforms, config.start_tension_range)
    return np.full(uniforms.shape, config.start_tension)


def _sensor_noise(config: RandomizationConfig, uniforms: Array) -> Array:
    return _pose_scale(config.position_noise_mm, config.angle_noise_rad) * normal(uniforms)


def _pose_scale(mm: float, rad: float) -> Array:
    """The scale of x, y, angle, (3,)."""
    return np.array([mm, mm, rad])


def symmetric(bound: float | Array, uniforms: Array) -> Array:
    """Uniform numbers in [-bound, bound)."""
    return 2 * bound * uniforms - bound


def log_uniform(uniforms: Array, limits: tuple[float, float]) -> Array:
    """Numbers within the limits whose logarithms are uniform."""
    low, high = limits
    return low * (high / low) ** uniforms


def normal(uniforms: Array) -> Array:
    """Standard normal numbers from pairs of uniform ones, (..., 2) -> (...) (Box and Muller 1958)."""
    return np.sqrt(-2 * np.log1p(-uniforms[..., 0])) * np.cos(2 * np.pi * uniforms[..., 1])
