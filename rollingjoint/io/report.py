"""An equilibrium as text: a table to read and JSON to process."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, cast

from rollingjoint.planar.equilibrium import Equilibrium
from rollingjoint.solution import Solution, Status
from rollingjoint.spatial import se3
from rollingjoint.spatial.chain import HingeChain
from rollingjoint.spatial.equilibrium import HingeEquilibrium
from rollingjoint.statics.families import Mechanism

FRICTION = 0.3
"""Coefficient of friction for slip margins unless another is given."""

_DEGREES = 180.0 / math.pi


def mechanism_line(mechanism: Mechanism) -> str:
    """One line: links, tendons, length, joint travel; of an arm also a model of tendons other than the default."""
    ends = [tendon.last_link(mechanism.n_links) for tendon in mechanism.tendons]
    at = "" if set(ends) == {mechanism.n_links - 1} else f" ending at links {', '.join(map(str, ends))}"
    lo, hi = mechanism.joint_limits[:, 0].min(), mechanism.joint_limits[:, 1].max()
    what, travel = f"{mechanism.n_links} links", f"s from {lo:g} to {hi:g} mm"
    if isinstance(mechanism, HingeChain):
        model = "" if mechanism.model == HingeChain.model else f", model {mechanism.model}"
        what, travel = f"{mechanism.n_joints} beads", f"hinges from {lo:.3g} to {hi:.3g} rad{model}"
    return f"{what}, {mechanism.n_tendons} tendons{at}, {mechanism.length:g} mm long, {travel}"


def status_line(found: Solution) -> str:
    """One line: status, its meaning, residual and iterations; whether an arm has buckled."""
    status = Status(int(found.status))
    numbers = f"residual {found.residual:.1e} N·mm, {found.iterations} iterations"
    if isinstance(found, HingeEquilibrium) and found.escapes:
        numbers += f", buckled: {found.escapes} escapes"
    return f"{status.name}: {status.message} ({numbers})"


def title(what: Mechanism | Solution) -> str:
    """Name of the mechanism, and the status if it is not simply converged."""
    if not isinstance(what, Solution):
        return what.name
    name, status = what.mechanism.name, Status(int(what.status))
    return name if status == Status.CONVERGED else f"{name}: {status.name}"


def as_table(found: Equilibrium | HingeEquilibrium, friction: float = FRICTION) -> str:
    """Links, joints and tendons of an equilibrium as aligned columns, and the status line."""
    links, joints = _arm_tables(found) if isinstance(found, HingeEquilibrium) else _chain_tables(found, friction)
    tendons = zip(range(len(found.tensions)), found.tensions, found.lengths, strict=True)
    pulled = _columns(("tendon", "tension [N]", "length [mm]"), tendons, (4, 4))
    return "\n\n".join((links, joints, pulled, status_line(found)))


def _chain_tables(eq: Equilibrium, friction: float) -> tuple[str, str]:
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
        _columns(("link", "x [mm]", "y [mm]", "angle [rad]", "angle [deg]"), links, (4, 4, 6, 3)),
        _columns(
            ("joint", "s [mm]", "angle [rad]", "normal [N]", "tangential [N]", "slip margin [N]"),
            joints,
            (4, 6, 4, 4, 4),
        ),
    )


def _arm_tables(found: HingeEquilibrium) -> tuple[str, str]:
    turns = se3.rotation_vector(found.rotations)
    links = [(i, *at, *turn) for i, (at, turn) in enumerate(zip(found.positions, turns, strict=True))]
    names = ("link", "x [mm]", "y [mm]", "z [mm]", "turn x [rad]", "turn y [rad]", "turn z [rad]")
    angles, moments = found.joint_angles, _spring_moments(found)
    hinges = zip(range(len(angles)), angles, angles * _DEGREES, moments, strict=True)
    return (
        _columns(names, links, (4, 4, 4, 6, 6, 6)),
        _columns(("hinge", "angle [rad]", "angle [deg]", "spring [N·mm]"), hinges, (6, 3, 4)),
    )


def _spring_moments(found: HingeEquilibrium) -> list[float]:
    """Moment of the spring in every hinge [N·mm]: stiffness × angle from rest."""
    assert isinstance(found.mechanism, HingeChain)
    beads = zip(found.mechanism.beads, found.joint_angles, strict=True)
    return [bead.stiffness * float(angle - bead.rest_angle) for bead, angle in beads]


def as_json(found: Equilibrium | HingeEquilibrium, friction: float = FRICTION) -> str:
    """The same as JSON text; units stand in the key names."""
    return json.dumps(as_dict(found, friction), indent=2, allow_nan=False)


def as_dict(found: Equilibrium | HingeEquilibrium, friction: float = FRICTION) -> dict[str, Any]:
    """The same as plain dicts, lists and numbers."""
    status, mechanism = Status(int(found.status)), cast(Mechanism, found.mechanism)
    return {
        "mechanism": mechanism.name,
        "status": status.name,
        "message": status.message,
        "usable": bool(found.ok),
        "residual_N_mm": _finite(found.residual),
        "iterations": int(found.iterations),
        "smallest_eigenvalue_N_mm_per_rad": _finite(found.smallest_eigenvalue),
        **(_arm_dict(found) if isinstance(found, HingeEquilibrium) else _chain_dict(found, friction)),
        "tendons": [
            {"tendon": j, "tension_N": float(tension), "length_mm": float(length)}
            for j, (tension, length) in enumerate(zip(found.tensions, found.lengths, strict=True))
        ],
    }


def _chain_dict(eq: Equilibrium, friction: float) -> dict[str, Any]:
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


def _arm_dict(found: HingeEquilibrium) -> dict[str, Any]:
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


def _columns(heads: Sequence[str], rows: Any, digits: Sequence[int]) -> str:
    """Aligned columns: an index, then numbers with that many digits each."""
    body = [[str(row[0]), *(_fixed(value, d) for value, d in zip(row[1:], digits, strict=True))] for row in rows]
    widths = [max(len(line[k]) for line in [heads, *body]) for k in range(len(heads))]
    return "\n".join("  ".join(cell.rjust(w) for cell, w in zip(line, widths, strict=True)) for line in [heads, *body])


def _finite(value: Any) -> float | None:
    """The number, or None for infinity, which JSON has not."""
    return float(value) if math.isfinite(value) else None


def _fixed(value: float, digits: int) -> str:
    """Fixed-point text without a negative zero."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"
