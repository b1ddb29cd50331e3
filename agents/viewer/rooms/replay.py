"""The room Replay: episodes of policies, run folders and recordings, to be looked at step by step."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

from agents.viewer.camera import episode_view, look
from agents.viewer.clock import Clock
from agents.viewer.drive import Film
from agents.viewer.episodes import RANKS, EpisodeSet, grouped, of_shipped_policies
from agents.viewer.play import hidden_load
from agents.viewer.record import episode_page
from agents.viewer.recorded import file_of, records_in
from agents.viewer.rooms.messages import Messages
from agents.viewer.scoreboard import Scoreboard
from agents.viewer.stage import Stage

CHOSEN = "seed below"


class Replay:
    """Episodes, step by step, with other controllers over them.

    Args:
        client: the browser. shelf: episodes to choose from; the ones of shipped policies follow.
    """

    name: ClassVar[str] = "Replay"

    def __init__(self, client: Any, shelf: Sequence[EpisodeSet] = ()) -> None:
        self.client, self.gui = client, client.gui
        self.shelf = {_title(episodes): episodes for episodes in [*shelf, *of_shipped_policies()]}
        self.clock = Clock(self.forward, 10.0)
        self.films: list[Film] = []
        self._lock = threading.RLock()
        self._parts: list[Any] = []
        self._choices: dict[str, Any] = {}
        self._known: dict[tuple[str, str, int], Film] = {}

    def build(self) -> None:
        """Add the widgets to the panel."""
        gui = self.gui
        self.source = gui.add_dropdown("Episodes of", tuple(self.shelf))
        self.rank = gui.add_dropdown("Which one", (*RANKS, CHOSEN), initial_value="median")
        self.seed = gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1)
        self.others = gui.add_folder("Over it", expand_by_default=False)
        self.at = gui.add_slider("Step", 0, 1, 1, 0)
        self.rate = gui.add_slider("Speed", 1, 60, 1, 10, hint="steps per second")
        self.buttons = gui.add_button_group("Play", ("Play", "Back", "Ahead", "Start"))
        self.loads = gui.add_checkbox("Hidden load", True)
        self.note = gui.add_markdown("")
        self.messages = Messages(gui)
        self.scores = gui.add_folder("Tip error")
        self.upload = gui.add_upload_button("Open a file of episodes", mime_type="application/json")
        self.saving = gui.add_button("Save these episodes")
        self.paging = gui.add_button("Save as a page", hint="It plays in any browser, without this viewer")
        self._offer()
        self._bind()

    def fill(self) -> None:
        """Show the chosen episode."""
        self.choose()

    def stop(self) -> None:
        """Pause."""
        self.clock.stop()

    def close(self) -> None:
        """Empty the scene."""
        with self._lock:
            self._clear()

    def forward(self) -> bool:
        """One step on; whether there are more."""
        with self._lock:
            if self.at.value >= self._steps:
                return False
            self.at.value = self.at.value + 1
            self.show()
            return True

    def show(self) -> None:
        """Show the step at the slider."""
        with self._lock:
            if not self.films:
                return
            step = int(self.at.value)
            self.stage.shows_loads = self.loads.value
            with self.client.atomic():
                self.stage.show(step)
                self.board.show(step)
            load = f" Load: {hidden_load(self.films[0], step)}." if self.loads.value else ""
            self.note.content = f"Step {step} of {self._steps}, seed {self.films[0].seed}.{load}"

    def choose(self) -> None:
        """Find the chosen episode under all chosen controllers, and show its start."""
        self.clock.stop()
        with self._lock, self.messages.told():
            episodes = self.shelf[self.source.value]
            if self.rank.value != CHOSEN:
                self.seed.value = episodes.ranked()[self.rank.value]
            seed = int(self.seed.value)
            films = [self._film(self.source.value, episodes, seed)]
            beside = episodes.beside()
            names = [name for name, choice in self._choices.items() if choice.value]
            films += [self._film(name, beside[name], seed) for name in names]
            self._show_films(films)

    @property
    def _steps(self) -> int:
        return max((film.steps for film in self.films), default=0)

    def _film(self, name: str, source: Any, seed: int) -> Film:
        """The episode under one controller, which is computed once."""
        key = self.source.value, name, seed
        if key not in self._known:
            self._known[key] = source.film(seed)
        return self._known[key]

    def _show_films(self, films: list[Film]) -> None:
        self._clear()
        self.films = films
        self.at.max, self.at.value = self._steps, 0
        self.stage = Stage(self.client.scene, films)
        look(self.client, episode_view(films[0].scenes[0]))
        with self.scores:
            self.board = Scoreboard(self.gui, films, self._steps)
        self._parts = [self.stage, self.board]
        self.show()

    def _do(self, action: str) -> None:
        if action == "Play" and not self.clock.running:
            self.at.value = 0 if self.at.value >= self._steps else self.at.value
            self.clock.start()
            return
        self.clock.stop()
        moved = {"Back": self.at.value - 1, "Ahead": self.at.value + 1, "Start": 0}.get(action, self.at.value)
        self.at.value = min(max(moved, 0), self._steps)
        self.show()

    def _offer(self) -> None:
        """List the other controllers that can drive in the chosen episodes."""
        with self._lock, self.messages.told(), self.others:
            for choice in self._choices.values():
                choice.remove()
            names = self.shelf[self.source.value].beside()
            self._choices = {name: self.gui.add_checkbox(name, False) for name in names}
            for choice in self._choices.values():
                choice.on_update(lambda _: self.choose())

    def _bind(self) -> None:
        self.source.on_update(lambda _: self._turn_to())
        self.rank.on_update(lambda _: self.choose())
        self.seed.on_update(lambda event: self._go_to_seed() if event.client is not None else None)
        self.at.on_update(lambda event: self.show() if event.client is not None else None)
        self.loads.on_update(lambda _: self.show())
        self.rate.on_update(lambda _: setattr(self.clock, "rate", float(self.rate.value)))
        self.buttons.on_click(lambda _: self._do(self.buttons.value))
        self.upload.on_upload(lambda _: self._opened(self.upload.value))
        self.saving.on_click(lambda _: self._save("json", file_of))
        self.paging.on_click(lambda _: self._save("html", lambda films: episode_page(films).encode()))

    def _turn_to(self) -> None:
        """Other episodes were chosen."""
        self._offer()
        self.choose()

    def _go_to_seed(self) -> None:
        """A seed was typed."""
        if self.rank.value == CHOSEN:
            self.choose()
        else:
            self.rank.value = CHOSEN

    def _opened(self, file: Any) -> None:
        """Put the episodes of an uploaded file on the shelf, and show them."""
        with self.messages.told():
            sets = grouped(records_in(file.content, file.name))
            opened = {f"{_title(episodes)} ({file.name})": episodes for episodes in sets}
            self.shelf = opened | self.shelf
            self.source.options = tuple(self.shelf)
            self.source.value = next(iter(opened))

    def _save(self, ending: str, content: Callable[[Sequence[Film]], bytes]) -> None:
        with self._lock, self.messages.told():
            if self.films:
                name = f"episodes_{self.films[0].seed}.{ending}"
                self.client.send_file_download(name, content(self.films), save_immediately=True)

    def _clear(self) -> None:
        for part in self._parts:
            part.remove()
        self._parts, self.films = [], []


def _title(episodes: EpisodeSet) -> str:
    return f"{episodes.name}, {episodes.env.id.removeprefix('rj_gym/')}"
