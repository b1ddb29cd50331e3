"""An equilibrium as text: a table to read and JSON to process."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.solution import Solution
from rollingjoint.chain.status import Status
from rollingjoint.chain.wall_step import WallContact
from rollingjoint.tables import column_dicts, column_table, fixed, number_table, text_table

Array = NDArray[np.float64]

FRICTION = 0.3
"""Coefficient of friction for slip margins unless another is given."""
_FAR = 0.1  # of a tendon's path: real tendons stretch less


def mechanism_line(mechanism: AnyChain) -> str:
    """One line: links, tendons, length, joint travel."""
    ends = mechanism.last_links
    at = "" if set(ends) == {mechanism.n_links - 1} else f" ending at links {', '.join(map(str, ends))}"
    return f"{mechanism.parts}, {mechanism.n_tendons} tendons{at}, {mechanism.length:g} mm long, {mechanism.travel}"


def neutral_line(mechanism: AnyChain) -> str:
    """One line: the tendons' lengths at rest."""
    return f"neutral_lengths [mm]: {_numbers(mechanism.neutral_lengths, 4)}"


def length_note(solution: Solution, inputs: ArrayLike) -> str:
    """One line where lengths in equilibrium, or on a path, are far above the input, (..., m) [mm]; else empty.

    The line includes the lengths of the mechanism, and a remark on tendons that stretch more than real ones.
    """
    mechanism, far = solution.mechanism, _FAR * np.atleast_2d(solution.lengths)
    excess = np.atleast_2d(solution.lengths - np.asarray(inputs))
    tendons = np.flatnonzero((excess > far).any(axis=0))
    if not tendons.size:
        return ""
    stretched = bool((np.atleast_2d(solution.tensions) > mechanism.stiffnesses * far).any())
    which = f"tendon {tendons[0]} is" if tendons.size == 1 else f"tendons {', '.join(map(str, tendons))} are"
    return (
        f"lengths far too short: in equilibrium {which} {_numbers(excess.max(axis=0)[tendons], 1, ', ')} mm longer,"
        f" over a tenth of the path{', and no real tendon stretches so far' if stretched else ''}; "
        f"neutral_lengths [mm]: {_numbers(mechanism.neutral_lengths, 1)}, "
        f"shortest within the joints' limits: {_numbers(mechanism.shortest_lengths, 1)}"
    )


def _numbers(values: Array, digits: int, between: str = " ") -> str:
    return between.join(f"{value:.{digits}f}" for value in values)


def status_line(equilibrium: Solution) -> str:
    """One line: status, its meaning, residual and iterations; whether an arm has buckled."""
    status = Status(int(equilibrium.status))
    numbers = f"residual {equilibrium.residual:.1e} N·mm, {equilibrium.iterations} iterations{equilibrium.remark}"
    return f"{status.name}: {status.message} ({numbers})"


def as_table(equilibrium: Solution, friction: float = FRICTION) -> str:
    """Links, joints and tendons of an equilibrium as aligned columns, and the status line."""
    links = column_table("link", equilibrium.link_columns())
    joints = column_table(equilibrium.mechanism.joint, equilibrium.joint_columns(friction))
    tendons = zip(range(len(equilibrium.tensions)), equilibrium.tensions, equilibrium.lengths, strict=True)
    pulled = number_table(("tendon", "tension [N]", "length [mm]"), tendons, (4, 4))
    return "\n\n".join((links, joints, pulled, *_wall_table(equilibrium), status_line(equilibrium)))


def _wall_table(equilibrium: Solution) -> list[str]:
    """Contacts with walls as aligned columns, and the insertion force; empty without surroundings."""
    if equilibrium.walls is None:
        return []
    axes = "xyz"[: equilibrium.mechanism.dimension]
    head = ("link", "wall", *(f"{axis} [mm]" for axis in axes), "gap [mm]", "normal [N]", "friction [N]", "state")
    rows = [
        [str(touch.link), _wall(touch)]
        + [fixed(value, 4) for value in (*touch.place, touch.gap, touch.force, touch.friction)]
        + [fixed(touch.state, 2)]
        for touch in equilibrium.wall_contacts
    ]
    forces = f"insertion force {fixed(float(equilibrium.insertion_force), 4)} N{', jumped' * bool(equilibrium.jumped)}"
    return [text_table(head, rows, left=0) if rows else "no link touches a wall", forces]


def _wall(touch: WallContact) -> str:
    return f"{touch.kind} {touch.wall}"


def _wall_figures(equilibrium: Solution) -> dict[str, Any]:
    """Contact with walls for JSON; empty without surroundings."""
    if equilibrium.walls is None:
        return {}
    contacts = [
        {
            "link": touch.link,
            "wall": _wall(touch),
            "place_mm": touch.place.tolist(),
            "normal": touch.normal.tolist(),
            "gap_mm": touch.gap,
            "normal_N": touch.force,
            "friction_N": touch.friction,
            "state": touch.state,
            "sticks": touch.sticks,
        }
        for touch in equilibrium.wall_contacts
    ]
    return {
        "wall_contacts": contacts,
        "wall_forces_N_N_mm": equilibrium.wall_forces.tolist(),
        "insertion_force_N": float(equilibrium.insertion_force),
        "jumped": bool(equilibrium.jumped),
    }


def as_json(equilibrium: Solution, friction: float = FRICTION) -> str:
    """The equilibrium as JSON text; units are in the key names."""
    return json.dumps(as_dict(equilibrium, friction), indent=2, allow_nan=False)


def as_dict(equilibrium: Solution, friction: float = FRICTION) -> dict[str, Any]:
    """The equilibrium as plain dicts, lists and numbers."""
    status = Status(int(equilibrium.status))
    return {
        "mechanism": equilibrium.mechanism.name,
        "status": status.name,
        "message": status.message,
        "usable": bool(equilibrium.ok),
        "residual_N_mm": _finite(equilibrium.residual),
        "iterations": int(equilibrium.iterations),
        "smallest_eigenvalue_N_mm_per_rad": _finite(equilibrium.smallest_eigenvalue),
        **equilibrium.figures(friction),
        "links": column_dicts("link", equilibrium.link_columns()),
        "joints": column_dicts("joint", equilibrium.joint_columns(friction)),
        "tendons": [
            {"tendon": j, "tension_N": float(tension), "length_mm": float(length)}
            for j, (tension, length) in enumerate(zip(equilibrium.tensions, equilibrium.lengths, strict=True))
        ],
        **_wall_figures(equilibrium),
    }


def _finite(value: Any) -> float | None:
    """The number, or None for infinity, which JSON cannot express."""
    return float(value) if math.isfinite(value) else None
