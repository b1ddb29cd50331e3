"""An equilibrium as text: a table to read and JSON to process."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from rollingjoint.equilibrium import Equilibrium, Status
from rollingjoint.families import Mechanism
from rollingjoint.hinge_chain import HingeChain
from rollingjoint.rolling_chain import RollingChain


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


def status_line(eq: Equilibrium) -> str:
    """One line: status, its meaning, residual and iterations."""
    status = Status(int(eq.status))
    return f"{status.name}: {status.message} (residual {eq.residual:.1e} N·mm, {eq.iterations} iterations)"


def title(mechanism: RollingChain | Equilibrium) -> str:
    """Name of the mechanism, and the status if it is not simply converged."""
    if isinstance(mechanism, RollingChain):
        return mechanism.name
    name, status = mechanism.chain.name, Status(int(mechanism.status))
    return name if status == Status.CONVERGED else f"{name}: {status.name}"


def as_table(eq: Equilibrium, friction: float = 0.3) -> str:
    """Links, joints and tendons of an equilibrium as aligned columns, and the status line."""
    degrees = 180.0 / math.pi
    links = [(i, x, y, angle, angle * degrees) for i, (x, y, angle) in enumerate(eq.poses)]
    joints = zip(
        range(eq.chain.n_joints),
        eq.arc_lengths,
        eq.joint_angles,
        eq.contact_forces[:, 1],
        eq.contact_forces[:, 0],
        eq.slip_margins(friction),
        strict=True,
    )
    tendons = zip(range(eq.chain.n_tendons), eq.tensions, eq.lengths, strict=True)
    blocks = (
        _columns(("link", "x [mm]", "y [mm]", "angle [rad]", "angle [deg]"), links, (4, 4, 6, 3)),
        _columns(
            ("joint", "s [mm]", "angle [rad]", "normal [N]", "tangential [N]", "slip margin [N]"),
            joints,
            (4, 6, 4, 4, 4),
        ),
        _columns(("tendon", "tension [N]", "length [mm]"), tendons, (4, 4)),
    )
    return "\n\n".join((*blocks, status_line(eq)))


def as_json(eq: Equilibrium, friction: float = 0.3) -> str:
    """The same as JSON text; units stand in the key names."""
    return json.dumps(as_dict(eq, friction), indent=2, allow_nan=False)


def as_dict(eq: Equilibrium, friction: float = 0.3) -> dict[str, Any]:
    """The same as plain dicts, lists and numbers."""
    slip, status = eq.slip_margins(friction), Status(int(eq.status))
    return {
        "mechanism": eq.chain.name,
        "status": status.name,
        "message": status.message,
        "usable": bool(eq.ok),
        "residual_N_mm": _finite(eq.residual),
        "iterations": int(eq.iterations),
        "smallest_eigenvalue_N_mm_per_rad": _finite(eq.smallest_eigenvalue),
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
        "tendons": [
            {"tendon": j, "tension_N": float(eq.tensions[j]), "length_mm": float(eq.lengths[j])}
            for j in range(eq.chain.n_tendons)
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
