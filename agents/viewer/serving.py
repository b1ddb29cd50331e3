"""Servers of viser that print nothing of their own."""

from __future__ import annotations

import io
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

import viser


def started(host: str = "127.0.0.1", port: int = 0) -> viser.ViserServer:
    """A server that runs; port 0: any that is free. Raises OSError for one that is in use."""
    if port:
        _check_free(host, port)
    with redirect_stdout(io.StringIO()):
        return viser.ViserServer(host=host, port=port, verbose=False)


def _check_free(host: str, port: int) -> None:
    """Raise OSError for a port in use; viser would take another one."""
    kind = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(kind) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, os.name != "nt")
        try:
            probe.bind((host, port))
        except OSError as error:
            raise OSError(
                f"--port {port} at {host}: {error.strerror}; name another, or 0 for any that is free"
            ) from None


def stop(server: viser.ViserServer) -> None:
    """End it and its threads."""
    with redirect_stdout(io.StringIO()):
        server.stop()


@contextmanager
def serving() -> Iterator[viser.ViserServer]:
    """A server for what is done inside, at any port that is free."""
    server = started()
    try:
        yield server
    finally:
        stop(server)
