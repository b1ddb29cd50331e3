"""A step to a target by solves of the whole model, walls and friction included, from the equilibrium before the step.

The search of the kernel (kernels.inverse) knows no walls and no friction. Here every trial is a solve, and a step
minimises, over the change x of the commanded lengths,

    |e + E x|² + |a + A x|² + weight² |tau + D x - preferred|² + (stress excess)²,

e the miss, E and D its and the tensions' derivatives by the implicit function theorem, a by how much other aims are
missed, with its derivatives by differences of solves, under the limits of tensions, joints and travel, forces of walls
and a trust region, all linear in x. What is beyond a limit is the excess. A tendon at a limit of its tension yields;
its command is taken back to where it begins to, and its stiffness counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.outline import rotation
from rollingjoint.inverse.aims import NO_AIMS, Aims, held_stiffness
from rollingjoint.inverse.constrained import constrained_least_squares
from rollingjoint.inverse.goal import Goal
from rollingjoint.kernels.walled_solve import JUMP
from rollingjoint.statics.among import Around
from rollingjoint.statics.sensitivity import joint_response
from rollingjoint.statics.solve import solve_lengths, solve_lengths_batch
from rollingjoint.transmission import unstretched_length

Array = NDArray[np.float64]

_MOST_TRIALS = 40
_MOST_ALONE = 120  # of a search that follows no path
_FIRST_TRUST, _SMALLEST_TRUST = 0.3, 1e-6  # rad: change of any joint in a trial
_WEIGHT = 1e-5  # of the rates, as in kernels.inverse
_MOST_LIGHTENED = 2  # times that the weight is lowered where a miss remains
_STRESS = 10.0  # of the size per N or rad: miss that counts as much as an excess
_MORE_STRESS = 100.0  # times as much, where a search has settled beyond a limit
WITHIN = 1e-6  # N or rad: a smaller excess is none
_NO_GAIN, _NO_CHANGE = 1e-7, 1e-3  # as in kernels.inverse
_TINY = 1e-9  # of the rates: keeps x small where it has no effect
_LIGHT = 0.5  # of the cap: contacts that press less are not limited in a trial
_PROBE = 1e-3  # mm: change of the lengths for the derivatives of wall forces


@dataclass(frozen=True)
class Situation:
    """A mechanism under loads, among walls, and the limits that a step keeps.

    Attributes:
        loads: a sequence of them, or their table, (rows, columns).
        limits: of the tensions, (2, m) [N]. preferred: tensions, (m,) [N]. wall_force: cap on every normal force [N].
        surroundings, base: as of solve_lengths. joint_limits: of the joint angles, (2, J) [rad]; None: the mechanism's.
        aims: what is wanted beyond the place of the links.
    """

    mechanism: AnyChain
    loads: Any
    limits: Array
    preferred: Array
    wall_force: float = np.inf
    surroundings: Around = None
    base: ArrayLike = (0.0, 0.0, 0.0)
    joint_limits: Array | None = None
    aims: Aims = NO_AIMS

    def solve(self, lengths: Array, start: Any, history: Any) -> Any:
        """The equilibrium under commanded lengths, (m,), or those of rows of them."""
        more = {"tension_limits": tuple(self.limits), "history": history}
        if self.surroundings is not None:
            more |= {"surroundings": self.surroundings, "base": self.base}
        loads, single = self.loads, lengths.ndim == 1
        if single and not isinstance(loads, np.ndarray):
            return solve_lengths(self.mechanism, lengths, loads, start, **more)
        rows = np.atleast_2d(lengths)
        angles = getattr(start, "joint_angles", start)
        starts = None if angles is None else np.repeat(angles[None], len(rows), axis=0)
        tables = np.repeat(loads[None], len(rows), axis=0) if isinstance(loads, np.ndarray) else loads
        many = solve_lengths_batch(self.mechanism, rows, tables, starts, **more)
        return many.row(0) if single else many


@dataclass(frozen=True)
class HeldPose:
    """An equilibrium on the way to a goal, and the command that holds it.

    free: joints that move in the linear model, (J,); None: those that are at no limit.
    stress: miss per excess, of the size [1/N, 1/rad].
    """

    situation: Situation
    goal: Goal
    equilibrium: Any
    command: Array  # (m,) mm
    free: NDArray[np.bool_] | None = None
    stress: float = _STRESS

    @cached_property
    def miss(self) -> Array:
        """(C,) weighted coordinates by which the links are off [mm], along a wall if the tip is to press on it."""
        return self.situation.aims.along_wall(self.equilibrium, self.goal.misses(self.equilibrium)[0])

    @cached_property
    def off(self) -> Array:
        """(Q,) by how much what is wanted beyond the place is missed, as a miss [mm]."""
        return self.situation.aims.misses(self.equilibrium, self.goal.size)

    @property
    def square(self) -> float:
        """Sum of the squares of both [mm²]."""
        return float(self.miss @ self.miss + self.off @ self.off)

    def meets(self, tolerance: float) -> bool:
        """Whether the links are where they should be, and what is wanted beyond that is met."""
        return self.distance <= tolerance and bool((np.abs(self.off) <= tolerance).all())

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

    def follows(self, other: HeldPose) -> bool:
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
        return held_stiffness(self.equilibrium)

    @cached_property
    def tension_rates(self) -> Array:
        """(m, m) d tensions / d commanded lengths, no tendon yielding [N/mm]."""
        k = self.situation.mechanism.stiffnesses
        return np.asarray(k[:, None] * (self.equilibrium.tendon_rates.T @ self.angle_rates - np.eye(len(k))))

    @cached_property
    def rates(self) -> Array:
        """(C, m) d miss / d commanded lengths [mm/mm]."""
        rates = self.goal.rates(self.equilibrium) @ self.angle_rates
        return self.situation.aims.along_wall(self.equilibrium, rates)

    @property
    def room(self) -> Array:
        """(2 J,) from joint angles to their lowest, and to their highest [rad]; empty without joint limits."""
        limits, angles = self.situation.joint_limits, self.equilibrium.joint_angles
        return np.zeros(0) if limits is None else np.concatenate([angles - limits[0], limits[1] - angles])

    @property
    def excess(self) -> Array:
        """(C + 2 J,) normal forces beyond their cap [N], and joint angles beyond their limits [rad]."""
        return np.maximum(np.concatenate([self.normals - self.situation.wall_force, -self.room]), 0.0)

    @property
    def keeps_limits(self) -> bool:
        """Whether nothing is beyond its limit."""
        return bool((self.excess <= WITHIN).all())

    def value(self, weight: float) -> float:
        """The sum that is minimised."""
        off = weight * (self.equilibrium.tensions - self.situation.preferred)
        excess = self.stress * self.goal.size * self.excess
        return float(self.square + off @ off + excess @ excess)


@dataclass(frozen=True)
class Move:
    """How a step to a goal ended: a pose, whether it snapped there, and the number of solves."""

    pose: HeldPose
    snapped: bool
    solves: int

    @property
    def ok(self) -> bool:
        """Whether it is a stable equilibrium."""
        return bool(self.pose.equilibrium.ok)

    def reaches(self, tolerance: float) -> bool:
        """Whether it is one within a tolerance of the goal [mm]."""
        return self.ok and self.pose.meets(tolerance)


def approach(begin: HeldPose, tolerance: float) -> Move:
    """The equilibrium nearest to the goal that solves find from a pose, each from the one before, without a history."""
    return _search(begin, None, tolerance, np.inf, jumps=True)


def step_to(
    before: HeldPose,
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
    return _search(HeldPose(situation, goal, at, before.command), before, tolerance, travel, jumps)


def drive(before: HeldPose, goal: Goal, command: Array, count: int) -> list[Move]:
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


def _search(pose: HeldPose, before: HeldPose | None, tolerance: float, travel: float | Array, jumps: bool) -> Move:
    """The search for a goal; before: the equilibrium before the step, None: each solve starts at the last one."""
    situation = pose.situation
    snapped = before is not None and bool(pose.equilibrium.ok) and _snaps(before, pose)
    trust, solves, weight, lightened = _FIRST_TRUST, 1, -1.0, 0
    anchor = pose.command.copy() if before is None else before.command
    most_trials = _MOST_ALONE if before is None else _MOST_TRIALS
    while pose.equilibrium.ok and solves < most_trials and trust > _SMALLEST_TRUST:
        try:
            if weight < 0.0:
                size = np.linalg.norm(pose.rates) / np.mean(situation.mechanism.stiffnesses)
                weight = _WEIGHT * float(size) / np.sqrt(len(anchor))
            x, left = _change(pose, before, weight, anchor, travel, trust)
        except np.linalg.LinAlgError:
            break
        value, most = pose.value(weight), max(1e-3, float(pose.equilibrium.tensions.max()))
        gain = value - left
        if gain <= _NO_GAIN * pose.square + (weight * _NO_CHANGE * most) ** 2:
            if not pose.keeps_limits and pose.stress == _STRESS:
                pose = replace(pose, stress=_MORE_STRESS * _STRESS)
            elif lightened < _MOST_LIGHTENED and not pose.meets(tolerance):
                weight, lightened = 0.01 * weight, lightened + 1
            else:
                break
            continue
        command = pose.held + x
        start, history = (pose.equilibrium, None) if before is None else (None, before.equilibrium)
        trial = replace(pose, equilibrium=situation.solve(command, start, history), command=command, free=None)
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


def _holds_others(pose: HeldPose, trial: HeldPose) -> bool:
    """Whether other joints are at their limits at a trial: the step is tried with those held, too."""
    return not np.array_equal(pose.equilibrium.free_joints, trial.equilibrium.free_joints)


def _snaps(before: HeldPose, pose: HeldPose) -> bool:
    try:
        return bool(pose.equilibrium.jumped) or not before.follows(pose)
    except np.linalg.LinAlgError:  # on the verge of a snap
        return True


def _change(
    pose: HeldPose, before: HeldPose | None, weight: float, anchor: Array, travel: float | Array, trust: float
) -> tuple[Array, float]:
    """The change x of the lengths, and the sum that it would leave."""
    at, situation, m = pose.equilibrium, pose.situation, len(anchor)
    rates, tension_rates, angle_rates = pose.rates, pose.tension_rates, pose.angle_rates
    low, high = situation.limits
    stress = pose.stress * pose.goal.size
    excess, over = pose.excess, pose.excess > WITHIN
    pressing = pose.normals > _LIGHT * situation.wall_force
    force_rates, aim_rates = _probed(pose, before, bool(pressing.any()))
    joint_rates = angle_rates[:0] if situation.joint_limits is None else np.concatenate([-angle_rates, angle_rates])
    excess_rates = np.concatenate([force_rates, joint_rates])
    kept = ~over & np.concatenate([pressing, np.ones(len(joint_rates), bool)])
    spare = np.concatenate([situation.wall_force - pose.normals, pose.room])
    tiny = _TINY * (np.linalg.norm(rates) + 1e-9)
    A = np.concatenate([rates, aim_rates, weight * tension_rates, stress * excess_rates[over], tiny * np.eye(m)])
    off = weight * (situation.preferred - at.tensions)
    b = np.concatenate([-pose.miss, -pose.off, off, -stress * excess[over], np.zeros(m)])
    room = pose.held - anchor
    rows = [
        (tension_rates, low - at.tensions),
        (-tension_rates, at.tensions - high),
        (np.eye(m), -room - travel),
        (-np.eye(m), room - travel),
        (angle_rates, np.full(len(angle_rates), -trust)),
        (-angle_rates, np.full(len(angle_rates), -trust)),
        (-excess_rates[kept], -spare[kept]),
    ]
    G, h = np.concatenate([row[0] for row in rows]), np.minimum(np.concatenate([row[1] for row in rows]), 0.0)
    finite = np.isfinite(h)
    x = constrained_least_squares(A, b, G[finite], h[finite])
    if x is None:
        x = np.zeros(m)
    return x, float(np.sum((A @ x - b) ** 2))


def _probed(pose: HeldPose, before: HeldPose | None, pressing: bool) -> tuple[Array, Array]:
    """d normal forces, (C, m) [N/mm], and d what is wanted beyond the place, (Q, m) / d lengths, by differences.

    pressing: whether those of forces count; they are 0 where not.
    """
    held, m = pose.held, len(pose.command)
    aims, size = pose.situation.aims, pose.goal.size
    if not (pressing or len(pose.off)):
        return np.zeros((len(pose.normals), m)), np.zeros((0, m))
    commands = held + np.concatenate([np.zeros((1, m)), _PROBE * np.eye(m)])
    free = replace(pose.situation, limits=np.array([np.zeros(m), np.full(m, np.inf)]))  # no tendon yields
    near = free.solve(commands, pose.equilibrium, None if before is None else before.equilibrium)
    normals = np.zeros((m + 1, 0)) if near.walls is None else near.walls.normals
    values = np.concatenate([normals, np.array([aims.misses(near.row(i), size) for i in range(m + 1)])], axis=1)
    values = np.where(np.asarray(near.ok)[:, None], values, np.concatenate([pose.normals, pose.off]))
    rates = ((values[1:] - values[0]) / _PROBE).T
    return rates[: len(pose.normals)], rates[len(pose.normals) :]
