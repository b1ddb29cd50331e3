"""The command `rj trace`: paths of inputs and of the base, with memory, among walls."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from rollingjoint import WorldForce, trace, two_segment
from rollingjoint.io.surroundings_file import load_surroundings
from tests.rollingjoint.command import rj

WALLS = Path(__file__).resolve().parents[3] / "configs" / "surroundings" / "s_bend.yaml"
AMONG = f"--surroundings {WALLS} --base 1 -70 0.02"
FEED = "--tensions 3 3 3 3 --feed 0 100 99.9 --feed-step 5"


@pytest.fixture(autouse=True)
def few_frames(monkeypatch):
    monkeypatch.setattr("rollingjoint.plotting.film._MOST_FRAMES", 3)


@pytest.fixture(scope="module")
def expected():
    feeds = np.array([*np.linspace(0.0, 100.0, 21), 99.9])
    turn = np.array([-np.sin(0.02), np.cos(0.02)])
    bases = np.column_stack([[1.0, -70.0] + feeds[:, None] * turn, np.full(len(feeds), 0.02)])
    inputs = np.full((len(feeds), 4), 3.0)
    force = [WorldForce(-1, (0.02, 0.0))]
    return trace(two_segment(), inputs, force, "tensions", surroundings=load_surroundings(WALLS), base=bases), bases


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_a_base_that_is_pushed_in_is_traced(capsys, expected):
    path, bases = expected
    assert rj(f"trace two_segment {FEED} {AMONG} --force -1 0.02 0 --csv") == 0
    rows = rows_of(capsys.readouterr().out)
    assert len(rows) == len(bases) == 22
    for name, values in (
        ("base_x_mm", bases[:, 0]), ("base_y_mm", bases[:, 1]), ("tip_x_mm", path.tip[:, 0]), ("tension_3_N", 3.0),
        ("insertion_force_N", path.insertion_force), ("wall_force_6_x_N", path.wall_forces[:, 6, 0]),
        ("dissipated_work_N_mm", path.dissipated_work), ("jumped", path.jumped), ("status", path.status),
        ("wall_contacts", list(map(len, path.wall_contacts))),
        ("sticking_contacts", [0, *(sum(touch.sticks for touch in every) for every in path.wall_contacts[1:])]),
    ):  # fmt: skip
        np.testing.assert_allclose([float(row[name]) for row in rows], values, atol=1e-9, err_msg=name)
    assert float(rows[-1]["sticking_contacts"]) > 0.0


@pytest.mark.slow
def test_a_path_among_walls_in_space_is_traced_and_drawn(capsys, tmp_path):
    around = Path(__file__).resolve().parents[3] / "configs/surroundings/in_space.yaml"
    command = f"trace pitch_yaw --lengths 63.6 63.5 60.5 61.8 --surroundings {around} --feed 0 4 3.98 --csv"
    assert rj(f"{command} --plot {tmp_path / 'path.png'}") == 0
    rows = rows_of(capsys.readouterr().out)
    assert (tmp_path / "path.png").stat().st_size > 10_000
    assert all(int(row["wall_contacts"]) >= 2 for row in rows)
    assert int(rows[0]["sticking_contacts"]) == 0 < int(rows[-1]["sticking_contacts"])
    assert rj(f"{command} --plot {tmp_path / 'path.gif'}") == 0
    frames = frames_of(tmp_path / "path.gif")
    assert len(frames) == 3 and (frames[0] != frames[1]).any() and (frames[1] != frames[2]).any()


def test_the_table_has_a_line_per_step_and_json_the_columns(capsys, expected):
    path, _ = expected
    assert rj(f"trace two_segment {FEED} {AMONG} --force -1 0.02 0") == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert head.split()[:3] == ["step", "feed", "[mm]"] and len(lines) == 22
    assert lines[20].split()[:2] == ["20", "100.000"] and f"{path.insertion_force[20]:.3f}" in lines[20].split()
    assert rj(f"trace two_segment {FEED} {AMONG} --force -1 0.02 0 --json") == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["given"], content["usable"]) == ("tensions", True)
    np.testing.assert_allclose(content["steps"]["insertion_force_N"], path.insertion_force, atol=1e-9)


def test_files_hold_lengths_and_bases_of_every_step(capsys, tmp_path):
    chain = two_segment()
    lengths = chain.neutral_lengths - 1.0 + np.array([[0.0] * 4, [-1.0, 1.0, -1.0, 1.0]])
    head = ["length_0_mm", "length_1_mm", "length_2_mm", "length_3_mm", "base_x_mm", "base_y_mm", "base_angle_rad"]
    bases = np.array([[0.0, -20.0, 0.0], [0.1, 0.0, 0.01]])
    table = np.column_stack([lengths, bases])
    text = "\n".join([",".join(head), *(",".join(map(repr, row)) for row in table.tolist())])
    (tmp_path / "way.csv").write_text(text)
    columns = {name: values.tolist() for name, values in zip(head, table.T, strict=True)}
    (tmp_path / "way.yaml").write_text("\n".join(f"{name}: {values}" for name, values in columns.items()))
    found, limits = [], "--tension-limits 0.5 15"
    for name in ("way.csv", "way.yaml"):
        assert rj(f"trace two_segment --path {tmp_path / name} --surroundings {WALLS} {limits} --csv") == 0
        found.append(capsys.readouterr().out)
    path = trace(chain, lengths, tension_limits=(0.5, 15.0), surroundings=load_surroundings(WALLS), base=bases)
    assert found[0] == found[1]
    np.testing.assert_allclose([float(row["tip_y_mm"]) for row in rows_of(found[0])], path.tip[:, 1], atol=1e-9)
    np.testing.assert_allclose([float(row["length_1_mm"]) for row in rows_of(found[0])], lengths[:, 1])


def test_a_feed_in_a_file_moves_along_the_base_and_numbers_that_stay_are_one(capsys, tmp_path):
    (tmp_path / "way.yaml").write_text(
        "feed_mm: [0, 10]\ntension_0_N: 3\ntension_1_N: 3\ntension_2_N: 3\ntension_3_N: 4\n"
    )
    assert rj(f"trace two_segment --path {tmp_path / 'way.yaml'} {AMONG} --csv") == 0
    first, second = rows_of(capsys.readouterr().out)
    assert float(second["base_y_mm"]) - float(first["base_y_mm"]) == pytest.approx(10.0 * np.cos(0.02))
    assert float(second["tension_3_N"]) == 4.0


def test_a_path_without_walls_has_friction_in_holes(capsys, tmp_path):
    (tmp_path / "way.csv").write_text("tension_0_N,tension_1_N\n3,3\n6,3\n4,3\n")
    assert rj(f"trace five_link --path {tmp_path / 'way.csv'}") == 0
    head, *lines = capsys.readouterr().out.splitlines()
    assert "tension of tendon 0 [N]" in head and "contacts" not in head and len(lines) == 3


def frames_of(path):
    with Image.open(path) as film:
        return [np.array(frame.convert("RGB")) for frame in ImageSequence.Iterator(film)]


@pytest.mark.slow
def test_pictures_and_films(capsys, tmp_path):
    for name in ("way.png", "way.gif"):
        assert rj(f"trace two_segment {FEED} {AMONG} --plot {tmp_path / name}") == 0
    frames = frames_of(tmp_path / "way.gif")
    assert len(frames) == 3 and (frames[0] != frames[1]).any() and (frames[1] != frames[2]).any()
    assert (tmp_path / "way.png").stat().st_size > 5000


def test_steps_without_an_equilibrium_are_told(capsys):
    assert rj(f"trace two_segment --tensions 0 0 0 0 --feed 0 2 {AMONG}") == 3
    said = capsys.readouterr()
    assert "INDETERMINATE" in said.out.splitlines()[1] and "rj trace: 3 of 3 steps are no stable equilibria" in said.err


@pytest.mark.parametrize(
    ("content", "options", "told"),
    [
        ("length_0_mm,tension_0_N\n1,2", "", "expected all of length_0_mm"),
        ("feed_mm,base_x_mm,base_y_mm,base_angle_rad\n1,2,3,4", "", "expected one of both"),
        ("feed_mm\n", "--tensions 3 3 3 3", "number of steps"),
        ("feed_mm\n1,2\n", "--tensions 3 3 3 3", "row 2 = '2 values'"),
        ("feed_mm\nx\n", "--tensions 3 3 3 3", "row 2, feed_mm = 'x'"),
        ("feeds_mm\n1\n", "--tensions 3 3 3 3", "feed_mm"),
        ("feed_mm\n1\n", "", "lengths or tensions, in the file or by an option"),
        ("feed_mm\n1\n", "--tensions 3 3 3 3 --feed 1 2", "a column feed_mm"),
    ],
)
def test_wrong_files_are_one_line(content, options, told, capsys, tmp_path):
    (tmp_path / "way.csv").write_text(content)
    assert rj(f"trace two_segment --path {tmp_path / 'way.csv'} {options} {AMONG}") == 2
    said = capsys.readouterr().err
    assert told in said and said.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("--tensions 3 3 3 3 --feed 0 5", "--surroundings"),
        (f"--tensions 3 3 3 3 --feed 0 {AMONG}", "two numbers or more"),
        (f"--tensions 3 3 3 3 --feed-step 2 {AMONG}", "--feed beside it"),
        (f"--tensions 3 3 3 3 --feed 0 1e6 {AMONG}", "less than 25,000"),
        (f"--tensions 3 3 3 3 --tension-limits 1 2 {AMONG}", "only with lengths"),
        ("--tensions 3 3 3 3 --plot x.png", "--surroundings beside it"),
    ],
)
def test_wrong_options_are_one_line(options, told, capsys):
    assert rj(f"trace two_segment {options}") == 2
    said = capsys.readouterr().err
    assert told in said and said.count("\n") == 1
