"""The rooms of the viewer: each is one tab of one browser.

Modules:
    explore: a mechanism under tendons, loads, friction and curvatures that a person sets.
    control: a person steers, others drive the same episode.
    replay: episodes step by step.
    designs: the designs of a search.
    messages: errors, in one line.
"""

from __future__ import annotations

from typing import ClassVar, Protocol

from agents.viewer.rooms.messages import Messages


class Room(Protocol):
    """One room for one client: made when the client enters, stopped when it vanishes; when it leaves, closed, too."""

    name: ClassVar[str]
    messages: Messages  # from build() on

    def build(self) -> None:
        """Add the room's widgets to the panel, in the container that is open."""

    def fill(self) -> None:
        """Fill the scene; the room may run clocks from now on."""

    def stop(self) -> None:
        """Stop all clocks; the client may be gone."""

    def close(self) -> None:
        """Empty the scene of a room that has stopped."""
