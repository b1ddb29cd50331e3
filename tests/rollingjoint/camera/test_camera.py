"""Views of a plane, balls in pictures, links by their balls; rendered photographs through a lens, to rj identify."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rollingjoint import five_link, flexible_arm, solve_tensions, trace
from rollingjoint.camera import LinkBalls, Photographs, PlaneView, find_balls, load_view, save_view, view_of_board
from rollingjoint.cli import main
from rollingjoint.errors import ConfigError, InvalidInput
from rollingjoint.friction import CapstanFriction
from rollingjoint.identify import load_measurements

PAGE = (Path(__file__).parents[3] / "docs/rig.md").read_text("utf-8")
BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
SMALL = {"size": (520, 416), "focal": 1000.0, "shift": (4.0, -3.0)}


@pytest.fixture(scope="module")
def rendered():
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(str(BENCHMARKS))
        import marker_accuracy

        yield marker_accuracy


@pytest.fixture(scope="module")
def camera(rendered):
    return rendered.Pinhole(**SMALL, radial=(-0.25, 0.1))


@pytest.fixture(scope="module")
def board_picture(rendered, camera):
    return rendered.photograph_of_board(camera, np.random.default_rng(0))


@pytest.fixture(scope="module")
def board(rendered, board_picture):
    return view_of_board(board_picture, rendered.PITCH)


def a_view():
    homography = np.array([[0.012, 1e-3, 0.02], [-1e-3, -0.013, 0.1], [1e-4, -2e-4, 1.0]])
    return PlaneView((640, 480), homography, (-0.12, 0.03), (0.01, -0.02))


def test_places_are_the_inverse_of_pixels():
    places = np.random.default_rng(1).uniform(-50, 50, (40, 2))
    np.testing.assert_allclose(a_view().places(a_view().pixels(places)), places, atol=1e-9)


def test_a_lens_that_folds_the_picture_over_gives_nan_where_it_does():
    view = replace(a_view(), distortion=(-0.6, 0.0))
    places = view.places([[320.0, 240.0], [5000.0, 5000.0]])
    assert np.isfinite(places[0]).all() and np.isnan(places[1]).all()
    assert np.isnan(a_view().pixels([[0.0, 6000.0]])).all()  # behind the camera


def test_a_view_survives_its_file(tmp_path):
    save_view(a_view(), tmp_path / "view.yaml")
    again = load_view(tmp_path / "view.yaml")
    np.testing.assert_array_equal(again.homography, a_view().homography)
    assert (again.size, again.distortion, again.centre) == ((640, 480), (-0.12, 0.03), (0.01, -0.02))
    flat = "size: [640, 480]\nhomography: [[1, 0, 0], [0, 1, 0]]\ndistortion: [0, 0]\ncentre: [0, 0]\n"
    (tmp_path / "view.yaml").write_text(flat)
    with pytest.raises(ConfigError, match="homography"):
        load_view(tmp_path / "view.yaml")


@pytest.mark.parametrize("kind", ["dark", "bright", "red", "blue"])
def test_round_spots_are_found_to_a_twentieth_of_a_pixel_and_bars_are_not(kind):
    y, x = np.mgrid[:120, :160].astype(float)
    centres = np.array([[30.3, 25.7], [110.6, 31.2], [70.45, 80.55]])
    spots = sum(np.clip(7.0 - np.hypot(x - a, y - b), 0.0, 1.0) for a, b in centres)
    spots += ((np.abs(x - 120) < 4) & (np.abs(y - 90) < 20)).astype(float)  # a bar
    lit = 1.0 - 0.3 * x / 160
    grey = {"dark": lit * (0.9 - 0.8 * spots), "bright": lit * (0.1 + 0.8 * spots)}.get(kind)
    if grey is None:
        channel = ("red", "green", "blue").index(kind)
        grey = np.stack([lit * (0.5 - 0.4 * spots)] * 3, axis=-1)
        grey[..., channel] = lit * (0.5 + 0.3 * spots)
    found = find_balls(200 * grey + np.random.default_rng(0).normal(0, 1, grey.shape), kind)
    assert found.shape == (3, 2)
    order = np.argsort(found[:, 0])
    np.testing.assert_allclose(found[order], centres[np.argsort(centres[:, 0])], atol=0.05)


def test_pictures_that_are_none_say_so_and_empty_ones_have_no_balls():
    assert find_balls(np.full((50, 60), 3.0)).shape == (0, 2)
    for picture, said in ((np.zeros((5, 5)), "shape"), (np.full((20, 20), np.nan), "finite"), ("x", "grey values")):
        with pytest.raises(InvalidInput, match=said):
            find_balls(picture)
    with pytest.raises(InvalidInput, match="without colours"):
        find_balls(np.eye(20), "red")


def test_a_board_gives_the_view_of_a_lens_that_the_calibration_does_not_know(board, camera):
    assert len(board.pixels) > 100 and board.rms < 0.01
    assert board.view.pixels_per_mm() == pytest.approx(3.45, rel=0.01) and board.view.distortion[0] < -0.02
    straight = replace(board.view, distortion=(0.0, 0.0))
    assert np.linalg.norm(straight.places(board.pixels) - board.places, axis=1).max() > 10 * board.rms


def test_a_board_needs_dots_that_form_a_grid(board_picture):
    with pytest.raises(InvalidInput, match="20 or more that form a square grid"):
        view_of_board(np.full((100, 100), 200.0), 8.0)
    with pytest.raises(InvalidInput, match="pitch"):
        view_of_board(board_picture, 0.0)


def test_links_are_found_in_any_frame_among_strangers_and_in_any_order(rendered):
    rng, links = np.random.default_rng(2), LinkBalls(five_link(), rendered.BALLS)
    poses = rendered.random_poses(rng)
    places = np.concatenate([rendered.BALLS @ _turned(angle).T + (x, y) for x, y, angle in poses])
    seen = np.concatenate([places, rng.uniform(-60, 120, (6, 2))])
    seen = rng.permutation(seen @ _turned(0.7).T + (31.0, -12.0))
    np.testing.assert_allclose(links.poses(seen), poses, atol=1e-9)
    hidden = np.delete(places, 3 * 3, axis=0)  # a ball of the fourth link
    partly = links.poses(hidden)
    np.testing.assert_allclose(partly[:3], poses[:3], atol=1e-9)
    assert np.isnan(partly[3:]).all() and np.isnan(links.poses(places * (-1.0, 1.0))).all()  # mirrored: none


def _turned(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def test_triangles_with_equal_sides_and_arms_are_refused():
    with pytest.raises(InvalidInput, match="sides of the triangle"):
        LinkBalls(five_link(), [(0, 0), (10, 0), (5, 8.66)])
    with pytest.raises(InvalidInput, match="planar chain"):
        LinkBalls(flexible_arm(), [(0, 0), (10, 0), (5, 5)])


def test_poses_from_a_photograph_are_right_to_hundredths_of_a_millimetre(rendered, camera, board):
    rng = np.random.default_rng(4)
    poses = rendered.random_poses(rng)
    photographs = Photographs(board.view, LinkBalls(five_link(), rendered.BALLS), rendered.DIAMETER)
    off = (photographs.poses(rendered.photograph_of(camera, poses, rng)) - poses)[1:]
    assert np.linalg.norm(off[:, :2], axis=1).max() < 0.15 and np.abs(off[:, 2]).max() < 3e-3
    with pytest.raises(ConfigError, match="size of the picture"):
        photographs.poses(np.zeros((100, 100)))


FILE = """\
mechanism: five_link
camera: {view: view.yaml, balls: [[-6, -1], [6, -3], [2, 4]], diameter: 3}
deviations: {position: 0.05, angle: 0.002}
runs:
  A:
