"""The server of the viewer: separate rooms for every browser."""

from __future__ import annotations

import ipaddress
import threading
from collections.abc import Callable, Mapping
from typing import Any

from agents.viewer.camera import View, begin_with
from agents.viewer.choice import ButtonRow
from agents.viewer.guard import Guard
from agents.viewer.rooms import Room
from agents.viewer.serving import Uploads, started, stop
from rollingjoint.errors import InvalidInput

Rooms = Mapping[str, Callable[[Any], Room]]
"""The function that makes a room for a client, by name of the room."""

BRAND = (70, 110, 170)


class Viewer:
    """A server of rooms that browsers enter; runs from when it is made until stop().

    Args:
        rooms: the first is entered at once. host: address to listen at. port: 0 for any that is free.
        exposed: whether addresses that other machines can reach are allowed.
        view: of the first room, see camera.look.
    Raises:
        InvalidInput: such an address without `exposed`, or a viser that cannot be guarded.
        OSError: a port that is in use, or an address that is not this machine's.
    """

    def __init__(
        self,
        rooms: Rooms,
        host: str = "127.0.0.1",
        port: int = 8080,
        exposed: bool = False,
        view: View | None = None,
    ) -> None:
        check_host(host, exposed)
        self.rooms = rooms
        self.visits: dict[int, Visit] = {}
        self.guard = Guard(host)
        self.server = started(self.guard, port)
        self.server.gui.set_panel_label("rolling joints")
        self.server.gui.configure_theme(brand_color=BRAND, show_logo=False, show_share_button=False)
        if view is not None:
            begin_with(self.server, view)
        self.server.on_client_connect(self._enter)
        self.server.on_client_disconnect(self._leave)

    @property
    def url(self) -> str:
        """The address for a browser, with its token."""
        return self.guard.url(self.server.get_port())

    def stop(self) -> None:
        """Close all rooms and stop serving."""
        for visit in list(self.visits.values()):
            visit.close()
        stop(self.server)

    def _enter(self, client: Any) -> None:
        self.visits[client.client_id] = Visit(client, self.rooms)
        self.visits[client.client_id].enter(next(iter(self.rooms)))

    def _leave(self, client: Any) -> None:
        if visit := self.visits.pop(client.client_id, None):
            visit.close()


class Visit:
    """One browser and the room that it is in.

    Args:
        client: the browser. rooms: that it can enter.
    """

    def __init__(self, client: Any, rooms: Rooms) -> None:
        self.client, self.rooms = client, rooms
        self.room: Room | None = None
        self._lock = threading.Lock()
        self._gone = False
        self._uploads = Uploads(client, self._refused)
        self._doors = ButtonRow(client.gui, "Room", tuple(rooms), self.enter)
        self._panel: Any = None

    def enter(self, name: str) -> None:
        """Leave the room for another one."""
        with self._lock:
            if self._gone:
                return
            self._leave()
            self._doors.mark(name)
            self._panel = self.client.gui.add_folder(name)
            self.room = self.rooms[name](self.client)
            with self._panel:
                self.room.build()
            self.room.fill()

    def close(self) -> None:
        """Vanish."""
        with self._lock:
            self._gone = True
            if self.room is not None:
                self.room.stop()

    def _refused(self, error: InvalidInput) -> None:
        """Show that a file was refused."""
        if self.room is not None:
            self.room.messages.tell(error)

    def _leave(self) -> None:
        if self.room is not None:
            self.room.stop()
            self.room.close()
            self._panel.remove()
            self.room = None


def check_host(host: str, exposed: bool) -> None:
    """Raise InvalidInput for an address that other machines can reach, unless that is wanted."""
    if exposed or host == "localhost":
        return
    try:
        local = ipaddress.ip_address(host).is_loopback
    except ValueError:
        local = False
    if not local:
        hint = "Nothing that is sent is encrypted: add --exposed only in a network that you trust."
        raise InvalidInput("--host", host, "127.0.0.1, ::1 or localhost", hint)
