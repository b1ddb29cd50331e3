"""A step to a target by solves of the whole model, walls and friction included, from the equilibrium before the step.

The search of the kernel (kernels.inverse) knows no walls and no friction. Here every trial is a solve, and a step
minimises, over the change x of the commanded lengths,

    |e + E x|² + weight² |tau + D x - preferred|² + (stress excess)²,

e the miss, E and D its and the tensions' derivatives by the implicit function theorem, under the limits of tensions and
travel, forces of walls and a trust region, all linear in x. A tendon at a limit of its tension yields; its command is
taken back to where it begins to, and its stiffness counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.outline import rotation
from rollingjoint.inverse.constrained import constrained_least_squares
from rollingjoint.inverse.goal import Goal
from rollingjoint.kernels.walled_solve import JUMP
from rollingjoint.load import Load
from rollingjoint.statics.among import Around
from rollingjoint.statics.sensitivity import joint_response
from rollingjoint.statics.solve import solve_lengths, solve_lengths_batch
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]

_MOST_TRIALS = 40
_FIRST_TRUST, _SMALLEST_TRUST = 0.3, 1e-6  # rad: change of any joint in a trial
_WEIGHT = 1e-5  # of the rates, as in kernels.inverse
_STRESS = 10.0  # of the size per N: miss that counts as much as a wall force beyond its cap
_NO_GAIN, _NO_CHANGE = 1e-7, 1e-3  # as in kernels.inverse
_TINY = 1e-9  # of the rates: keeps x small where it has no effect
_LIGHT = 0.5  # of the cap: contacts that press less are not limited in a trial
_PROBE = 1e-3  # mm: change of the lengths for the derivatives of wall forces


@dataclass(frozen=True)
class Situation:
    """A mechanism under loads, among walls, and the limits that a step keeps.

    Attributes:
        limits: of the tensions, (2, m) [N]. preferred: tensions, (m,) [N]. wall_force: cap on every normal force [N].
        surroundings, base: as of solve_lengths. history: before the first step; None: there is no friction in it.
    """

    mechanism: AnyChain
    loads: Sequence[Load]
    limits: Array
    preferred: Array
    wall_force: float = np.inf
    surroundings: Around = None
    base: ArrayLike = (0.0, 0.0, 0.0)

    def solve(self, lengths: Array, start: Any, history: Any) -> Any:
        """The equilibrium under commanded lengths, (m,), or those of rows of them."""
        more = {"tension_limits": tuple(self.limits), "history": history}
        if self.surroundings is not None:
            more |= {"surroundings": self.surroundings, "base": self.base}
        if lengths.ndim == 1:
            return solve_lengths(self.mechanism, lengths, self.loads, start, **more)
        starts = np.repeat(start.joint_angles[None], len(lengths), axis=0)
        return solve_lengths_batch(self.mechanism, lengths, self.loads, starts, **more)


@dataclass(frozen=True)
class Pose:
    """An equilibrium on the way to a goal, and the command that holds it.

    free: joints that move in the linear model, (J,); None: those that are at no limit.
    """

    situation: Situation
    goal: Goal
    equilibrium: Any
    command: Array  # (m,) mm
    free: NDArray[np.bool_] | None = None

    @cached_property
    def miss(self) -> Array:
        """(C,) weighted coordinates by which the links are off [mm]."""
        return self.goal.misses(self.equilibrium)[0]

    @property
    def distance(self) -> float:
        """Root of the mean square miss of the links [mm]."""
        return float(np.sqrt(self.miss @ self.miss / len(self.goal.links)))

    @property
    def normals(self) -> Array:
        """(C,) normal force of every candidate of contact with a wall [N]."""
        walls = self.equilibrium.walls
        return np.zeros(0) if walls is None else np.asarray(walls.normals)

    @property
    def held(self) -> Array:
        """(m,) the least change of the command that leaves a tendon at a limit about to yield [mm]."""
        at = self.equilibrium
        return unstretched_length(at.lengths, at.tensions, self.situation.mechanism.stiffnesses)

    @cached_property
    def angle_rates(self) -> Array:
        """(J, m) d joint angles / d commanded lengths, no tendon yielding [rad/mm]."""
        at, k = self.equilibrium, self.situation.mechanism.stiffnesses
        return joint_response(at, self._stiffness, at.torques_per_tension * k, self.free)

    def follows(self, other: Pose) -> bool:
        """Whether another equilibrium is where the tangent here says, by the rule of `Solution.jumped`."""
        moved = other.equilibrium.joint_angles - self.equilibrium.joint_angles
        tangent = self.angle_rates @ (other.command - self.command)
        walls = other.equilibrium.walls
        if walls is not None and self.equilibrium.walls is not None:
            base = self.equilibrium.walls.base
            motion = walls.base - base
            motion[:2] = motion[:2] @ rotation(base[2])
            tangent += joint_response(self.equilibrium, self._stiffness, -self.equilibrium.base_torques) @ motion
        return bool((np.abs(moved) <= np.maximum(JUMP, 3.0 * np.abs(tangent))).all())

    @cached_property
    def _stiffness(self) -> Array:
        at, k = self.equilibrium, self.situation.mechanism.stiffnesses
        return np.asarray(at.stiffness + (at.torques_per_tension * (k - at.tendon_stiffness)) @ at.tendon_rates.T)

    @cached_property
    def tension_rates(self) -> Array:
        """(m, m) d tensions / d commanded lengths, no tendon yielding [N/mm]."""
        k = self.situation.mechanism.stiffnesses
        return np.asarray(k[:, None] * (self.equilibrium.tendon_rates.T @ self.angle_rates - np.eye(len(k))))

    @cached_property
    def rates(self) -> Array:
        """(C, m) d miss / d commanded lengths [mm/mm]."""
        return np.asarray(self.goal.rates(self.equilibrium) @ self.angle_rates)

    @property
    def excess(self) -> Array:
        """(C,) normal forces beyond their cap, as a miss [mm]."""
        return _STRESS * self.goal.size * np.maximum(self.normals - self.situation.wall_force, 0.0)

    def value(self, weight: float) -> float:
        """The sum that is minimised."""
        off = weight * (self.equilibrium.tensions - self.situation.preferred)
        return float(self.miss @ self.miss + off @ off + self.excess @ self.excess)


@dataclass(frozen=True)
class Move:
    """How a step to a goal ended: a pose, whether it snapped there, and the number of solves."""

    pose: Pose
    snapped: bool
    solves: int

    @property
    def ok(self) -> bool:
        """Whether it is a stable equilibrium."""
        return bool(self.pose.equilibrium.ok)

    def reaches(self, tolerance: float) -> bool:
        """Whether it is one within a tolerance of the goal [mm]."""
        return self.ok and self.pose.distance <= tolerance


def approach(begin: Pose, tolerance: float) -> Move:
    """The equilibrium nearest to the goal that solves find from a pose, each from the one before, without a history."""
    return _search(begin, None, tolerance, np.inf, jumps=True)


def step_to(
    before: Pose,
    situation: Situation,
    goal: Goal,
    tolerance: float,
    travel: float | Array = np.inf,
    jumps: bool = False,
) -> Move:
    """The step from an equilibrium to the nearest one to a goal, no command changing by more than the travel.

    Args:
        before: where friction and contact go on. situation: of the step, its base in another place, perhaps.
        tolerance: of the distance from the goal [mm]. travel: (m,) or a number [mm].
        jumps: whether the mechanism may snap.
    """
    at = situation.solve(before.command, None, before.equilibrium)
    return _search(Pose(situation, goal, at, before.command), before, tolerance, travel, jumps)


def drive(before: Pose, goal: Goal, command: Array, count: int) -> list[Move]:
    """Steps to a command in equal parts, wherever they lead, as far as there are equilibria."""
    steps: list[Move] = []
    first = before.command
    for share in np.linspace(0.0, 1.0, count + 1)[1:]:
        lengths = first + share * (command - first)
        pose = replace(before, goal=goal, command=lengths)
        pose = replace(pose, equilibrium=pose.situation.solve(lengths, None, before.equilibrium))
        if not pose.equilibrium.ok:
            break
        steps.append(Move(pose, _snaps(before, pose), 1))
        before = pose
    return steps


def _search(pose: Pose, before: Pose | None, tolerance: float, travel: float | Array, jumps: bool) -> Move:
    """The search for a goal; before: the equilibrium before the step, None: each solve starts at the last one."""
    situation, goal = pose.situation, pose.goal
    snapped = before is not None and bool(pose.equilibrium.ok) and _snaps(before, pose)
    trust, solves, weight = _FIRST_TRUST, 1, -1.0
    anchor = pose.command.copy() if before is None else before.command
    while pose.equilibrium.ok and solves < _MOST_TRIALS and trust > _SMALLEST_TRUST:
        try:
            if weight < 0.0:
                size = np.linalg.norm(pose.rates) / np.mean(situation.mechanism.stiffnesses)
                weight = _WEIGHT * float(size) / np.sqrt(len(anchor))
            x, left = _change(pose, before, weight, anchor, travel, trust)
        except np.linalg.LinAlgError:
            break
        value, most = pose.value(weight), max(1e-3, float(pose.equilibrium.tensions.max()))
        gain = value - left
        if gain <= _NO_GAIN * (pose.miss @ pose.miss) + (weight * _NO_CHANGE * most) ** 2:
            break
        command = pose.held + x
        start, history = (pose.equilibrium, None) if before is None else (None, before.equilibrium)
        trial = Pose(situation, goal, situation.solve(command, start, history), command)
        solves += 1
        fits = bool(trial.equilibrium.ok) and trial.value(weight) < value - 1e-4 * gain
        jumped = fits and before is not None and not snapped and _snaps(before, trial)
        if fits and (jumps or not jumped):
            pose, snapped = trial, snapped or jumped
            trust = min(2.0 * trust, _FIRST_TRUST)
        elif pose.free is None and trial.equilibrium.ok and _holds_others(pose, trial):
            pose = replace(pose, free=trial.equilibrium.free_joints)
        else:
            trust, pose = 0.3 * trust, replace(pose, free=None)
    held = np.clip(pose.held, anchor - travel, anchor + travel) if pose.equilibrium.ok else pose.command
    return Move(replace(pose, command=held), snapped, solves)


def _holds_others(pose: Pose, trial: Pose) -> bool:
    """Whether other joints are at their limits at a trial: the step is tried with those held, too."""
    return not np.array_equal(pose.equilibrium.free_joints, trial.equilibrium.free_joints)


def _snaps(before: Pose, pose: Pose) -> bool:
    try:
        return bool(pose.equilibrium.jumped) or not before.follows(pose)
    except np.linalg.LinAlgError:  # on the verge of a snap
        return True


def _change(
    pose: Pose, before: Pose | None, weight: float, anchor: Array, travel: float | Array, trust: float
) -> tuple[Array, float]:
    """The change x of the lengths, and the sum that it would leave."""
    at, situation, m = pose.equilibrium, pose.situation, len(anchor)
    rates, tension_rates, angle_rates = pose.rates, pose.tension_rates, pose.angle_rates
    low, high = situation.limits
    excess, forces = pose.excess, np.flatnonzero(pose.normals > _LIGHT * situation.wall_force)
    force_rates = _force_rates(pose, before)[forces] if forces.size else np.zeros((0, m))
    over = excess[forces] > 0.0
    stress = _STRESS * pose.goal.size * force_rates[over]
    tiny = _TINY * (np.linalg.norm(rates) + 1e-9)
    A = np.concatenate([rates, weight * tension_rates, stress, tiny * np.eye(m)])
    b = np.concatenate([-pose.miss, weight * (situation.preferred - at.tensions), -excess[forces][over], np.zeros(m)])
    room = pose.held - anchor
    rows = [
        (tension_rates, low - at.tensions),
        (-tension_rates, at.tensions - high),
        (np.eye(m), -room - travel),
        (-np.eye(m), room - travel),
        (angle_rates, np.full(len(angle_rates), -trust)),
        (-angle_rates, np.full(len(angle_rates), -trust)),
        (-force_rates[~over], (pose.normals[forces] - situation.wall_force)[~over]),
    ]
    G, h = np.concatenate([row[0] for row in rows]), np.minimum(np.concatenate([row[1] for row in rows]), 0.0)
    finite = np.isfinite(h)
    x = constrained_least_squares(A, b, G[finite], h[finite])
    if x is None:
        x = np.zeros(m)
    return x, float(np.sum((A @ x - b) ** 2))


def _force_rates(pose: Pose, before: Pose | None) -> Array:
    """(C, m) d normal forces / d commanded lengths [N/mm], by differences of solves."""
    held, m = pose.held, len(pose.command)
    commands = held + np.concatenate([np.zeros((1, m)), _PROBE * np.eye(m)])
    near = pose.situation.solve(commands, pose.equilibrium, None if before is None else before.equilibrium)
    normals = np.where(np.asarray(near.ok)[:, None], near.walls.normals, pose.normals)
    return np.asarray(((normals[1:] - normals[0]) / _PROBE).T)
