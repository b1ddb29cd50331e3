"""The room Designs: the designs of a search as a scatter plot, and chosen ones, which bend."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from agents.search.pictures import TENSION
from agents.viewer.body import SceneMechanism
from agents.viewer.camera import View, look
from agents.viewer.chart import COLOURS, Area, Chart
from agents.viewer.clock import Clock
from agents.viewer.designs import KINDS, LARGEST_RATIO, Design, Designs
from agents.viewer.html import coloured, html_table
from agents.viewer.rooms.messages import Messages
from agents.viewer.solids import strands
from agents.viewer.stage import FAINT, colour_of
from rj_gym.rendering import LINK, Color, blend
from rollingjoint.checked_yaml import dump_yaml
from rollingjoint.io.mechanism_file import mechanism_to_dict

NONE = "There is no search to show. `rj search FILE` makes one; start the viewer with `--search FOLDER`."
FIRST, SECOND = "first", "second"
PLACES: Mapping[str, Color] = {FIRST: colour_of(0), SECOND: colour_of(2)}
"""The two designs that are compared, and their colours."""

DOT, RING = "&#9679;", "&#9711;"
RANGE = (TENSION / (1 + LARGEST_RATIO), TENSION - TENSION / (1 + LARGEST_RATIO))
SECONDS = 4.0  # of bending to and fro
RATE = 25.0  # pictures per second of it


class DesignsRoom:
    """The designs of searches.

    Args:
        client: the browser. searches: to choose from.
    """

    name: ClassVar[str] = "Designs"

    def __init__(self, client: Any, searches: Sequence[Designs] = ()) -> None:
        self.client, self.gui = client, client.gui
        self.searches = {designs.name: designs for designs in searches}
        self.clock = Clock(self._swing, RATE)
        self.chosen: dict[str, Design] = {}
        self._bodies: dict[str, SceneMechanism] = {}
        self._chart: Chart | None = None
        self._lock = threading.RLock()
        self._phase = 0.0

    def build(self) -> None:
        """Add the widgets to the panel."""
        gui = self.gui
        self.messages = Messages(gui)
        if not self.searches:
            gui.add_markdown(NONE)
            return
        self.search = gui.add_dropdown("Search", tuple(self.searches))
        quantities = self.designs.quantities
        across, up = self.designs.axes
        self.across = gui.add_dropdown("Across", tuple(quantities), initial_value=quantities[across])
        self.up = gui.add_dropdown("Up", tuple(quantities), initial_value=quantities[up])
        gui.add_html(_legend())
        self.place = gui.add_dropdown("A click chooses", tuple(PLACES))
        self.row = gui.add_number("Design", 0, min=0, step=1)
        self.bend = gui.add_slider("Bend", -1.0, 1.0, 0.02, 0.0, hint="the share by which one tendon pulls harder")
        self.swings = gui.add_checkbox("To and fro", False)
        self.comparison = gui.add_html("")
        self.copy = gui.add_button("Save the first as YAML", hint="A mechanism file")
        self._bind()

    @property
    def designs(self) -> Designs:
        """The search that is shown."""
        return self.searches[self.search.value]

    def fill(self) -> None:
        """Show the best design and the reference."""
        if self.searches:
            self.begin()

    def stop(self) -> None:
        """Stop bending to and fro."""
        self.clock.stop()

    def close(self) -> None:
        """Empty the scene."""
        with self._lock:
            self._clear()

    def begin(self) -> None:
        """Show the chosen search from the start: its best design and the reference."""
        with self._lock, self.messages.told():
            self._clear()
            self.plot()
            best, reference = self.designs.design(self.designs.best), self.designs.reference
            self._put(SECOND, reference)
            self._put(FIRST, best)
            length = best.mechanism.length
            centre, offset = np.array([-0.3, 0.42, 0.0]), np.array([0.0, 0.0, 4.3])
            look(self.client, View(centre * length, offset * length, (0.0, 1.0, 0.0)))

    def plot(self) -> None:
        """Draw the plot over the two chosen quantities."""
        with self._lock, self.messages.told():
            if self._chart is not None:
                self._chart.remove()
            quantities, length = self.designs.quantities, self.designs.reference.mechanism.length
            points = self.designs.points(quantities.index(self.across.value), quantities.index(self.up.value))
            area = Area(-1.75 * length, 0.0, 1.05 * length, 0.95 * length)
            self._chart = Chart(self.client.scene, area, points, (self.across.value, self.up.value), self.choose)
            for place in self.chosen:
                self._mark(place)

    def choose(self, row: int) -> None:
        """Show a design of the search in the place that clicks choose."""
        with self._lock, self.messages.told():
            self._put(self.place.value, self.designs.design(row))

    def show(self) -> None:
        """Bend both designs by the value of the slider."""
        with self._lock, self.messages.told(), self.client.atomic():
            for place, design in self.chosen.items():
                shape: Any = design.bent(float(self.bend.value))
                if not shape.ok:
                    self.messages.show(f"⚠ {design.title}: {shape.status.message}")
                    continue
                lines = strands(design.mechanism, shape.poses, shape.tensions)
                self._bodies[place].show(shape.poses, lines, RANGE)

    def _put(self, place: str, design: Design) -> None:
        if place in self._bodies:
            self._bodies[place].remove()
        solid = place == FIRST
        colour = blend(LINK, PLACES[place], 0.25 if solid else 0.75)
        behind = 0.0 if solid else 0.008 * design.mechanism.length
        opacity = 1.0 if solid else FAINT
        self._bodies[place] = SceneMechanism(self.client.scene, f"/{place}", design.mechanism, colour, opacity, behind)
        self.chosen[place] = design
        self._mark(place)
        self._compare()
        self.show()

    def _compare(self) -> None:
        shown = {place: self.chosen[place] for place in PLACES if place in self.chosen}
        head = [coloured(_css(PLACES[place]), design.title, RING) for place, design in shown.items()]
        self.comparison.content = html_table(["", *head], self.designs.compared(list(shown.values())))

    def _mark(self, place: str) -> None:
        assert self._chart is not None
        self._chart.mark(place, self.chosen[place].row, PLACES[place])

    def _swing(self) -> bool:
        self._phase += 2 * np.pi / (RATE * SECONDS)
        self.bend.value = round(float(np.sin(self._phase)), 3)
        self.show()
        return True

    def _bind(self) -> None:
        self.search.on_update(lambda _: self.begin())
        for axis in (self.across, self.up):
            axis.on_update(lambda _: self.plot())
        self.row.on_update(lambda event: self.choose(int(self.row.value)) if event.client is not None else None)
        self.bend.on_update(lambda event: self.show() if event.client is not None else None)
        self.swings.on_update(lambda _: self.clock.start() if self.swings.value else self.clock.stop())
        self.copy.on_click(lambda _: self._save())

    def _save(self) -> None:
        design = self.chosen[FIRST]
        name = design.title.replace(" ", "_")
        content = dump_yaml(mechanism_to_dict(design.mechanism)).encode()
        self.client.send_file_download(f"{name}.yaml", content, save_immediately=True)

    def _clear(self) -> None:
        for part in (*self._bodies.values(), self._chart):
            if part is not None:
                part.remove()
        self._bodies, self.chosen, self._chart = {}, {}, None


def _legend() -> str:
    """The kinds of points as HTML."""
    parts = [coloured(_css(colour), kind, DOT) for kind, colour in zip(KINDS, COLOURS, strict=True)]
    return f'<p style="font-size:0.85em">{" &ensp; ".join(parts)}</p>'


def _css(colour: Color) -> str:
    return f"rgb{colour}"
