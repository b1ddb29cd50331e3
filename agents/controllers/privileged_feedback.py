"""Jacobian feedback on the true state: the limit of control alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from agents.controllers.controller import Array, Reading
from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.kernels import cross_play
from agents.controllers.measured import hanging_loads, loads_along, measured_equilibrium
from agents.controllers.steps import FeedbackSettings, pulling_in, tensions_within_margin
from rj_gym.tracking.observation import load_scale
from rollingjoint import HingeChain, RollingChain, SpatialChain, solve_lengths_batch
from rollingjoint.chain.solution import Solution
from rollingjoint.transmission import pull_limit


@dataclass(frozen=True)
class Truth:
    """The true state of B episodes, as far as feedback uses it.

    Args:
        joint_angles: (B, n - 1) [rad]. tensions: (B, m) [N]. error: target minus tip, (B, d) [mm].
        behind: commands of tendons minus motors, (B, m) [mm]. half_widths: of the play, (B, m) [mm].
        limits: tensions behind the sheath at which motors that pull give way or stop, (B, m) [N].
    """

    joint_angles: Array
    tensions: Array
    error: Array
    behind: Array
    half_widths: Array
    limits: Array

    @classmethod
    def of(cls, reading: Reading) -> Truth:
        """From the privileged state."""
        assert reading.task is not None
        config, axes = reading.task.config, "xyz"[: reading.task.dimension]
        return cls(
            _joint_angles(reading),
            config.tension_range[1] * of_tendons(reading, "tension"),
            config.reward.error_scale_mm * privileged(reading, *(f"tip error {axis}" for axis in axes)),
            of_tendons(reading, "command minus motor"),
            of_tendons(reading, "half play"),
            _limits(reading),
        )


def _limits(reading: Reading) -> Array:
    """Upper limits of tension behind the sheath, (B, m) [N]."""
    assert reading.task is not None
    config = reading.task.config
    if not config.actuation.limits_vary:
        return np.full((len(reading.privileged), reading.task.action_size), config.tension_range[1])
    limits = of_tendons(reading, "tension limit")
    if config.actuation.limit_at == "tendon":
        return limits
    return pull_limit(limits, of_tendons(reading, "sheath friction"), of_tendons(reading, "half play"))


def _joint_angles(reading: Reading) -> Array:
    """True ones, (B, n - 1) [rad]; in the plane of links that turn by less than half a turn against each other."""
    assert reading.task is not None
    mechanism = reading.task.mechanism
    links = range(1, mechanism.n_links)
    if mechanism.dimension == 3:
        return privileged(reading, *(f"{mechanism.joint} {k - 1} angle" for k in links))
    cos, sin = (privileged(reading, *(f"link {k} {f} angle" for k in links)) for f in ("cos", "sin"))
    turns = np.diff(np.arctan2(sin, cos), axis=1, prepend=0.0)
    return np.asarray((turns + np.pi) % (2 * np.pi) - np.pi)


def of_tendons(reading: Reading, what: str) -> Array:
    """These entries of the privileged state, one per tendon, (B, m), in their units."""
    assert reading.task is not None
    return privileged(reading, *(f"tendon {j} {what}" for j in range(reading.task.mechanism.n_tendons)))


def privileged(reading: Reading, *names: str) -> Array:
    """These entries of the privileged state, (B, len(names)), in their units."""
    assert reading.task is not None
    places = {entry.name: place for place, entry in enumerate(reading.task.privileged_entries())}
    return np.take(reading.privileged, [places[name] for name in names], axis=1)


def true_chain(reading: Reading, truth: Truth) -> Solution:
    """The nominal chain at the true pose and tensions."""
    assert reading.task is not None
    mechanism = reading.task.mechanism
    assert isinstance(mechanism, RollingChain)
    return measured_equilibrium(mechanism, truth)


def true_arm(reading: Reading, truth: Truth) -> Solution:
    """The nominal chain in space under the true commands and loads, its tendons elastic and at the true tensions."""
    assert reading.task is not None
    mechanism, config = reading.task.mechanism, reading.task.config
    assert isinstance(mechanism, HingeChain | SpatialChain)
    gravity = privileged(reading, *(f"gravity {axis}" for axis in "xyz"))
    payloads = privileged(reading, "payload")[:, 0]
    loads = loads_along(hanging_loads(mechanism), gravity, load_scale(config) * payloads)
    commands = reading.commands + truth.behind + of_tendons(reading, "motor offset")
    equilibria = solve_lengths_batch(mechanism, commands, loads, truth.joint_angles)
    elastic = np.broadcast_to(mechanism.stiffnesses, truth.tensions.shape)
    return replace(equilibria, tensions=truth.tensions, tendon_stiffness=elastic)


TRUE_MODELS: dict[type, Callable[[Reading, Truth], Solution]] = {
    RollingChain: true_chain,
    HingeChain: true_arm,
    SpatialChain: true_arm,
}


class PrivilegedFeedback(JacobianFeedback):
    """Jacobian feedback on the true pose, tensions and play, which no robot measures.

    It needs privileged="observation" in the settings of a tracking task. It knows the nominal mechanism.

    Args:
        settings: as of JacobianFeedback; by default a motor crosses the whole play for moves above 0.02 mm.
    """

    privileged = True

    def __init__(self, settings: FeedbackSettings | None = None) -> None:
        super().__init__(settings or FeedbackSettings(dead_band_mm=0.02))

    def act(self, observations: Any) -> Array:
        """Actions of the motors, (B, m)."""
        reading = self.read(observations)
        truth = Truth.of(reading)
        model = TRUE_MODELS[type(self.task.mechanism)](reading, truth)
        if self.task.config.actuation.limits_vary:
            self.tension_range = tensions_within_margin((self.task.config.tension_range[0], truth.limits))
        tendons = self.tendon_moves(reading, truth, model)
        moves, settings = np.empty_like(tendons), self.settings
        motors = np.zeros_like(tendons)
        cross_play(tendons, truth.behind, motors, truth.half_widths, settings.dead_band_mm, settings.crossing, moves)
        return pulling_in(moves, self.task.config.action_scale_mm)

    def tendon_moves(self, reading: Reading, truth: Truth, model: Solution) -> Array:
        """Moves of the tendons from the true state, (B, m) [mm]."""
        way = self.settings.gain * truth.error + self.motion.since_last(reading.target)
        return self.step(model, way, self.wanted(model), np.zeros_like(model.tensions))
