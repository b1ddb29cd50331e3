"""Pictures of a co-design: the designs beside each other, and a film of a design while it is trained."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from agents.codesign.study import JOINT, Results, Study
from agents.evaluation.pictures import COLOURS, figure_of, png, tidy
from rollingjoint.errors import MechanismError
from rollingjoint.plotting import plot_mechanism
from rollingjoint.plotting.film import canvas_of, pixels_of, save_gif

_MOST = 9  # designs in a picture


def designs(study: Study, results: Results) -> bytes:
    """PNG: the reference, the best design of every objective, and the co-designed one of the first seed."""
    shown = {"reference": np.asarray(study.space.reference())}
    for found, name in zip(results.get("design", []), study.rivals, strict=False):
        shown[f"best {name.replace('_', ' ')}"] = np.array(found["x"])
    shown = dict(list(shown.items())[: _MOST - 1])
    shown["co-designed"] = np.array(results[JOINT][0]["x"])
    figure = figure_of(1.25 * len(shown) + 0.5, 7.0)
    panels = np.atleast_1d(figure.subplots(1, len(shown), sharey=True))
    for axes, (title, x) in zip(panels, shown.items(), strict=True):
        _draw(axes, study.space.mechanism(x))
        axes.set_title(title.replace(" ", "\n"), fontsize=8)
    return png(figure, 90)


def film(study: Study, found: dict[str, Any], path: Path) -> Path:
    """GIF: the design of a pair while it is trained, and the measure in the validation episodes."""
    return save_gif(_frames(study, found), path)


def _frames(study: Study, found: dict[str, Any]) -> Iterator[Any]:
    settings, history = study.task.settings, found["history"]
    updates, values = ([entry[place] for entry in history] for place in (0, 1))
    shapes = [_built(study, entry[2]) for entry in history]
    figure, canvas = canvas_of(7.5, 6.4)
    left, right = figure.subplots(1, 2, width_ratios=(1, 3))
    figure.subplots_adjust(left=0.05, right=0.98, bottom=0.1, top=0.93, wspace=0.2)
    for place, mechanism in enumerate(shapes):
        if mechanism is None:
            continue
        left.clear()
        right.clear()
        _draw(left, mechanism)
        left.set_title(f"update {updates[place]}", fontsize=10)
        right.plot(updates, values, color="0.8")
        right.plot(updates[: place + 1], values[: place + 1], color=COLOURS[0], linewidth=2)
        right.plot(updates[place], values[place], "o", color=COLOURS[1])
        right.set(xlabel="update", ylabel=f"{settings.name} in validation [{settings.unit}]", ylim=(0.0, None))
        tidy(right)
        canvas.draw()
        yield pixels_of(canvas)


def _built(study: Study, x: Any) -> Any:
    try:
        return study.space.mechanism(np.asarray(x))
    except MechanismError:  # on its way a design may break a limit
        return None


def _draw(axes: Any, mechanism: Any) -> None:
    """A mechanism as it stands, with its tendons."""
    plot_mechanism(mechanism, axes, contacts=False, numbers=False, legend=False, color="#56606B")
    breadth = 1.3 * max(abs(point[0]) for link in mechanism.links for point in _ends(link))
    places = mechanism.poses(mechanism.neutral_angles)[:, 1]
    reach = float(np.diff(places).max())
    axes.set(xlim=(-breadth, breadth), ylim=(-0.8 * reach, places[-1] + 0.8 * reach), aspect="equal")
    axes.set(xlabel="", ylabel="", xticks=[])
    axes.grid(visible=False)


def _ends(link: Any) -> list[Any]:
    """The ends of the surfaces of a link."""
    return [end for surface in (link.parent, link.child) for end in surface.point(np.array(surface.limits))]
