"""Conclusions from the runs of a search, in sentences; each is computed."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from agents.search.optimiser import Evaluated
from agents.search.outcome import BASELINE, YARDSTICK, Search, median, plain_number, words

Scores = tuple[Evaluated, list[float]]


def beside_reference(search: Search, scores: Scores, held_out: Scores | None) -> Iterator[str]:
    """The best design and the reference mechanism, in the search and under held-out conditions.

    Args:
        scores, held_out: as Search.scored gives them.
    """
    who = f"{words(search.winner.method)}, seed {search.winner.seed}"
    if not math.isfinite(search.winner.best):
        yield f"No run found a feasible design; the nearest to one is from {who}."
    elif search.single is not None:
        yield f"The best design, found by {who}, {_gain(search, scores, search.single)}."
        if held_out is not None:
            yield f"Under conditions that no search saw it {_gain(search, held_out, search.single)}."
    else:
        yield from _many(search, scores[1], who)


def _many(search: Search, reference: list[float], who: str) -> Iterator[str]:
    """The same for several objectives."""
    terms, everything = search.problem.objectives, search.everything
    factors = np.array([term.factor for term in terms])
    theirs = np.array(reference[: len(terms)])
    cost, name = plain_number(float(factors @ theirs)), search.config.reference
    ours = plain_number(search.winner.best)
    yield f"The best design, found by {who}, costs {ours}; the values of {name} cost {cost}."
    signs = np.array([-1.0 if term.objective.maximise else 1.0 for term in terms])
    better = ((everything.measured[:, : len(terms)] - theirs) * signs < 0).all(1) & everything.feasible
    counts = f"{better.sum():,} of {everything.feasible.sum():,} feasible designs"
    yield f"{counts} are better than {name} in all objectives."


def _gain(search: Search, scores: Scores, place: int) -> str:
    """How the winner compares with the reference in one objective."""
    evaluated, reference = scores
    row, unit, name = search.all.index(search.winner), search.units[place], search.config.reference
    ours, theirs = float(evaluated.measured[row, place]), reference[place]
    if not evaluated.ok[row]:
        return "has no equilibrium in one of the cases"
    if math.isnan(theirs):
        return f"has {plain_number(ours)} {unit}, where {name} has no equilibrium"
    more = search.problem.objectives[place].objective.maximise
    verb = "equals" if ours == theirs else "beats" if (ours > theirs) == more else "falls behind"
    share = f" by {100 * abs(ours - theirs) / abs(theirs):.0f} %" if theirs and ours != theirs else ""
    figures = f"{plain_number(ours)} {unit} against {plain_number(theirs)} {unit}"
    return f"{verb} {name}{share}: {words(search.names[place])} {figures}"


def beside_yardstick(search: Search) -> Iterator[str]:
    """Number of evaluations after which the other methods reach the final cost of CMA-ES."""
    if search.goal is None:
        return
    goal = plain_number(float(search.shown(search.goal)))
    goal_text = f"what {words(YARDSTICK)} has after {search.config.budget:,} evaluations ({goal})"
    for method in search.outcomes:
        if method == YARDSTICK:
            continue
        counts = [math.inf if count is None else count for count in search.reached(method)]
        seeds = f"{sum(map(math.isfinite, counts))} of {len(counts)} seeds"
        name = words(method).capitalize() if words(method).islower() else words(method)
        if not math.isfinite(min(counts)):
            yield f"{name} does not reach {goal_text} with any seed."
        elif math.isfinite(median(counts)):
            yield f"{name} reaches {goal_text} after {median(counts):,} (median; {seeds} reach it)."
        else:
            yield f"{name} reaches {goal_text} with {seeds}, after {min(counts):,} at best."


def beside_baseline(search: Search) -> Iterator[str]:
    """Which methods end better than random search with every seed, and which do not."""
    if BASELINE not in search.outcomes:
        return
    bar = min(outcome.best for outcome in search.outcomes[BASELINE])
    beaten = {method: all(outcome.best < bar for outcome in outcomes) for method, outcomes in search.outcomes.items()}
    del beaten[BASELINE]
    for is_better, text in ((True, "Better with every seed"), (False, "Not better with every seed")):
        names = [words(method) for method, better in beaten.items() if better is is_better]
        if names:
            yield f"{text} than {words(BASELINE)} with its best: {', '.join(names)}."
