"""`rj export` and the assembly drawing: files, lines, exit codes, scales."""

from __future__ import annotations

import argparse
import inspect
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rollingjoint as rj
from rollingjoint.cad import Fabrication, assembly_drawing
from rollingjoint.cad import export as export_function
from rollingjoint.cad.assembly import assemble
from rollingjoint.cad.command import add_options
from rollingjoint.cad.drawing import draw_assembly
from tests.rollingjoint.command import rj as run_rj

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "cad.md").read_text(encoding="utf-8")
CONSOLE = re.findall(r"^\$ rj export (.*)\n(.*)$", PAGE, re.MULTILINE)
SHELL = sorted(set(re.findall(r"^rj export (.*)$", PAGE, re.MULTILINE)))
SHEETS = {"A4": (210.0, 297.0), "A3": (420.0, 297.0)}


@pytest.fixture(autouse=True)
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def export(command):
    return run_rj(f"export {command}")


def words(figure):
    return [text.get_text() for text in figure.axes[0].texts]


def sheet_of(figure):
    width, height = figure.get_size_inches() * 25.4
    return next(name for name, size in SHEETS.items() if np.allclose(size, (width, height)))


@pytest.mark.slow
def test_one_line_is_printed_for_every_file_written(workplace, capsys):
    assert export("five_link --out parts --format svg png stl") == 0
    printed = capsys.readouterr().out.splitlines()
    links = [f"parts/link_{i}.{suffix}" for i in range(5) for suffix in ("svg", "stl")]
    sheets = [f"parts/{name}.png" for name in ("assembly", *(f"link_{i}" for i in range(5)))]
    assert printed == [*links, "parts/assembly.svg", *sheets, "parts/parts.csv"]
    assert sorted(printed) == sorted(str(path) for path in Path("parts").iterdir())


@pytest.mark.parametrize(("command", "shown"), CONSOLE)
def test_page_shows_what_the_command_prints(command, shown, capsys):
    assert export(command) == 2
    assert capsys.readouterr().err == f"{shown}\n"


@pytest.mark.slow
@pytest.mark.parametrize("command", SHELL)
def test_commands_of_the_page_succeed(command):
    assert export(command) == 0


def test_options_of_the_page_are_those_of_the_command_with_their_defaults():
    parser = argparse.ArgumentParser()
    add_options(parser)
    rows = re.findall(r"^\| `(--\w+)[^|]*\| `(\w+)` \|([^|]*)\|", PAGE, re.MULTILINE)
    known = {action.option_strings[0]: action for action in parser._actions[1:]}
    assert [option for option, _, _ in rows] == list(known)
    defaults = {option: action.default for option, action in known.items()}
    stated = {option: float(text) for option, _, text in rows if re.match(r" \d", text)}
    assert stated == {option: value for option, value in defaults.items() if isinstance(value, float)}
    assert defaults["--format"] == tuple(next(text for option, _, text in rows if option == "--format").split())
    assert {name for _, name, _ in rows} == set(inspect.signature(export_function).parameters) - {"mechanism"}


def test_formats_are_dxf_svg_and_stl_unless_told(capsys):
    assert export("uniform --out parts") == 0
    assert {path.suffix for path in Path("parts").iterdir()} == {".dxf", ".svg", ".stl", ".csv"}


def test_sizes_reach_the_files():
    assert export("uniform --out parts --format svg --thickness 9.5 --channel 0 --tolerance 0.05") == 0
    row = Path("parts/parts.csv").read_text(encoding="utf-8").splitlines()[1].split(",")
    assert row[4:6] == ["9.5", "0"]
    assert Path("parts/link_0.svg").read_text(encoding="utf-8").count(" L ") == 25  # 24 corners, and two lines


def test_tensions_and_loads_set_the_pose_of_the_assembly():
    assert export("five_link --out rest --format svg") == 0
    assert export("five_link --out bent --format svg --tensions 6 3 --force -1 0.5 0") == 0
    assert Path("rest/link_3.svg").read_bytes() == Path("bent/link_3.svg").read_bytes()
    assert Path("rest/assembly.svg").read_bytes() != Path("bent/assembly.svg").read_bytes()
    assert "equilibrium at tensions of 6, 3 N" in Path("bent/assembly.svg").read_text(encoding="utf-8")


def test_pose_that_is_no_equilibrium_exits_with_3_and_writes_nothing(capsys):
    assert export("five_link --out parts --tensions 0 0") == 3
    assert "INDETERMINATE" in capsys.readouterr().err
    assert not Path("parts").exists()


def test_files_that_are_there_are_kept_without_overwrite(capsys):
    assert export("uniform --out parts --format svg") == 0
    before = Path("parts/link_0.svg").read_bytes()
    assert export("uniform --out parts --format svg --tolerance 0.03") == 2
    assert Path("parts/link_0.svg").read_bytes() == before
    assert export("uniform --out parts --format svg --tolerance 0.03 --overwrite") == 0
    assert Path("parts/link_0.svg").read_bytes() != before


