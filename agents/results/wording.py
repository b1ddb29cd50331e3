"""Figures with their intervals, and verdicts, in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import mean
from textwrap import fill

from agents.results.standings import FEEDBACK, Standings, Verdict
from agents.results.statistics import Interval

ENOUGH_RUNS = 10  # training seeds that a verdict asks for
WIDTH = 120
_HEADS = {
    Verdict.PAYS: "Learning pays here.",
    Verdict.NARROWLY: "Learning pays narrowly here: better episode by episode, but the intervals of the two means "
    "overlap.",
    Verdict.BEATS_FEEDBACK: "Learning beats Jacobian feedback here, but not the best opponent.",
    Verdict.NO_DIFFERENCE: "Learning makes no clear difference here.",
    Verdict.DOES_NOT: "Learning does not pay here.",
}


def verdict_text(standings: Standings) -> str:
    """Whether learning pays in this world, against the best opponent and Jacobian feedback, and by how much."""
    policy, baseline = standings.policy, standings.baseline
    if standings.verdict == Verdict.UNKNOWN or policy is None or baseline is None:
        return "No verdict: it takes a trained controller and an opponent, both chosen in validation episodes."
    names = [baseline] + ([FEEDBACK] if FEEDBACK in standings.names and baseline != FEEDBACK else [])
    against = "; with ".join(_compared(standings, policy, name) for name in names)
    result = f"The best trained controller, {policy} ({with_interval(standings.mean(policy), mm)} mm), ends with"
    runs = standings.runs(policy)
    head = _HEADS[standings.verdict]
    head = head if runs >= ENOUGH_RUNS else f"Preliminary: {head[0].lower()}{head[1:]}"
    return f"**{head}** {result} {against}. {_how_sure(runs)}".rstrip()


def change_text(standings: Standings, before: Standings) -> str:
    """The change of the best learner's and the best opponent's mean in another world; empty where unknown."""
    names = {name: standings.change(name, before) for name in (standings.policy, standings.baseline) if name}
    changes = [
        f"that of {name} by {with_interval(change, signed_percent)} %"
        for name, change in names.items()
        if change is not None
    ]
    if standings.world is before.world or not changes:
        return ""
    return f"From the task's own episodes to these the mean changes: {' and '.join(changes)}."


def _compared(standings: Standings, policy: str, opponent: str) -> str:
    comparison, best = standings.compare(policy, opponent), opponent == standings.baseline
    less = "less" if comparison.difference.value <= 0 else "more"
    seeds = f" and with {comparison.runs_better} of {comparison.runs} training seeds" if comparison.runs > 1 else ""
    return (
        f"{with_interval(_size(comparison.difference), mm)} mm{_share(comparison.ratio)} {less} than "
        f"{'the best opponent, ' if best else ''}{opponent} ({with_interval(standings.mean(opponent), mm)} mm), "
        f"better in {with_interval(comparison.improvement, percent)} % of the episodes{seeds}"
    )


def _share(ratio: Interval) -> str:
    """The ratio in brackets, in per cent; empty where it is unknown or the opponent hardly has an error."""
    if not all(map(math.isfinite, ratio)) or abs(ratio.value) > 1:
        return ""
    return f" ({with_interval(_size(ratio), percent)} %)"


def _size(interval: Interval) -> Interval:
    """The interval, its value made positive."""
    return interval if interval.value > 0 else Interval(-interval.value, -interval.high, -interval.low)


def _how_sure(runs: int) -> str:
    if runs >= ENOUGH_RUNS:
        return ""
    seeds = "A single training seed is" if runs == 1 else f"{runs} training seeds are"
    return f"{seeds} no verdict about other seeds: that asks for {ENOUGH_RUNS}."


def in_short(standings: Standings) -> str:
    """The verdict for the summary, with the number of training seeds where they are too few for one."""
    runs = standings.runs(standings.policy) if standings.policy else ENOUGH_RUNS
    note = "" if runs >= ENOUGH_RUNS else f" (preliminary: {runs} {'seed' if runs == 1 else 'seeds'})"
    return standings.verdict + note


def with_interval(interval: Interval, form: Callable[[float], str]) -> str:
    """A figure with its interval: 1.23 [1.17, 1.29]."""
    return f"{form(interval.value)} [{form(interval.low)}, {form(interval.high)}]"


def mm(value: float) -> str:
    """Millimetres: three decimals below 1, else two."""
    if abs(value) < 0.001:
        return "< 0.001"
    return f"{value:.3f}" if abs(value) < 1 else f"{value:.2f}"


def percent(value: float) -> str:
    """A share in per cent, without decimals."""
    return f"{100 * value:.0f}"


def signed_percent(value: float) -> str:
    """A change in per cent, with its sign."""
    return "unknown" if math.isnan(value) else f"{100 * value:+.0f}"


def share(value: float) -> str:
    """A share in per cent, with one decimal."""
    return f"{100 * value:.1f}"


def spread(values: Sequence[float], form: Callable[[float], str]) -> str:
    """The mean of the values, with the smallest and the largest where there are several."""
    around = f" ({form(min(values))} to {form(max(values))})" if len(values) > 1 else ""
    return f"{form(mean(values))}{around}"


def wrapped(part: str) -> str:
    """Paragraphs and lists in lines of limited width; tables, headings, pictures and code as they are."""
    if part.startswith(("|", "#", "```", "![")):
        return part
    lines = part.split("\n")
    indent = "  " if part.startswith("- ") else ""
    return "\n".join(fill(line, WIDTH, subsequent_indent=indent, break_on_hyphens=False) for line in lines)
