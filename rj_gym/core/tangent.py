"""How the last step of a tracking task answers its motors: what a learner needs to differentiate an episode."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REACH = 1e-4  # mm: of the forward differences
FREE_OF_LIMITS = 100.0  # times the largest tension: what motors would hold if they never gave way


class Tangent(NamedTuple):
    """The state of B lanes after a step, and how it answers the commands of the m tendons; fresh arrays.

    A tendon's command p follows the position q of its motor through play: |p - q| <= half_play. The motor measures
    T exp(sheath u), u = (p - q) / half_play. `held` tendons are at a tension limit and stay there: motors and
    commands move with their lengths, and nothing answers them.
    """

    motors: Array  # q, (B, m) mm
    commands: Array  # p, (B, m) mm
    tensions: Array  # T, (B, m) N
    tips: Array  # (B, d) mm
    poses: Array  # what `TrackingTask.pictured` names, (B, k), mm and 1
    half_play: Array  # (B, m) mm
    sheath: Array  # (B, m)
    held: NDArray[np.bool_]  # (B, m)
    tip_rates: Array  # d tip / d command, (B, d, m) mm/mm
    pose_rates: Array  # d pose / d command, (B, k, m) mm/mm, 1/mm
    tension_rates: Array  # d tension / d command, (B, m, m) N/mm
    length_rates: Array  # d length / d command, (B, m, m) mm/mm
