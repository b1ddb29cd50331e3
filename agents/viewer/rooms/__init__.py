"""The rooms of the viewer: each is what one browser sees and does in one of its tabs.

Modules:
    control: a person steers, others drive the same episode.
    replay: episodes step by step.
    designs: what a search found.
    messages: what goes wrong, in one line.
"""

from __future__ import annotations

from typing import ClassVar, Protocol


class Room(Protocol):
    """One room for one client; it is made when the client enters and closed when it leaves or vanishes."""

    name: ClassVar[str]

    def build(self) -> None:
        """Add the room's widgets to the panel, in the container that is open."""

    def open(self) -> None:
        """Fill the scene; the room may run clocks from now on."""

    def close(self) -> None:
        """Empty the scene and stop every clock."""
