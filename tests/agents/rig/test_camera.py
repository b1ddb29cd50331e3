"""A camera as the tracker of a rig: the tip of poses, the function that takes pictures, the keys of the rig's file."""

from pathlib import Path

import numpy as np
import pytest

from agents.rig.camera import CameraPoses, grabber
from agents.rig.pace import VirtualClock
from agents.rig.settings import _tracker, load_rig
from rollingjoint.camera import PlaneView, save_view
from rollingjoint.errors import ConfigError

PORTS = "mechanism: five_link\nmotors: {port: a, ids: [1, 2], signs: [1, 1], radius_mm: 10}\ncells: {port: b}\n"
CAMERA = "camera: {grab: mine.py:picture, view: view.yaml, balls: [[-6, -1], [6, -3], [2, 4]], diameter: 3}\n"


class Poses:
    """Photographs that were read already: a picture is its poses."""

    def poses(self, picture):
        return picture


def test_the_tip_is_the_last_link_and_none_where_it_was_not_seen():
    seen = np.arange(15.0).reshape(5, 3)
    clock = VirtualClock()
    reading = CameraPoses(Poses(), lambda: seen, clock).read()
    assert reading.values.tolist() == [12.0, 13.0] and reading.t == clock.now()
    hidden = seen.copy()
    hidden[4] = np.nan
    assert CameraPoses(Poses(), lambda: hidden, clock).read() is None


def test_a_file_of_a_rig_names_the_function_that_takes_pictures(tmp_path):
    (tmp_path / "rig.yaml").write_text(PORTS + CAMERA)
    (tmp_path / "mine.py").write_text("import numpy as np\n\n\ndef picture():\n    return np.full((50, 60), 9.0)\n")
    save_view(PlaneView((60, 50), np.diag([0.02, -0.02, 1.0])), tmp_path / "view.yaml")
    tracker = _tracker(load_rig(tmp_path / "rig.yaml"), VirtualClock())
    assert tracker.read() is None and tracker.photographs.diameter == 3.0  # nothing is in the picture
    (tmp_path / "plain.yaml").write_text(PORTS)
    assert _tracker(load_rig(tmp_path / "plain.yaml"), VirtualClock()) is None


@pytest.mark.parametrize("named", ["none.py:picture", "mine.py:nothing", "mine.py:number", "picture"])
def test_what_is_no_function_is_named_with_its_place(tmp_path, named):
    (tmp_path / "mine.py").write_text("number = 3\n")
    with pytest.raises(ConfigError, match=r"rig: camera\.grab = .*a function that returns a picture"):
        grabber("rig: camera.grab", named, tmp_path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (PORTS + CAMERA.replace("grab", "grub"), "grub"),
        (PORTS + CAMERA.replace("view: view.yaml, ", ""), "'view'"),
        (PORTS + "simulated: {}\n" + CAMERA, "no camera beside 'simulated'"),
    ],
)
def test_wrong_keys_of_a_camera_are_one_line(tmp_path, text, said):
    (tmp_path / "rig.yaml").write_text(text)
    with pytest.raises(ConfigError, match=said):
        load_rig(Path(tmp_path / "rig.yaml"))