@pytest.mark.parametrize(
    ("command", "parts"),
    [
        ("five_link", ["--out"]),
        ("five_lnik --out parts", ["'five_lnik'", "Did you mean 'five_link'?"]),
        ("five_link --out no/such", ["folder = 'no/such'", "Create no first"]),
        ("five_link --out parts --format iges", ["formats = ['iges']", "dxf, svg, stl, step, pdf, png"]),
        ("five_link --out parts --thickness nan", ["thickness = nan", "0.1 to 1000 mm"]),
        ("five_link --out parts --thickness 0", ["thickness = 0.0"]),
        ("five_link --out parts --thickness 1e300", ["thickness = 1e+300"]),
        ("five_link --out parts --channel 5.5", ["thickness = 6.0", "at least 6.3 mm"]),
        ("two_segment --out parts --channel 3", ["tendons 0 and 2 in link 0"]),
        ("five_link --out parts --tolerance 0", ["tolerance = 0.0"]),
        ("five_link --out parts --force -1 1 0", ["--force", "--tensions or --lengths"]),
    ],
)
def test_wrong_input_exits_with_2_and_one_clear_line(command, parts, workplace, capsys):
    assert export(command) == 2
    output = capsys.readouterr()
    assert output.out == "" and output.err.count("\n") == 1 and output.err.startswith("rj export: error: ")
    assert all(part in output.err for part in parts), output.err
    assert list(workplace.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["pdf", "png"])
def test_drawing_is_a_sheet_of_paper(suffix):
    path = assembly_drawing(rj.five_link(), f"assembly.{suffix}")
    if suffix == "png":
        with Image.open(path) as picture:
            width, height = picture.size
        assert width / height == pytest.approx(210 / 297, rel=2e-3) and width > 1600
    else:
        content = path.read_bytes()
        assert content.startswith(b"%PDF") and b"/MediaBox [ 0 0 595.2" in content
        assert content == assembly_drawing(rj.five_link(), "again.pdf").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mechanism", "sheet", "scale"),
    [
        (rj.five_link(), "A4", 1.0),
        (rj.two_segment(), "A4", 2.0),
        (rj.uniform(12), "A3", 1.0),
        (rj.uniform(40), "A3", 0.2),
        (rj.uniform(2, height=2, radius=2, half_width=1.5, tendon_offset=0.7), "A4", 20.0),
    ],
)
def test_drawing_is_to_the_scale_and_on_the_sheet_that_it_states(mechanism, sheet, scale):
    making = Fabrication(channel_diameter=0.4, wall=0.1)
    figure = draw_assembly(assemble(mechanism, making))
    stated = f"{scale:g}:1" if scale >= 1 else f"1:{1 / scale:g}"
    assert sheet_of(figure) == sheet and sheet in words(figure) and stated in words(figure)
    assert f"ASSEMBLY  {stated}" in words(figure)
    drawn = figure.axes[0].patches[0].get_xy()  # the base, first of all areas
    low, high = assemble(mechanism, making).bodies[0].bounds
    np.testing.assert_allclose(np.ptp(drawn, axis=0), scale * (high - low), rtol=1e-9)
    limits = np.array(SHEETS[sheet])
    for line in figure.axes[0].lines:
        points = line.get_xydata()
        assert np.all((points >= 9.9) & (points <= limits - 9.9))


def test_drawing_states_dimensions_holes_and_what_is_made():
    assembly = assemble(rj.two_segment(), Fabrication(thickness=7.5, channel_diameter=0.9))
    found = words(draw_assembly(assembly))
    width, hole = 40 * np.sin(0.6), 20 * np.sin(9 / 20)
    outer_y = 7.5 - 20 * (1 - np.cos(9 / 20))
    for entry in (
        f"{width:.2f}",
        f"{hole:.2f}".rstrip("0"),
        f"{outer_y:.2f}",
        "105",
        "7.5",
        "Ø0.9",
        "0-3",
        "4-6",
        "mm",
    ):
        assert entry in found, entry
    assert {"two_segment", "assembly, every contact at s = 0", "material"} <= set(found)


def test_table_that_is_too_long_says_how_much_it_leaves_out():
    links = [rj.uniform(2, height=20 + 0.1 * i).links[0] for i in range(40)]
    mechanism = rj.RollingChain(links, rj.uniform().tendons, "many")
    figure = draw_assembly(assemble(mechanism, Fabrication()))
    hidden = [int(word.removesuffix(" more")) for word in words(figure) if word.endswith(" more")]
    shown = words(figure).count("27.27")
    assert len(hidden) == 2 and hidden[0] == 40 - shown + 1 + 1
    for line in figure.axes[0].lines:
        assert np.all(line.get_xydata() >= 9.9)


def test_mechanism_beyond_every_scale_is_refused():
    mechanism = rj.uniform(2, height=4e6, radius=20.0)
    with pytest.raises(rj.InvalidInput, match="fits on A3"):
        assembly_drawing(mechanism, "huge.png")


@pytest.mark.parametrize("path", ["a.doc", "no/such/a.pdf"])
def test_drawing_that_cannot_be_written_is_refused(path):
    with pytest.raises(rj.InvalidInput, match="picture"):
        assembly_drawing(rj.five_link(), path)
