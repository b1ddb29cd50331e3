"""Pictures of a co-design: the designs beside each other, and a film of a design while it is trained."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from agents.codesign.study import JOINT, Results, Study
from agents.evaluation.pictures import COLOURS, figure_of, png, tidy
from rollingjoint import solve_tensions
from rollingjoint.errors import MechanismError
from rollingjoint.plotting import plot_mechanism
from rollingjoint.plotting.film import canvas_of, pixels_of, save_gif

_RATIOS = 0.4, 1.0, 2.5  # of the tensions of a pair of tendons, left to right
_TENSION = 10.0  # their sum [N]
_MOST = 9  # designs in a picture


def designs(study: Study, results: Results) -> bytes:
    """PNG: the reference, the best design of every objective, and the co-designed one of the first seed."""
    shown = {"reference": np.asarray(study.space.reference())}
    for found, name in zip(results.get("design", []), study.rivals, strict=False):
        shown[f"best {name.replace('_', ' ')}"] = np.array(found["x"])
    shown = dict(list(shown.items())[: _MOST - 1])
    shown["co-designed"] = np.array(results[JOINT][0]["x"])
    columns = min(len(shown), 5)
    rows = -(-len(shown) // columns)
    figure = figure_of(2.5 * columns, 3.4 * rows)
    panels = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True)).reshape(-1)
    for axes, (title, x) in zip(panels, shown.items(), strict=False):
        _draw(axes, study.space.mechanism(x))
        axes.set_title(title, fontsize=9)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    return png(figure, 90)


def film(study: Study, found: dict[str, Any], path: Path) -> Path:
    """GIF: the design of a pair while it is trained, and the measure in the validation episodes."""
    return save_gif(_frames(study, found), path)


def _frames(study: Study, found: dict[str, Any]) -> Iterator[Any]:
    settings, history = study.task.settings, found["history"]
    updates, values = ([entry[place] for entry in history] for place in (0, 1))
    shapes = [_built(study, entry[2]) for entry in history]
    figure, canvas = canvas_of(8.0, 4.6)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.3))
    figure.subplots_adjust(left=0.08, right=0.98, bottom=0.13, top=0.92, wspace=0.25)
    for place, mechanism in enumerate(shapes):
        if mechanism is None:
            continue
        left.clear()
        right.clear()
        _draw(left, mechanism)
        left.set_title(f"update {updates[place]}")
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
    """A mechanism under three tensions of its pairs of tendons, the middle one in front."""
    pairs = mechanism.n_tendons // 2
    for ratio in sorted(_RATIOS, key=lambda ratio: ratio == 1.0):
        left = _TENSION * ratio / (1.0 + ratio)
        tensions = [left, _TENSION - left] * pairs if mechanism.n_tendons % 2 == 0 else [_TENSION] * mechanism.n_tendons
        shape = solve_tensions(mechanism, tensions)
        if shape.ok:
            front = ratio == 1.0
            plot_mechanism(
                shape, axes, tendons=front, contacts=False, numbers=False, legend=False,
                color="#56606B" if front else "#C9CED4",
            )  # fmt: skip
    reach = 1.12 * mechanism.length
    axes.set(xlim=(-0.75 * reach, 0.75 * reach), ylim=(-0.15 * reach, reach), aspect="equal", xlabel="", ylabel="")
