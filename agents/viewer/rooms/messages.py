"""What goes wrong in a room, told to the person in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from agents.viewer.html import markdown
from rollingjoint.errors import RollingJointError, one_line


class Messages:
    """A line in the panel of a client, hidden while there is nothing to tell."""

    def __init__(self, gui: Any) -> None:
        self.line = gui.add_markdown("", visible=False)

    def show(self, text: str) -> None:
        """Tell something, which is no Markdown; nothing hides the line."""
        self.line.content, self.line.visible = markdown(text), bool(text)

    def tell(self, error: RollingJointError) -> None:
        """Tell an error."""
        self.show(f"⚠ {one_line(str(error))}")

    @contextmanager
    def told(self) -> Iterator[None]:
        """Tells an error of what is done inside, which then ends; forgets the one before."""
        self.show("")
        try:
            yield
        except RollingJointError as error:
            self.tell(error)
