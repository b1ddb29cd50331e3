"""Arrays of what surrounds a chain, and of its outline: the rows that kernels of contact with walls take.

A wall meets the *points* or the *bars* of an outline: discs and capsules of the links. Half planes and lumens meet
points, discs and capsules meet bars. Lengths in mm, angles in rad, world frame; body points in the frame of their link.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from rollingjoint._numba.layout import Floats

N_LAW = 5
# Columns of the law of a wall, the last of its row: stiffness, toe [mm], coefficient of friction, presliding [mm], and
# whether the stiffness is per length of outline, 1 or 0 [N/mm² or N/mm]. A stiffness of 0 is a row without effect.
STIFFNESS, TOE, MU, PRESLIDING, PER_LENGTH = range(N_LAW)


class Walls(NamedTuple):
    """W surroundings of one chain, each with its outline; rows of zeros have no effect and pad them to equal sizes.

    Candidates of contact are numbered in this order: every point with every plane, then with every lumen; after all
    points every bar with every disc, then with every capsule, four for each: the two ends of the capsule against the
    bar, the two ends of the bar against the capsule.
    """

    points: Annotated[Floats, "W", "points", 5]  # link (>= 1), x, y in its frame, radius, length of outline it is for
    bars: Annotated[Floats, "W", "bars", 6]  # link (>= 1), first end x, y, second end x, y in its frame, radius
    planes: Annotated[
        Floats, "W", "planes", 3 + N_LAW
    ]  # unit normal x, y to the free side, d: free where n . x >= d; law
    discs: Annotated[Floats, "W", "discs", 3 + N_LAW]  # x, y, radius; law
    capsules: Annotated[Floats, "W", "capsules", 5 + N_LAW]  # first end x, y, second end x, y, radius; law
    # Of all lumens, one after the other: x, y, angle of the tangent and curvature at the start, length, arc length of
    # the lumen at the start, radius at the start and at the end, number of the lumen.
    pieces: Annotated[Floats, "W", "pieces", 9]
    lumens: Annotated[Floats, "W", "lumens", N_LAW]  # law
    rigid: Annotated[Floats, "W"]  # 1: the walls are rigid, and stiffnesses only penalties; 0: compliant
