"""Buttons of which one is chosen, and marked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

MARK = "● "


class ButtonRow:
    """A row of buttons in the panel of a browser; the chosen one is marked.

    Args:
        gui: of the client. label: of the row. names: of the buttons, of which the first is chosen.
        choose: called with the name of the button that is clicked, which marks nothing.
    """

    def __init__(self, gui: Any, label: str, names: Sequence[str], choose: Callable[[str], None]) -> None:
        self.names = tuple(names)
        self.buttons = gui.add_button_group(label, self._marked(self.names[0]))
        self.buttons.on_click(lambda _: choose(self.buttons.value.removeprefix(MARK)))

    def mark(self, name: str) -> None:
        """Mark this one as chosen."""
        self.buttons.options = self._marked(name)

    def _marked(self, chosen: str) -> tuple[str, ...]:
        return tuple(f"{MARK}{name}" if name == chosen else name for name in self.names)
