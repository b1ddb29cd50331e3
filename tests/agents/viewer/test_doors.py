"""Who may talk to the viewer and what it may send, tried by a small client."""

import gc
import http.client
import types
import weakref
from contextlib import contextmanager
from functools import partial
from http import HTTPStatus

import pytest

pytest.importorskip("viser", reason="the extra view is not installed")

import msgspec
import viser
import zstandard
from viser.infra import _infra
from websockets.exceptions import ConnectionClosedError
from websockets.sync.client import connect

from agents.runs.files import write_text
from agents.view import main
from agents.viewer import guard as guards
from agents.viewer import serving
from agents.viewer.guard import Guard
from agents.viewer.rooms.explore import Explore
from agents.viewer.rooms.messages import Messages
from agents.viewer.server import Viewer
from rollingjoint import two_segment
from rollingjoint.errors import InvalidInput
from rollingjoint.io.mechanism_file import dump_mechanism
from tests.agents.viewer.conftest import until

UPGRADE = {
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
    "Sec-WebSocket-Protocol": f"viser-v{viser.__version__}",
}


class Files:
    """A room with a button for files and a slider."""

    name = "Files"

    def __init__(self, client):
        self.client, self.files = client, []

    def build(self):
        self.messages = Messages(self.client.gui)
        self.button = self.client.gui.add_upload_button("Open")
        self.slider = self.client.gui.add_slider("Slide", 0, 10, 1, 0)
        self.button.on_upload(lambda _: self.files.append(self.button.value))

    def fill(self):
        pass

    stop = close = fill


@pytest.fixture
def viewer():
    running = Viewer({"Files": Files}, port=0)
    yield running
    running.stop()


def ask(viewer, path=None, hosts=("127.0.0.1:{port}",), origin=None, cookie=None, upgrade=False):
    """Status, headers and text of the response to one request; with the token, unless a path is given."""
    port = viewer.server.get_port()
    headers = [("Host", host) for host in hosts] + list(UPGRADE.items() if upgrade else ())
    headers += [("Origin", origin)] if origin else []
    headers += [("Cookie", cookie)] if cookie else []
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.putrequest("GET", f"/?token={viewer.guard.token}" if path is None else path, skip_host=True)
    for name, value in headers:
        connection.putheader(name, value.replace("{port}", str(port)))
    connection.endheaders()
    response = connection.getresponse()
    text = "" if response.status == HTTPStatus.SWITCHING_PROTOCOLS else response.read().decode()
    connection.close()
    return response.status, response.headers, text


def refused(viewer, **request):
    """Whether a page and a WebSocket are both refused by one line that says what to do."""
    answers = [ask(viewer, upgrade=upgrade, **request) for upgrade in (False, True)]
    for status, _, text in answers:
        assert status != HTTPStatus.FORBIDDEN or (text.count("\n") == 1 and "address that rj view printed" in text)
    return {status for status, *_ in answers} == {HTTPStatus.FORBIDDEN}


