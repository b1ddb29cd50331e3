"""Moves of tendons and motors on an estimate, compiled, one episode after the other."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from rollingjoint.compiled import Floats, kernel, part, play_inverse, play_step

ROUNDING = 1e-10  # of a hessian's trace, added to its diagonal: near a snap-through responses grow without bound
PASSES = 3  # after which hardly a tension changes sides of its limit
SWEEPS = 2  # over the motors
IDLE = 0.01  # cost of a move that only crosses play, as a share of one that moves its tendon


class Outlook(NamedTuple):
    """The estimate of a bank for B episodes with H hypotheses each, R = B x H rows."""

    weights: Annotated[Floats, "B", "H"]
    errors: Annotated[Floats, "B", "H", "d"]  # target minus tip, mm
    tips: Annotated[Floats, "R", "d", "m"]  # d tip / d command
    played: Annotated[Floats, "R", "m"]  # commands behind the play, mm
    half_widths: Annotated[Floats, "R", "m"]  # of the play, mm
    motors: Annotated[Floats, "B", "m"]  # their positions, mm
    tensions: Annotated[Floats, "B", "m"]  # means, N
    tensions_by_command: Annotated[Floats, "B", "m", "m"]  # N/mm


@kernel(nogil=True, title="the controllers")
def damped_increments(tips, tensions, now, way, goals, low, high, limit, stiffen, damping, far, keep, moves):
    """Fill moves (B, m) [mm], the damped increments within +-limit of JacobianFeedback.

    Args:
        tips, tensions: derivatives by increments, (B, d, m) [mm/mm], (B, m, m) [N/mm].
        now, goals: tensions, (B, m) [N]. low, high: their limits, (B, m) [N].
        way: (B, d) [mm] that the tip should go.
        stiffen, damping, far, keep: weights as of FeedbackSettings.
    """
    m = moves.shape[1]
    free, hessian, slope = np.empty((m, m)), np.empty((m, m)), np.empty(m)
    weights, changes = np.empty(m), np.empty(m)
    for b in range(len(moves)):
        distance = _product(way[b], way[b])
        for i in range(m):
            for k in range(m):
                free[i, k] = _product(tips[b, :, i], tips[b, :, k])
            free[i, i] += damping**2 + far**2 * distance
            weights[i], changes[i] = stiffen**2, goals[b, i] - now[b, i]
        for _ in range(PASSES):
            trace = 0.0
            for i in range(m):
                slope[i] = -_product(tips[b, :, i], way[b])
                for j in range(m):
                    slope[i] -= tensions[b, j, i] * weights[j] * changes[j]
                for k in range(m):
                    hessian[i, k] = free[i, k]
                    for j in range(m):
                        hessian[i, k] += tensions[b, j, i] * weights[j] * tensions[b, j, k]
                trace += hessian[i, i]
            for i in range(m):
                hessian[i, i] += ROUNDING * trace
            _bounded_step(hessian, slope, limit, moves[b])
            for j in range(m):
                after = now[b, j]
                for i in range(m):
                    after += tensions[b, j, i] * moves[b, i]
                clipped = min(max(after, low[b, j]), high[b, j])
                if after != clipped:
                    weights[j], changes[j] = keep**2, clipped - now[b, j]


@part
def _product(a, b):
    """a · b."""
    value = 0.0
    for k in range(len(a)):
        value += a[k] * b[k]
    return value


@part
def _bounded_step(hessian, slope, limit, step):
    """The step of responses.bounded_step within +-limit."""
    m = len(step)
    held, system = np.zeros(m), np.empty((m, m + 1))
    solution = system[:, m]
    step[:] = 0.0
    for _ in range(m):
        for i in range(m):
            solution[i] = -slope[i]
            for k in range(m):
                fixed = held[i] > 0.0 or held[k] > 0.0
                system[i, k] = (1.0 if i == k else 0.0) if fixed else hessian[i, k]
                if held[k] > 0.0:
                    solution[i] -= hessian[i, k] * step[k]
        for i in range(m):
            if held[i] > 0.0:
                solution[i] = 0.0
        eliminate(system, m, -np.inf)  # positive definite
        for i in range(m):
            if held[i] == 0.0:
                step[i] = min(max(solution[i], -limit), limit)
                held[i] = 1.0 if step[i] != solution[i] else 0.0


@part
def eliminate(system, n, least):
    """Solve n equations in place: columns from n on become the solutions; False where a pivot is at most `least`."""
    width = system.shape[1]
    for i in range(n):
        if not system[i, i] > least:
            return False
        for k in range(i + 1, n):
            factor = system[k, i] / system[i, i]
            for c in range(i + 1, width):
                system[k, c] -= factor * system[i, c]
    for i in range(n - 1, -1, -1):
        for c in range(n, width):
            for k in range(i + 1, n):
                system[i, c] -= system[i, k] * system[k, c]
            system[i, c] /= system[i, i]
    return True


@kernel(nogil=True, title="the controllers")
def cross_play(tendon_moves, played, motors, half_widths, dead_band, crossing, moves):
    """Fill moves (B, m) [mm] of the motors that move the tendons behind their play by `tendon_moves`.

    Args:
        tendon_moves: (B, m) [mm]; moves within +-dead_band do not cross the play.
        played, motors: commands of tendons and motors, (B, m) [mm]. half_widths: of the play, (B, m) [mm].
        crossing: share of the half width by which a motor goes ahead of its tendon.
    """
    for b in range(len(moves)):
        for j in range(moves.shape[1]):
            way = tendon_moves[b, j]
            if abs(way) > dead_band:
                moves[b, j] = play_inverse(played[b, j], way, crossing * half_widths[b, j]) - motors[b, j]
            else:
                moves[b, j] = way


@kernel(nogil=True, title="the controllers")
def look_ahead(outlook, goals, weights, reach, points, moves):
    """Improve moves (B, m) [mm] of motors towards the least expected cost, each within +-reach.

    The cost is the mean square of the tip error over the hypotheses, plus the costs of tensions off their goals
    and of the moves. One motor after the other goes to the best move of a grid, then of a finer one there.

    Args:
        outlook: see Outlook.
        goals: tensions, (B, m) [N].
        weights: stiffen, damping, and the lowest and highest tension, beyond which the weight is the last number.
        points: of a grid on either side of its middle.
    """
    n_episodes, m = moves.shape
    for b in range(n_episodes):
        for _ in range(SWEEPS):
            for j in range(m):
                for width in (reach, reach / points):
                    _best_of_grid(outlook, b, goals[b], weights, reach, width, points, moves[b], j)


@part
def _best_of_grid(outlook, b, goals, weights, reach, width, points, move, j):
    """Move motor j of an episode to the best of a grid; the coarse one lies around 0, the fine one around the move."""
    middle = 0.0 if width == reach else move[j]
    best, lowest = move[j], _cost(outlook, b, goals, weights, move)
    for step in range(-points, points + 1):
        move[j] = min(max(middle + width * step / points, -reach), reach)
        cost = _cost(outlook, b, goals, weights, move)
        if cost < lowest:
            best, lowest = move[j], cost
    move[j] = best


@part
def _cost(outlook, b, goals, weights, move):
    """The expected cost after a move of the motors of an episode [mm²]."""
    stiffen, damping, low, high, keep = weights
    n_hypotheses, m = outlook.weights.shape[1], len(move)
    mean, error, cost = np.zeros(m), np.empty(outlook.errors.shape[2]), 0.0
    for h in range(n_hypotheses):
        row, weight = b * n_hypotheses + h, outlook.weights[b, h]
        error[:] = outlook.errors[b, h]
        for j in range(m):
            motor, half, before = outlook.motors[b, j] + move[j], outlook.half_widths[row, j], outlook.played[row, j]
            change = play_step(before, motor, half) - before
            mean[j] += weight * change
            for axis in range(len(error)):
                error[axis] -= outlook.tips[row, axis, j] * change
        cost += weight * _product(error, error)
    for j in range(m):
        after = outlook.tensions[b, j]
        for k in range(m):
            after += outlook.tensions_by_command[b, j, k] * mean[k]
        excess = min(after - low, 0.0) + max(after - high, 0.0)
        cost += (stiffen * (goals[j] - after)) ** 2 + (keep * excess) ** 2
        cost += damping**2 * (mean[j] ** 2 + IDLE * move[j] ** 2)
    return cost
