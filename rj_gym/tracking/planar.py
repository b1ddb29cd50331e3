"""The task of chains in the plane: random episodes, the force on a link, pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import checked_array, checked_parts
from rj_gym.core.columns import FORCE, LINK
from rj_gym.core.generators import Shapes, Uniforms
from rj_gym.rendering import Screen
from rj_gym.tracking.config import LoadConfig, RandomizationConfig, TrackingConfig
from rj_gym.tracking.draws import (
    TrackingDraws,
    fading_walk,
    load_shapes,
    loads_over_time,
    normal,
    own_series,
    shared_draws,
    symmetric,
)
from rj_gym.tracking.observation import first_seen, measured_entries
from rj_gym.tracking.options import TrackingOptions
from rj_gym.tracking.render import PlanarCanvas, PlanarScene
from rj_gym.tracking.task import TrackingTask
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.variations import ChainVariations
from rollingjoint.errors import InvalidInput
from rollingjoint.load import LOAD_COLUMNS

Array = NDArray[np.float64]

_LINK, _FX = LOAD_COLUMNS.index("link"), LOAD_COLUMNS.index("fx")


class PlanarTask(TrackingTask):
    """The tip of a rolling-contact chain under an unknown force."""

    dimension: ClassVar[int] = 2
    LOAD_COLUMNS: ClassVar[tuple[str, ...]] = LOAD_COLUMNS
    config: TrackingConfig
    mechanism: RollingChain

    @property
    def pictured(self) -> list[str]:
        """The entries of the observed links' poses."""
        return [entry.name for entry in measured_entries(self.config, self.mechanism)]

    def pictured_values(self, poses: Array) -> Array:
        """Of poses (B, n, 3) x, y, cosine and sine of the angle of every observed link, (B, k) [mm, 1]."""
        links = poses[:, 1 + first_seen(self.config, self.mechanism) :]
        columns = links[..., 0], links[..., 1], np.cos(links[..., 2]), np.sin(links[..., 2])
        return np.stack(columns, axis=-1).reshape(len(poses), -1)

    def tips(self, poses: Array) -> Array:
        """Where the tips of poses (B, n, 3) are, (B, 2) [mm]."""
        return poses[:, -1, :2]

    def draws(self, uniforms: Uniforms, fixed: TrackingOptions) -> PlanarDraws:
        """Episodes from uniform numbers, with the fixed mechanism if there is one."""
        config, nominal = self.config, self.mechanism
        mechanisms, designs, offsets = _mechanisms(config.randomization, nominal, uniforms, fixed)
        return PlanarDraws(
            **shared_draws(config, mechanisms, designs, uniforms, _pose_scale, (nominal.n_links - 1,)),
            **self.of_designs(mechanisms, designs),
            links=load_links(config.load, nominal.n_links, uniforms["link"]),
            forces=load_forces(config.load, uniforms)
            if config.terms.loads is None
            else own_series(config, "loads", uniforms, mechanisms, (2,)),
            surface_offsets=offsets,
        )

    def own_uniforms(self) -> tuple[Shapes, Shapes]:
        """Shapes of the uniform numbers of an episode that loads, and mechanisms, are drawn from."""
        loads = load_shapes(self.config.load, self.config.episode_steps + 1, ("direction", "magnitude"), walk=(2,))
        return {"link": (1,)} | loads, {"surface": (self.mechanism.n_links, 2, 3)}

    def load_tables(self, episodes: PlanarDraws, step: int) -> Array:
        """The true loads of E episodes at a step, tables (E, 1, columns)."""
        tables = np.zeros((len(episodes), 1, len(LOAD_COLUMNS)))
        tables[:, 0, _LINK] = episodes.links
        tables[:, 0, _FX : _FX + 2] = episodes.forces[:, min(step, episodes.forces.shape[1] - 1)]
        return tables

    def base_load_tables(self, episodes: PlanarDraws) -> Array:
        """Loads of the unloaded states: none, tables (E, 0, columns)."""
        return np.zeros((len(episodes), 0, len(LOAD_COLUMNS)))

    def new_loads(self, lanes: int) -> Array:
        """Load tables of lanes before they begin, (lanes, 1, columns)."""
        return np.zeros((lanes, 1, len(LOAD_COLUMNS)))

    def new_results(self, lanes: int) -> Any:
        """Room for equilibria of lanes: with how they answer commands, and contacts where the tip's rates are asked."""
        n_joints, truth = self.mechanism.n_joints, self.config.privileged != "off"
        return self.mechanism.kernels.new_results(lanes, n_joints, self.action_size, contacts=truth, responses=True)

    def measured_shapes(self) -> tuple[tuple[int, ...], int]:
        """Shape of the measurement errors of a step, and how many numbers a picture has."""
        moving = self.mechanism.n_links - 1
        return (moving, 3), 3 * moving

    def varied_mechanisms(self, state: Any, lanes: int) -> ChainVariations:
        """The variations of the nominal mechanism that `Variations.get_state` has described; raises InvalidInput."""
        nominal = self.mechanism
        parts = checked_parts(state, ("offsets", "factors"), "state: mechanisms")
        like = {"offsets": (nominal.n_links, 2, 3), "factors": (nominal.n_tendons,)}
        for name, shape in like.items():
            values = checked_array(name, parts[name], np.empty((lanes, *shape)))
            if not np.isfinite(values).all() or (name == "factors" and values.min() <= 0.0):
                raise InvalidInput(f"state: {name}", values, "finite offsets and positive factors")
        return ChainVariations(nominal, **parts)

    def own_sampled(self, draws: PlanarDraws, targets: Array) -> dict[str, Any]:
        """Entries of info["sampled"] that only chains have."""
        return {"surface_offsets": draws.surface_offsets}

    def scene(self, trail: Array, readings: Array, shared: dict[str, Any]) -> PlanarScene:
        """The scene of a lane's picture; `shared`: the fields of a TrackingScene."""
        return PlanarScene(**shared, trail=trail, force=readings[FORCE : FORCE + 2], link=int(readings[LINK]))

    def renderer(self) -> Screen[PlanarScene]:
        """A renderer of the scenes."""
        return Screen(PlanarCanvas(self.length))


