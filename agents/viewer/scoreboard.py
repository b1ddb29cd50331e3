"""Errors of several controllers in one episode: a legend with numbers, and curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.evaluation.pictures import COLOURS
from agents.viewer.drive import Film
from agents.viewer.html import coloured, html_table
from agents.viewer.solids import Array

SMALLEST_MM = 0.01  # smaller errors are drawn here: the axis is logarithmic


class Scoreboard:
    """The errors of films up to a step, in the panel of a client.

    Args:
        gui: of the client. films: of the same episode, in the order of their colours.
        steps: of a whole episode.
    """

    def __init__(self, gui: Any, films: Sequence[Film], steps: int) -> None:
        self.films, self.steps = films, steps
        self.legend = gui.add_html("")
        grid = {"show": True, "width": 1, "stroke": "#eaecee"}
        self.curves = gui.add_uplot(
            self._columns(0),
            series=({"label": "step"}, *(_series(place, film) for place, film in enumerate(films))),
            scales=self._scales(0),
            axes=({"grid": grid, "size": 26}, {"grid": grid, "size": 52, "ticks": {"show": False}}),
            title="tip error [mm] over steps",
            legend={"show": False},
            height=210,
            padding=(10, 12, 0, 0),
        )
        self.show(0)

    def show(self, step: int) -> None:
        """Show the errors until this step."""
        self.legend.content = legend(self.films, step)
        self.curves.data, self.curves.scales = self._columns(step), self._scales(step)

    def remove(self) -> None:
        """Take it out of the panel."""
        self.legend.remove()
        self.curves.remove()

    def _scales(self, step: int) -> dict[str, Any]:
        """Whole decades around the errors until this step."""
        largest = max(max(film.errors[: step + 1]) for film in self.films)
        highest = 10.0 ** np.ceil(np.log10(max(largest, 1.0)))
        return {"x": {"time": False, "range": (0, self.steps)}, "y": {"distr": 3, "range": (SMALLEST_MM, highest)}}

    def _columns(self, step: int) -> tuple[Array, ...]:
        """Steps until now, and the error of every film after each; of one that ended before, its last error."""
        count = max(len(film.errors[: step + 1]) for film in self.films)
        curves = [film.errors[:count] for film in self.films]
        padded = [np.pad(errors, (0, count - len(errors)), mode="edge") for errors in curves]
        return (np.arange(float(count)), *(np.maximum(errors, SMALLEST_MM) for errors in padded))


def legend(films: Sequence[Film], step: int, when: str = "now") -> str:
    """HTML: the colour of every controller, its error at a step, and its mean over the last 10."""
    names = [coloured(_hex(place), film.name) for place, film in enumerate(films)]
    rows = [[name, *_figures(film, step)] for name, film in zip(names, films, strict=True)]
    return html_table(["", when, "last 10"], rows)


def _series(place: int, film: Film) -> dict[str, Any]:
    return {"label": film.name, "stroke": _hex(place), "width": 2, "points": {"show": False}}


def _hex(place: int) -> str:
    return COLOURS[place % len(COLOURS)]


def _figures(film: Film, step: int) -> tuple[str, str]:
    """The error after a step, and the mean over the last 10 where the episode is over."""
    errors = film.errors[: step + 1]
    is_over = step >= film.steps > 0
    return _millimetres(errors[-1]), _millimetres(film.last_10_mm) if is_over else "–"


def _millimetres(error: float) -> str:
    return f"{error:.3f} mm" if error < 1 else f"{error:.1f} mm"
