"""Random targets, loads, tensions and errors of every episode of a tracking task, from uniform numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.generators import Uniforms
from rj_gym.tracking.config import FrictionConfig, LoadSettings, TaskConfig
from rj_gym.tracking.hardware import HardwareDraws, draw_hardware
from rj_gym.tracking.options import TrackingOptions
from rj_gym.tracking.terms import Start, checked_series
from rollingjoint.chain.stacks import Variations

Array = NDArray[np.float64]
D = TypeVar("D", bound="TrackingDraws")


@dataclass(kw_only=True)
class TrackingDraws:
    """Random numbers of B episodes of any tracking task; T is the number of steps, time 0 the start.

    A series has one entry where it does not change over time.

    Args:
        mechanisms: the mechanisms that occur: one, or one per lane, which may be Variations.
        designs: which of them each lane has, (B,).
        targets: of the tip, (B, 1 or T + 1, ...) [mm]; or None: tips of the unloaded equilibria at target_tensions.
        target_tensions: (B, 1 or T + 1, m) [N].
        start_tensions: tensions before the load acts, (B, m) [N].
        stiffnesses: of the tendons, (B, m) [N/mm].
        actuator_offsets: added by the motors to every length command, (B, m) [mm].
        noise: measurement errors, (B, T + 1, ...) [mm, rad], or None.
        friction_mu: coefficients of friction of the tendons, (B, m), or None: as the mechanisms have them.
        hardware: of motors and sensors, or None where everything is plain.
    """

    mechanisms: Sequence[Any]
    designs: NDArray[np.int64]
    targets: Array | None
    target_tensions: Array
    start_tensions: Array
    stiffnesses: Array
    actuator_offsets: Array
    noise: Array | None
    friction_mu: Array | None
    hardware: HardwareDraws | None

    def __len__(self) -> int:
        return len(self.designs)

    @property
    def rest_causes(self) -> Array:
        """Quantities that determine the pose before the load acts, besides the mechanism, (B, ...)."""
        return self.start_tensions


def shared_draws(
    config: TaskConfig,
    mechanisms: Sequence[Any],
    designs: NDArray[np.int64],
    uniforms: Uniforms,
    scale: Callable[[float, float], list[float]],
    parts: tuple[int, ...] = (),
) -> dict[str, Any]:
    """The fields of TrackingDraws but those that mechanisms have, see `TrackingTask.of_designs`.

    Args:
        config, mechanisms, designs, uniforms: as elsewhere.
        scale: the scales of a pose's numbers, from the scales of its positions [mm] and angles [rad].
        parts: shape of the poses that are measured, (n - 1,) for every link; () for one.
    """
    randomization, terms, targets = config.randomization, config.terms, None
    if terms.targets is not None:
        targets = own_series(config, "targets", uniforms, mechanisms, (config.target_numbers,))
    if terms.target_tensions is None:
        tensions = target_tensions(config, uniforms["target"])
    else:
        tensions = own_series(config, "target_tensions", uniforms, mechanisms, uniforms["start"].shape[1:])
    return {
        "mechanisms": mechanisms,
        "designs": designs,
        "targets": targets,
        "target_tensions": tensions,
        "start_tensions": start_tensions(config, uniforms["start"]),
        "actuator_offsets": symmetric(randomization.actuator_offset_mm, uniforms["actuator"]),
        "noise": measurement_errors(config, uniforms, scale, parts),
        "friction_mu": None if config.friction is None else friction_mu(config.friction, uniforms),
        "hardware": draw_hardware(config, uniforms, normal),
    }


def own_series(
    config: TaskConfig, name: str, uniforms: Uniforms, mechanisms: Sequence[Any], shape: tuple[int, ...]
) -> Array:
    """The targets or loads that the settings bring, `terms.<name>`, (B, 1 or T + 1, *shape)."""
    term = getattr(config.terms, name)
    numbers = uniforms[f"own {name}"] if term.uniforms else np.zeros((len(uniforms), 0))
    start = Start(numbers, config.episode_steps, float(mechanisms[0].length))
    return checked_series(f"terms.{name}", term.function(start), start, shape)


def measurement_errors(
    config: TaskConfig, uniforms: Uniforms, scale: Callable[[float, float], list[float]], parts: tuple[int, ...]
) -> Array | None:
    """Noise and bias of measured poses, (B, 1 or T + 1, *parts, numbers) [mm, rad], or None; see shared_draws."""
    noise, sensing = config.randomization, config.sensing
    errors: Array | None = None
    if noise.sensor_noise:
        errors = np.array(scale(noise.position_noise_mm, noise.angle_noise_rad)) * normal(uniforms["noise"])
    if sensing.biased:
        limits = np.array(scale(sensing.position_bias_mm, sensing.angle_bias_rad))
        bias = symmetric(limits, uniforms["bias"])  # the same for every part
        spread = np.broadcast_to(bias.reshape(len(bias), 1, *[1] * len(parts), -1), (len(bias), 1, *parts, len(limits)))
        errors = spread.copy() if errors is None else errors + spread
    return errors


class KeptRows:
    """Arrays with a row per mechanism; of several they are kept until others come, for most draw from the same ones."""

    def __init__(self) -> None:
        self._mechanisms: Sequence[Any] = ()
        self._kept: dict[str, Array] = {}

    def of(self, mechanisms: Sequence[Any], name: str, of_one: Callable[[Any], Any] | None = None) -> Array:
        """Of every mechanism its attribute `name`, or what `of_one` makes of it, (D, ...)."""
        if isinstance(mechanisms, Variations):
            return np.asarray(getattr(mechanisms, name))
        of_one = of_one or attrgetter(name)
        if len(mechanisms) == 1:
            return np.array([of_one(mechanisms[0])], float)
        if mechanisms is not self._mechanisms:
            self._mechanisms, self._kept = mechanisms, {}
        if name not in self._kept:
            self._kept[name] = np.array(list(map(of_one, mechanisms)), float)
        return self._kept[name]


def of_lanes(values: Sequence[Any], designs: NDArray[np.int64]) -> Array:
    """The values of every lane's design, (B, ...)."""
    return np.array(values, float).take(designs, axis=0)


