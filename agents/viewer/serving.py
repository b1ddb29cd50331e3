"""Servers of viser that print nothing of their own."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

import viser


def started(host: str = "127.0.0.1", port: int = 0) -> viser.ViserServer:
    """A server that runs; port 0: any that is free. Raises OSError for one that is in use."""
    with redirect_stdout(io.StringIO()):
        return viser.ViserServer(host=host, port=port, verbose=False)


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
