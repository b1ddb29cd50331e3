"""A viewer in this process."""

import re
import time

import pytest

from agents.viewer.choice import MARK
from rollingjoint import five_link


@pytest.fixture(scope="module")
def viewer():
    """A running viewer with all rooms and nothing but what is shipped."""
    pytest.importorskip("viser", reason="the extra view is not installed")
    from agents.view import rooms
    from agents.viewer.camera import mechanism_view
    from agents.viewer.server import Viewer

    running = Viewer(rooms(), port=0, view=mechanism_view(five_link()))
    yield running
    running.stop()


class Guest:
    """A page in the browser, the server's side of it, and what it complained about."""

    def __init__(self, browser, viewer, size=(1280, 800)):
        self.viewer, self.complaints = viewer, []
        known = set(viewer.visits)
        self.page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        self.page.on("console", lambda said: self.complaints.append(said.text) if said.type == "error" else None)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(viewer.url)
        until(lambda: set(viewer.visits) - known)
        (self.id,) = set(viewer.visits) - known

    @property
    def room(self):
        return self.viewer.visits[self.id].room

    def enter(self, name):
        self.page.get_by_role("button", name=re.compile(f"^({MARK})?{name}$")).first.click()
        until(lambda: self.room is not None and self.room.name == name)
        self.settle()

    def is_open(self):
        """Whether the room has been opened: nobody holds its door."""
        return not self.viewer.visits[self.id]._lock.locked()

    def settle(self):
        """Wait until the room is open and the page has drawn it; keys pressed before would mean nothing."""
        until(lambda: self.room is not None and self.is_open())
        self.viewer.visits[self.id].client.get_render(8, 8, timeout=60.0)
        self.page.wait_for_timeout(500)

    def press(self, *keys):
        self.page.mouse.click(60, 740)  # the scene, not a field of the panel
        for key in keys:
            self.page.keyboard.press(key)
            self.page.wait_for_timeout(150)

    def pixels(self):
        """What the scene looks like now, without the panel."""
        self.page.wait_for_timeout(700)
        return self.page.screenshot(clip={"x": 300, "y": 0, "width": 600, "height": 800})


def until(true, seconds=60.0):
    """Wait until this is so."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.02)


@pytest.fixture
def guests(browser, viewer):
    """Makes guests; none of them may have had an error on the console."""
    found = []

    def come(room="Control", to=viewer, **size):
        guest = Guest(browser, to, **size)
        found.append(guest)
        guest.settle()
        if guest.room.name != room:
            guest.enter(room)
        return guest

    yield come
    for guest in found:
        if not guest.page.is_closed():
            guest.page.close()
    assert [complaint for guest in found for complaint in guest.complaints] == []