class Client:
    """What a browser's page does, in a few lines."""

    def __init__(self, viewer):
        known = set(viewer.visits)
        address = viewer.url.replace("http://", "ws://")
        protocol = UPGRADE["Sec-WebSocket-Protocol"]
        self.socket = connect(address, subprotocols=[protocol], max_size=None, compression=None)
        view = {"position": (0.0, 0.0, 1.0), "look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 1.0, 0.0)}
        size = {"fov": 1.0, "near": 0.1, "far": 10.0, "image_height": 100, "image_width": 100}
        self.send("ViewerCameraMessage", wxyz=(1.0, 0.0, 0.0, 0.0), **view, **size)
        until(lambda: set(viewer.visits) - known)
        (self.id,) = set(viewer.visits) - known
        self.visit = viewer.visits[self.id]
        until(lambda: self.visit.room is not None and not self.visit._lock.locked())
        self.room = self.visit.room

    def send(self, kind, **values):
        self.socket.send(msgspec.msgpack.encode({"type": kind, **values}))

    def announce(self, size, parts, transfer="one", widget=None, name="mine.json"):
        button = (widget or self.room.button)._impl.uuid
        self.send(
            "FileTransferStartUpload", source_component_uuid=button, transfer_uuid=transfer, filename=name,
            mime_type="application/json", part_count=parts, size_bytes=size,
        )  # fmt: skip

    def part(self, index, content, transfer="one", widget=None):
        button = (widget or self.room.button)._impl.uuid
        values = {"source_component_uuid": button, "transfer_uuid": transfer}
        self.send("FileTransferPart", part_index=index, content=content, **values)

    def answered(self):
        """Wait until all that was sent before has been handled: the slider moves."""
        at = self.room.slider.value + 1
        self.set(self.room.slider, at)
        until(lambda: self.room.slider.value == at)

    def set(self, widget, value):
        self.send("GuiUpdateMessage", uuid=widget._impl.uuid, updates={"value": value})

    def received(self, kind):
        """The first message of this kind."""
        while True:
            raw = self.socket.recv(timeout=10)
            size, packed = (int.from_bytes(raw[at : at + 8], "little") for at in (0, 8))
            content = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + packed], max_output_size=size)
            for message in msgspec.msgpack.decode(content)["messages"]:
                if message["type"] == kind:
                    return message

    @property
    def held(self):
        """The transfers that the server holds parts of."""
        return self.room.client.gui._current_file_upload_states


@contextmanager
def client_of(viewer):
    client = Client(viewer)
    yield client
    client.socket.close()


def test_the_printed_address_opens_page_and_websocket(viewer):
    status, _, text = ask(viewer)
    assert status == HTTPStatus.OK and "<title>" in text
    own = {"origin": "http://127.0.0.1:{port}"}
    assert ask(viewer, **own)[0] == HTTPStatus.OK
    assert ask(viewer, upgrade=True, **own)[0] == HTTPStatus.SWITCHING_PROTOCOLS
    assert ask(viewer, upgrade=True, hosts=["LOCALHOST:{port}"])[0] == HTTPStatus.SWITCHING_PROTOCOLS


@pytest.mark.parametrize(
    "hosts",
    [
        ["evil.example"],
        ["evil.example:{port}"],
        ["127.0.0.1"],
        ["127.0.0.1:1"],
        ["0.0.0.0:{port}"],
        ["127.0.0.1.evil:{port}"],
        [""],
        [],
        ["127.0.0.1:{port}", "evil.example"],
    ],
    ids=str,
)
def test_a_request_to_a_name_that_is_not_the_viewers_is_refused(viewer, hosts):
    assert refused(viewer, hosts=hosts)
    assert viewer.visits == {}


@pytest.mark.parametrize(
    "origin",
    ["https://evil.example", "null", "http://127.0.0.1:1", "https://127.0.0.1:{port}", "http://localhost:{port}"],
)
def test_a_request_from_a_page_of_another_origin_is_refused(viewer, origin):
    assert refused(viewer, origin=origin)
    assert viewer.visits == {}


@pytest.mark.parametrize("path", ["/", "/index.html", "/?token=", "/?token=wrong", "/?token=%ff", "/nothing.js"])
def test_a_request_without_the_token_is_refused(viewer, path):
    assert refused(viewer, path=path)
    assert viewer.visits == {}


def test_every_server_has_another_token(viewer):
    assert refused(viewer, path=f"/?token={Guard().token}")


def test_the_page_hands_the_token_to_its_websocket_in_a_cookie_that_opens_no_page(viewer):
    _, headers, _ = ask(viewer)
    cookie, *attributes = headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Strict"} <= set(attributes)
    given = {"path": "/", "cookie": f"theirs=1; {cookie}; odd"}
    assert ask(viewer, upgrade=True, **given)[0] == HTTPStatus.SWITCHING_PROTOCOLS
    assert ask(viewer, **given)[0] == HTTPStatus.FORBIDDEN
    assert ask(viewer, upgrade=True, path="/", cookie=f"{cookie}x")[0] == HTTPStatus.FORBIDDEN


