"""Calibration of a rig: signs of motors, homing by tension, and guarded sweeps on the bench."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from agents.rig.env import settle_tensions
from agents.rig.loop import Rig, RigState
from agents.rig.protocols import Array, RigError
from rollingjoint import solve_tensions
from rollingjoint.chain.chain import AnyChain
from rollingjoint.transmission import unstretched_length

HOME_TENSION = 3.0  # N
_TUG, _FELT, _LONGEST = 0.15, 0.6, 10.0  # mm a step, N, mm: to find a sign
_BENDS, _COMMON = (0.5, 1.0), (-0.05, 0.25)  # shares of the bend by which motors pull against each other, and together
_EASY = 0.6  # of the guard's upper tension, above which sweeps turn back
_SLACK = 1.5  # of the lower one, below which nobody lets out further


def wrong_signs(rig: Rig) -> list[int]:
    """Motors whose pulling in lowers the tension: their signs are wrong.

    Raises:
        RigError: a motor that changes no tension within 10 mm: a loose tendon, or a load cell of another one.
    """
    wrong = []
    for j in range(len(rig.goal)):
        first, moved = rig.state.tensions[j], 0.0
        while abs(change := float(rig.state.tensions[j] - first)) < _FELT:
            if moved >= _LONGEST:
                raise RigError(
                    f"motor {j} pulled in {moved:.1f} mm, and load cell {j} shows {first + change:.2f} N as before"
                )
            pull = np.zeros(len(rig.goal))
            pull[j] = _TUG
            rig.step(rig.goal - pull)
            moved += _TUG
        if change < 0.0:
            wrong.append(j)
        back = np.zeros(len(rig.goal))
        back[j] = _TUG
        for _ in range(round(moved / _TUG)):
            rig.step(rig.goal + back)
    return wrong


def home(rig: Rig, mechanism: AnyChain, tension: float = HOME_TENSION) -> tuple[RigState, Array]:
    """Bring all tendons to a tension; the state, and the lengths [mm] there of the mechanism as designed.

    These lengths are off by the unknown place in the play and by errors of the mechanism: offsets to rj identify.
    """
    tensions = np.full(mechanism.n_tendons, tension)
    state = settle_tensions(rig, tensions)
    solved = solve_tensions(mechanism, tensions)
    return state, unstretched_length(solved.lengths, tensions, mechanism.stiffnesses)


def bench(rig: Rig, steps: int, bend_mm: float = 8.0, seed: int = 0, say: Callable[[], object] = lambda: None) -> None:
    """Sweeps of motors to and fro about where they stand, a guarded step at a time, into the recording of the rig.

    A sweep turns back where a tension comes near the guard's upper one; a tendon near its lower one is not let out.

    Args:
        steps: in all. bend_mm: the farthest that motors go from the middle. seed: of the ends of sweeps.
        say: called at each step.
    """
    rng, m = np.random.default_rng(seed), len(rig.goal)
    limits, middle = rig.guard.settings, rig.goal.copy()
    signs, side = (-1.0) ** np.arange(m), 1.0
    end = middle.copy()
    for _ in range(steps):
        T, goal = rig.state.tensions, rig.goal
        blocked = (_SLACK * limits.low >= T) & (end > goal)
        arrived = np.abs(np.where(blocked, goal, end) - goal).max() < 1e-9
        if (_EASY * limits.high <= T).any() or arrived:
            end = middle + bend_mm * (side * rng.uniform(*_BENDS) * signs - rng.uniform(*_COMMON))
            side, blocked = -side, (_SLACK * limits.low >= T) & (end > goal)
        way = np.where(blocked, 0.0, np.clip(end - goal, -rig.step_mm, rig.step_mm))
        if (_EASY * limits.high <= T).any():
            way = np.maximum(way, 0.0)
        rig.step(goal + way)
        say()
