"""Errors in a room, shown to the person in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from agents.viewer.html import markdown
from rollingjoint.errors import RollingJointError, one_line


class Messages:
    """A line in the panel of a client, hidden while it is empty."""

    def __init__(self, gui: Any) -> None:
        self.line = gui.add_markdown("", visible=False)

    def show(self, text: str) -> None:
        """Show plain text, without Markdown; an empty text hides the line."""
        self.line.content, self.line.visible = markdown(text), bool(text)

    def tell(self, error: RollingJointError) -> None:
        """Show an error."""
        self.show(f"⚠ {one_line(str(error))}")

    @contextmanager
    def told(self) -> Iterator[None]:
        """A context that ends with an error and shows it; the message before is removed."""
        self.show("")
        try:
            yield
        except RollingJointError as error:
            self.tell(error)