"""


@pytest.mark.slow
def test_photographs_go_from_a_board_to_identified_friction_without_a_hand_written_number(
    rendered, camera, board_picture, tmp_path, capsys
):
    true, rng = five_link().replace(friction=CapstanFriction(0.15)), np.random.default_rng(5)
    tensions = [(3, 3), (6, 3), (9, 3), (6, 3), (3, 3), (3, 6), (3, 9), (3, 6)]
    path = trace(true, tensions, given="tensions")
    lines = FILE
    for k, (values, poses) in enumerate(zip(tensions, path.poses, strict=True)):
        _save(tmp_path / f"{k}.png", rendered.photograph_of(camera, poses, rng))
        lines += f"    - {{tensions: {list(values)}, photograph: {k}.png}}\n"
    _save(tmp_path / "board.png", board_picture)
    (tmp_path / "photographs.yaml").write_text(lines)
    assert main(["camera", str(tmp_path / "board.png"), "--pitch", "8", "--output", str(tmp_path / "view.yaml")]) == 0
    assert "pixels per mm" in capsys.readouterr().out
    assert main(["identify", str(tmp_path / "photographs.yaml"), "--intervals", "linear", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["parameters"]["mu"]["value"] == pytest.approx(0.15, abs=0.01)


def _save(path, picture):
    Image.fromarray(picture.astype(np.uint8)).save(path)


def test_a_step_takes_its_poses_from_its_photograph(rendered, camera, board, tmp_path):
    save_view(board.view, tmp_path / "view.yaml")
    poses = np.asarray(solve_tensions(five_link(), (5.0, 3.0)).poses)
    _save(tmp_path / "a.png", rendered.photograph_of(camera, poses, np.random.default_rng(6)))
    step = "    - {tensions: [5, 3], photograph: a.png}\n"
    (tmp_path / "a.yaml").write_text(FILE + step)
    (one,) = load_measurements(tmp_path / "a.yaml").runs[0].steps
    np.testing.assert_allclose(one.positions[1:], poses[1:, :2], atol=0.15)
    np.testing.assert_allclose(one.angles[1:], poses[1:, 2], atol=3e-3)


def test_the_file_of_the_page_can_be_read(rendered, camera, board, tmp_path):
    (text,) = [block for block in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL) if "photograph:" in block]
    save_view(board.view, tmp_path / "view.yaml")
    for k, tensions in enumerate([(3.0, 3.0), (6.0, 3.0)]):
        poses = np.asarray(solve_tensions(five_link(), tensions).poses)
        _save(tmp_path / f"{k}.png", rendered.photograph_of(camera, poses, np.random.default_rng(k)))
    (tmp_path / "page.yaml").write_text(text)
    assert len(load_measurements(tmp_path / "page.yaml").runs[0].steps) == 2
    (commands,) = [block for block in re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL) if "rj camera" in block]
    assert commands.startswith("rj camera board.png --pitch 8 --output view.yaml ")  # as the test of all of it has them


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("photograph: a.png", "photograph: none.png"), "none.png"),
        (("photograph: a.png", "photograph: a.png, tip: [0, 0]"), "one of poses, positions, tip and photograph"),
        (("photograph: a.png", "photograph: blank.png"), "links are seen"),
        (("diameter: 3", "diameter: 0"), "camera.diameter = 0"),
        (("diameter: 3", "diameter: 3, kind: gold"), "camera.kind = 'gold'"),
        (("[2, 4]]", "[0, 8.4]]"), "sides of the triangle"),
        (("camera: {", "about: x\n#"), "a file with the key 'camera'"),
        (("mechanism: five_link", "mechanism: small_arm"), "a planar chain of rolling links"),
    ],
)
def test_wrong_files_with_photographs_are_one_line(tmp_path, capsys, change, said):
    save_view(PlaneView((60, 50), np.diag([0.02, -0.02, 1.0])), tmp_path / "view.yaml")
    for name in ("a", "blank"):
        _save(tmp_path / f"{name}.png", np.full((50, 60), 200.0))
    text = (FILE + "    - {tensions: [5, 3], photograph: a.png}\n").replace(*change)
    (tmp_path / "a.yaml").write_text(text)
    assert main(["identify", str(tmp_path / "a.yaml")]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["text.png", "--pitch", "8"], "a readable picture"),
        (["blank.png", "--pitch", "8"], "dots of the board = 0"),
        (["blank.png", "--pitch", "-1"], "pitch"),
    ],
)
def test_wrong_boards_are_one_line(tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    Path("text.png").write_text("no picture")
    _save("blank.png", np.full((50, 60), 200.0))
    assert main(["camera", *words, "--output", "view.yaml"]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and not Path("view.yaml").exists()
