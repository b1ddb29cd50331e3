"""What evaluations.csv has of every evaluation during training, and by which of its columns policies are chosen."""

from __future__ import annotations

AT_THE_END, LAST_10 = "mean_mm", "last_10_mm"
"""Mean tip error at the end of the episodes, and over their last 10 steps, as in the tables of results."""

COLUMNS = ("steps", AT_THE_END, "median_mm", "p95_mm", LAST_10, "mean_reward")
_WHEN = {AT_THE_END: "at the end", LAST_10: "over the last 10 steps"}


def in_words(column: str, error: float) -> str:
    """A mean tip error [mm] of one of these two columns."""
    return f"mean tip error {_WHEN[column]} {error:.3f} mm"
