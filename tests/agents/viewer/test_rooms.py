"""The rooms of the viewer in a real browser."""

import json

import numpy as np
import pytest

from agents.view import main, rooms
from agents.viewer.controllers import worlds
from agents.viewer.drive import Repeated, filmed
from agents.viewer.recorded import write_records
from tests.agents.viewer.conftest import until
from tests.agents.viewer.test_designs import search_in

pytestmark = pytest.mark.slow


def chosen(guest, label, option):
    guest.page.get_by_label(label, exact=True).first.click()
    guest.page.get_by_role("option", name=option, exact=True).click()


def test_a_person_steers_by_keys_and_sees_it(guests):
    guest = guests()
    control, before = guest.room, guest.pixels()
    tip = control.match.films[0].scenes[0].tip
    guest.press("j", "j", "j", "i", "Enter", "Enter", "Enter")
    until(lambda: control.match.films[0].steps == 3)
    assert np.abs(control.match.films[0].actions).max() > 0.1
    assert control.match.person.point == pytest.approx(tip + np.array([-6.0, 2.0]), abs=0.1)
    guest.page.get_by_text("Step 3 of 50.").wait_for()
    assert guest.pixels() != before
    assert [film.name for film in control.match.films] == ["you", "policy fixed_target"]


def test_an_episode_runs_by_itself_until_it_ends_and_tells_the_hidden_load(guests):
    guest = guests()
    guest.page.get_by_label("Hidden load").click()
    until(lambda: guest.room.loads.value)
    guest.room.clock.rate = 100.0
    guest.press("Space")
    until(lambda: guest.room.match.over)
    until(lambda: not guest.room.clock.running)
    guest.page.get_by_text("Load: ").wait_for()


def test_an_arm_without_a_pose_is_steered_by_its_tendons(guests):
    guest = guests()
    chosen(guest, "World", "ArmInstrument-v0")
    until(lambda: guest.room.match and guest.room.match.task.dimension == 3)
    chosen(guest, "Steer by", "tendons")
    until(lambda: guest.room.match and len(guest.room.sliders) == 8)
    guest.page.wait_for_timeout(500)
    guest.press("l", "o", "Enter")
    until(lambda: guest.room.match.films[0].steps == 1)
    pulls = guest.room.match.films[0].actions[0]
    assert pulls[0] == pytest.approx(0.25) and pulls[2] == pytest.approx(-0.25) and abs(pulls[1]) == pytest.approx(0.25)


def test_a_replay_plays_and_others_come_over_it(guests):
    guest = guests("Replay")
    replay, before = guest.room, guest.pixels()
    guest.page.get_by_text("Over it").click()
    guest.page.get_by_label("open loop").click()
    until(lambda: len(replay.films) == 2)
    guest.page.get_by_role("button", name="Play", exact=True).click()
    until(lambda: replay.at.value == 50)
    assert guest.pixels() != before
    assert [film.name for film in replay.films] == ["policy fixed_target", "open loop"]
    assert replay.films[0].last_10_mm == pytest.approx(
        replay.shelf[replay.source.value].error(replay.films[0].seed), abs=1e-6
    )


def test_best_and_worst_are_found_and_a_seed_can_be_typed(guests):
    guest = guests("Replay")
    replay, errors = guest.room, {}
    for rank in ("best", "worst"):
        chosen(guest, "Which one", rank)
        until(lambda rank=rank: replay.rank.value == rank and replay.films)
        guest.page.wait_for_timeout(500)
        errors[rank] = replay.films[0].last_10_mm
    assert errors["best"] < errors["worst"]
    guest.page.get_by_label("Seed", exact=True).fill("10007")
    until(lambda: replay.films and replay.films[0].seed == 10_007)


