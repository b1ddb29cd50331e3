"""How the last step of a tracking task answers its motors: derivatives for learners that differentiate an episode."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.columns import TENSIONS, TIP
from rj_gym.tracking.arrays import BOUND, GAIN, IN_PLAY, LIMIT, MOTOR, STAYS, STOP, Hardware
from rj_gym.tracking.motors import AT_LIMIT
from rj_gym.tracking.solver import LaneSolver
from rj_gym.tracking.task import TrackingTask
from rollingjoint.chain.batch import free_joints, stiffnesses, tip_rates
from rollingjoint.transmission import at_limit, pull_limit

Array = NDArray[np.float64]

REACH = 1e-4  # mm: of the forward differences
FREE_OF_LIMITS = 100.0  # times the largest tension: of motors that never give way


class Tangent(NamedTuple):
    """The state of B lanes after a step, and how it answers the commands of the m tendons; fresh arrays.

    A tendon's command p follows the position q of its motor through play: |p - q| <= half_play. The motor measures
    T exp(sheath zeta), zeta = (p - q) / half_play. `held` tendons are at a tension limit and stay there: motors and
    commands move with their lengths, and have no effect. A limit at the motor can also end a pull while the tendon
    stays: in the play, where T exp(sheath zeta) is the limit, or at once, so that the motor stays.
    """

    motors: Array  # q, (B, m) mm
    commands: Array  # p, (B, m) mm
    tensions: Array  # T, (B, m) N
    tips: Array  # (B, d) mm
    poses: Array  # of the entries `TrackingTask.pictured`, (B, k), mm and 1
    half_play: Array  # (B, m) mm
    sheath: Array  # (B, m)
    held: NDArray[np.bool_]  # (B, m)
    stays: NDArray[np.bool_]  # (B, m): motors that stay, at their limit
    in_play: NDArray[np.bool_]  # (B, m): motors that their limit stopped in the play
    limits: Array  # (B, m) N: tensions at which motors that pull give way or stop
    cell_gains: Array  # (B, m): d measured tension / d tension where the load cell is
    cell_sheath: Array  # (B, m): `sheath` between tendon and load cell
    tip_rates: Array  # d tip / d command, (B, d, m) mm/mm
    pose_rates: Array  # d pose / d command, (B, k, m) mm/mm, 1/mm
    tension_rates: Array  # d tension / d command, (B, m, m) N/mm
    length_rates: Array  # d length / d command, (B, m, m) mm/mm


def tangent_of(task: TrackingTask, solver: LaneSolver, state: Any, hardware: Hardware, offsets: Array) -> Tangent:
    """The Tangent of the first lanes; solves them anew from where they are, without an effect on later steps.

    With friction, of steps that would follow: holes that stick go on sticking, the others sliding.

    Args:
        task, solver: of the lanes.
        state: where they are, a RunningEpisodes. hardware: their motors.
        offsets: added by motors to commands, (B, m) [mm]: of all lanes, or of the B first.
    """
    m, d, B = task.action_size, task.dimension, len(offsets)
    readings, hardware = state.readings[:B].copy(), Hardware._make(array[:B] for array in hardware)
    (low, highest), has_limits = task.config.tension_range, len(hardware.limits) > 0
    high = hardware.limits[:, BOUND] if has_limits else np.full((len(readings), m), highest)
    tensions, commands = readings[:, TENSIONS : TENSIONS + m], readings[:, TENSIONS + m : TENSIONS + 2 * m]
    limited = at_limit(tensions, low, high)
    solver.laws.low[:B] = np.where(limited, tensions, 0.0)  # tendons at a limit are held at it
    solver.laws.high[:B] = np.where(limited, tensions, FREE_OF_LIMITS * high)  # infinite where there is no limit
    rates = _rates(task, solver, state.angles[:B], commands + offsets)
    solver.laws.low[:B], solver.laws.high[:B] = low, high
    active, zeros = len(hardware.motors) > 0, np.zeros_like(tensions)
    sheath = hardware.sheath.copy() if active else zeros
    stops = hardware.limits[:, STOP] if has_limits else zeros
    return Tangent(
        motors=hardware.motors[:, MOTOR].copy() if active else commands,
        commands=commands,
        tensions=tensions,
        tips=readings[:, TIP : TIP + d],
        poses=task.pictured_values(state.poses[:B]),
        half_play=hardware.half_play.copy() if active else zeros,
        sheath=sheath,
        held=limited,
        stays=stops == STAYS,
        in_play=stops == IN_PLAY,
        limits=_pull_limits(task, hardware, high),
        cell_gains=hardware.cells[:, GAIN].copy() if len(hardware.cells) > 0 else np.ones_like(tensions),
        cell_sheath=zeros if task.config.sensing.tension_at == "tendon" else sheath,
        tip_rates=rates[:, :d],
        pose_rates=rates[:, d + 2 * m :],
        tension_rates=rates[:, d : d + m],
        length_rates=rates[:, d + m : d + 2 * m],
    )


def _pull_limits(task: TrackingTask, hardware: Hardware, high: Array) -> Array:
    """Tensions behind the sheath at which motors give way, or stop as they pull in, (B, m) [N]."""
    if task.config.actuation.limit_at == "motor":
        return np.asarray(pull_limit(hardware.limits[:, LIMIT], hardware.sheath, hardware.half_play))
    return high.copy()


def _rates(task: TrackingTask, solver: LaneSolver, angles: Array, held: Array) -> Array:
    """Tip, tensions, lengths and poses by d command, (B, d + 2 m + k, m), at commands `held`; 0 where unknown."""
    together = task.dimension == 3 and len(held) == len(solver.designs)
    rates = _implicit_rates(task, solver, angles, held) if together else None
    if rates is not None:
        return rates
    outputs, valid = [], np.ones(len(held), bool)
    for change in np.vstack([np.zeros(held.shape[1]), REACH * np.eye(held.shape[1])]):
        solver.solve_near(held + change, angles)
        results, count = solver.results, len(held)
        poses, tendons = results.poses[:count], (results.tensions[:count], results.lengths[:count])
        tips = task.tips(poses)[:, : task.dimension]
        outputs.append(np.hstack([tips, *tendons, task.pictured_values(poses)]))
        valid &= results.status[:count] <= AT_LIMIT
    forward = np.stack([(changed - outputs[0]) / REACH for changed in outputs[1:]], axis=-1)
    return np.where(valid[:, None, None], forward, 0.0)


def _implicit_rates(task: TrackingTask, solver: LaneSolver, angles: Array, held: Array) -> Array | None:
    """The rates of chains in space by the implicit function theorem: a linear system costs less than differences.

    None where they cannot be solved together, and at the edge of buckling.
    """
    batches = solver.batches()
    if len(batches) > 1:
        return None
    solver.solve_near(held, angles)
    results, eye = solver.results, np.eye(held.shape[1])
    H, torques = stiffnesses(task.mechanism.kernels, batches[0], solver.friction)
    valid, free = results.status <= AT_LIMIT, free_joints(batches[0])
    free &= valid[:, None]
    H = np.where(free[:, :, None] & free[:, None], H, np.eye(H.shape[1]))
    try:
        turns = np.linalg.solve(H, np.where(free[..., None], torques * results.elastic[:, None], 0.0))
    except np.linalg.LinAlgError:
        return None
    lengths = np.swapaxes(results.rates, 1, 2) @ turns
    tensions = results.elastic[..., None] * (lengths - eye)
    tips = tip_rates(task.mechanism.kernels, batches[0]) @ turns
    rates = np.concatenate([tips, tensions, lengths, tips[:, : len(task.pictured)]], axis=1)
    return np.where(valid[:, None, None], rates, 0.0)
