"""The room Control: a person steers, and other controllers drive the same episode."""

from __future__ import annotations

import threading
from typing import Any, ClassVar

import numpy as np

from agents.viewer.camera import episode_view, look
from agents.viewer.clock import Clock
from agents.viewer.controllers import offered_controllers, worlds
from agents.viewer.play import WAYS, Match, Seat, hidden_load
from agents.viewer.recorded import file_of
from agents.viewer.rooms.messages import Messages
from agents.viewer.scoreboard import Scoreboard
from agents.viewer.solids import Array, in_space
from agents.viewer.stage import Stage
from agents.viewer.steering import KEYS, nudge, pulls

HELP = {
    "point": "Drag the cross, or move it by the keys J, L, I, K{}: the tip of the *model* goes there.",
    "tendons": "Sliders pull tendons in (+) or pay out (−). Keys: J and L bend{}, I tightens, K slackens.",
}
IN_SPACE = {"point": " and O, U (away, back)", "tendons": ", O and U, too"}
RUN, STEP, AGAIN, NEXT = "Run", "Step", "Again", "Next"
HOTKEYS = {"space": RUN, "enter": STEP, "R": AGAIN, "N": NEXT}


class Control:
    """A person in an episode of any tracking environment, with other controllers.

    Args:
        client: the browser.
    """

    name: ClassVar[str] = "Control"

    def __init__(self, client: Any) -> None:
        self.client, self.gui = client, client.gui
        self.match: Match | None = None
        self.clock = Clock(self.step, 5.0)
        self._lock = threading.RLock()
        self.aim: Any = None
        self.sliders: list[Any] = []
        self._parts: list[Any] = []  # of the panel and the scene, of the running episode
        self._commands: list[Any] = []
        self._choices: dict[str, Any] = {}

    def build(self) -> None:
        """Add the widgets to the panel."""
        gui = self.gui
        self.world = gui.add_dropdown("World", tuple(worlds()))
        self.seed = gui.add_number("Episode", 0, min=0, max=2**31 - 1, step=1, hint="the seed")
        self.way = gui.add_dropdown("Steer by", tuple(WAYS))
        self.beside = gui.add_folder("Beside you", expand_by_default=False)
        self.loads = gui.add_checkbox("Hidden load", False)
        self.rate = gui.add_slider("Speed", 1, 20, 1, 5, hint="steps per second")
        self.buttons = gui.add_button_group("Steps", (RUN, STEP, AGAIN, NEXT), hint="Space, Enter, R, N")
        self.note = gui.add_markdown("")
        self.messages = Messages(gui)
        self.steering = gui.add_folder("Steering")
        self.scores = gui.add_folder("Tip error")
        self.saving = gui.add_button("Save these episodes", hint="A file for the room Replay")
        self._offer()
        self._bind()

    def fill(self) -> None:
        """Begin an episode; keys steer from now on."""
        self._commands = [self._command(key) for key in (*KEYS, *HOTKEYS)]
        self.begin()

    def stop(self) -> None:
        """End the episode."""
        self.clock.stop()
        with self._lock:
            if self.match is not None:
                self.match.close()
            self.match = None

    def close(self) -> None:
        """Empty the scene and release the keys."""
        with self._lock:
            self._clear()
            for command in self._commands:
                command.remove()
            self._commands = []

    def begin(self) -> None:
        """Restart the chosen episode."""
        self.stop()
        with self._lock, self.messages.told():
            self._clear()
            beside = [name for name, choice in self._choices.items() if choice.value]
            self.match = Match(Seat(worlds()[self.world.value], int(self.seed.value), self.way.value, beside))
            films = self.match.films
            self.stage = Stage(self.client.scene, films)
            look(self.client, episode_view(films[0].scenes[0]))
            with self.scores:
                self.board = Scoreboard(self.gui, films, self.match.task.config.episode_steps)
            self._parts = [self.stage, self.board]
            self._steer(self.match)
            self.show()

    def step(self) -> bool:
        """One step of all controllers; whether the episode continues."""
        with self._lock, self.messages.told():
            if self.match is not None and not self.match.over:
                self.match.step()
                self.show()
                return not self.match.over
        return False

    def show(self) -> None:
        """Show the present step."""
        if self.match is None:
            return
        film = self.match.films[0]
        self.stage.shows_loads = self.loads.value
        with self.client.atomic():
            self.stage.show(film.steps)
            self.board.show(film.steps)
        load = f" Load: {hidden_load(film, film.steps)}." if self.loads.value else ""
        self.note.content = f"Step {film.steps} of {self.match.task.config.episode_steps}.{load}"

    def press(self, key: str) -> None:
        """Do the action of a key."""
        if key in HOTKEYS:
            self._do(HOTKEYS[key])
        else:
            with self._lock:
                self._steer_by(key)

    def _steer_by(self, key: str) -> None:
        if self.match is None:
            return
        if self.match.seat.way == "point":
            self._point(self.aim.position[: self.match.task.dimension] + nudge(self.match.task, key))
            return
        for slider, more in zip(self.sliders, pulls(self.match.task, key).tolist(), strict=True):
            slider.value = float(np.clip(slider.value + more, -1.0, 1.0))
        self._pull()

    def _do(self, action: str) -> None:
        if action == NEXT:
            self.seed.value = int(self.seed.value) + 1
        if action in (AGAIN, NEXT):
            self.begin()
        elif action == STEP:
            self.step()
        elif self.clock.running:
            self.clock.stop()
        else:
            self.clock.start()

    def _steer(self, match: Match) -> None:
        """Add the widgets by which the person steers."""
        with self.steering:
            more = IN_SPACE[self.way.value] if match.task.dimension == 3 else ""
            self._parts.append(self.gui.add_markdown(HELP[self.way.value].format(more)))
            if self.way.value == "point":
                self._add_point(match)
            else:
                self._add_sliders(match)

    def _add_point(self, match: Match) -> None:
        tip = match.films[0].scenes[0].tip
        flat = match.task.dimension == 2
        self.aim = self.client.scene.add_transform_controls(
            "/aim",
            scale=0.22 * match.task.length,
            disable_rotations=True,
            active_axes=(True, True, not flat),
            depth_test=False,
            position=in_space(tip, self.stage.height),
        )
        self.aim.on_update(lambda _: self._point(self.aim.position[: match.task.dimension]))
        self._parts.append(self.aim)
        match.person.aim_at(tip)

    def _add_sliders(self, match: Match) -> None:
        self.sliders = [
            self.gui.add_slider(f"Tendon {j}", -1.0, 1.0, 0.05, 0.0, hint="in units of action_scale_mm per step")
            for j in range(match.task.action_size)
        ]
        for slider in self.sliders:
            slider.on_update(lambda _: self._pull())
        self._parts += self.sliders

    def _point(self, place: Array) -> None:
        with self._lock, self.messages.told():
            if self.match is not None:
                self.match.person.aim_at(place)
                self.aim.position = in_space(place, self.stage.height)

    def _pull(self) -> None:
        with self._lock, self.messages.told():
            if self.match is not None:
                self.match.person.pull([slider.value for slider in self.sliders])

    def _offer(self) -> None:
        """List the controllers that can drive in the chosen world; a shipped policy is chosen."""
        with self._lock, self.messages.told(), self.beside:
            for choice in self._choices.values():
                choice.remove()
            names = list(offered_controllers(worlds()[self.world.value]))
            self._choices = {name: self.gui.add_checkbox(name, place == 0) for place, name in enumerate(names)}
            for choice in self._choices.values():
                choice.on_update(lambda _: self.begin())

    def _bind(self) -> None:
        self.world.on_update(lambda _: self._move())
        for widget in (self.seed, self.way):
            widget.on_update(lambda event: self.begin() if event.client is not None else None)
        self.loads.on_update(lambda _: self.show())
        self.rate.on_update(lambda _: setattr(self.clock, "rate", float(self.rate.value)))
        self.buttons.on_click(lambda _: self._do(self.buttons.value))
        self.saving.on_click(lambda _: self._save())

    def _move(self) -> None:
        """Another world was chosen."""
        self._offer()
        self.begin()

    def _command(self, key: str) -> Any:
        words = {"space": "Run or pause", "enter": "One step", "R": "The same episode again", "N": "The next episode"}
        command = self.gui.add_command(words.get(key, f"Steer: {key}"), hotkey=key)
        command.on_trigger(lambda _: self.press(key))
        return command

    def _save(self) -> None:
        with self._lock, self.messages.told():
            if self.match is not None:
                content = file_of(self.match.films)
                self.client.send_file_download(f"episodes_{self.seed.value}.json", content, save_immediately=True)

    def _clear(self) -> None:
        """Take the running episode out of panel and scene."""
        for part in self._parts:
            part.remove()
        self._parts = []