def test_no_page_can_frame_the_viewer_or_learn_its_address(viewer):
    for status, headers, _ in (ask(viewer), ask(viewer, path="/")):
        assert headers["X-Frame-Options"] == "DENY", status
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert headers["Referrer-Policy"] == "no-referrer"


@pytest.mark.parametrize(
    ("listens", "address", "accepted", "unknown"),
    [
        ("192.168.1.4", "192.168.1.4", {"192.168.1.4:80", "192.168.1.4"}, {"localhost:80", "box:80", "192.168.1.5:80"}),
        ("Rig.example", "10.0.0.2", {"rig.example", "10.0.0.2:80"}, {"example", "rig.example:81", "box"}),
        ("0.0.0.0", "10.0.0.2", {"10.0.0.2", "box", "box:80"}, {"0.0.0.0", "localhost", "10.0.0.3"}),
        ("0.0.0.0", "127.0.0.1", {"127.0.0.1", "localhost", "box"}, {"0.0.0.0", "10.0.0.2"}),
        ("::", "fd00::2", {"[fd00::2]", "[fd00::2]:80", "box"}, {"fd00::2", "[::]", "localhost"}),
        ("::1", "::1", {"[::1]", "localhost"}, {"127.0.0.1", "box"}),
    ],
)
def test_hosts_are_the_address_that_was_reached_and_the_name_that_was_given(
    listens, address, accepted, unknown, monkeypatch
):
    monkeypatch.setattr(guards.socket, "gethostname", lambda: "Box")
    hosts = Guard(listens).hosts(address, 80)
    assert accepted <= hosts and not unknown & hosts
    assert all(host.endswith(":8080") for host in Guard(listens).hosts(address, 8080))


def test_a_viewer_that_listens_everywhere_prints_an_address_that_a_browser_can_open():
    viewer = Viewer({"Files": Files}, "0.0.0.0", 0, exposed=True)
    port = viewer.server.get_port()
    assert viewer.url == f"http://127.0.0.1:{port}/?token={viewer.guard.token}"
    assert ask(viewer)[0] == HTTPStatus.OK
    assert refused(viewer, hosts=["evil.example:{port}"])
    viewer.stop()


def test_an_address_of_another_machine_is_refused_in_one_line(capsys):
    assert main(["--host", "192.0.2.1", "--exposed", "--port", "0"]) == 2
    line = capsys.readouterr().err
    assert "--host 192.0.2.1" in line and line.count("\n") == 1


def test_no_client_makes_the_server_open_a_tunnel(viewer, monkeypatch):
    opened = []

    class Tunnel:
        def __init__(self, *place):
            opened.append(place)
            raise OSError("no network")

    monkeypatch.setattr("viser._viser.ViserTunnel", Tunnel)
    with client_of(viewer) as client:
        client.send("ShareUrlRequest")
        client.send("ShareUrlDisconnect")
        client.answered()
        viewer.server._thread_executor.submit(lambda: None).result()  # tunnels are opened there
    assert opened == []


def test_a_file_arrives_in_parts(viewer):
    with client_of(viewer) as client:
        client.announce(5, 2)
        client.part(0, b"abc")
        client.part(1, b"de")
        until(lambda: client.room.files)
        (file,) = client.room.files
        assert (file.name, file.content) == ("mine.json", b"abcde") and client.held == {}
        client.announce(0, 0, "two", name="empty.json")
        until(lambda: len(client.room.files) == 2)


@pytest.mark.parametrize("parts", [[b"x" * 600], [b"x", b"y" * 600], [b"x", b"y"]], ids=["first", "later", "too few"])
def test_a_file_that_is_not_as_long_as_was_announced_is_refused_and_forgotten(viewer, parts):
    with client_of(viewer) as client:
        client.announce(500, 2)
        for index, part in enumerate(parts):
            client.part(index, part)
        client.answered()
        assert client.held == {} and client.room.files == []
        assert "500 bytes that were announced" in client.room.messages.line.content


