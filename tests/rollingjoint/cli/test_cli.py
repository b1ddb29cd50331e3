"""The command `rj`: what it prints, its exit codes, and that its documentation is true."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from rollingjoint.chain.presets import PRESETS, five_link, small_arm
from rollingjoint.chain.status import Status
from rollingjoint.friction import CapstanFriction
from rollingjoint.io.mechanism_file import dump_mechanism
from rollingjoint.load import BodyWrench, Gravity, Spring, WorldForce
from rollingjoint.statics.loop import trace_loop
from rollingjoint.statics.solve import solve_lengths, solve_tensions
from tests.rollingjoint.command import rj

ROOT = Path(__file__).resolve().parents[3]
DOCUMENT = (ROOT / "docs" / "cli.md").read_text(encoding="utf-8")
CONSOLE = [block.splitlines() for block in re.findall(r"```console\n(.*?)```", DOCUMENT, flags=re.DOTALL)]
SHELL = [line for block in re.findall(r"```sh\n(.*?)```", DOCUMENT, flags=re.DOTALL) for line in block.splitlines()]
NUMBER = re.compile(r"-?\d+\.\d+(?:e[+-]\d+)?")


def solved(capsys: pytest.CaptureFixture[str], command: str) -> dict[str, list[dict[str, float]]]:
    assert rj(f"solve {command} --json") == 0
    return json.loads(capsys.readouterr().out)


def steps(block: list[str]) -> list[tuple[str, list[str]]]:
    """Commands of a console block, each with the lines printed below it."""
    found: list[tuple[str, list[str]]] = []
    for line in block:
        if line.startswith("$ "):
            found.append((line[2:], []))
        else:
            found[-1][1].append(line)
    return found


@pytest.mark.parametrize("block", CONSOLE, ids=[block[0] for block in CONSOLE])
def test_documented_commands_print_what_the_documentation_shows(
    block: list[str], workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = 0
    for command, shown in steps(block):
        if command == "echo $?":
            assert shown == [str(code)]
            continue
        assert command.startswith("rj ")
        code = rj(command.removeprefix("rj "))
        printed = "".join(capsys.readouterr()).splitlines()
        assert len(printed) == len(shown)
        for line, expected in zip(printed, shown, strict=True):
            assert NUMBER.sub("#", line).split() == NUMBER.sub("#", expected).split()
            values, wanted = NUMBER.findall(line), NUMBER.findall(expected)
            np.testing.assert_allclose([float(v) for v in values], [float(v) for v in wanted], atol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("command", SHELL)
def test_documented_commands_succeed_and_write_their_files(
    command: str, workplace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rollingjoint.plotting.loops._FRAMES", 5)
    assert command.startswith("rj ")
    assert rj(command.removeprefix("rj ")) == 0
    for file in re.findall(r"--(?:out|plot) (\S+)", command):
        assert (workplace / file).stat().st_size > 1000


def test_every_documented_exit_code_is_shown_by_an_example() -> None:
    assert len(CONSOLE) >= 5
    assert len(SHELL) >= 5
    assert {shown[0] for block in CONSOLE for command, shown in steps(block) if command == "echo $?"} == {
        "2",
        "3",
    }


def test_json_holds_the_numbers_of_the_solver_to_the_last_bit(capsys: pytest.CaptureFixture[str]) -> None:
    expected = solve_tensions(five_link(), (6, 3), [WorldForce(-1, (0.5, 0))])
    result = solved(capsys, "five_link --tensions 6 3 --force -1 0.5 0")
    assert [[row["x_mm"], row["y_mm"], row["angle_rad"]] for row in result["links"]] == expected.poses.tolist()
    assert [row["arc_length_mm"] for row in result["joints"]] == expected.arc_lengths.tolist()
    assert [row["length_mm"] for row in result["tendons"]] == expected.lengths.tolist()
    assert [row["contact_mm"] for row in result["joints"]] == expected.contact_points.tolist()
    np.testing.assert_array_equal([row["slip_margin_N"] for row in result["joints"]], expected.slip_margins(0.3))


def test_every_load_option_reaches_the_solver(capsys: pytest.CaptureFixture[str]) -> None:
    loads = [
        WorldForce(2, (0.1, -0.2)),
        WorldForce(-1, (-0.3, 0)),
        BodyWrench(3, (0.2, 0.1)),
        WorldForce(1, (0, 0), moment=-4),
        Spring(-1, 0.02, (-30, 90)),
        Gravity([0.1, 0.2, 0.3, 0.4, 0.5], direction=(1, 0)),
    ]
    options = (
        "--force 2 0.1 -0.2 --force -1 -0.3 0 --body-force 3 0.2 0.1 --moment 1 -4 --spring -1 0.02 -30 90 "
        "--gravity 0.1 0.2 0.3 0.4 0.5 --gravity-direction 1 0"
    )
    result = solved(capsys, f"five_link --tensions 6 3 {options}")
    expected = solve_tensions(five_link(), (6, 3), loads)
    assert [row["angle_rad"] for row in result["joints"]] == expected.joint_angles.tolist()


def test_loads_and_start_of_an_arm_reach_the_solver(capsys: pytest.CaptureFixture[str]) -> None:
    arm = small_arm()
    loads = [
        WorldForce(-1, (0, 0, 0), moment=(3, -4, 5)),
        WorldForce(2, (0.1, -0.2, 0.3)),
        BodyWrench(3, (0.2, 0.1, -0.3)),
        Spring(-1, 0.02, (-30, 90, 70)),
        arm.gravity((1, 0, 2)),
    ]
    options = (
        "--moment -1 3 -4 5 --force 2 0.1 -0.2 0.3 --body-force 3 0.2 0.1 -0.3 --spring -1 0.02 -30 90 70 --gravity "
        "--gravity-direction 1 0 2 --start 0.01 0.02 0.03 0.04"
    )
    result = solved(capsys, f"small_arm --tensions 6 3 0 0 {options}")
    expected = solve_tensions(arm, (6, 3, 0, 0), loads, start=[0.01, 0.02, 0.03, 0.04])
    assert [row["angle_rad"] for row in result["joints"]] == expected.joint_angles.tolist()
    assert result["iterations"] == expected.iterations
    result = solved(capsys, "small_arm --lengths 70 80 81 79 --tension-limits 0.5 3")
    expected = solve_lengths(arm, (70, 80, 81, 79), tension_limits=(0.5, 3))
    assert [row["tension_N"] for row in result["tendons"]] == expected.tensions.tolist()


def test_json_of_an_arm_holds_the_numbers_of_the_solver_to_the_last_bit(capsys: pytest.CaptureFixture[str]) -> None:
    arm = small_arm()
    result = solved(capsys, "small_arm --tensions 5 0 0 1 --gravity")
    expected = solve_tensions(arm, (5, 0, 0, 1), [arm.gravity()])
    assert [[row["x_mm"], row["y_mm"], row["z_mm"]] for row in result["links"]] == expected.positions.tolist()
    assert [row["rotation"] for row in result["links"]] == expected.rotations.tolist()
    assert [row["spring_moment_N_mm"] for row in result["joints"]] == (500.0 * expected.joint_angles).tolist()
    assert [row["length_mm"] for row in result["tendons"]] == expected.lengths.tolist()
    assert result["smallest_eigenvalue_N_mm_per_rad"] == expected.smallest_eigenvalue
    assert result["escapes"] == 0


def test_an_arm_that_has_buckled_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert rj("solve flexible_arm --tensions 1 1 1 1 1 1 1 1 --gravity") == 0
    assert re.search(r"buckled: \d+ escapes\)$", capsys.readouterr().out.rstrip())


def test_a_hanging_arm_is_drawn_hanging(workplace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = []
    monkeypatch.setattr("rollingjoint.plotting.figure.save_figure", lambda figure, path: drawn.append(figure.axes[0]))
    for options in ("", "--gravity", "--gravity --gravity-direction 0 0 1"):
        assert rj(f"plot small_arm --tensions 1 1 1 1 {options} --out arm.png") == 0
    assert [ax.zaxis_inverted() for ax in drawn] == [False, False, True]


def test_one_weight_stands_for_every_link(capsys: pytest.CaptureFixture[str]) -> None:
    one = solved(capsys, "five_link --tensions 6 3 --gravity 0.2")
    each = solved(capsys, "five_link --tensions 6 3 --gravity 0.2 0.2 0.2 0.2 0.2")
    assert one == each


def test_method_and_tension_limits_reach_the_solver(capsys: pytest.CaptureFixture[str]) -> None:
    result = solved(capsys, "five_link --lengths 86 108 --tension-limits 0.5 3 --method elastic")
    expected = solve_lengths(five_link(), (86, 108), tension_limits=(0.5, 3))
    assert [row["tension_N"] for row in result["tendons"]] == expected.tensions.tolist()
    result = solved(capsys, "five_link --lengths 86 108 --method least_squares")
    expected = solve_lengths(five_link(), (86, 108), method="least_squares")
    assert [row["tension_N"] for row in result["tendons"]] == expected.tensions.tolist()


@pytest.mark.parametrize("number", ["-0.25", "-.25", "-25e-2", "-2.5E-1"])
def test_negative_number_is_no_option_however_it_is_written(number: str, capsys: pytest.CaptureFixture[str]) -> None:
    expected = solve_tensions(five_link(), (6, 3), [WorldForce(-1, (-0.25, -0.25))])
    result = solved(capsys, f"five_link --tensions 6 3 --force -1 {number} {number}")
    assert [row["angle_rad"] for row in result["joints"]] == expected.joint_angles.tolist()


def test_friction_changes_the_slip_margin(capsys: pytest.CaptureFixture[str]) -> None:
    command = "five_link --tensions 6 3 --force -1 0.5 0 --friction 0"
    for joint in solved(capsys, command)["joints"]:
        assert joint["slip_margin_N"] == -abs(joint["tangential_N"])


@pytest.mark.parametrize(
    ("command", "status"),
    [
        ("solve five_link --tensions 0 0", Status.INDETERMINATE),
        ("solve five_link --tensions 1e12 1e12", Status.NOT_CONVERGED),
    ],
)
def test_unusable_result_exits_with_3_and_names_the_status(
    command: str, status: Status, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rj(command) == 3
    assert capsys.readouterr().out.splitlines()[-1].startswith(f"{status.name}: {status.message}")
    assert rj(f"{command} --json") == 3
    result = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert (result["status"], result["usable"]) == (status.name, False)


def test_plot_of_an_unusable_result_is_drawn_and_exits_with_3(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rj("plot five_link --tensions 0 0 --out bad.png") == 3
    assert (workplace / "bad.png").exists()
    assert "INDETERMINATE" in capsys.readouterr().err


def test_a_loop_as_json_and_csv_holds_its_figures_and_every_step(capsys: pytest.CaptureFixture[str]) -> None:
    command = "loop five_link --friction 0.1 0.2 --presliding 0.05 --steps 8 --cycles 1 --force -1 0.2 0.1 --swing -4 4"
    assert rj(f"{command} --json") == 0
    found = json.loads(capsys.readouterr().out)
    chain = five_link().replace(friction=CapstanFriction(0.2, presliding=0.05))
    expected = trace_loop(chain, (-4, 4), loads=[WorldForce(-1, (0.2, 0.1))], steps=8, cycles=1)
    assert [(loop["friction"], loop["presliding_mm"]) for loop in found["loops"]] == [
        ([0.1, 0.1], [0.05, 0.05]),
        ([0.2, 0.2], [0.05, 0.05]),
    ]
    loop = found["loops"][1]
    assert (found["usable"], found["swing_mm"], loop["width_mm"]) == (True, [-4, 4], expected.width)
    assert loop["path"]["tip_mm"] == expected.path.tip.tolist()
    assert rj(f"{command} --csv") == 0
    head, *lines = (line.split(",") for line in capsys.readouterr().out.splitlines())
    assert len(lines) == 2 * len(expected.shares)
    rows = [dict(zip(head, map(float, line), strict=True)) for line in lines if line[0] == "0.2"]
    assert [(row["x_mm"], row["y_mm"]) for row in rows] == list(map(tuple, expected.path.tip.tolist()))
    assert [row["tension_1_N"] for row in rows] == expected.path.tensions[:, 1].tolist()
    assert [row["sticking_holes"] for row in rows] == expected.path.sticking.sum(axis=(1, 2)).tolist()


def test_a_loop_has_the_friction_of_its_mechanism_unless_another_is_given(
    workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = CapstanFriction(0.02, presliding=0.1, extra_turn=0.3)
    chain = five_link()
    tendons = [chain.tendons[0], dataclasses.replace(chain.tendons[1], friction=own)]
    text = dump_mechanism(chain.replace(tendons=tendons, friction=CapstanFriction(0.1)))
    (workplace / "rubbed.yaml").write_text(text, encoding="utf-8")
    for option, friction, presliding in (("", [0.1, 0.02], [0.02, 0.1]), ("--friction 0.2", [0.2, 0.2], [0.02, 0.1])):
        assert rj(f"loop rubbed.yaml {option} --steps 2 --json") == 0
        [loop] = json.loads(capsys.readouterr().out)["loops"]
        assert (loop["friction"], loop["presliding_mm"]) == (friction, presliding)
    assert rj("loop rubbed.yaml --steps 2") == 0
    assert capsys.readouterr().out.splitlines()[1].startswith("0.1, 0.02 ")


def test_a_loop_with_unusable_steps_exits_with_3_and_names_the_first(capsys: pytest.CaptureFixture[str]) -> None:
    assert rj("loop five_link --friction 0.1 --lengths 140 140 --swing 3 -3 --steps 4 --json") == 3
    output = capsys.readouterr()
    assert json.loads(output.out, parse_constant=pytest.fail)["usable"] is False
    assert "steps are no stable equilibria; step 0 is INDETERMINATE" in output.err


def test_check_goes_on_after_a_wrong_file(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (workplace / "wrong.yaml").write_text("links: 3\ntendons: []\n", encoding="utf-8")
    assert rj("check wrong.yaml configs/mechanism/five_link.yaml") == 2
    output = capsys.readouterr()
    assert "wrong.yaml: links = 3" in output.err
    assert "configs/mechanism/five_link.yaml: ok: 5 links" in output.out


@pytest.mark.slow
def test_warmup_says_where_the_kernels_are(capsys: pytest.CaptureFixture[str]) -> None:
    assert rj("warmup") == 0
    capsys.readouterr()
    assert rj("warmup") == 0
    printed = capsys.readouterr().out
    assert printed.startswith("all kernels are there, kept in ")
    kept = Path(printed.split("kept in ")[1].strip())
    for kernels in ("batch.solve_lanes", "hinge_lanes.solve_hinges_pinned"):
        assert any(kept.glob(f"{kernels}-*.nbc")), kernels


def test_check_prints_lengths_that_solve_takes_back_to_the_pose_at_rest(capsys: pytest.CaptureFixture[str]) -> None:
    assert rj("check five_link uniform") == 0
    line = capsys.readouterr().out.splitlines()[3]
    assert line.startswith("uniform: neutral_lengths [mm]: ")
    lengths = [float(word) for word in line.rpartition(": ")[2].split()]
    np.testing.assert_allclose(lengths, PRESETS["uniform"]().neutral_lengths, atol=1e-4)
    at_rest = solved(capsys, f"uniform --lengths {lengths[0] - 1} {lengths[1] - 1}")
    assert max(abs(joint["arc_length_mm"]) for joint in at_rest["joints"]) < 1e-6


def test_far_too_short_lengths_are_noted_with_the_neutral_and_the_shortest(capsys: pytest.CaptureFixture[str]) -> None:
    assert rj("solve two_segment --lengths 30 32 50 54") == 0
    output = capsys.readouterr()
    assert output.err.startswith("rj solve: note: lengths far too short: in equilibrium tendons 0, 1, 2, 3 are 25.6, ")
    assert "no real tendon stretches so far; neutral_lengths [mm]: 56.0 56.0 103.2 103.2, " in output.err
    assert output.err.endswith("shortest within the joints' limits: 44.1 44.1 92.5 92.5\n")
    assert output.err.count("\n") == 1 and "note" not in output.out


@pytest.mark.parametrize(
    ("command", "noted", "stretched"),
    [
        ("solve uniform --lengths 77 77", True, True),  # each is possible, both together are not
        ("solve uniform --lengths 77 77 --tension-limits 0 5", True, False),
        ("solve uniform --lengths 77 77 --method least_squares", True, False),
        ("loop five_link --friction 0.1 --lengths 70 80 --steps 2", True, True),
        ("loop five_link --friction 0.1 --steps 2", False, False),
        ("solve five_link --lengths 83 110", False, False),
        ("solve five_link --lengths 89.84 99.64", False, False),
        ("solve small_arm --lengths 70 80 90 80", False, False),
    ],
)
def test_only_lengths_that_are_far_too_short_are_noted(
    command: str, noted: bool, stretched: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rj(command) == 0
    note = capsys.readouterr().err
    assert ("note: lengths far too short" in note, "no real tendon" in note) == (noted, stretched)


@pytest.mark.slow
@pytest.mark.parametrize("module", ["rollingjoint", "rollingjoint.cli"])
def test_the_package_run_as_a_module_is_rj(module: str, run_python: Callable[..., str]) -> None:
    assert run_python("-m", module, "mechanisms").split()[0] == next(iter(PRESETS))


def test_mechanisms_gives_one_line_per_preset(capsys: pytest.CaptureFixture[str]) -> None:
    assert rj("mechanisms") == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(PRESETS)


def test_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert rj("--version") == 0
    assert re.fullmatch(r"rj \d+\.\d+\.\d+\S*\n", capsys.readouterr().out)


@pytest.mark.slow
def test_closed_pipe_ends_quietly() -> None:
    """The reader closes at once, as `rj mechanisms | true` does."""
    script = "import sys; from rollingjoint.cli import main; sys.stdin.read(); sys.exit(main(['mechanisms']))"
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stdin is not None
    assert process.stderr is not None
    process.stdout.close()
    process.stdin.close()
    assert process.stderr.read() == b""
    process.stderr.close()
    assert process.wait() == 0


@pytest.mark.slow
@pytest.mark.posix
@pytest.mark.parametrize("command", ["mechanisms", "--help", "solve five_link --tensions 1 1", "train --list"])
def test_a_command_ends_without_a_word_when_its_reader_has_gone(command: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    run = [sys.executable, "-m", "rollingjoint", *command.split()]
    done = subprocess.run(run, cwd=ROOT, stdout=writing, stderr=subprocess.PIPE, text=True, timeout=120)
    os.close(writing)
    assert (done.stderr, done.returncode) == ("", 0)


def test_teeth_of_a_picture_carry_what_this_friction_leaves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(matplotlib.rcParams, "svg.fonttype", "none")
    command = "plot pitch_yaw --tensions 4 1 2 3 --force -1 0.3 0.2 0"
    for friction, drawn in ((0.01, True), (0.3, False)):
        picture = tmp_path / f"{friction}.svg"
        assert rj(f"{command} --friction {friction} --out {picture}") == 0
        assert ("teeth beside friction of 0.01" in picture.read_text("utf-8")) is drawn
