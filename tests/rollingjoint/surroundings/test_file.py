"""Surroundings in YAML files, and the options of `rj` that read them."""

import json
from pathlib import Path

import numpy as np
import pytest

from rollingjoint import (
    Bare,
    Capsule,
    ConfigError,
    Disc,
    HalfPlane,
    Lumen,
    Plane,
    Polygon,
    Sleeve,
    Sphere,
    Surroundings,
    Tube,
    WallFriction,
    solve_tensions,
    two_segment,
)
from rollingjoint.checked_yaml import dump_yaml, parse_yaml
from rollingjoint.io.surroundings_file import load_surroundings
from rollingjoint.surroundings.file import surroundings_from_dict, surroundings_to_dict
from tests.rollingjoint.command import rj

SHIPPED = Path(__file__).resolve().parents[3] / "configs/surroundings/s_bend.yaml"
WALLS = [
    HalfPlane((0.6, 0.8), -25.0, stiffness=5.0, toe=0.3),
    Disc((1, 2), 3, friction=WallFriction(0.4, 0.1)),
    Capsule((0, 0), (1, 1), 2),
    Polygon([(0, 0), (4, 0), (0, 4)], 0.25),
    Lumen([30, 40], [0, 0.02], [8, 8, 7], (1.0, 2.0, 1.5)),
]
IN_SPACE = [
    Plane((0.6, 0.0, 0.8), -25.0, stiffness_per_length=0.5),
    Sphere((1, 2, 60), 3, friction=WallFriction(0.4, 0.1)),
    Capsule((0, 0, 9), (1, 1, 30), 2),
    Tube([30, 40], [0, 0.02], [0.0, 1.5], [8, 8, 7], (1.0, 2.0, 3.0), (0, 1, 1), stiffness=2.0),
]


@pytest.mark.parametrize(
    "around",
    [
        Surroundings(WALLS, Sleeve(8.0), WallFriction(0.2)),
        Surroundings(WALLS[1:], Bare(0.5, 4)),
        Surroundings([Disc((1, 2), 3)], rigid=True),
        Surroundings(IN_SPACE, Bare(0.5, 4, 6), WallFriction(0.2)),
    ],
    ids=["all", "bare", "rigid", "in space"],
)
def test_surroundings_come_back_from_their_yaml(around):
    text = dump_yaml(surroundings_to_dict(around))
    assert surroundings_from_dict("file", parse_yaml(text, "file")) == around


def test_lumens_may_be_given_by_points():
    points = [[0, 0], [0, 50], [40, 80]]
    around = surroundings_from_dict(
        "file",
        {
            "walls": [
                {"lumen": {"through": points, "radii": [8, 7, 7], "bend_radius": 20, "stiffness": 2}},
                {"lumen": {"fit": points, "radii": 8, "tolerance": 0.5, "friction": {"mu": 0.1}}},
            ]
        },
    )
    assert around.walls[0] == Lumen.through(points, [8, 7, 7], 20, stiffness=2)
    assert around.walls[1] == Lumen.fit(points, 8, 0.5, friction=WallFriction(0.1))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("walls: []", "f.walls = []: expected a list with at least one entry."),
        ("outline: {}", "f = ['outline']: expected the key 'walls'."),
        ("walls: [{disk: {}}]", "f.walls[0]: unknown key = 'disk': expected one of half_plane, disc,"),
        ("walls: [{disc: {centre: [0, 1], radius: 0}}]", "f.walls[0].disc: Disc radius = 0.0: expected"),
        (
            "walls: [{disc: {centre: [0, '1'], radius: 2}}]",
            "f.walls[0].disc.centre[1] = '1': expected a finite",
        ),
        ("walls: [{disc: {radius: 2}}]", "f.walls[0].disc = ['radius']: expected the key 'centre'."),
        ("walls: [{disc: {centre: [0, 1], radius: 2}, lumen: {}}]", "f.walls[0] = ['disc', 'lumen']: expected one key"),
        ("walls: [{lumen: {through: [[0, 0], [0, 9]], radii: 2}}]", "expected the key 'bend_radius'."),
        (
            "walls: [{lumen: {lengths: 3, curvatures: [0], radii: 2}}]",
            "f.walls[0].lumen: Lumen lengths = 3.0",
        ),
        ("walls: [{disc: {centre: [0, 1], radius: 2}}]\noutline: {tube: {}}", "f.outline: unknown key = 'tube'"),
        ("walls: [{disc: {centre: [0, 1], radius: 2}}]\nfriction: {mu: 2}", "f.friction: wall friction mu = 2.0"),
        ("walls: [{disc: {centre: [0, 1], radius: 2}}]\nrigid: 1", "f: rigid = 1: expected true or false."),
    ],
)
def test_wrong_files_are_one_line_with_the_place(content, words):
    with pytest.raises(ConfigError) as error:
        surroundings_from_dict("f", parse_yaml(content.replace("'1'", '"1"'), "f"))
    assert words in str(error.value) and "\n" not in str(error.value)