def test_a_file_that_is_too_large_is_refused_before_it_comes_and_the_page_does_not_wait(viewer):
    with client_of(viewer) as client:
        client.announce(serving.LARGEST_FILE + 1, 40)
        client.part(0, b"x" * 1000)
        client.answered()
        assert client.held == {} and client.room.messages.line.visible
        assert "at most 16 MB" in client.room.messages.line.content
        end = client.received("FileTransferPartAck")
        assert (end["transferred_bytes"], end["total_bytes"]) == (0, 0)


@pytest.mark.parametrize(("size", "parts"), [(10, 11), (10, -1), (-1, 0), (-5, -5)])
def test_a_transfer_of_impossible_numbers_is_not_begun(viewer, size, parts):
    with client_of(viewer) as client:
        client.announce(size, parts)
        client.answered()
        assert client.held == {} and client.room.files == []


def test_a_browser_sends_one_file_at_a_time_and_to_buttons_for_files_alone(viewer):
    with client_of(viewer) as client:
        for transfer in ("one", "two", "three"):
            client.announce(1000, 2, transfer)
            client.part(0, b"x" * 500, transfer)
        client.answered()
        assert list(client.held) == ["three"]
        client.announce(1000, 2, "four", client.room.slider)
        client.part(0, b"x" * 500, "four", client.room.slider)
        client.answered()
        assert client.held == {}


def test_a_message_that_is_too_large_ends_the_connection(viewer):
    with client_of(viewer) as client:
        client.announce(10_000_000, 20)
        client.part(0, b"x" * (serving.LARGEST_MESSAGE + 1))
        with pytest.raises(ConnectionClosedError, match="1009"):
            client.received("never")
        until(lambda: client.id not in viewer.visits)


def test_a_browser_that_leaves_leaves_no_file_behind(viewer):
    with client_of(viewer) as client:
        client.announce(3, 1)
        client.part(0, b"abc")
        until(lambda: client.room.files)
        client.announce(1000, 2, "half")
        client.part(0, b"x" * 500, "half")
        client.answered()
        held, file = client.held, weakref.ref(client.room.files[0])
    until(lambda: viewer.visits == {} and held == {})
    client = None
    until(lambda: gc.collect() >= 0 and file() is None)


def test_no_more_windows_than_allowed_are_open_at_once(viewer, monkeypatch):
    monkeypatch.setattr(guards, "MOST_WINDOWS", 2)
    with client_of(viewer), client_of(viewer) as second:
        for upgrade in (False, True):
            status, _, text = ask(viewer, upgrade=upgrade)
            assert status == HTTPStatus.SERVICE_UNAVAILABLE and "close one" in text
        second.socket.close()
        until(lambda: len(viewer.visits) == 1)
        with client_of(viewer):
            assert len(viewer.visits) == 2


def test_a_client_has_no_other_file_read_than_those_that_were_named(tmp_path):
    write_text(tmp_path / "theirs.yaml", dump_mechanism(two_segment()))
    viewer = Viewer({"Explore": partial(Explore, mechanisms=["five_link"])}, port=0)
    with client_of(viewer) as client:
        client.set(client.room.which, str(tmp_path / "theirs.yaml"))
        until(lambda: client.room.messages.line.visible)
        assert "five" in client.room.messages.line.content and client.room.explorer.name == "five_link"
    viewer.stop()


class Frozen:
    """A module whose `serve` another module holds already."""

    def __init__(self):
        object.__setattr__(self, "serve", _infra.websockets.asyncio.server.serve)

    def __setattr__(self, name, value):
        pass


@pytest.mark.parametrize("change", ["serve", "handlers"])
def test_a_viser_that_cannot_be_guarded_is_refused(monkeypatch, capsys, change):
    if change == "serve":
        known = {name: getattr(_infra.websockets, name) for name in ("datastructures", "exceptions")}
        other = types.SimpleNamespace(asyncio=types.SimpleNamespace(server=Frozen()), **known)
        monkeypatch.setattr(_infra, "websockets", other)
    else:
        monkeypatch.delattr(_infra.WebsockMessageHandler, "unregister_handler")
    with pytest.raises(InvalidInput, match="pip install viser=="):
        serving.started(Guard())
    assert main(["--port", "0"]) == 2
    assert capsys.readouterr().err.startswith("error: viser = ")
