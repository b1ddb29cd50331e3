"""Reports of spatial arms and their equilibria: text, tables, JSON."""

from __future__ import annotations

import math
from typing import Any

from rollingjoint.spatial import se3
from rollingjoint.spatial.chain import HingeChain
from rollingjoint.spatial.equilibrium import HingeEquilibrium
from rollingjoint.tables import number_table

_DEGREES = 180.0 / math.pi


def travel(mechanism: HingeChain) -> str:
    """Range of its hinges, in words, and the tendon model if it is not the default."""
    low, high = mechanism.joint_limits[:, 0].min(), mechanism.joint_limits[:, 1].max()
    model = "" if mechanism.model == HingeChain.model else f", model {mechanism.model}"
    return f"hinges from {low:.3g} to {high:.3g} rad{model}"


def remark(found: HingeEquilibrium) -> str:
    """Whether the arm has buckled."""
    return f", buckled: {found.escapes} escapes" if found.escapes else ""


def tables(found: HingeEquilibrium, friction: float) -> tuple[str, str]:
    """Links and hinges of an equilibrium as aligned columns; `friction` has no effect."""
    turns = se3.rotation_vector(found.rotations)
    links = [(i, *at, *turn) for i, (at, turn) in enumerate(zip(found.positions, turns, strict=True))]
    names = ("link", "x [mm]", "y [mm]", "z [mm]", "turn x [rad]", "turn y [rad]", "turn z [rad]")
    angles, moments = found.joint_angles, _spring_moments(found)
    hinges = zip(range(len(angles)), angles, angles * _DEGREES, moments, strict=True)
    return (
        number_table(names, links, (4, 4, 4, 6, 6, 6)),
        number_table(("hinge", "angle [rad]", "angle [deg]", "spring [N·mm]"), hinges, (6, 3, 4)),
    )


def as_dict(found: HingeEquilibrium, friction: float) -> dict[str, Any]:
    """Links and hinges of an equilibrium; units are in the key names."""
    moments = _spring_moments(found)
    return {
        "escapes": int(found.escapes),
        "links": [
            {
                "link": i,
                **dict(zip(("x_mm", "y_mm", "z_mm"), pose[:3, 3].tolist(), strict=True)),
                "rotation": pose[:3, :3].tolist(),
            }
            for i, pose in enumerate(found.poses)
        ],
        "joints": [
            {"joint": i, "angle_rad": float(angle), "spring_moment_N_mm": float(moment)}
            for i, (angle, moment) in enumerate(zip(found.joint_angles, moments, strict=True))
        ],
    }


def _spring_moments(found: HingeEquilibrium) -> list[float]:
    """Moment of the spring in every hinge [N·mm]: stiffness × angle from rest."""
    assert isinstance(found.mechanism, HingeChain)
    beads = zip(found.mechanism.beads, found.joint_angles, strict=True)
    return [bead.stiffness * float(angle - bead.rest_angle) for bead, angle in beads]
