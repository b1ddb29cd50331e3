"""A recording of a rig in the browser: rj view --recording FILE --identified FOLDER --record OUT.html."""

import re

import numpy as np
import pytest

from agents import view
from agents.viewer import record
from rollingjoint.identify import IdentifiedRig, write_recording
from rollingjoint.identify.beliefs import RigSpace
from rollingjoint.identify.rig_files import save_rig
from tests.rollingjoint.identify.rigs import TRUE, recorded


@pytest.fixture
def folder(tmp_path):
    """A recording, and the true rig as if it had been identified."""
    recording = recorded(30)
    write_recording(recording, tmp_path / "bench.jsonl")
    space = RigSpace(recording.mechanism, list(TRUE))
    found = IdentifiedRig(
        space,
        space.vector(TRUE),
        1e-6 * np.eye(len(space)),
        {"tension": 0.05, "position": 0.05},
        1.0,
        9.0,
        60,
        recording.runs[0].motors[0],
    )
    save_rig(found, tmp_path / "found")
    return tmp_path


def test_the_identified_mechanism_follows_the_measured_tip_and_the_one_as_designed_does_not(
    folder, capsys, monkeypatch
):
    shown = {}
    show = record.SceneMechanism.show

    def counted(self, poses, *others):
        shown.setdefault(self.name, []).append(np.array(poses)[-1, :2])
        show(self, poses, *others)

    monkeypatch.setattr(record.SceneMechanism, "show", counted)
    words = ["--recording", str(folder / "bench.jsonl"), "--identified", str(folder / "found")]
    assert view.main([*words, "--record", str(folder / "replay.html")]) == 0
    assert "30 steps" in capsys.readouterr().out
    page = (folder / "replay.html").read_text()
    errors = {name: float(mm) for name, mm in re.findall(r"as (\w+): tip off by ([\d.]+) mm", page)}
    assert errors["identified"] < 0.2 and errors["designed"] > 1.0
    tips = recorded(30).runs[0].tips
    np.testing.assert_allclose(shown["/0/mechanism"], tips, atol=0.5)
    assert len(shown["/1/mechanism"]) == 30


@pytest.mark.slow
def test_the_page_plays_in_a_browser_without_network(folder, browser):
    words = ["--recording", str(folder / "bench.jsonl"), "--identified", str(folder / "found")]
    assert view.main([*words, "--record", str(folder / "replay.html")]) == 0
    page, complaints, asked = browser.new_page(viewport={"width": 480, "height": 360}), [], []
    page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: asked.append(request.url) if request.url.startswith("http") else None)
    page.goto((folder / "replay.html").as_uri())
    page.get_by_text("the ball is the measured tip").wait_for()
    assert page.title() == "bench.jsonl"
    page.locator("canvas").first.wait_for()
    seconds = "Number(document.querySelector('input').value)"
    page.wait_for_function(f"{seconds} > 0.2", timeout=60_000)  # of 1.5: it plays
    assert complaints == [] and asked == []
    page.close()


@pytest.mark.parametrize("missing", ["--recording", "--record"])
def test_a_recording_needs_a_page_to_go_to(folder, capsys, missing):
    words = {"--recording": ["--identified", str(folder / "found"), "--record", str(folder / "x.html")]}
    assert view.main(words.get(missing, ["--recording", str(folder / "bench.jsonl")])) == 2
    error = capsys.readouterr().err
    assert missing in error and error.count("\n") == 1