def test_a_file_of_episodes_is_opened_and_another_one_is_refused_in_one_line(guests, tmp_path):
    write_records(
        tmp_path / "mine.json", [filmed("mine", worlds()["RollingJoint-v0"], Repeated(np.full((1, 2), 0.1)), 3)]
    )
    (tmp_path / "other.json").write_text("{}")
    guest = guests("Replay")
    guest.page.set_input_files("input[type=file]", tmp_path / "other.json")
    until(lambda: "rj view wrote" in guest.room.messages.line.content)
    guest.page.set_input_files("input[type=file]", tmp_path / "mine.json")
    until(lambda: guest.room.films and guest.room.films[0].name == "mine")
    assert guest.room.messages.line.content == ""


def test_saved_episodes_are_those_that_were_driven(guests):
    guest = guests()
    guest.press("l", "Enter", "Enter")
    until(lambda: guest.room.match.films[0].steps == 2)
    with guest.page.expect_download() as download:
        guest.page.get_by_role("button", name="Save these episodes").click()
    person, policy = json.loads(download.value.path().read_text())["episodes"]
    assert (person["name"], policy["name"]) == ("you", "policy fixed_target")
    np.testing.assert_array_equal(np.float32(person["actions"]), guest.room.match.films[0].actions)


@pytest.fixture(scope="module")
def with_designs(tmp_path_factory):
    from agents.viewer.server import Viewer

    running = Viewer(rooms(searches=[search_in(tmp_path_factory.mktemp("search") / "two")]), port=0)
    yield running
    running.stop()


def test_a_click_on_a_point_shows_the_design_and_the_slider_bends_it(guests, with_designs):
    guest = guests("Designs", with_designs)
    room, before = guest.room, guest.pixels()
    first = room.chosen["first"].row
    x, y = next(place for place in places(guest) if place[0] != first)[1]
    guest.page.mouse.click(x, y)
    until(lambda: room.chosen["first"].row != first)
    guest.page.get_by_text(f"design {room.chosen['first'].row}").first.wait_for()
    shown = guest.pixels()
    assert shown != before
    guest.page.get_by_label("To and fro").click()
    until(lambda: abs(room.bend.value) > 0.5)
    guest.page.get_by_label("To and fro").click()
    assert guest.pixels() != shown


def places(guest):
    """The rows of the designs with a point, and where on the screen they are: what the camera shows."""
    room = guest.room
    chart, camera = room._chart, room.client.camera
    ahead = camera.look_at - camera.position
    distance = np.linalg.norm(ahead)
    right = np.cross(ahead / distance, camera.up_direction)
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead / distance)
    for at, row in enumerate(chart.points.rows):
        away = np.array([*chart._place(at), 0.1 * chart.points.kinds[at]]) - camera.position
        scale = 400.0 / np.tan(0.5 * camera.fov) / (away @ ahead / distance)
        yield int(row), (640.0 + scale * (away @ right), 400.0 - scale * (away @ up))


def test_two_browsers_have_states_of_their_own_and_one_that_vanishes_leaves_nothing_running(guests, viewer):
    first, second = guests(), guests()
    assert first.room is not second.room
    first.press("Enter", "Enter")
    until(lambda: first.room.match.films[0].steps == 2)
    assert second.room.match.films[0].steps == 0
    gone = first.room
    gone.clock.rate = 1.0
    first.press("Space")
    until(lambda: gone.clock.running)
    first.page.close()
    until(lambda: first.id not in viewer.visits)
    until(lambda: not gone.clock.running and gone.match is None)
    second.press("Enter")
    until(lambda: second.room.match.films[0].steps == 1)


def test_a_recorded_page_plays_from_the_disk_without_network(browser, tmp_path):
    page_file = tmp_path / "page.html"
    assert (
        main(["--episodes", "fixed_target", "--which", "10003", "--beside", "open loop", "--record", str(page_file)])
        == 0
    )
    page, asked, complaints = browser.new_page(), [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(page_file.as_uri())
    page.get_by_text("policy fixed_target").wait_for()
    page.wait_for_timeout(3000)
    shown = page.screenshot()
    page.wait_for_timeout(1000)
    assert page.screenshot() != shown and complaints == []
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
    assert page_file.stat().st_size < 2_000_000
    page.close()