def target_shape(config: TaskConfig, n_tendons: int) -> tuple[int, int]:
    """Shape of the uniform numbers from which targets come, (waypoints, m)."""
    return config.target.waypoints if config.target.process == "path" else 1, n_tendons


def friction_shapes(config: TaskConfig, n_tendons: int) -> dict[str, tuple[int]]:
    """Shapes of the uniform numbers from which coefficients of friction come: none where no friction is set."""
    if config.friction is None:
        return {}
    return {"friction": (1 if config.friction.shared else n_tendons,)}


def friction_mu(config: FrictionConfig, uniforms: Uniforms) -> Array:
    """Coefficients of friction of the tendons, (B, m)."""
    low, high = config.mu
    drawn = low + (high - low) * uniforms["friction"]
    return np.ascontiguousarray(np.broadcast_to(drawn, (len(uniforms), uniforms["start"].shape[1])))


def load_shapes(config: LoadSettings, times: int, drawn: Sequence[str], walk: tuple[int, ...]) -> dict[str, Any]:
    """Shapes of the uniform numbers from which loads come: independent draws, or the coordinates of a random walk."""
    if config.process == "ou":
        return {"walk": (times, *walk, 2)}
    step = config.process == "step"
    return dict.fromkeys(drawn, (times if step else 1,)) | ({"jump": (times,)} if step else {})


def loads_over_time(config: LoadSettings, drawn: Array, uniforms: Uniforms) -> Array:
    """Loads (B, 1 or T + 1, ...) of the process "constant" or "step" from independent draws of that shape."""
    if config.process == "constant":
        return drawn
    held = held_draws(uniforms["jump"], config.hold_steps)
    return np.take_along_axis(drawn, held.reshape(*held.shape, *[1] * (drawn.ndim - 2)), axis=1)


def hold(drawn: D, fixed: TrackingOptions) -> D:
    """The draws, with fixed values in place of drawn ones, the same in every lane."""
    held: dict[str, Any] = {
        name: np.stack([np.asarray(value)] * len(drawn))
        for name, value in vars(fixed).items()
        if value is not None and name != "mechanism"
    }
    motors = {name: held.pop(name) for name in ("play", "sheath_friction", "tension_limits") if name in held}
    if motors and drawn.hardware is not None:
        held["hardware"] = drawn.hardware.held(**motors)
    return replace(drawn, **held) if held else drawn


def homed(config: TaskConfig, drawn: D) -> D:
    """The draws with the true tensions of the start, of which load cells show the drawn ones."""
    low, at_tendons = max(config.tension_range[0], 1e-3), config.sensing.tension_at == "tendon"
    if drawn.hardware is None:
        return drawn
    tensions = drawn.hardware.true_tensions(drawn.start_tensions, at_tendons)
    return replace(drawn, start_tensions=np.maximum(tensions, low))


def target_tensions(config: TaskConfig, uniforms: Array) -> Array:
    """Tensions of the equilibria with their tips at the targets, (B, 1 or T + 1, m) [N].

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


def held_draws(uniforms: Array, hold_steps: float) -> NDArray[np.int64]:
    """Which draw holds at each time, (B, T + 1), where the next one comes after `hold_steps` on average."""
    jumps = uniforms < 1 / hold_steps
    jumps[:, 0] = False
    return np.cumsum(jumps, axis=1, dtype=np.int64)


def fading_walk(normal: Array, correlation_steps: float) -> Array:
    """Ornstein-Uhlenbeck processes of standard deviation 1, (B, T + 1, ...), from normal numbers of that shape."""
    keep = math.exp(-1 / correlation_steps)
    walk = normal.copy()
    for t in range(1, walk.shape[1]):
        walk[:, t] = keep * walk[:, t - 1] + math.sqrt(1 - keep * keep) * normal[:, t]
    return walk


def start_tensions(config: TaskConfig, uniforms: Array) -> Array:
    """Tensions before the load acts, (B, m) [N]."""
    if config.start == "random":
        return log_uniform(uniforms, config.start_tension_range)
    tensions = np.empty(uniforms.shape)
    tensions.fill(config.start_tension)
    return tensions


def symmetric(bound: float | Array, uniforms: Array) -> Array:
    """Uniform numbers in [-bound, bound)."""
    if isinstance(bound, float) and bound == 0.0:
        return np.zeros(uniforms.shape)
    return 2 * bound * uniforms - bound


def log_uniform(uniforms: Array, limits: tuple[float, float]) -> Array:
    """Numbers within the limits, with uniform logarithms."""
    low, high = limits
    return low * (high / low) ** uniforms


def normal(uniforms: Array) -> Array:
    """Standard normal numbers from pairs of uniform ones, (..., 2) -> (...) (Box and Muller 1958)."""
    return np.sqrt(-2 * np.log1p(-uniforms[..., 0])) * np.cos(2 * np.pi * uniforms[..., 1])


def over_time(series: Array, times: int) -> Array:
    """A fresh series (..., times, d) from one with one entry where it is constant, (..., 1 or times, d)."""
    return series.repeat(times, axis=-2) if series.shape[-2] == 1 else series.copy()
