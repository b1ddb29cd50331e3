"""Model-predictive control over a receding horizon, on the exact responses of the model.

Every step plans the moves of the tendons of the next steps (horizon.py), from the plan of the last step on, and the
first of them is made. What differs is the belief that plans begin with: the measured pose with the load that explains
it, the most likely filter of a bank, a smoother's fit, or the true state.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from agents.controllers.controller import Array, Mask, Reading, restarted
from agents.controllers.filter_feedback import FilterFeedback, FilterFeedbackSettings
from agents.controllers.filters.estimate import Estimate
from agents.controllers.horizon import Goals, Plans, Stages, improve
from agents.controllers.jacobian_feedback import JacobianFeedback
from agents.controllers.kernels import cross_play
from agents.controllers.measured import balanced, unstretched
from agents.controllers.privileged_feedback import PrivilegedFeedback, Truth
from agents.controllers.smoother import SmootherFeedback, SmootherFeedbackSettings
from agents.controllers.steps import KEEP, FeedbackSettings, pulling_in
from rj_gym.core.settings import Settings
from rj_gym.tracking.task import TrackingTask
from rollingjoint.chain.batch import PinnedRange, stiffnesses, tip_rates
from rollingjoint.chain.solution import Solution
from rollingjoint.checks import as_boolean, as_integer, as_number
from rollingjoint.compiled import TendonLaw, machine_code, run_in_threads
from rollingjoint.estimate import ArmSmoother
from rollingjoint.load import LOAD_COLUMNS

_LINK, _FX = LOAD_COLUMNS.index("link"), LOAD_COLUMNS.index("fx")
_HIGHEST = 1e6  # N: tensions of plans are limited by their costs


@dataclass(frozen=True)
class MpcSettings(Settings):
    """Settings of the plans.

    Args:
        horizon: steps that are planned.
        solves: of all stages in every step; one less than that improve the plan.
        fade: weight of a step over that of the one before: far ones are less certain.
        bend: share of the last change of the target's motion that goes on in the next step, and so on.
        estimated: whether the load of a chain in the plane is a force on one link, which is estimated; else moments on
            all links that balance the measured tensions, and stay as they are.
    """

    _SECTION: ClassVar[str] = "mpc."
    horizon: int = 10
    solves: int = 4
    fade: float = 0.811
    bend: float = 1.0
    estimated: bool = False

    def __post_init__(self) -> None:
        self._check(as_integer, "horizon", low=1, high=1000)
        self._check(as_integer, "solves", low=1, high=100)
        self._check(as_number, "bend", "fade", low=0.0, high=1.0)
        self._check(as_boolean, "estimated")


class PlanStart(NamedTuple):
    """What plans begin with, B episodes."""

    commands: Array  # of the tendons behind their play, (B, m) mm
    stiffnesses: Array  # of the tendons, (B, m) N/mm
    loads: Array  # load tables, (B, rows, columns)
    angles: Array  # of the model's joints, from which its equilibria are looked for, (B, J) rad
    tip: Array  # (B, d) mm
    tensions: Array  # (B, m) N


class _PlanRows:
    """Arrays of B plans with tables of so many loads, and the solver that is bound to them."""

    def __init__(self, task: TrackingTask, count: int, n_loads: int, horizon: int) -> None:
        mechanism: Any = task.mechanism
        kernels, J, m, d = mechanism.kernels, mechanism.n_joints, mechanism.n_tendons, mechanism.dimension
        self.count, self.kernels, R = count, kernels, count * (horizon + 1)
        self.laws = TendonLaw(np.zeros((R, m)), np.ones((R, m)), np.zeros((R, m)), np.full((R, m), _HIGHEST))
        if d == 2:  # motors take slack up: paying out moves nothing further; in space many tendons are at this limit,
            self.laws.low[:] = task.config.possible_tensions[0]  # and none of them would have a response
        self.loads, self.starts = np.zeros((R, n_loads, len(mechanism.load_columns))), np.zeros((R, J))
        results = kernels.new_results(R, J, m)
        designs = np.zeros(R, np.int64)
        self.batch = kernels.batch_arrays(mechanism.arrays, designs, self.laws, self.loads, self.starts, results)
        self.solver = PinnedRange(kernels, self.batch)
        plans = ((horizon, m), (horizon, m), (), (), (d,), (m,), (horizon, m), (horizon, m, m))
        turns = (horizon, J), (horizon, J, m)
        self.plans = Plans(*(np.zeros((count, *shape)) for shape in (*plans, *turns)))

    def solved(self) -> Stages:
        """The model at all stages."""
        batch, results = self.batch, self.batch.results
        run_in_threads(self.solver, len(self.starts), self.starts.shape[1])
        H, torques = stiffnesses(self.kernels, batch)
        tips, levers = _tips_in_space(self.kernels, batch) if results.poses.ndim == 4 else _tips_in_the_plane(results)
        return Stages(
            self.laws.command, self.starts, self.laws.stiffness, batch.chain.joints[0], results.status,
            results.joint_angles, H, torques, results.rates, results.elastic, results.lengths, tips, levers,
        )  # fmt: skip


def _tips_in_the_plane(results: Any) -> tuple[Array, Array]:
    """Tips (R, 2) [mm], and their derivatives by joint angles, (R, 2, J) [mm/rad]."""
    tips = np.ascontiguousarray(results.poses[:, -1, :2])
    levers = np.empty((len(tips), 2, results.contacts.shape[1]))
    np.subtract(results.contacts[:, :, 1], tips[:, 1:], out=levers[:, 0])
    np.subtract(tips[:, :1], results.contacts[:, :, 0], out=levers[:, 1])
    return tips, levers


def _tips_in_space(kernels: Any, batch: Any) -> tuple[Array, Array]:
    """Tips (R, 3) [mm], and their derivatives by joint angles, (R, 3, J) [mm/rad]."""
    return np.ascontiguousarray(batch.results.poses[:, -1, :3, 3]), np.ascontiguousarray(tip_rates(kernels, batch))


class Planner:
    """Plans of B episodes side by side.

    Args:
        task: with the nominal mechanism, and the largest move.
        settings: of the plans. feedback: their weights: gain, stiffen and damping.
    """

    def __init__(self, task: TrackingTask, settings: MpcSettings, feedback: FeedbackSettings) -> None:
        self.task, self.settings, self.feedback = task, settings, feedback
        limit = task.config.action_scale_mm
        self._weights = feedback.stiffen, feedback.damping, KEEP, settings.fade, limit
        load, columns = task.config.load, list(task.mechanism.load_columns)
        wanders = load.process == "ou" and task.dimension == 2
        memory = math.exp(-1.0 / load.correlation_steps) if wanders else 1.0
        scale = np.ones((settings.horizon + 1, len(columns)))
        forces = [columns.index(name) for name in ("fx", "fy", "moment") if name in columns]
        scale[:, forces] = memory ** np.arange(settings.horizon + 1.0)[:, None]
        self._scale = scale[:, None]
        self._moves = self._angles = self._motion = self._damping = np.empty(0)
        self._bind()

    def _bind(self) -> None:
        self._rows: dict[tuple[int, int], _PlanRows] = {}
        self._improve = machine_code(improve, Stages, Goals, Plans, (0.0,) * 5, bool, bool)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in ("_rows", "_improve")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state
        self._bind()

    def reset(self, mask: Mask) -> None:
        """Begin the episodes of the mask, (B,): without plans, their targets at rest."""
        count, N, mechanism = len(mask), self.settings.horizon, self.task.mechanism
        self._moves = restarted(self._moves, mask, np.zeros((count, N, mechanism.n_tendons)))
        self._angles = restarted(self._angles, mask, np.full((count, N, mechanism.n_joints), np.nan))
        self._motion = restarted(self._motion, mask, np.zeros((count, self.task.dimension)))
        self._damping = restarted(self._damping, mask, np.zeros(count))

    def moves(self, belief: PlanStart, target: Array, motion: Array, limits: tuple[Any, Any], level: Array) -> Array:
        """The next moves of the tendons, (B, m) [mm].

        Args:
            belief: what is known.
            target: now, (B, d) [mm]. motion: since the last step.
            limits: lowest and highest tension, numbers or (B, m) [N].
            level: mean tension to go for, (B,) [N]; NaN: until the largest is at its limit.
        """
        rows, shape = self._rows_of(belief), belief.tensions.shape
        low, high = (np.ascontiguousarray(np.broadcast_to(limit, shape), float) for limit in limits)
        goals = Goals(self._targets(belief.tip, target, motion), belief.tip, belief.tensions, low, high, level)
        stages, plans = rows.solved(), rows.plans
        for number in range(self.settings.solves):
            ends = number == self.settings.solves - 1
            self._improve(stages, goals, plans, self._weights, number == 0, ends)
            if not ends:
                stages = rows.solved()
        self._damping = plans.damping.copy()
        self._moves[:, :-1], self._moves[:, -1] = plans.moves[:, 1:], 0.0
        self._angles[:, :-1], self._angles[:, -1] = plans.angles[:, 1:], plans.angles[:, -1]
        return plans.moves[:, 0].copy()

    def _rows_of(self, belief: PlanStart) -> _PlanRows:
        """The arrays of so many episodes, with the first plans in them: those of the last step go on."""
        (count, n_loads), N = belief.loads.shape[:2], self.settings.horizon
        if (count, n_loads) not in self._rows:
            self._rows = {(count, n_loads): _PlanRows(self.task, count, n_loads, N)}
        rows = self._rows[count, n_loads]
        rows.plans.trial[:], rows.plans.damping[:] = self._moves, self._damping
        commands = rows.laws.command.reshape(count, N + 1, -1)
        commands[:, 0] = belief.commands
        np.cumsum(self._moves, axis=1, out=commands[:, 1:])
        commands[:, 1:] += belief.commands[:, None]
        rows.laws.stiffness.reshape(count, N + 1, -1)[:] = belief.stiffnesses[:, None]
        np.multiply(belief.loads[:, None], self._scale, out=rows.loads.reshape(count, N + 1, n_loads, -1))
        starts = rows.starts.reshape(count, N + 1, -1)
        starts[:, 0] = belief.angles
        np.copyto(starts[:, 1:], np.where(np.isnan(self._angles), belief.angles[:, None], self._angles))
        return rows

    def _targets(self, tip: Array, target: Array, motion: Array) -> Array:
        """Where the tip should be after every step, (B, N, d) [mm]: it keeps a share of its error in each."""
        settings, steps = self.settings, np.arange(1.0, self.settings.horizon + 1)
        shares = settings.bend**steps
        turn, self._motion = motion - self._motion, motion
        ahead = steps[:, None] * motion[:, None] + np.cumsum(np.cumsum(shares))[:, None] * turn[:, None]
        kept = ((1.0 - self.feedback.gain) ** steps)[:, None] * (target - tip)[:, None]
        return np.ascontiguousarray(target[:, None] + ahead - kept)


@dataclass(frozen=True)
class MpcFeedbackSettings(Settings):
    """Settings of Mpc and PrivilegedMpc: of the plans, their weights, and how motors cross their play.

    The defaults are the best of 66 tries over the six tasks of a planar chain whose poses are measured, 40 tuning seeds
    each: the geometric mean of the error over that of JacobianFeedback is 0.75.
    """

    _NESTED: ClassVar[dict[str, type[Settings]]] = {"mpc": MpcSettings, "feedback": FeedbackSettings}
    mpc: MpcSettings = field(default_factory=MpcSettings)
    feedback: FeedbackSettings = field(default_factory=lambda: FeedbackSettings(0.834, 0.114, 0.299))

    def __post_init__(self) -> None:
        self._check_nested(self._NESTED)


class Mpc(JacobianFeedback):
    """Predictive control from measured poses.

    Args:
        settings: of the plans, and of feedback.
    """

    def __init__(self, settings: MpcFeedbackSettings | None = None) -> None:
        self.mpc = settings or MpcFeedbackSettings()
        super().__init__(self.mpc.feedback)

    def bind(self, task: TrackingTask | None) -> None:
        """Take over the task, and its model."""
        super().bind(task)
        self.planner = Planner(self.task, self.mpc.mpc, self.settings)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,), without plans."""
        super().reset(mask)
        self.planner.reset(mask)

    def act(self, observations: Any) -> Array:
        """The first moves of the plans, (B, m)."""
        reading = self.read(observations)
        self.play.follow(reading.commands)
        motion = self.motion.since_last(reading.target)
        belief = self.belief(reading)
        level = _level(belief.tensions, self.measured.stiffens)
        tendons = self.planner.moves(belief, reading.target, motion, self.tension_range, level)
        return pulling_in(self.play.motor_moves(tendons), self.task.config.action_scale_mm)

    def belief(self, reading: Reading) -> PlanStart:
        """The measured pose, and the load that explains it."""
        mechanism, tensions = self.task.mechanism, reading.tensions
        if self.task.dimension == 3 or self.mpc.mpc.estimated:
            return _belief_of(self.measured.loaded(reading)[0], reading.tip, tensions)
        stiff = np.broadcast_to(mechanism.stiffnesses, tensions.shape)
        commands, loads = balanced(mechanism, reading)
        return PlanStart(commands, stiff, loads, reading.joint_angles, reading.tip, tensions)


