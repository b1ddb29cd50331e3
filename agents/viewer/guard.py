"""The requests that the viewer answers: of its own page, at its own address, with the printed token."""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Callable, Sequence
from http import HTTPStatus
from typing import Any
from urllib.parse import parse_qs

MOST_WINDOWS = 16  # that are open at the same time
PRINTED = "open the address that rj view printed, with its token"
HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address has the token
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""Of every response: no page of another origin shows this one, reads it or learns its address."""


class Guard:
    """The answer to every request that reaches a server, before the server sees it.

    A request must name the server's own address as its host, since a name that an attacker owns may lead here, too.
    If a page makes it, the page must be of that address. And it must have the token, which the page takes from its
    own address and hands on to its WebSocket in a cookie.

    Args:
        host: the address that the server listens at.
    Attributes:
        token: another one for every server.
    """

    def __init__(self, host: str = "127.0.0.1") -> None:
        self.host, self.token = host, secrets.token_urlsafe()
        self._windows: set[Any] = set()

    def url(self, port: int) -> str:
        """The address for a browser on this machine."""
        host = self.host
        if self.everywhere:
            host = "[::1]" if ":" in host else "127.0.0.1"
        return f"http://{_bracketed(host)}:{port}/?token={self.token}"

    @property
    def everywhere(self) -> bool:
        """Whether the server listens at all addresses of the machine."""
        address = _address(self.host)
        return not self.host or (address is not None and address.is_unspecified)

    def hosts(self, address: str, port: int) -> set[str]:
        """The allowed values of the header Host.

        Args:
            address, port: of this machine, at which the request arrived.
        """
        arrived = _address(address)
        names = {address, socket.gethostname() if self.everywhere else self.host}
        if arrived is not None and arrived.is_loopback:
            names.add("localhost")
        hosts = {f"{_bracketed(name)}:{port}".lower() for name in names}
        return hosts | ({host.removesuffix(":80") for host in hosts} if port == 80 else set())

    def answer(self, connection: Any, request: Any, page: Callable[[Any, Any], Any]) -> Any:
        """The response to a request; None opens a WebSocket.

        Args:
            connection, request: of websockets. page: the server's own answer, None to a WebSocket.
        """
        refusal = self._refusal(connection, request)
        response = connection.respond(*refusal) if refusal else page(connection, request)
        if response is None:
            self._windows.add(connection)
            return None
        response.headers.update(HEADERS)
        if not refusal:
            port = connection.local_address[1]
            response.headers["Set-Cookie"] = f"{_cookie(port)}={self.token}; Path=/; HttpOnly; SameSite=Strict"
        return response

    def _refusal(self, connection: Any, request: Any) -> tuple[HTTPStatus, str] | None:
        """Status and text, one line, for a request that is refused."""
        address, port = connection.local_address[:2]
        hosts, origins = (request.headers.get_all(name) for name in ("Host", "Origin"))
        if len(hosts) != 1 or hosts[0].lower() not in self.hosts(address, port):
            return HTTPStatus.FORBIDDEN, f"This is not the viewer's address: {PRINTED}.\n"
        if origins not in ([], [f"http://{hosts[0]}"]):
            return HTTPStatus.FORBIDDEN, f"The viewer answers to its own page alone: {PRINTED}.\n"
        if not self._has_token(request, port):
            return HTTPStatus.FORBIDDEN, f"The token is missing or another server's: {PRINTED}.\n"
        self._windows = {window for window in self._windows if not window.transport.is_closing()}
        if len(self._windows) >= MOST_WINDOWS:
            return HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_WINDOWS} windows are open, no more are allowed: close one.\n"
        return None

    def _has_token(self, request: Any, port: int) -> bool:
        """Whether the address of a page has the token, or address or cookie of a WebSocket.

        A cookie is not enough for a page: a page of another port of this machine makes the browser send it, too, and
        could so open the viewer's page with an address that names another WebSocket.
        """
        tokens: Sequence[str] = parse_qs(request.path.partition("?")[2]).get("token", [])
        if [value.lower() for value in request.headers.get_all("Upgrade")] == ["websocket"]:
            pieces = ";".join(request.headers.get_all("Cookie")).split(";")
            cookies = (piece.strip().partition("=") for piece in pieces)
            tokens = [*tokens, *(value for name, _, value in cookies if name == _cookie(port))]
        return any(hmac.compare_digest(_bytes(token), _bytes(self.token)) for token in tokens)


def _cookie(port: int) -> str:
    """The name of the cookie; browsers send the cookies of all ports of a host."""
    return f"rj_view_{port}"


def _bytes(text: str) -> bytes:
    return text.encode("utf-8", "surrogateescape")


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host and not host.startswith("[") else host


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """The IP address; None for a name."""
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        return None
