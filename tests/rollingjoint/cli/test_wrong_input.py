"""What the command `rj` refuses: one line that names the value, and exit code 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.rollingjoint.command import rj


@pytest.mark.parametrize(
    ("command", "parts"),
    [
        ("", ["COMMAND"]),
        ("solv five_link", ["'solv'", "'solve'"]),
        ("solve five_lnik --tensions 1 1", ["'five_lnik'", "Did you mean 'five_link'?"]),
        ("solve missing.yaml --tensions 1 1", ["missing.yaml", "path of a YAML file"]),
        ("solve five_link", ["--tensions --lengths is required"]),
        ("solve five_link --tensions 1 1 --lengths 9 9", ["not allowed with"]),
        ("solve five_link --tensions 1 x", ["--tensions", "'x'"]),
        ("solve five_link --tensions 1", ["--tensions = [1.0]", "2 numbers"]),
        ("solve five_link --lengths 1 2 3", ["--lengths", "2 numbers"]),
        ("solve five_link --tensions 1 1 --force -1 1", ["--force = [-1.0, 1.0]", "LINK FX FY for"]),
        ("solve small_arm --tensions 1 1 1 1 --force -1 1 0", ["--force = [-1.0, 1.0, 0.0]", "LINK FX FY FZ"]),
        ("solve small_arm --tensions 1 1 1 1 --moment -1 1", ["--moment", "LINK MX MY MZ"]),
        ("solve small_arm --tensions 1 1 1 1 --moment 5 1 0 0", ["--moment LINK = 5.0", "0 (base) to 4"]),
        ("solve small_arm --tensions 1 1 1 1 --spring -1 1 0 0", ["--spring", "LINK K AX AY AZ"]),
        ("solve small_arm --tensions 1 1 1 1 --gravity 0.1", ["--gravity = [0.1]", "weights of their own"]),
        ("solve small_arm --tensions 1 1 1 1 --gravity --gravity-direction 0 -1", ["--gravity-direction", "3 numbers"]),
        ("solve small_arm --tensions 1 1 1 1 --gravity --gravity-direction 0 0 0", ["direction"]),
        ("solve small_arm --tensions 1 1 1 1 --friction 0.2", ["--friction = 0.2", "a chain of links that roll"]),
        ("solve small_arm --tensions 1 1 1 1 --start 0 0", ["--start", "4 numbers"]),
        ("solve small_arm --lengths 80 80 80 80 --method least_squares --tension-limits -1 2", ["LO = -1.0", "0 to"]),
        ("solve five_link --tensions 1 1 --gravity", ["--gravity = []", "5, one per link"]),
        ("export small_arm --out parts --format svg", ["formats = ['svg']", "stl", "arms"]),
        ("plot small_arm --gravity --out a.png", ["--gravity", "--tensions or --lengths"]),
        ("plot five_link --start 0 0 0 0 --out a.png", ["--start", "--tensions or --lengths"]),
        ("solve five_link --tensions 1 1 --force 5 1 0", ["--force LINK = 5.0", "0 (base) to 4"]),
        ("solve five_link --tensions 1 1 --moment 1.5 1", ["--moment LINK = 1.5"]),
        ("solve five_link --tensions 1 1 --gravity 1 2", ["--gravity", "5, one per link"]),
        ("solve five_link --tensions 1 1 --gravity 1 --gravity-direction 0 0", ["direction"]),
        ("solve five_link --tensions 1 1 --start 0 0", ["--start", "4 numbers"]),
        ("solve five_link --tensions 1 1 --start 0 0 0 99", ["99", "limits"]),
        ("solve five_link --tensions 1 1 --method elastic", ["--method", "only beside --lengths"]),
        (
            "solve five_link --tensions 1 1 --tension-limits 0 9",
            ["--tension-limits", "only beside --lengths"],
        ),
        ("solve five_link --lengths 1 1 --method fast", ["'fast'", "'elastic'"]),
        ("solve five_link --tensions 1 1 --friction -1", ["--friction = -1.0", "from 0 to 100"]),
        ("solve five_link --tensions 1 1 --friction 1e308 --json", ["--friction = 1e+308"]),
        ("solve five_link --tensions 1 1 --gravity-direction 1 0", ["--gravity-direction", "--gravity beside it"]),
        ("solve five_link --tensions 1 1 --plot no/such.png", ["no/such.png", "existing folder"]),
        ("solve five_link --tensions 1 1 --plot bend.doc", ["bend.doc", ".png"]),
        ("plot five_link", ["--out"]),
        ("plot five_link --out bend", ["'bend'", ".png"]),
        ("plot five_link --force -1 1 0 --out a.png", ["--force", "--tensions or --lengths"]),
        ("plot five_link --tensions 1 1 --friction 0.2 --out a.png", ["--friction = 0.2", "rolling joints in space"]),
        ("plot pitch_yaw --friction 0.2 --out a.png", ["--friction = 0.2", "in equilibrium"]),
        ("evaluat runs/a", ["'evaluat'", "adapt, camera, campaign, check", "Did you mean 'evaluate'?"]),
        ("reach five_link --tip 1", ["--tip = [1.0]", "2 numbers x, y", "or 3 with the angle"]),
        ("reach small_arm --tip 1 2", ["--tip = [1.0, 2.0]", "3 numbers"]),
        ("reach five_link --tip nan 2", ["--tip number 0 = nan"]),
        ("check missing.yaml", ["missing.yaml"]),
        ("loop five_link", ["--friction", "five_link has no friction", "--friction 0.1"]),
        ("loop five_link --friction 0.3", ["friction mu = 0.3", "0 to 0.25"]),
        ("loop five_link --friction 0.1 --presliding 0.001", ["friction presliding = 0.001", "0.01 to 10"]),
        ("loop five_link --friction 0.1 --swing 5", ["--swing = [5.0]", "2 numbers"]),
        ("loop five_link --friction 0.1 --lengths 90", ["--lengths = [90.0]", "2 numbers"]),
        ("loop five_link --friction 0.1 --tensions 2 2", ["--swing", "2 numbers, one per tendon"]),
        ("loop five_link --friction 0.1 --tensions 2 2 --swing 1 -1 --tension-limits 0 9", ["only with lengths"]),
        ("loop five_link --friction 0.1 --lengths 90 99 --tensions 2 2", ["not allowed with"]),
        ("loop five_link --friction 0.1 --lengths nan 99", ["--lengths of tendon 0 = nan", "from 0 to 1e+12"]),
        ("loop five_link --friction 0.1 --json --csv", ["not allowed with"]),
        ("loop five_link --friction 0.1 --steps 0", ["steps = 0", "from 1 to 25000"]),
        ("loop five_link --friction 0.1 --force 7 1 0", ["--force LINK = 7.0"]),
        ("loop five_link --friction 0.1 --steps 1000000000", ["steps = 1000000000", "from 1 to 25000"]),
        ("loop five_link --friction 0.1 --cycles 1000000000", ["cycles = 1000000000", "from 1 to 125"]),
        ("loop five_link --friction 0.1 0.2 --steps 10000", ["coefficients x cycles x steps = 40000", "25,000"]),
        ("loop five_link --friction 0.1 --swing inf 1", ["--swing of tendon 0 = inf", "-1e+12 to 1e+12"]),
        ("loop five_link --friction 0.1 --tensions -2 2 --swing 1 -1", ["--tensions of tendon 0 = -2.0", "from 0"]),
        ("loop five_link --friction 0.1 --tensions 1 2 --swing 1 -3", ["--swing of tendon 1 = -3.0", "from -2 to 2"]),
        ("loop five_link --friction 0.1 --tension-limits nan 1", ["--tension-limits LO = nan", "from 0"]),
        ("solve two_segment --tensions 3 1 1 -2", ["--tensions of tendon 3 = -2.0", "from 0 to 1e+12"]),
        ("solve two_segment --tensions 3 1 1 -2 --json", ["--tensions of tendon 3 = -2.0"]),
        ("solve five_link --tensions nan 1", ["--tensions of tendon 0 = nan"]),
        ("solve five_link --tensions 1 2e12", ["--tensions of tendon 1 = 2000000000000.0", "to 1e+12"]),
        ("solve five_link --lengths inf 1", ["--lengths of tendon 0 = inf"]),
        ("solve five_link --lengths -90 1", ["--lengths of tendon 0 = -90.0", "from 0 to 1e+12"]),
        ("solve five_link --lengths 90 99 --tension-limits -1 9", ["--tension-limits LO = -1.0", "from 0"]),
        ("solve five_link --lengths 90 99 --tension-limits 9 1", ["--tension-limits HI = 1.0", "from LO = 9"]),
        (
            "solve five_link --lengths 90 99 --tension-limits 2000 inf --method least_squares",
            ["--tension-limits LO = 2000.0", "from 0 to 1000"],
        ),
        ("solve five_link --tensions 1 1 --force -1 inf 0", ["--force FX = inf"]),
        ("solve five_link --tensions 1 1 --moment -1 1e13", ["--moment M = 10000000000000.0"]),
        ("solve five_link --tensions 1 1 --spring -1 -2 0 0", ["--spring K = -2.0", "from 0 to 1e+12"]),
        ("solve five_link --tensions 1 1 --torsion-spring 2 -1", ["--torsion-spring K = -1.0", "from 0 to 1e+12"]),
        ("solve five_link --tensions 1 1 --gravity nan", ["--gravity of link 0 = nan"]),
        (
            "solve five_link --tensions 1 1 --gravity 1 --gravity-direction 1 nan",
            ["--gravity-direction number 1 = nan"],
        ),
        ("solve five_link --tensions 1 1 --start 0 nan 0 0", ["--start of joint 1 = nan"]),
        ("solve small_arm --tensions 1 1 1 1 --force -1 1 nan 0", ["--force FY = nan"]),
        ("plot five_link --tensions 1 1 --force -1 nan 0 --out bad.png", ["--force FX = nan"]),
        ("export five_link --tensions -1 1 --out parts", ["--tensions of tendon 0 = -1.0"]),
        ("solve five_link --tensions 1 1" + 2001 * " --force -1 0 0", ["number of options = 2002", "at most 2,000"]),
        ("loop two_segment --friction 0.1", ["--swing", "4 numbers, one per tendon"]),
        ("loop five_link --friction 0.1 0.2 --plot both.gif", ["--friction", "one number beside a .gif"]),
        ("loop five_link --friction 0.1 --plot loop.doc", ["loop.doc", ".gif", ".png"]),
    ],
)
def test_wrong_input_exits_with_2_and_one_clear_line(
    command: str, parts: list[str], workplace: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rj(command) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert output.err.startswith("rj")
    assert all(part in output.err for part in parts), output.err
