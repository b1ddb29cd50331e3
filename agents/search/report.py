"""The text of a search's report. Every figure and every verdict is computed from the runs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from agents.runs.files import write_bytes, write_json, write_text
from agents.search import verdicts
from agents.search.optimiser import Evaluated
from agents.search.outcome import YARDSTICK, Search, median, plain_number, words
from rollingjoint.io.mechanism_file import dump_mechanism
from rollingjoint.tables import markdown_table

SHOWN = 15  # designs of the Pareto set in the table
CAPTIONS = {
    "progress.png": "Best feasible design so far over evaluations and over seconds: median of the seeds, band from the "
    "best to the worst.",
    "shapes.png": "The best design beside the reference, without load, under the same tensions.",
    "archive.png": "MAP-Elites: the best feasible design of every kind, all seeds together.",
    "front.png": "All feasible designs of all runs; marked: those that no other one beats in all objectives.",
}


def write_report(out: Path) -> None:
    """Write report.md, report.json, best.yaml and pictures into the folder of a search, from its runs alone."""
    from agents.search import pictures

    report = SearchReport(Search.read(out))
    images = draw(report.search)
    for name, content in images.items():
        write_bytes(out / name, content)
    best = pictures.best_mechanism(report.search)
    if best is not None:
        write_text(out / "best.yaml", dump_mechanism(best))
    write_text(out / "report.md", report.markdown(1, {name: name for name in images}))
    write_json(out / "report.json", report.to_dict())


def draw(search: Search) -> dict[str, bytes]:
    """The pictures by file name."""
    from agents.search import pictures

    drawn = {
        "progress.png": pictures.progress(search),
        "shapes.png": pictures.shapes(search, pictures.best_mechanism(search)),
        "archive.png": pictures.archive(search),
        "front.png": pictures.front(search),
    }
    return {name: content for name, content in drawn.items() if content is not None}


@dataclass(frozen=True)
class SearchReport:
    """The report of a search: verdicts and tables in Markdown, and plain values."""

    search: Search

    @cached_property
    def scores(self) -> tuple[Evaluated, list[float]]:
        """The best designs and the reference, under the conditions of the search."""
        return self.search.scored(held_out=False)

    @cached_property
    def held_out(self) -> tuple[Evaluated, list[float]] | None:
        """The same under the held-out conditions; None where the search has none."""
        return self.search.scored(held_out=True) if self.search.config.held_out else None

    def markdown(self, level: int, pictures: Mapping[str, str]) -> str:
        """The report, its first heading of this level.

        Args:
            pictures: path by the name in CAPTIONS.
        """
        search, below = self.search, "#" * (level + 1)
        parts = [
            f"{'#' * level} {words(search.name).capitalize()}",
            self._about(),
            "\n".join(f"- {verdict}" for verdict in self.verdicts()),
            f"{below} Methods: {words(search.name)}",
            markdown_table(*self._methods()),
            self._reading(),
            _picture("progress.png", pictures),
            f"{below} Best design: {words(search.name)}",
            markdown_table(*self._winner()),
            _picture("shapes.png", pictures),
            _picture("archive.png", pictures),
            self._front(below),
            _picture("front.png", pictures),
            "\n".join(f"- left out: {path}: {reason}" for path, reason in search.left_out.items()),
        ]
        return "\n\n".join(part for part in parts if part) + "\n"

    def in_short(self) -> list[str]:
        """Best value, its method, the reference's value; both values on held-out cases."""
        search, place = self.search, self.search.single
        cells = [f"{plain_number(search.shown(search.winner.best))}", words(search.winner.method)]
        if place is None:
            return [f"cost {cells[0]}", cells[1], "", "", ""]
        row = search.all.index(search.winner)
        cells[0] += f" {search.units[place]}"
        cells.append(plain_number(self.scores[1][place]))
        if self.held_out is None:
            return [*cells, "", ""]
        evaluated, reference = self.held_out
        ours = plain_number(evaluated.measured[row, place]) if evaluated.ok[row] else "fails"
        return [*cells, ours, plain_number(reference[place])]

    def verdicts(self) -> list[str]:
        """The conclusions, one sentence each."""
        search = self.search
        sentences = verdicts.beside_reference(search, self.scores, self.held_out)
        return [*sentences, *verdicts.beside_yardstick(search), *verdicts.beside_baseline(search)]

    def _about(self) -> str:
        search, problem = self.search, self.search.problem
        terms = [(words(name), term) for name, term in zip(search.names, problem.objectives, strict=False)]
        goals = [
            f"{'most' if term.objective.maximise else 'least'} {name} (weight {term.weight:g}, scale {term.scale:g})"
            for name, term in terms
            if term.weight
        ]
        limits = [
            f"{words(name)} {' and '.join(_bounds(limit.low, limit.high))} {limit.objective.unit}"
            for name, limit in zip(search.names[len(problem.objectives) :], problem.limits, strict=True)
        ]
        text = (
            f"Wanted: {'; '.join(goals)}. Limits: {'; '.join(limits) or 'none'}, and designs that can be built. "
            f"{problem.dimensions} dimensions, {search.config.budget:,} evaluations of every method with every seed "
            f"({', '.join(map(str, search.config.seeds))})."
        )
        return f"{text}\n\n```bash\n{search.command}\n```"

    def _methods(self) -> tuple[list[str], list[list[str]]]:
        search = self.search
        head = ["method", f"best {search.shown_name}", "of the seeds", "feasible"]
        head += ["evaluations to goal", "seconds to goal", "seconds"]
        if self.held_out is not None and search.single is not None:
            head.append(f"held out [{search.units[search.single]}]")
        rows = []
        for method, outcomes in search.outcomes.items():
            costs = sorted(outcome.best for outcome in outcomes)
            reached = [math.inf if count is None else count for count in search.reached(method)]
            feasible = float(np.mean([outcome.evaluated.feasible.mean() for outcome in outcomes]))
            row = [words(method), plain_number(search.shown(median(costs)))]
            row += [
                " to ".join(plain_number(search.shown(cost)) for cost in (costs[0], costs[-1])),
                f"{100 * feasible:.0f} %",
            ]
            row += [f"{median(reached):,}" if math.isfinite(median(reached)) else "–"]
            until = median([outcome.seconds_at(count) for outcome, count in zip(outcomes, reached, strict=True)])
            row += [f"{until:.1f}" if math.isfinite(until) else "–"]
            row += [f"{median([float(outcome.seconds[-1]) for outcome in outcomes]):.1f}"]
            if len(head) > len(row):
                row.append(self._held_out_median(method))
            rows.append(row)
        return head, rows

    def _held_out_median(self, method: str) -> str:
        assert self.held_out is not None and self.search.single is not None
        rows = [row for row, outcome in enumerate(self.search.all) if outcome.method == method]
        evaluated = self.held_out[0]
        if not all(math.isfinite(self.search.all[row].best) for row in rows):
            return "–"
        values = [float(evaluated.measured[row, self.search.single]) for row in rows if evaluated.ok[row]]
        return plain_number(median(values)) if len(values) == len(rows) else "fails"

    def _reading(self) -> str:
        note = ""
        if self.search.goal is not None:
            goal = plain_number(self.search.shown(self.search.goal))
            note = (
                f" The goal is the median of what {words(YARDSTICK)} ends with, {goal}; evaluations and seconds to it "
                "are medians of the seeds, – where half of them or more do not reach it."
            )
        return (
            f"Best feasible design of a run: median of the seeds, then the best and the worst.{note} A design with its "
            "gradient counts as one evaluation; seconds are processor time of a run, with what the method itself "
            "takes. Feasible: share of all designs that were evaluated."
        )

    def _winner(self) -> tuple[list[str], list[list[str]]]:
        search = self.search
        row = search.all.index(search.winner)
        columns = {"searched": self.scores} | ({"held out": self.held_out} if self.held_out is not None else {})
        head = [
            "",
            *(f"{who}, {conditions}" for conditions in columns for who in ("best design", search.config.reference)),
        ]
        rows = []
        for place, (name, unit) in enumerate(zip(search.names, search.units, strict=True)):
            cells = [f"{words(name)} [{unit}]"]
            for evaluated, reference in columns.values():
                cells.append(plain_number(evaluated.measured[row, place]) if evaluated.ok[row] else "fails")
                cells.append("fails" if math.isnan(reference[place]) else plain_number(reference[place]))
            rows.append(cells)
        return head, rows

    def _front(self, heading: str) -> str:
        """The Pareto set as a table, thinned out to SHOWN rows; empty for one objective."""
        search = self.search
        count = len(search.problem.objectives)
        if count < 2 or not search.front.any():
            return ""
        values = np.unique(search.everything.measured[search.front, :count], axis=0)
        shown = values[np.unique(np.linspace(0, len(values) - 1, min(SHOWN, len(values))).round().astype(int))]
        head = [f"{words(n)} [{u}]" for n, u in zip(search.names[:count], search.units[:count], strict=True)]
        text = f"{len(values)} designs are not beaten by another one in all objectives; of them {len(shown)}:"
        rows = [list(map(plain_number, row)) for row in shown]
        return f"{heading} Pareto set: {words(search.name)}\n\n{text}\n\n{markdown_table(head, rows)}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for report.json."""
        search = self.search
        runs = [
            {
                "method": outcome.method,
                "seed": outcome.seed,
                "cost": _finite(outcome.best),
                "evaluations_to_goal": None if search.goal is None else outcome.reached(search.goal),
                "seconds": float(outcome.seconds[-1]),
                "x": outcome.best_x.tolist(),
                "measured": self.scores[0].measured[row].tolist(),
                "held_out": None if self.held_out is None else self.held_out[0].measured[row].tolist(),
            }
            for row, outcome in enumerate(search.all)
        ]
        return {
            "command": search.command,
            "config": search.config.to_dict(),
            "names": list(search.names),
            "units": list(search.units),
            "goal": search.goal,
            "verdicts": self.verdicts(),
            "winner": search.all.index(search.winner),
            "runs": runs,
            "reference": [_finite(value) for value in self.scores[1]],
            "reference_held_out": None if self.held_out is None else [_finite(value) for value in self.held_out[1]],
            "pareto": search.everything.measured[search.front, : len(search.problem.objectives)].tolist(),
        }


def _picture(name: str, pictures: Mapping[str, str]) -> str:
    return f"![{CAPTIONS[name]}]({pictures[name]})\n\n{CAPTIONS[name]}" if name in pictures else ""


def _bounds(low: float, high: float) -> list[str]:
    bounds = [f"at least {low:.4g}"] if math.isfinite(low) else []
    return [*bounds, *([f"at most {high:.4g}"] if math.isfinite(high) else [])]


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
