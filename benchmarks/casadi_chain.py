"""The inverse of `rollingjoint.two_segment()` as a program for IPOPT, written out in CasADi: an opponent and an oracle.

Needs CasADi: pip install casadi
"""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

import rollingjoint as rj

HEIGHT, RADIUS, HALF_WIDTH = 15.0, 20.0, 12.0  # mm, as two_segment's
ENDS, HOLES = (3, 3, 6, 6), (-9.0, 9.0, -6.0, 6.0)  # links at which its tendons end; their holes on the arcs [mm]
JOINTS = max(ENDS)


class CasadiInverse:
    """Joint angles and tensions at which the chain is in equilibrium with its tip at a target, by least tensions.

    Args:
        force: on the tip [N]. limits: of the tensions [N].
    """

    def __init__(self, force: tuple[float, float], limits: tuple[float, float]) -> None:
        angles, tensions, target = (casadi.SX.sym(name, n) for name, n in (("phi", JOINTS), ("tau", 4), ("target", 2)))
        tip, lengths = _tip_and_lengths(angles)
        energy = casadi.dot(tensions, lengths) - casadi.dot(casadi.DM(force), tip)
        residual = casadi.gradient(energy, angles)
        self.equilibrium = casadi.Function("equilibrium", [angles, tensions], [tip, residual])
        program = {
            "x": casadi.vertcat(angles, tensions),
            "p": target,
            "f": casadi.sumsqr(tensions - limits[0]),
            "g": casadi.vertcat(residual, tip - target),
        }
        quiet = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-9}
        self._solver = casadi.nlpsol("inverse", "ipopt", program, quiet)
        turn = 2.0 * HALF_WIDTH / RADIUS
        self._bounds = {
            "lbx": [-turn] * JOINTS + [limits[0]] * 4,
            "ubx": [turn] * JOINTS + [limits[1]] * 4,
            "lbg": 0.0,
            "ubg": 0.0,
        }
        self._start = [0.0] * JOINTS + [0.5 * sum(limits)] * 4

    def solve(self, target: NDArray[Any]) -> tuple[bool, NDArray[Any], NDArray[Any]]:
        """Whether IPOPT has converged, joint angles [rad] and tensions [N]."""
        found = np.array(self._solver(x0=self._start, p=target, **self._bounds)["x"]).ravel()
        return bool(self._solver.stats()["success"]), found[:JOINTS], found[JOINTS:]

    def deviation(self, solved: rj.Equilibrium) -> float:
        """How far this model is from an equilibrium of ours: tip [mm] and residual [N·mm], the larger one."""
        tip, residual = self.equilibrium(solved.joint_angles, solved.tensions)
        return float(max(np.abs(np.array(tip).ravel() - solved.tip).max(), np.abs(np.array(residual)).max()))


def _tip_and_lengths(angles: Any) -> tuple[Any, Any]:
    """Position of the last link [mm], and lengths of the tendons between the surfaces [mm]."""
    centre = RADIUS - 0.5 * HEIGHT  # of a link's lower arc above its origin, and of its upper arc below
    turn, tip, lengths = 0.0, casadi.SX.zeros(2), [0.0] * len(ENDS)
    for joint in range(JOINTS):
        angle = angles[joint]
        apart = 2.0 * RADIUS * _up(0.5 * angle)  # from the parent's centre to the child's
        for tendon, (end, hole) in enumerate(zip(ENDS, HOLES, strict=True)):
            if joint < end:
                at = RADIUS * np.array([np.sin(hole / RADIUS), np.cos(hole / RADIUS)])
                below, above = casadi.DM(at), _turned(casadi.DM([at[0], -at[1]]), angle)
                lengths[tendon] += casadi.norm_2(apart + above - below)
        tip += -centre * _up(turn) + 2.0 * RADIUS * _up(turn + 0.5 * angle) - centre * _up(turn + angle)
        turn += angle
    return tip, casadi.vertcat(*lengths)


def _up(angle: Any) -> Any:
    """The y axis of a link that has turned by `angle`."""
    return casadi.vertcat(-casadi.sin(angle), casadi.cos(angle))


def _turned(vector: Any, angle: Any) -> Any:
    """A vector of a link that has turned by `angle`."""
    c, s = casadi.cos(angle), casadi.sin(angle)
    return casadi.vertcat(c * vector[0] - s * vector[1], s * vector[0] + c * vector[1])
