"""The arrays of the smoother's kernels: model, history of an episode, and rows of hidden numbers that follow it."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint.compiled import (
    Floats,
    Integers,
)
from rollingjoint.estimate.hidden import HiddenLayout
from rollingjoint.estimate.surfaces import SurfaceTables
from rollingjoint.kernels.rolling import Chain, State


class MeasurementLaw(NamedTuple):
    """What is known of the measurements, and how far they may be off; numbers.

    start_tension: of all tendons before the load acts [N]. start_sd: of the lengths that follow from it, where motors
    were set without their offsets [mm]; inf: they were not. shown_sd: of that tension, where load cells showed it when
    motors were set, which a first, unloaded step of the history stands for [N]; inf: there is none.
    low, high: tensions at which motors take their tendons along; inf: not known [N]. limit_sd: of these tensions; inf:
    they are not used. cells_at_tendons: whether load cells are behind the sheath.
    memory: share of the force that stays from step to step; 1: all of it.
    angle_sd, position_sd: of the links in a picture [rad, mm].
    tension_sd: of a measured tension [N]. tension_share: the same in proportion to it. robust: standard deviations
    beyond which a residual counts linearly.
    """

    start_tension: float
    start_sd: float
    shown_sd: float
    low: float
    high: float
    limit_sd: float
    cells_at_tendons: bool
    tension_sd: float
    tension_share: float
    robust: float
    memory: float = 1.0
    angle_sd: float = 0.01
    position_sd: float = 0.5


class Model(NamedTuple):
    """The nominal chain, the law of its measurements, and moments of P priors of the hidden numbers."""

    chain: Chain
    tables: SurfaceTables
    law: MeasurementLaw
    at: HiddenLayout
    stiffnesses: Annotated[Floats, "m"]
    means: Annotated[Floats, "P", "K"]
    sds: Annotated[Floats, "P", "K"]


class MotorHistory(NamedTuple):
    """What N episodes have measured in up to T steps."""

    counts: Annotated[Integers, "N"]  # of the steps
    motors: Annotated[Floats, "N", "T", "m"]  # their positions, mm
    shifts: Annotated[Floats, "N", "T", "m"]  # how far motors have given way in a step, mm
    tensions: Annotated[Floats, "N", "T", "m"]  # measured, N
    pictures: Annotated[Floats, "N", "T", "links", 3]  # x, y, angle of the moving links, mm, rad; NaN where none is


class Track(NamedTuple):
    """Rows of hidden numbers, how far they have been followed, and the normal equations of what was measured.

    Changes of hidden numbers are in units of their standard deviations in the normal equations.
    """

    episodes: Annotated[Integers, "R"]
    links: Annotated[Integers, "R"]  # the loaded ones
    priors: Annotated[Integers, "R"]  # index of the prior
    numbers: Annotated[Floats, "R", "K"]
    steps: Annotated[Integers, "R"]  # that have been followed
    played: Annotated[Floats, "R", "m"]  # commands of the tendons behind the play, mm
    by_width: Annotated[Floats, "R", "m"]  # their derivatives by half the width,
    by_place: Annotated[Floats, "R", "m"]  # and by where the motor began
    angles: Annotated[Floats, "R", "J"]  # of the equilibrium, from which the next solve starts, rad
    information: Annotated[Floats, "R", "K", "K"]  # lower triangle
    slope: Annotated[Floats, "R", "K"]
    cost: Annotated[Floats, "R"]
    misfit: Annotated[Floats, "R"]  # the part of the cost that measurements have
    tip: Annotated[Floats, "R", 2]  # mm
    tip_by: Annotated[Floats, "R", 2, "K"]
    tensions: Annotated[Floats, "R", "m"]  # N
    tensions_by: Annotated[Floats, "R", "m", "K"]
    volume: Annotated[Floats, "R"]  # half the logarithm of the determinant of the eliminated information
    forces: Annotated[Floats, "R", "times", 2]  # in every step, NaN where not known; none where it stays as it is, N
    forward: Annotated[Floats, "R", "times", 2, "K"]  # the change of a force by those of the next one and all others,
    alone: Annotated[Floats, "R", "times", 2]  # and without any


class Scratch(NamedTuple):
    """Room for the derivatives of one row."""

    state: State
    H: Annotated[Floats, "J", "J"]
    causes: Annotated[Floats, "J", "causes"]  # torques by force, commands and surfaces; then joint angles
    values: Annotated[Floats, "J", "rates"]  # of the surface tables,
    slopes: Annotated[Floats, "J", "rates"]  # and their derivatives by the joint's angle
    rates: Annotated[Floats, "m", "causes"]  # of tensions; of lengths before
    column: Annotated[Floats, "K"]  # of one measurement, by the hidden numbers


def empty_track(
    episodes: np.ndarray,
    links: np.ndarray,
    priors: np.ndarray,
    numbers: np.ndarray,
    angles: np.ndarray,
    m: int,
    forces: np.ndarray,
) -> Track:
    """Rows of hidden numbers (R, K) and forces (R, T, 2), to be followed from the start."""
    (R, K), times = numbers.shape, forces.shape[1]
    return Track(
        episodes, links, priors, numbers, np.zeros(R, np.int64),
        np.zeros((R, m)), np.zeros((R, m)), np.zeros((R, m)), angles,
        np.zeros((R, K, K)), np.zeros((R, K)), np.zeros(R), np.zeros(R),
        np.zeros((R, 2)), np.zeros((R, 2, K)), np.zeros((R, m)), np.zeros((R, m, K)),
        np.zeros(R), forces, np.zeros((R, times, 2, K)), np.zeros((R, times, 2)),
    )  # fmt: skip
