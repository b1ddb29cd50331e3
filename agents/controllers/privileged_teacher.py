"""Jacobian feedback on the true state: what control alone can do, and a teacher for policies that see less."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from agents.controllers.feedback_settings import FeedbackSettings
from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.kernels import cross_play
from agents.controllers.measured_arm import hanging_loads, loads_along
from agents.controllers.measured_chain import measured_equilibrium
from agents.evaluation.controller import Array, Seen
from rj_gym.core.observation import load_scale
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.solution import Solution
from rollingjoint.statics.solve import solve_lengths_batch


@dataclass(frozen=True)
class Truth:
    """The true state of B episodes, as far as feedback uses it.

    Args:
        joint_angles: (B, n - 1) [rad]. tensions: (B, m) [N]. error: target minus tip, (B, d) [mm].
        behind: commands of tendons minus motors, (B, m) [mm]. half_widths: of the play, (B, m) [mm].
    """

    joint_angles: Array
    tensions: Array
    error: Array
    behind: Array
    half_widths: Array

    @classmethod
    def of(cls, seen: Seen) -> Truth:
        """From the privileged state."""
        assert seen.task is not None
        config, axes = seen.task.config, "xyz"[: seen.task.dimension]
        return cls(
            _joint_angles(seen),
            config.tension_range[1] * of_tendons(seen, "tension"),
            config.reward.error_scale_mm * privileged(seen, *(f"tip error {axis}" for axis in axes)),
            of_tendons(seen, "command minus motor"),
            of_tendons(seen, "half play"),
        )


def _joint_angles(seen: Seen) -> Array:
    """True ones, (B, n - 1) [rad]: of hinges, or of links that turn by less than half a turn against each other."""
    assert seen.task is not None
    links = range(1, seen.task.mechanism.n_links)
    if isinstance(seen.task.mechanism, HingeChain):
        return privileged(seen, *(f"hinge {k - 1} angle" for k in links))
    cos, sin = (privileged(seen, *(f"link {k} {f} angle" for k in links)) for f in ("cos", "sin"))
    turns = np.diff(np.arctan2(sin, cos), axis=1, prepend=0.0)
    return np.asarray((turns + np.pi) % (2 * np.pi) - np.pi)


def of_tendons(seen: Seen, what: str) -> Array:
    """These entries of the privileged state, one per tendon, (B, m), in their units."""
    assert seen.task is not None
    return privileged(seen, *(f"tendon {j} {what}" for j in range(seen.task.mechanism.n_tendons)))


def privileged(seen: Seen, *names: str) -> Array:
    """These entries of the privileged state, (B, len(names)), in their units."""
    assert seen.task is not None
    places = {entry.name: place for place, entry in enumerate(seen.task.privileged_entries())}
    return np.take(seen.privileged, [places[name] for name in names], axis=1)


def true_chain(seen: Seen, truth: Truth) -> Solution:
    """The nominal chain at the true pose and tensions."""
    assert seen.task is not None
    mechanism = seen.task.mechanism
    assert isinstance(mechanism, RollingChain)
    return measured_equilibrium(mechanism, truth)


def true_arm(seen: Seen, truth: Truth) -> Solution:
    """The nominal arm under the true commands and loads, its tendons elastic and at the true tensions."""
    assert seen.task is not None
    mechanism, config = seen.task.mechanism, seen.task.config
    assert isinstance(mechanism, HingeChain)
    gravity, payloads = privileged(seen, *(f"gravity {axis}" for axis in "xyz")), privileged(seen, "payload")[:, 0]
    loads = loads_along(hanging_loads(mechanism), gravity, load_scale(config) * payloads)
    commands = seen.commands + truth.behind + of_tendons(seen, "motor offset")
    found = solve_lengths_batch(mechanism, commands, loads, truth.joint_angles)
    elastic = np.broadcast_to(mechanism.stiffnesses, truth.tensions.shape)
    return replace(found, tensions=truth.tensions, tendon_stiffness=elastic)


TRUE_MODELS: dict[type, Callable[[Seen, Truth], Solution]] = {RollingChain: true_chain, HingeChain: true_arm}


class PrivilegedTeacher(JacobianFeedback):
    """Jacobian feedback that sees the true pose, tensions and play, which no robot does.

    It needs privileged="observation" in the settings of a tracking task. It knows the nominal mechanism.

    Args:
        settings: as of JacobianFeedback; by default a motor crosses the whole play for moves above 0.02 mm.
    """

    privileged = True

    def __init__(self, settings: FeedbackSettings | None = None) -> None:
        super().__init__(settings or FeedbackSettings(dead_band_mm=0.02))

    def act(self, seen: Seen) -> Array:
        """Actions of the motors, (B, m)."""
        truth = Truth.of(seen)
        before = seen.target if self.target is None else self.target
        self.target = seen.target
        model = TRUE_MODELS[type(self.task.mechanism)](seen, truth)
        way = self.settings.gain * truth.error + (self.target - before)
        tendons = self.step(model, way, self.wanted(model), np.zeros_like(model.tensions))
        moves, some = np.empty_like(tendons), self.settings
        motors = np.zeros_like(tendons)
        cross_play(tendons, truth.behind, motors, truth.half_widths, some.dead_band_mm, some.crossing, moves)
        return np.clip(-moves / self.task.config.action_scale_mm, -1.0, 1.0)