def test_rj_solves_among_the_walls_of_a_file(capsys):
    assert rj(f"solve two_segment --tensions 3 1 1 2 --surroundings {SHIPPED} --base 0 20 0 --json") == 0
    printed = json.loads(capsys.readouterr().out)
    around = load_surroundings(SHIPPED)
    expected = solve_tensions(two_segment(), [3, 1, 1, 2], surroundings=around, base=(0, 20, 0))
    assert len(printed["wall_contacts"]) == len(expected.wall_contacts) == 2
    first = printed["wall_contacts"][0]
    assert first["wall"] == "lumen 0" and first["normal_N"] == pytest.approx(expected.wall_contacts[0].force)
    np.testing.assert_allclose(printed["wall_forces_N_N_mm"], expected.wall_forces)
    assert printed["insertion_force_N"] == pytest.approx(expected.insertion_force)
    assert rj(f"solve two_segment --tensions 3 1 1 2 --surroundings {SHIPPED}") == 0
    assert "lumen 0" in capsys.readouterr().out
    assert rj(f"solve two_segment --tensions 1 1 1 1 --surroundings {SHIPPED} --base 0 -200 0") == 0
    assert "no link touches a wall" in capsys.readouterr().out


def test_rj_solves_and_draws_among_walls_in_space(capsys, tmp_path):
    options = f"pitch_yaw --lengths 63.6 63.5 60.5 61.8 --surroundings {SHIPPED.with_name('in_space.yaml')}"
    assert rj(f"solve {options} --base 0 0 -2") == 0
    text = capsys.readouterr().out
    assert "plane 0" in text and "sphere 0" in text and "CONVERGED" in text
    picture = tmp_path / "walls.png"
    assert rj(f"plot {options} --out {picture}") == 0
    assert picture.stat().st_size > 10_000


def test_rj_draws_the_walls_of_a_file(tmp_path):
    picture = tmp_path / "walls.png"
    assert rj(f"plot two_segment --tensions 3 1 1 2 --surroundings {SHIPPED} --base 0 20 0 --out {picture}") == 0
    bare = tmp_path / "bare.png"
    assert rj(f"plot two_segment --tensions 3 1 1 2 --out {bare}") == 0
    assert picture.read_bytes() != bare.read_bytes()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            "two_segment --tensions 3 1 1 2 --base 0 20 0",
            "--base = [0.0, 20.0, 0.0]: expected --surroundings",
        ),
        (
            f"small_arm --tensions 1 1 1 1 --surroundings {SHIPPED}",
            "expected walls around an arm of beads: Plane, Sphere",
        ),
        (f"two_segment --lengths 50 50 90 90 --method least_squares --surroundings {SHIPPED}", "--method elastic"),
        ("two_segment --tensions 3 1 1 2 --surroundings none.yaml", "none.yaml"),
        (f"two_segment --tensions 3 1 1 2 --surroundings {SHIPPED} --base 0 1 nan", "--base number 2 = nan"),
    ],
)
def test_wrong_options_get_one_line(options, words, capsys):
    assert rj(f"solve {options}") == 2
    error = capsys.readouterr().err
    assert words in error and error.count("\n") == 1
