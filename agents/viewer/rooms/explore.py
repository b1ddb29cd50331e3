"""The room Explore: a mechanism under tendons, loads, friction and curvatures, among walls, that a person sets."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from agents.viewer.around import NO_WALLS, Around, WallScene
from agents.viewer.body import SceneMechanism
from agents.viewer.camera import among_walls_view, look, mechanism_view
from agents.viewer.choice import ButtonRow
from agents.viewer.explorer import HIGHEST, INPUTS, MOST_PULL, TENSIONS, Explorer
from agents.viewer.html import code_block, html_table
from agents.viewer.rooms.messages import Messages
from agents.viewer.solids import Array, front, in_space, strands
from agents.viewer.stage import FAINT, add_grid
from rj_gym.rendering import FAINT as GREY
from rj_gym.rendering import LINK, LOAD, Color
from rollingjoint import PRESETS
from rollingjoint.checks import as_choice
from rollingjoint.io.mechanism_file import load_mechanism

CONTACT: Color = (0, 114, 178)
ELLIPSE: Color = (120, 90, 160)
REACH: Color = (150, 190, 150)
WALL: Color = (201, 167, 143)
PRESSED: Color = (140, 29, 64)
STICKS: Color = (0, 158, 115)
RANGE = (0.0, HIGHEST)
PER_NEWTON = 0.3  # length of an arrow of the force, and of forces of walls, in lengths of the mechanism per newton
PER_CONTACT = 0.015  # and of a contact force
PUSH = (-0.5, 1.5)  # lengths by which the base can be pushed in
CONTACTS = ("link", "wall", "gap [mm]", "normal [N]", "friction [N]", "")

FILES = {"Python": "py", "YAML": "yaml", "STL": "stl.zip", "DXF": "dxf.zip"}


def named(mechanisms: Sequence[str]) -> dict[str, str]:
    """Presets and mechanism files by the name to be shown: of a file without its folder, if no other has that name."""
    names = [Path(each).stem if each not in PRESETS else each for each in mechanisms]
    return {each if names.count(name) > 1 else name: each for name, each in zip(names, mechanisms, strict=True)}


class Explore:
    """A mechanism in a browser.

    Args:
        client: the browser. mechanisms: names of presets and mechanism files; the first is shown at once.
        scenes: surroundings of files, by name; the first for chains of its kind is around a chain at once.
    """

    name: ClassVar[str] = "Explore"

    def __init__(
        self, client: Any, mechanisms: Sequence[str] = tuple(PRESETS), scenes: Mapping[str, WallScene] | None = None
    ) -> None:
        self.client, self.gui, self.mechanisms = client, client.gui, named(mechanisms)
        self.scenes = scenes or {}
        self.explorer = self._explorer(next(iter(self.mechanisms)))
        self._lock = threading.RLock()
        self._bodies: dict[bool, SceneMechanism] = {}  # by whether it is the equilibrium, or the last one
        self._parts: list[Any] = []  # of the panel and the scene, of this mechanism
        self._of_walls: list[Any] = []  # widgets and crosses
        self._shapes: list[Any] = []  # of the walls
        self._quiet = False  # while widgets follow, not lead

    def _explorer(self, name: str) -> Explorer:
        """A mechanism from the start."""
        return Explorer(load_mechanism(self.mechanisms[name]), name, self.scenes)

    def build(self) -> None:
        """Add the widgets to the panel."""
        gui = self.gui
        self.which = gui.add_dropdown("Mechanism", tuple(self.mechanisms))
        self.headline, self.touching = gui.add_markdown(""), gui.add_markdown("", visible=False)
        self.messages = Messages(gui)
        self.drive = ButtonRow(gui, "Input", INPUTS, self._drive)
        self.tendons = gui.add_folder("Tendons")
        self.walls = gui.add_folder("Walls")
        self.load = gui.add_folder("Force")
        self.friction = gui.add_slider("Friction", 0.0, 0.3, 0.01, 0.0, hint="coefficient in all holes")
        self.curvatures = gui.add_folder("Curvatures", expand_by_default=False)
        self.shown = {name: gui.add_checkbox(name, name != "Reach") for name in ("Contact forces", "Links", "Reach")}
        self.ellipse = gui.add_checkbox("Compliance of the tip", True)
        with gui.add_folder("Numbers", expand_by_default=False):
            self.numbers = gui.add_markdown("")
        with gui.add_folder("Write down", expand_by_default=False):
            self.code = gui.add_markdown("")
            self.saving = gui.add_button_group("Save as", tuple(FILES))
        self._bind()

    def fill(self) -> None:
        """Show the mechanism."""
        self.begin()

    def stop(self) -> None:
        """No clock runs in this room."""

    def close(self) -> None:
        """Empty the scene."""
        with self._lock:
            self._clear()

    def begin(self) -> None:
        """Show the chosen mechanism from the start."""
        with self._lock, self.messages.told():
            name = as_choice("mechanism", self.which.value, tuple(self.mechanisms))
            self._clear()
            self.explorer = self._explorer(name)
            self.drive.mark(self.explorer.inputs.drive)
            self.shown["Contact forces"].visible = self.explorer.has_contacts
            look(self.client, mechanism_view(self.explorer.mechanism))
            self._fill()
            self.show()
        first = next(iter(self.explorer.scenes))
        if first in self.scenes:
            self.surround(first)

    def change(self, **changes: Any) -> None:
        """Set inputs; errors are shown, and the widgets stay as they are."""
        if self._quiet:
            return
        with self._lock, self.messages.told():
            before = self.explorer.mechanism
            self.explorer.change(**changes)
            if self.explorer.mechanism is not before:
                self._embody()
            self.show()
            if "around" in changes:
                self._enclose()
            if self.shown["Reach"].value and changes.keys() - {"tensions", "pulls", "drive"}:
                self.reach()

    def show(self) -> None:
        """Show the equilibrium, or in grey the last one where there is none."""
        explorer, equilibrium = self.explorer, self.explorer.usable
        self.headline.content = explorer.headline
        self.touching.content = explorer.wall_line
        self.touching.visible = bool(explorer.wall_line)
        self.contacts.content = html_table(CONTACTS, explorer.wall_table)
        self.contacts.visible = bool(explorer.wall_table)
        self.numbers.content = code_block(explorer.table)
        self.code.content = code_block(explorer.python, "python")
        with self.client.atomic():
            for usable, body in self._bodies.items():
                body.visible = usable is bool(explorer.found.ok) and equilibrium is not None
            if equilibrium is not None:
                poses = explorer.poses(equilibrium)
                lines = strands(explorer.mechanism, poses, equilibrium.tensions)
                body = self._bodies[bool(explorer.found.ok)]
                body.show(poses, lines, RANGE)
                body.number(poses if self.shown["Links"].value else None)
            self._arrows()
            self._ellipses()

    def reach(self) -> None:
        """Show or hide the reach of the tip."""
        with self._lock, self.messages.told():
            points = self.explorer.reached() if self.shown["Reach"].value else np.zeros((0, 3))
            places = in_space(points, -self._height)
            size = 0.004 * self.explorer.mechanism.length
            self.client.scene.add_point_cloud("/explore/reach", places, REACH, point_size=size, point_shape="circle")

    def drag(self, place: Array) -> None:
        """Set the force from the dragged end of its arrow."""
        begin = self._origin
        size = len(self.explorer.inputs.force)
        way = self.explorer.in_base(np.asarray(place)[:size] - begin[:size])
        force = way / (PER_NEWTON * self.explorer.mechanism.length)
        with self._lock:
            self._quiet = True
            for number, value in zip(self.forces, force, strict=True):
                number.value = round(float(value), 3)
            self._quiet = False
        self.change(force=tuple(float(value) for value in force))

    def _chosen_walls(self) -> None:
        if self.around.value != self.explorer.inputs.around.walls:
            self.surround(self.around.value)

    def surround(self, name: str) -> None:
        """Put these walls around the mechanism."""
        scene = self.explorer.scenes.get(name)
        self.change(around=Around() if scene is None else scene.begun(name))
        with self._lock:
            self._wall_widgets()
            view = mechanism_view(self.explorer.mechanism)
            if scene is not None:
                view = among_walls_view(self.explorer.mechanism, *scene.frame_at(scene.begun(name)))
            look(self.client, view)

    def drag_obstacle(self, number: int, place: Array) -> None:
        """Move an obstacle to where its cross is dragged."""
        with self._lock:  # a change may be under way
            around, scene = self.explorer.inputs.around, self.explorer.scene
            if scene is None or number >= len(around.moved):
                return
            moved, begun = list(around.moved), scene.places(scene.begun(around.walls))[number]
            moved[number] = tuple((np.asarray(place, float)[: len(begun)] - begun).tolist())
            self.change(around=replace(around, moved=tuple(moved)))

    def _set_walls(self, **numbers: Any) -> None:
        """Set numbers of the walls: bend, feed, stiffness, friction."""
        with self._lock:
            self.change(around=replace(self.explorer.inputs.around, **numbers))

    @property
    def _height(self) -> float:
        """The height of lines, in front of the links of a planar chain [mm]."""
        return front(self.explorer.mechanism) if self.explorer.flat else 0.0

    @property
    def _origin(self) -> Array:
        """The point of application of the force, (3,) [mm]."""
        explorer = self.explorer
        pose = explorer.poses(explorer.usable if explorer.usable is not None else explorer.found)[explorer.inputs.link]
        return in_space(pose[:2] if self.explorer.flat else pose[:3, 3], self._height)

    def _fill(self) -> None:
        """Make the widgets and bodies of this mechanism."""
        self._parts.append(add_grid(self.client.scene, "/explore/grid", self.explorer.mechanism))
        self._embody()
        self._pull()
        with self.walls:
            names = (NO_WALLS, *self.explorer.scenes)
            self.around = self.gui.add_dropdown("Around the chain", names)
            self.contacts = self.gui.add_html("", visible=False, order=1e6)  # below the sliders
        self.around.on_update(lambda _: self._chosen_walls())
        explorer, size = self.explorer, len(self.explorer.inputs.force)
        with self.load:
            last = explorer.mechanism.n_links - 1
            self.link = self.gui.add_slider("On link", 0, last, 1, explorer.inputs.link)
            self.forces = [
                self.gui.add_number(f"{axis} [N]", 0.0, min=-5.0, max=5.0, step=0.01) for axis in "xyz"[:size]
            ]
        with self.curvatures:
            surfaces = [self.gui.add_slider(name, 0.5, 1.5, 0.01, 1.0) for name in explorer.surface_names]
        self.curvatures.visible = bool(surfaces)
        self.link.on_update(lambda _: self.change(link=int(self.link.value)))
        for number in self.forces:
            number.on_update(lambda _: self.change(force=tuple(float(widget.value) for widget in self.forces)))
        for surface in surfaces:
            surface.on_update(lambda _: self.change(curvatures=tuple(float(widget.value) for widget in surfaces)))
        self._quiet, self.friction.value = True, explorer.inputs.friction
        self._quiet = False
        self.handle = self.client.scene.add_transform_controls(
            "/force", scale=0.18 * explorer.mechanism.length, disable_rotations=True,
            active_axes=(True, True, not explorer.flat), depth_test=False, position=self._origin,
        )  # fmt: skip
        self.handle.on_update(lambda _: self.drag(self.handle.position))
        self._parts += [self.link, *self.forces, *surfaces, self.handle, self.around, self.contacts]

    def _pull(self) -> None:
        """Make the sliders of the tendons: tensions, or pulls."""
        for slider in getattr(self, "pulls", []):
            slider.remove()
        inputs, length = self.explorer.inputs, self.explorer.mechanism.length
        pulls = inputs.drive != TENSIONS
        values, highest = (inputs.pulls, round(MOST_PULL * length)) if pulls else (inputs.tensions, HIGHEST)
        name, lowest = ("Pull {} [mm]", -highest) if pulls else ("Tension {} [N]", 0.0)
        with self.tendons:
            self.pulls = [
                self.gui.add_slider(
                    name.format(j), lowest, highest, 0.01, round(float(np.clip(value, lowest, highest)), 2)
                )
                for j, value in enumerate(values)
            ]
        for slider in self.pulls:
            slider.on_update(lambda _: self.change(**{"pulls" if pulls else "tensions": self._pulled()}))

    def _wall_widgets(self) -> None:
        """Make the sliders and crosses of the walls that are around the mechanism."""
        self._forget_walls()
        explorer, scene = self.explorer, self.explorer.scene
        around = explorer.inputs.around
        if self.around.value != around.walls:
            self.around.value = around.walls
        if scene is None:
            return
        gui, length, surroundings = self.gui, explorer.mechanism.length, scene.surroundings
        low, high = (round(share * length) for share in PUSH)
        wall = surroundings.walls[0]
        law = wall.friction or surroundings.friction
        with self.walls:
            sliders = {"feed": gui.add_slider("Push in [mm]", low, high, 0.1, around.feed)}
            if any(any(lumen.curvatures) for lumen in scene.lumens):
                sliders["bend"] = gui.add_slider("Bend", 0.0, 2.0, 0.01, around.bend, hint="factor of the curvatures")
            mu = law.mu if law is not None else 0.0
            sliders["friction"] = gui.add_slider("Wall friction", 0.0, 1.0, 0.01, mu)
            if not surroundings.rigid:
                sliders["stiffness"] = gui.add_number("Stiffness [N/mm]", wall.stiffness, min=0.01, max=1000, step=0.01)
        for name, slider in sliders.items():
            slider.on_update(lambda event, name=name: self._set_walls(**{name: float(event.target.value)}))
        crosses = [self._cross(number, place) for number, place in enumerate(scene.places(around))]
        self._of_walls = [*sliders.values(), *crosses]

    def _cross(self, number: int, place: Array) -> Any:
        """A cross by which an obstacle is dragged."""
        cross = self.client.scene.add_transform_controls(
            f"/obstacle/{number}", scale=0.15 * self.explorer.mechanism.length, disable_rotations=True,
            active_axes=(True, True, not self.explorer.flat), depth_test=False,
            position=in_space(place, self._height),
        )  # fmt: skip
        cross.on_update(lambda _: self.drag_obstacle(number, cross.position))
        return cross

    def _enclose(self) -> None:
        """Draw the walls."""
        for part in self._shapes:
            part.remove()
        flat, scene = self.explorer.flat, self.client.scene
        how: Any = {"color": WALL, "opacity": 0.6 if flat else 0.3, "flat_shading": flat}
        how |= {"side": "front" if flat else "double"}
        solids = self.explorer.wall_solids
        self._shapes = [scene.add_mesh_simple(f"/walls/{k}", *solid, **how) for k, solid in enumerate(solids)]

    def _forget_walls(self) -> None:
        for part in self._of_walls:
            part.remove()
        self._of_walls = []

    def _pulled(self) -> tuple[float, ...]:
        return tuple(float(slider.value) for slider in self.pulls)

    def _drive(self, drive: str) -> None:
        """Drive by tensions or lengths from now on, from the present equilibrium."""
        if drive != self.explorer.inputs.drive:
            self.change(drive=drive)
            with self._lock:
                self.drive.mark(self.explorer.inputs.drive)
                self._pull()

    def _embody(self) -> None:
        for body in self._bodies.values():
            body.remove()
        scene, mechanism = self.client.scene, self.explorer.mechanism
        self._bodies = {True: SceneMechanism(scene, "/mechanism", mechanism, LINK)}
        self._bodies[False] = SceneMechanism(scene, "/before", mechanism, GREY, FAINT)

    def _arrows(self) -> None:
        """The force, with a handle at its end, and the contact forces."""
        explorer, length = self.explorer, self.explorer.mechanism.length
        force = in_space(explorer.in_world(np.array(explorer.inputs.force), turned_only=True), 0.0)
        begin, by = self._origin, PER_NEWTON * length * force
        if not self._quiet:
            self.handle.position = begin + by
        arrows = [(np.stack([begin, begin + by]), LOAD)] if np.any(force) else []
        if self.shown["Contact forces"].value:
            for at, contact in explorer.contact_arrows:
                start = in_space(at, self._height)
                arrows.append((np.stack([start, start + PER_CONTACT * length * in_space(contact)]), CONTACT))
            for place, push, sticks in explorer.wall_arrows:
                start, end = (in_space(at, self._height) for at in (place, place + PER_NEWTON * length * push))
                arrows.append((np.stack([start, end]), STICKS if sticks else PRESSED))
        points = np.array([points for points, _ in arrows]).reshape(-1, 2, 3)
        colours = np.array([colour for _, colour in arrows], np.uint8).reshape(-1, 3)
        unit = 0.01 * length
        sizes = {"shaft_radius": 0.5 * unit, "head_radius": 1.4 * unit, "head_length": 3.5 * unit}
        self.client.scene.add_arrows("/explore/forces", points, colours, **sizes)

    def _ellipses(self) -> None:
        """Draw the positions of the tip under a force in any direction."""
        force, ellipses = self.explorer.ellipses() if self.ellipse.value else (0.0, [])
        self.ellipse.hint = f"where {force:g} N in any direction moves the tip" if ellipses else ""
        corners = [in_space(ellipse, self._height) for ellipse in ellipses]
        pieces = [np.stack([line[:-1], line[1:]], axis=1) for line in corners]
        points = np.concatenate(pieces) if pieces else np.zeros((0, 2, 3))
        self.client.scene.add_line_segments(
            "/explore/ellipse", points, ELLIPSE, thickness=2.0, thickness_units="screen"
        )

    def _save(self, kind: str) -> None:
        with self._lock, self.messages.told():
            name, content = f"{self.explorer.name}.{FILES[kind]}", self._content(kind)
            self.client.send_file_download(name, content, save_immediately=True)

    def _content(self, kind: str) -> bytes:
        if kind in ("Python", "YAML"):
            return (self.explorer.python if kind == "Python" else self.explorer.yaml).encode()
        return self.explorer.workshop_files(kind.lower())

    def _bind(self) -> None:
        self.which.on_update(lambda _: self.begin())
        self.friction.on_update(lambda _: self.change(friction=float(self.friction.value)))
        for name in ("Contact forces", "Links"):
            self.shown[name].on_update(lambda _: self._shown())
        self.ellipse.on_update(lambda _: self._shown())
        self.shown["Reach"].on_update(lambda _: self.reach())
        self.saving.on_click(lambda _: self._save(self.saving.value))

    def _shown(self) -> None:
        with self._lock:
            self.show()

    def _clear(self) -> None:
        self._forget_walls()
        parts = [*self._bodies.values(), *self._parts, *self._shapes, *getattr(self, "pulls", [])]
        for part in parts:
            part.remove()
        self._bodies, self._parts, self._shapes, self.pulls = {}, [], [], []
        self.client.scene.add_frame("/explore", show_axes=False).remove()
