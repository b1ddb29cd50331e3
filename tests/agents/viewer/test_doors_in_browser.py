"""The doors of the viewer as a browser meets them: pages of others, names that are HTML, files that are too large."""

import json
import re
import signal
import subprocess
import sys

import numpy as np
import pytest

from agents.viewer.controllers import worlds
from agents.viewer.drive import Repeated, filmed
from agents.viewer.recorded import file_of
from tests.agents.viewer.conftest import until

pytestmark = pytest.mark.slow

EVIL = '<img src=x onerror="window.ran = true">'
THEIRS = """
<iframe src="{url}"></iframe>
<script>
  const tried = [];
  for (const address of ["{socket}", "{socket}?token={token}"]) {{
    const socket = new WebSocket(address, ["viser-v{version}"]);
    socket.onopen = () => tried.push("open");
    socket.onerror = () => tried.push("refused");
  }}
</script>
"""


def test_the_command_prints_an_address_that_opens_and_opens_again(browser):
    command = [sys.executable, "-m", "agents.view", "two_segment", "--port", "0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        printed = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S{40,}", process.stdout.readline())
        page = browser.new_page()
        page.goto(printed[0])
        page.get_by_text("Tension 3 [N]").wait_for()
        page.reload()
        page.get_by_text("Tension 3 [N]").wait_for()
        assert page.url == printed[0]
        page.close()
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == 130
        process.stdout.close()


def test_a_page_of_another_port_in_the_same_browser_neither_frames_the_viewer_nor_talks_to_it(browser, viewer):
    viser = pytest.importorskip("viser")
    context = browser.new_context()
    own, other = context.new_page(), context.new_page()
    own.goto(viewer.url)
    own.get_by_text("Mechanism", exact=True).wait_for()
    socket = f"ws://127.0.0.1:{viewer.server.get_port()}/"  # to which the cookie goes, too
    theirs = THEIRS.format(url=viewer.url, socket=socket, token=viewer.guard.token, version=viser.__version__)
    other.route("http://127.0.0.1:9/", lambda route: route.fulfill(body=theirs, content_type="text/html"))
    visits = dict(viewer.visits)
    other.goto("http://127.0.0.1:9/")
    other.wait_for_function("tried.length == 2")
    assert other.evaluate("tried") == ["refused", "refused"]
    assert [frame.url for frame in other.frames if "chrome-error" not in frame.url] == ["http://127.0.0.1:9/"]
    assert viewer.visits == visits
    context.close()


def test_names_in_files_are_text_in_the_browser(guests):
    film = filmed(EVIL, worlds()["RollingJoint-v0"], Repeated(np.full((1, 2), 0.1)), 3)
    guest = guests("Replay")
    page, name = guest.page, f"{EVIL}.json"
    wrong = {"name": name, "mimeType": "application/json", "buffer": b"{}"}
    page.set_input_files("input[type=file]", wrong)
    page.get_by_text(f"episodes = '{EVIL}.json'").wait_for()
    page.set_input_files("input[type=file]", {**wrong, "buffer": file_of([film])})
    until(lambda: guest.room.films and guest.room.films[0].name == EVIL)
    page.locator("td", has_text=EVIL).wait_for()  # of the errors
    damaged = json.loads(file_of([film])) | {"episodes": [{EVIL: 1}]}
    page.set_input_files("input[type=file]", {**wrong, "buffer": json.dumps(damaged).encode()})
    until(lambda: guest.room.messages.line.visible)
    page.wait_for_timeout(1000)
    assert page.evaluate("window.ran") is None and page.locator("img[src=x]").count() == 0


def test_a_file_that_is_too_large_is_refused_in_one_line_and_the_next_one_is_taken(guests):
    film = filmed("mine", worlds()["RollingJoint-v0"], Repeated(np.full((1, 2), 0.1)), 3)
    guest = guests("Replay")
    large = {"name": "large.json", "mimeType": "application/json", "buffer": b" " * 17_000_000}
    guest.page.set_input_files("input[type=file]", large)
    guest.page.get_by_text("file = 'large.json': expected a file of at most 16 MB.").wait_for()
    guest.page.set_input_files("input[type=file]", {**large, "name": "mine.json", "buffer": file_of([film])})
    until(lambda: guest.room.films and guest.room.films[0].name == "mine")
    assert not guest.room.messages.line.visible
