"""Reports of planar chains and their equilibria: text, tables, JSON."""

from __future__ import annotations

import math
from typing import Any

from rollingjoint.planar.chain import RollingChain
from rollingjoint.planar.equilibrium import Equilibrium
from rollingjoint.tables import number_table

_DEGREES = 180.0 / math.pi


def travel(mechanism: RollingChain) -> str:
    """Range of its contacts, in words."""
    return f"s from {mechanism.joint_limits[:, 0].min():g} to {mechanism.joint_limits[:, 1].max():g} mm"


def remark(found: Equilibrium) -> str:
    """Nothing to add to the status."""
    return ""


def tables(eq: Equilibrium, friction: float) -> tuple[str, str]:
    """Links and joints of an equilibrium as aligned columns."""
    links = [(i, x, y, angle, angle * _DEGREES) for i, (x, y, angle) in enumerate(eq.poses)]
    joints = zip(
        range(eq.chain.n_joints),
        eq.arc_lengths,
        eq.joint_angles,
        eq.contact_forces[:, 1],
        eq.contact_forces[:, 0],
        eq.slip_margins(friction),
        strict=True,
    )
    return (
        number_table(("link", "x [mm]", "y [mm]", "angle [rad]", "angle [deg]"), links, (4, 4, 6, 3)),
        number_table(
            ("joint", "s [mm]", "angle [rad]", "normal [N]", "tangential [N]", "slip margin [N]"),
            joints,
            (4, 6, 4, 4, 4),
        ),
    )


def as_dict(eq: Equilibrium, friction: float) -> dict[str, Any]:
    """Links and joints of an equilibrium; units are in the key names."""
    slip = eq.slip_margins(friction)
    return {
        "friction": friction,
        "links": [
            {"link": i, "x_mm": float(x), "y_mm": float(y), "angle_rad": float(angle)}
            for i, (x, y, angle) in enumerate(eq.poses)
        ],
        "joints": [
            {
                "joint": i,
                "arc_length_mm": float(eq.arc_lengths[i]),
                "angle_rad": float(eq.joint_angles[i]),
                "contact_mm": eq.contact_points[i].tolist(),
                "normal_N": float(eq.contact_forces[i, 1]),
                "tangential_N": float(eq.contact_forces[i, 0]),
                "slip_margin_N": float(slip[i]),
            }
            for i in range(eq.chain.n_joints)
        ],
    }
