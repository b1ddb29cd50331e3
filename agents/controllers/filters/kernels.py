"""The formulas of a bank of Kalman filters, compiled; one row per episode and hypothesis.

A state is, in this order: the load (L numbers, as of the model), the offset of every commanded length (m) [mm], the
logarithm of every tendon's stiffness over the model's (m), how far the true tip is from the model's (d) [mm], half the
width of every tendon's play (m) [mm], its sheath friction (m), how far it began from where the hypothesis has it in the
play (m) [mm].
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, Self

import numpy as np

from agents.controllers.kernels import eliminate
from rollingjoint.compiled import NARROW, Floats, kernel, part, play_contact, play_place, play_step, sheath_ratio

SINGULAR = 1e-9  # N·mm/rad: a stable equilibrium has no pivots below


class StateLayout(NamedTuple):
    """Where in a state its parts begin; the load is at 0."""

    offsets: int
    stiffnesses: int
    bias: int
    half_widths: int
    frictions: int
    starts: int
    total: int

    @classmethod
    def of(cls, load: int, m: int, d: int) -> Self:
        """The layout for L numbers of a load, m tendons and tips with d coordinates."""
        bias = load + 2 * m
        return cls(load, load + m, bias, bias + d, bias + d + m, bias + d + 2 * m, bias + d + 3 * m)


class Play(NamedTuple):
    """Where tendons are in their play, R rows."""

    played: Annotated[Floats, "R", "m"]  # commands of the tendons behind the play, mm
    by_width: Annotated[Floats, "R", "m"]  # their derivatives by half the width,
    by_place: Annotated[Floats, "R", "m"]  # and by where they began


class ModelEquilibria(NamedTuple):
    """Equilibria of the model, R rows, and the parts of their derivatives."""

    usable: Annotated[Floats, "R"]  # bool
    free: Annotated[Floats, "R", "J"]  # bool: joints that are not at a limit
    stiffness: Annotated[Floats, "R", "J", "J"]  # N·mm/rad
    rates: Annotated[Floats, "R", "J", "m"]  # d length / d joint angle, mm/rad
    elastic: Annotated[Floats, "R", "m"]  # d tension / d length, N/mm
    tensions: Annotated[Floats, "R", "m"]  # N
    tips: Annotated[Floats, "R", "d"]  # mm


class Levers(NamedTuple):
    """Joint torques by loads, and the tip by joint angles; every model fills them in its own way."""

    loads: Annotated[Floats, "R", "J", "L"]  # d joint torque / d load, N·mm per its unit
    tips: Annotated[Floats, "R", "d", "J"]  # d tip / d joint angle, mm/rad


class Derivatives(NamedTuple):
    """How link angles, tensions and the tip of an equilibrium change with the state."""

    angles: Annotated[Floats, "R", "J", "states"]  # none where the model's pictures show none
    tensions: Annotated[Floats, "R", "m", "states"]
    tip: Annotated[Floats, "R", "d", "states"]


@kernel(nogil=True, title="the controllers' filters")
def linearise(solved, levers, play, stiffnesses, at, linear):
    """Fill the derivatives; zero where an equilibrium is not usable, so that no state changes there.

    stiffnesses: of the tendons of every row, (R, m) [N/mm]. at: StateLayout.
    """
    n_rows, n_joints, m = solved.rates.shape
    causes = at.offsets + m
    system = np.empty((n_joints, n_joints + causes))
    response = system[:, n_joints:]
    for row in range(n_rows):
        linear.angles[row], linear.tensions[row], linear.tip[row] = 0.0, 0.0, 0.0
        if solved.usable[row]:
            _fill_system(solved, levers, row, system)
            if eliminate(system, n_joints, SINGULAR):
                _spread(solved, levers, linear, response, row)
                _spread_tendons(solved, play, stiffnesses, at, linear, row)


@part
def _fill_system(solved, levers, row, system):
    """Stiffness, and right of it the joint torques by load and commands; joints at a limit stay there."""
    n_joints, m = solved.rates.shape[1:]
    n_loads = levers.loads.shape[2]
    for i in range(n_joints):
        for k in range(n_joints):
            joints_free = solved.free[row, i] and solved.free[row, k]
            system[i, k] = solved.stiffness[row, i, k] if joints_free else (1.0 if i == k else 0.0)
        free = 1.0 if solved.free[row, i] else 0.0
        for c in range(n_loads):
            system[i, n_joints + c] = free * levers.loads[row, i, c]
        for j in range(m):
            system[i, n_joints + n_loads + j] = free * solved.rates[row, i, j] * solved.elastic[row, j]


@part
def _spread(solved, levers, linear, response, row):
    """From d joint angles / d (load, commands) to the derivatives of a row by both."""
    n_joints, m = solved.rates.shape[1:]
    n_loads = levers.loads.shape[2]
    for c in range(response.shape[1]):
        angle = 0.0
        for i in range(n_joints):
            turn = response[i, c]
            if linear.angles.shape[1] > 0:
                angle += turn
                linear.angles[row, i, c] = angle
            for axis in range(levers.tips.shape[1]):
                linear.tip[row, axis, c] += levers.tips[row, axis, i] * turn
            for j in range(m):
                linear.tensions[row, j, c] += solved.elastic[row, j] * solved.rates[row, i, j] * turn
    for j in range(m):
        linear.tensions[row, j, n_loads + j] -= solved.elastic[row, j]


@part
def _spread_tendons(solved, play, stiffnesses, at, linear, row):
    """From the derivatives of a row by commands to derivatives by stiffness, play and the bias of the tip."""
    for j in range(solved.tensions.shape[1]):
        stretch = solved.tensions[row, j] / stiffnesses[row, j]  # a stiffer tendon acts like one that is pulled in
        for values in (linear.angles, linear.tensions, linear.tip):
            for i in range(values.shape[1]):
                by_command = values[row, i, at.offsets + j]
                values[row, i, at.stiffnesses + j] = -stretch * by_command
                values[row, i, at.half_widths + j] = play.by_width[row, j] * by_command
                values[row, i, at.starts + j] = play.by_place[row, j] * by_command
    for axis in range(linear.tip.shape[1]):
        linear.tip[row, axis, at.bias + axis] = 1.0


@kernel(nogil=True, title="the controllers' filters")
def expect_tensions(solved, linear, play, states, motors, at, expected, columns):
    """Fill the tensions that motors measure behind the friction of the sheaths, (R, m) [N], and their derivatives.

    NaN, and derivatives of zero, where an equilibrium is not usable.

    motors: their positions, (N, m) [mm]; the hypotheses of an episode are adjacent. at: StateLayout.
    """
    n_rows, m = solved.tensions.shape
    hypotheses = n_rows // len(motors)
    for row in range(n_rows):
        if not solved.usable[row]:
            expected[row], columns[row] = math.nan, 0.0
            continue
        for j in range(m):
            half, friction = states[row, at.half_widths + j], states[row, at.frictions + j]
            place = play_place(play.played[row, j], motors[row // hypotheses, j], half if half > NARROW else 0.0)
            factor = sheath_ratio(friction, place)
            expected[row, j] = factor * solved.tensions[row, j]
            for i in range(columns.shape[2]):
                columns[row, j, i] = factor * linear.tensions[row, j, i]
            if half > NARROW:
                pull = friction * expected[row, j] / half
                columns[row, j, at.half_widths + j] += pull * (play.by_width[row, j] - place)
                columns[row, j, at.frictions + j] += expected[row, j] * place
                columns[row, j, at.starts + j] += pull * play.by_place[row, j]


@kernel(nogil=True, title="the controllers' filters")
def move_play(play, states, motors, at):
    """Move tendons on as motors (N, m) [mm] take them along, in place: the play operator of every row."""
    n_rows, m = play.played.shape
    hypotheses = n_rows // len(motors)
    for row in range(n_rows):
        for j in range(m):
            half, motor = states[row, at.half_widths + j], motors[row // hypotheses, j]
            side = play_contact(play.played[row, j], motor, half)
            if side != 0.0:
                play.played[row, j] = play_step(play.played[row, j], motor, half)
                play.by_width[row, j], play.by_place[row, j] = side, 0.0


@kernel(nogil=True, title="the controllers' filters")
def correct_play(play, changes, at):
    """Tendons are elsewhere where the states of their play have changed, (R, states); in place."""
    n_rows, m = play.played.shape
    for row in range(n_rows):
        for j in range(m):
            play.played[row, j] += play.by_width[row, j] * changes[row, at.half_widths + j]
            play.played[row, j] += play.by_place[row, j] * changes[row, at.starts + j]
