"""Columns of readings, the true numbers that infos and rewards are made of, (B, columns)."""

from __future__ import annotations

# The first four of every task, the others of every tracking task. Vectors have room for three coordinates. From
# TENSIONS on: tensions [N], TENSIONS + j, and commands [mm], TENSIONS + m + j, of the m tendons; the task's own
# columns; the privileged state; friction.
STEP, STATUS, ERROR, REWARD, TRACKING, EFFORT, SMOOTHNESS, FAILURE, TIP, TARGET, LINK, FORCE, TENSIONS = (
    0, 1, 2, 3, 4, 5, 6, 7, 8, 11, 14, 15, 18,
)  # fmt: skip
REWARDS = slice(REWARD, FAILURE + 1)

# Of the last columns, in tasks with friction: work that it took up in the step [N·mm]; whether tendons stick in their
# holes, (J, m); tensions of their gaps, (J, m) [N].
WORK, STICKING = 0, 1

# Of the columns that only tasks with arms have, after the commands: direction of gravity; angle between tip and target
# frame, and its term of the reward; rotation matrices of both, row by row.
GRAVITY, ANGLE, ORIENTATION, TIP_FRAME, TARGET_FRAME, OWN = 0, 3, 4, 5, 14, 23
