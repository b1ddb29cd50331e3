"""The room Explore in a real browser."""

import io
import re
import zipfile

import numpy as np
import pytest

from agents.view import main
from agents.viewer.choice import MARK
from agents.viewer.rooms.explore import named
from rollingjoint import Status, five_link, solve_tensions
from tests.agents.viewer.conftest import until

pytestmark = pytest.mark.slow


def move(guest, place, presses):
    """Move a slider of the panel by so many of its steps."""
    guest.page.get_by_role("slider").nth(place).focus()
    for _ in range(abs(presses)):
        guest.page.keyboard.press("ArrowRight" if presses > 0 else "ArrowLeft")


def test_a_slider_moves_numbers_and_picture(guests):
    guest = guests(room="Explore")
    explorer, before = guest.room.explorer, guest.pixels()
    move(guest, 0, 40)  # steps of 0.01 N
    until(lambda: explorer.inputs.tensions == pytest.approx((3.4, 3.0)))
    expected = solve_tensions(five_link(), (3.4, 3.0))
    until(lambda: explorer.found.tip == pytest.approx(expected.tip, abs=1e-6))
    until(lambda: f"{expected.smallest_eigenvalue:.3g} N·mm" in guest.page.inner_text("body"))
    assert guest.pixels() != before


def test_what_has_no_equilibrium_is_told_and_the_last_pose_is_grey(guests):
    guest = guests(room="Explore")
    guest.room.change(tensions=(0.0, 0.0))
    until(lambda: "INDETERMINATE" in guest.page.inner_text("body"))
    assert guest.room.explorer.found.status is Status.INDETERMINATE
    assert guest.room._bodies[False].visible and not guest.room._bodies[True].visible
    guest.room.change(tensions=(3.0, 3.0))
    until(lambda: "CONVERGED" in guest.page.inner_text("body"))
    assert guest.room._bodies[True].visible


def test_curvatures_that_make_no_chain_are_told_in_one_line(guests):
    guest = guests(room="Explore")
    guest.room.change(curvatures=(0.5, *(1.0,) * 7))
    until(lambda: "⚠" in guest.page.inner_text("body"))
    assert "curvature" in guest.room.messages.line.content and "\n" not in guest.room.messages.line.content
    guest.room.change(curvatures=(1.1,) * 8)
    until(lambda: not guest.room.messages.line.visible)


def test_every_mechanism_input_and_force_is_shown(guests):
    guest = guests(room="Explore")
    for name, tendons in (("two_segment", 4), ("flexible_arm", 8), ("five_link", 2)):
        guest.room.which.value = name
        until(lambda name=name, tendons=tendons: guest.room.explorer.name == name and len(guest.room.pulls) == tendons)
        guest.page.get_by_role("button", name="lengths", exact=True).click()
        until(lambda: guest.room.explorer.inputs.drive == "lengths")
        explorer = guest.room.explorer
        origin, length = guest.room._origin, explorer.mechanism.length
        guest.room.drag(origin + np.array([0.03, 0.0, 0.0]) * length)  # as the handle does
        assert explorer.inputs.force[0] == pytest.approx(0.1, abs=1e-6)
        assert guest.room.forces[0].value == 0.1
        guest.settle()  # viser's page complains where a field is removed in the picture in which it would change
    before = guest.pixels()
    guest.page.get_by_label("Reach").click()
    until(lambda: guest.room.shown["Reach"].value)
    assert guest.pixels() != before


def test_the_room_and_the_input_that_are_chosen_are_marked(guests):
    guest = guests(room="Explore")
    marked = guest.page.get_by_role("button", name=re.compile(f"^{MARK}"))
    until(lambda: marked.all_inner_texts() == ["● Explore", "● tensions"])
    guest.page.get_by_role("button", name="lengths", exact=True).click()
    until(lambda: marked.all_inner_texts() == ["● Explore", "● lengths"])
    guest.room.which.value = "flexible_arm"
    until(lambda: marked.all_inner_texts() == ["● Explore", "● tensions"])
    guest.settle()
    assert not guest.page.get_by_label("Contact forces").is_visible()  # of hinges
    guest.enter("Control")
    assert marked.all_inner_texts() == ["● Control"]


def test_links_have_their_numbers_until_they_are_not_wanted(guests):
    guest = guests(room="Explore")
    body = guest.room._bodies[True]
    assert [label.text for label in body.numbers] == ["0", "1", "2", "3", "4"]
    np.testing.assert_allclose([label.position[:2] for label in body.numbers], guest.room.explorer.found.poses[:, :2])
    before = guest.pixels()
    guest.page.get_by_label("Links").click()
    until(lambda: body.numbers == [])
    assert guest.pixels() != before


def test_mechanism_files_go_by_their_names_where_these_differ():
    files = ("a/finger.yaml", "b/finger.yaml", "b/thumb.yaml", "five_link.yaml", "five_link")
    assert list(named(files)) == ["a/finger.yaml", "b/finger.yaml", "thumb", "five_link.yaml", "five_link"]
    assert named(files)["thumb"] == "b/thumb.yaml"


def test_two_guests_have_a_mechanism_each_and_one_who_vanishes_leaves_the_other(guests, viewer):
    first, second = guests(room="Explore"), guests(room="Explore")
    first.room.change(tensions=(6.0, 3.0))
    assert second.room.explorer.inputs.tensions == (3.0, 3.0)
    gone = second.id
    second.page.close()
    until(lambda: gone not in viewer.visits)
    first.room.change(tensions=(7.0, 3.0))
    assert first.room.explorer.found.ok


def test_the_mechanism_is_saved_as_program_file_and_parts(guests):
    guest = guests(room="Explore")
    guest.page.get_by_text("Write down").click()
    guest.page.wait_for_timeout(500)
    for kind, end in (("Python", ".py"), ("YAML", ".yaml"), ("STL", ".zip")):
        with guest.page.expect_download() as found:
            guest.page.get_by_role("button", name=kind, exact=True).click()
        path = found.value.path()
        assert found.value.suggested_filename.endswith(end)
        content = path.read_bytes()
        if end == ".zip":
            assert "link_0.stl" in zipfile.ZipFile(io.BytesIO(content)).namelist()
        else:
            assert b"five_link" in content


def test_a_sweep_is_one_page_that_needs_no_server(browser, tmp_path, capsys):
    assert main(["small_arm", "--record", str(tmp_path / "arm.html")]) == 0
    assert "every tendon in turn" in capsys.readouterr().out
    page = browser.new_page(viewport={"width": 800, "height": 600})
    asked, complaints = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    page.goto((tmp_path / "arm.html").as_uri())
    page.wait_for_timeout(3000)
    first = page.screenshot()
    page.wait_for_timeout(1500)
    assert page.screenshot() != first
    assert not complaints and not [url for url in asked if url.startswith("http")]
    page.close()


def test_a_port_in_use_is_told(viewer, capsys):
    port = viewer.server.get_port()
    assert main(["--port", str(port)]) == 2
    said = capsys.readouterr().err
    assert f"--port {port}" in said and said.count("\n") == 1