class PrivilegedMpc(PrivilegedFeedback):
    """Predictive control from the true pose, tensions and play, which no robot measures.

    Args:
        settings: of the plans, and of feedback.
    """

    def __init__(self, settings: MpcFeedbackSettings | None = None) -> None:
        self.mpc = settings or MpcFeedbackSettings(feedback=FeedbackSettings(dead_band_mm=0.02))
        super().__init__(self.mpc.feedback)

    def bind(self, task: TrackingTask | None) -> None:
        """Take over the task, and its model."""
        super().bind(task)
        self.planner = Planner(self.task, self.mpc.mpc, self.settings)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,), without plans."""
        super().reset(mask)
        self.planner.reset(mask)

    def tendon_moves(self, reading: Reading, truth: Truth, model: Solution) -> Array:
        """Moves of the tendons, (B, m) [mm]."""
        belief = _belief_of(model, reading.target - truth.error, truth.tensions)
        motion, level = self.motion.since_last(reading.target), _level(belief.tensions, self.measured.stiffens)
        return self.planner.moves(belief, reading.target, motion, self.tension_range, level)


def _belief_of(model: Solution, tip: Array, tensions: Array) -> PlanStart:
    """The belief of a model at measurements."""
    stiff = np.broadcast_to(model.mechanism.stiffnesses, tensions.shape)
    return PlanStart(unstretched(model), stiff, model.loads, model.joint_angles, tip, tensions)


def _level(tensions: Array, stiffens: bool) -> Array:
    """The mean tension to go for, (B,) [N]: that of now where higher ones do not stiffen."""
    return np.full(len(tensions), np.nan) if stiffens else tensions.mean(axis=1)


@dataclass(frozen=True)
class FilterMpcSettings(FilterFeedbackSettings):
    """Settings of FilterMpc."""

    _NESTED: ClassVar[dict[str, type[Settings]]] = FilterFeedbackSettings._NESTED | {"mpc": MpcSettings}
    mpc: MpcSettings = field(default_factory=MpcSettings)


@dataclass(frozen=True)
class SmootherMpcSettings(SmootherFeedbackSettings):
    """Settings of SmootherMpc."""

    _NESTED: ClassVar[dict[str, type[Settings]]] = SmootherFeedbackSettings._NESTED | {"mpc": MpcSettings}
    mpc: MpcSettings = field(default_factory=MpcSettings)


class _FromEstimates(FilterFeedback):
    """Predictive control from an estimate, whose hidden numbers `belief` puts into the model."""

    settings: Any

    def bind(self, task: TrackingTask | None) -> None:
        """Take over the task, and its model."""
        super().bind(task)
        self.planner = Planner(self.task, self.settings.mpc, self.settings.feedback)

    def reset(self, mask: Mask) -> None:
        """Begin episodes, (B,), without plans."""
        super().reset(mask)
        self.planner.reset(mask)

    @abstractmethod
    def belief(self, estimate: Estimate) -> PlanStart:
        """The model of the estimate."""

    def motor_moves(self, reading: Reading, estimate: Estimate) -> Array:
        """Moves of the motors that make the first moves of the plans, (B, m) [mm]."""
        settings, count = self.settings.feedback, len(estimate.tip)
        motion = self.motion.since_last(reading.target)
        level = np.full(count, np.nan if self.bank.model.stiffens else settings.rest_tension)
        belief = self.belief(estimate)
        tendons = self.planner.moves(belief, reading.target, motion, self.limits, level)
        motors = np.empty_like(tendons)
        play = estimate.played, reading.commands, estimate.half_widths
        cross_play(tendons, *play, settings.dead_band_mm, settings.crossing, motors)
        return motors


class FilterMpc(_FromEstimates):
    """Predictive control from a bank of filters: its mean tip and tensions, and the model of its most likely filter.

    Args:
        settings: of the bank, of the plans and of feedback.
    """

    def __init__(self, settings: FilterMpcSettings | None = None) -> None:
        super().__init__(settings or FilterMpcSettings())

    def belief(self, estimate: Estimate) -> PlanStart:
        """The model of the most likely filter."""
        bank, at = self.bank, self.bank.model.places
        count, H = bank.weights.shape
        best = np.arange(count) * H + bank.weights.argmax(axis=1)
        states = bank.belief.states
        commands = bank.belief.play.played[best] + states[best, at.offsets : at.stiffnesses]
        stiff = self.task.mechanism.stiffnesses * np.exp(states[best, at.stiffnesses : at.bias])
        loads = bank.model.load_tables(states)[best]
        return PlanStart(commands, stiff, loads, bank.belief.angles[best], estimate.tip, estimate.tensions)


class SmootherMpc(_FromEstimates, SmootherFeedback):
    """Predictive control from a smoother's fit, or the bank's estimate where that has failed.

    Args:
        settings: of the smoother and its bank, of the plans and of feedback.
    """

    def __init__(self, settings: SmootherMpcSettings | None = None) -> None:
        SmootherFeedback.__init__(self, settings or SmootherMpcSettings())

    def belief(self, estimate: Estimate) -> PlanStart:
        """The nominal mechanism under the fitted numbers."""
        numbers, smoother = self.smoothed.numbers, self.smoother
        at = smoother.prior.layout
        commands = estimate.played + numbers[:, at.offsets : at.stiffnesses]
        stiff = self.task.mechanism.stiffnesses * numbers[:, at.stiffnesses : at.half_widths]
        if isinstance(smoother, ArmSmoother):
            loads = smoother.load_tables(numbers)
        else:
            loads = np.zeros((len(numbers), 1, len(LOAD_COLUMNS)))
            loads[:, 0, _LINK], loads[:, 0, _FX : _FX + 2] = smoother.links, numbers[:, :2]
        return PlanStart(commands, stiff, loads, smoother.joint_angles, estimate.tip, estimate.tensions)
