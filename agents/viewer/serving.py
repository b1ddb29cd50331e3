"""Silent servers of viser that answer only requests that a guard admits; all uses of viser's private names.

Names with a leading underscore are not viser's public interface; they were read in viser 1.1.0 and 1.1.1. A viser
without them is refused when a server starts.
"""

from __future__ import annotations

import io
import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from importlib import import_module
from typing import Any

import viser
from viser import _messages

from agents.viewer.guard import Guard
from rollingjoint.errors import InvalidInput

LARGEST_MESSAGE = 2**20  # bytes; viser's page sends files in parts of half of it
LARGEST_FILE = 16_000_000  # bytes that a browser may send
KNOWN = "1.1.1"
_infra: Any = import_module("viser.infra._infra")
_REMOVED = (
    _messages.ShareUrlRequest,  # would open a public tunnel to the server
    _messages.ShareUrlDisconnect,
    _messages.FileTransferStartUpload,  # to widgets that all browsers share; for the widgets of one browser see Uploads
    _messages.FileTransferPart,
)
_OF_UPLOADS = (
    "_current_file_upload_states",
    "_gui_input_handle_from_uuid",
    "_handle_file_transfer_start",
    "_handle_file_transfer_part",
)
_starting = threading.Lock()


def started(guard: Guard, port: int = 0) -> viser.ViserServer:
    """A server that runs at the guard's host and asks the guard first.

    Args:
        port: 0 for any that is free.
    Raises:
        OSError: a port that is in use, or an address that is not this machine's.
        InvalidInput: a viser that cannot be guarded.
    """
    _check_free(guard.host, port)
    with redirect_stdout(io.StringIO()), _asked_first(guard) as servers:
        server = viser.ViserServer(host=guard.host, port=port, verbose=False)
    try:
        for message in _REMOVED:
            server._websock_server.unregister_handler(message)
        is_known = bool(servers) and all(hasattr(server.gui, name) for name in _OF_UPLOADS)
    except (AttributeError, AssertionError, KeyError):
        is_known = False
    if not is_known:
        stop(server)
        hint = f"Run pip install viser=={KNOWN}."
        raise InvalidInput("viser", viser.__version__, "a version whose requests can be checked", hint)
    return server


@contextmanager
def _asked_first(guard: Guard) -> Iterator[list[Any]]:
    """A context in which viser's servers ask the guard first; gives the list of their handlers of requests.

    viser starts its server when it is made, by websockets' `serve`, and has no argument for a check of requests.
    """
    module, handlers = _infra.websockets.asyncio.server, []
    serve = module.serve

    def guarded(*places: Any, **options: Any) -> Any:
        page: Any = options.get("process_request")
        if getattr(page, "__module__", None) == _infra.__name__:
            options["process_request"] = lambda connection, request: guard.answer(connection, request, page)
            options["max_size"] = LARGEST_MESSAGE
            handlers.append(page)
        return serve(*places, **options)

    with _starting:
        module.serve = guarded
        try:
            yield handlers
        finally:
            module.serve = serve


def _check_free(host: str, port: int) -> None:
    """Raise OSError for a port in use, where viser would take another one, and for an address of another machine."""
    kind = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(kind) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, os.name != "nt")
        try:
            probe.bind((host, port))
        except OSError as error:
            hint = "name another port, 0 for any that is free, or an address of this machine"
            raise OSError(f"--host {host} --port {port}: {error.strerror}; {hint}") from None


def stop(server: viser.ViserServer) -> None:
    """End it and its threads."""
    with redirect_stdout(io.StringIO()):
        server.stop()


@contextmanager
def serving() -> Iterator[viser.ViserServer]:
    """A context with a server that no browser can enter."""
    server = started(Guard())
    try:
        yield server
    finally:
        stop(server)


class Uploads:
    """Files that one browser sends: one at a time, no larger than LARGEST_FILE, no more bytes than it announced.

    Args:
        client: the browser, before it has a button for files.
        refused: called with the error where a file is refused.
    """

    def __init__(self, client: Any, refused: Callable[[InvalidInput], None]) -> None:
        self.gui, self.refused = client.gui, refused
        self._connection = client._websock_connection
        self._running = client.gui._current_file_upload_states
        for message, handler in (
            (_messages.FileTransferStartUpload, self._begin),
            (_messages.FileTransferPart, self._add),
        ):
            self._connection.unregister_handler(message)
            self._connection.register_handler(message, handler)

    def _begin(self, client_id: Any, message: Any) -> None:
        """A file is announced; one that is still coming is forgotten."""
        self._running.clear()
        button = self.gui._gui_input_handle_from_uuid.get(message.source_component_uuid)
        if not isinstance(button, viser.GuiUploadButtonHandle):
            return
        if message.size_bytes > LARGEST_FILE:
            hint = "Start the viewer with --episodes and its path."
            self._refuse(message, message.filename, f"a file of at most {LARGEST_FILE / 1e6:.0f} MB", hint)
        elif 0 <= message.part_count <= message.size_bytes:
            self.gui._handle_file_transfer_start(client_id, message)

    def _add(self, client_id: Any, message: Any) -> None:
        """A part of it."""
        state = self._running.get(message.transfer_uuid)
        if state is None:
            return
        size, announced = state["transferred_bytes"] + len(message.content), state["total_bytes"]
        is_last = len(state["parts"]) + 1 == state["part_count"]
        if size > announced or (is_last and size < announced):
            self._running.clear()
            self._refuse(message, state["filename"], f"the {announced} bytes that were announced")
        else:
            self.gui._handle_file_transfer_part(client_id, message)

    def _refuse(self, message: Any, name: str, allowed: str, hint: str = "") -> None:
        """Report the refusal, and end the transfer in the browser, which would wait for the rest."""
        end = _messages.FileTransferPartAck(message.source_component_uuid, message.transfer_uuid, 0, 0)
        self._connection.queue_message(end)
        self.refused(InvalidInput("file", name, allowed, hint))
