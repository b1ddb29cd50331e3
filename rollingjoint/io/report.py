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
from rollingjoint.tables import column_dicts, column_table, number_table

Array = NDArray[np.float64]

FRICTION = 0.3
"""Coefficient of friction for slip margins unless another is given."""
_FAR = 0.1  # of a tendon's path: no real tendon is stretched by more


def mechanism_line(mechanism: AnyChain) -> str:
    """One line: links, tendons, length, joint travel."""
    ends = mechanism.last_links
    at = "" if set(ends) == {mechanism.n_links - 1} else f" ending at links {', '.join(map(str, ends))}"
    return f"{mechanism.parts}, {mechanism.n_tendons} tendons{at}, {mechanism.length:g} mm long, {mechanism.travel}"


def neutral_line(mechanism: AnyChain) -> str:
    """One line: the tendons' lengths at rest."""
    return f"neutral_lengths [mm]: {_numbers(mechanism.neutral_lengths, 4)}"


def length_note(found: Solution, given: ArrayLike) -> str:
    """One line where lengths in equilibrium, or on a path, are far above those given, (..., m) [mm]; else empty.

    It also says which lengths the mechanism has; and where tendons stretch so far, that no real one does.
    """
    mechanism, far = found.mechanism, _FAR * np.atleast_2d(found.lengths)
    excess = np.atleast_2d(found.lengths - np.asarray(given))
    those = np.flatnonzero((excess > far).any(axis=0))
    if not those.size:
        return ""
    stretched = bool((np.atleast_2d(found.tensions) > mechanism.stiffnesses * far).any())
    which = f"tendon {those[0]} is" if those.size == 1 else f"tendons {', '.join(map(str, those))} are"
    return (
        f"lengths far too short: in equilibrium {which} {_numbers(excess.max(axis=0)[those], 1, ', ')} mm longer, over "
        f"a tenth of the path{', and no real tendon stretches so far' if stretched else ''}; "
        f"neutral_lengths [mm]: {_numbers(mechanism.neutral_lengths, 1)}, "
        f"shortest within the joints' limits: {_numbers(mechanism.shortest_lengths, 1)}"
    )


def _numbers(values: Array, digits: int, between: str = " ") -> str:
    return between.join(f"{value:.{digits}f}" for value in values)


def status_line(found: Solution) -> str:
    """One line: status, its meaning, residual and iterations; whether an arm has buckled."""
    status = Status(int(found.status))
    numbers = f"residual {found.residual:.1e} N·mm, {found.iterations} iterations{found.remark}"
    return f"{status.name}: {status.message} ({numbers})"


def as_table(found: Solution, friction: float = FRICTION) -> str:
    """Links, joints and tendons of an equilibrium as aligned columns, and the status line."""
    links = column_table("link", found.link_columns())
    joints = column_table(found.mechanism.joint, found.joint_columns(friction))
    tendons = zip(range(len(found.tensions)), found.tensions, found.lengths, strict=True)
    pulled = number_table(("tendon", "tension [N]", "length [mm]"), tendons, (4, 4))
    return "\n\n".join((links, joints, pulled, status_line(found)))


def as_json(found: Solution, friction: float = FRICTION) -> str:
    """The same as JSON text; units are in the key names."""
    return json.dumps(as_dict(found, friction), indent=2, allow_nan=False)


def as_dict(found: Solution, friction: float = FRICTION) -> dict[str, Any]:
    """The same as plain dicts, lists and numbers."""
    status = Status(int(found.status))
    return {
        "mechanism": found.mechanism.name,
        "status": status.name,
        "message": status.message,
        "usable": bool(found.ok),
        "residual_N_mm": _finite(found.residual),
        "iterations": int(found.iterations),
        "smallest_eigenvalue_N_mm_per_rad": _finite(found.smallest_eigenvalue),
        **found.figures(friction),
        "links": column_dicts("link", found.link_columns()),
        "joints": column_dicts("joint", found.joint_columns(friction)),
        "tendons": [
            {"tendon": j, "tension_N": float(tension), "length_mm": float(length)}
            for j, (tension, length) in enumerate(zip(found.tensions, found.lengths, strict=True))
        ],
    }


def _finite(value: Any) -> float | None:
    """The number, or None for infinity, which JSON cannot express."""
    return float(value) if math.isfinite(value) else None