@dataclass(kw_only=True)
class PlanarDraws(TrackingDraws):
    """Random numbers of B episodes of the planar task: see TrackingDraws, and the fields below.

    Args:
        links: link that the load pulls, (B,).
        forces: loads, (B, 1 or T + 1, 2) [N].
        surface_offsets: displacement (x, y, angle) of every link's parent and child surface, (B, n, 2, 3) [mm, rad].
    """

    links: NDArray[np.int64]
    forces: Array
    surface_offsets: Array


def _mechanisms(
    randomization: RandomizationConfig, nominal: RollingChain, uniforms: Uniforms, fixed: TrackingOptions
) -> tuple[Sequence[RollingChain], NDArray[np.int64], Array]:
    """Mechanisms, designs and surface offsets of PlanarDraws."""
    lanes = len(uniforms)
    if fixed.mechanism is not None or not randomization.varies_mechanism:
        mechanism = fixed.mechanism or nominal
        return (mechanism,), np.zeros(lanes, np.int64), np.zeros((lanes, nominal.n_links, 2, 3))
    tolerance = _pose_scale(randomization.link_tolerance_mm, randomization.link_tolerance_rad)
    offsets = symmetric(np.array(tolerance), uniforms["surface"])
    factors = 1 + symmetric(randomization.stiffness_spread, uniforms["stiffness"])
    return ChainVariations(nominal, offsets, factors), np.arange(lanes), offsets


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
    np.cos(angle, out=drawn[..., 0])
    np.sin(angle, out=drawn[..., 1])
    drawn *= magnitude[..., None]
    return loads_over_time(config, drawn, uniforms)


def _ornstein_uhlenbeck(config: LoadConfig, normal: Array) -> Array:
    """Force with exponentially fading memory, (B, T + 1, 2) [N], started in its stationary distribution."""
    largest = config.magnitude[1]
    walk = fading_walk(normal, config.correlation_steps)
    walk *= largest / 2
    magnitude = np.linalg.norm(walk, axis=-1, keepdims=True)
    return walk * np.minimum(1.0, largest / np.maximum(magnitude, 1e-12))


def _pose_scale(mm: float, rad: float) -> list[float]:
    """The scale of x, y, angle, (3,)."""
    return [mm, mm, rad]
