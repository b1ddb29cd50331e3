"""Columns of readings that only the arm's task has, counted from the end of those of every tracking task."""

from __future__ import annotations

# Direction of gravity; angle between tip and target frame, and its
# term of the reward; rotation matrices of both, row by row.
GRAVITY, ANGLE, ORIENTATION, TIP_FRAME, TARGET_FRAME, OWN = 0, 3, 4, 5, 14, 23
