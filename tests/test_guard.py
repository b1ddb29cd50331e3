"""The guard compares two checkouts: equal ones pass, and whatever differs is named with both values and fails."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
QUICK = ["--quick", "--users-cache"]


@pytest.fixture(autouse=True)
def benchmarks_on_the_path(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))


def record(values, rule=None, row="row", unsteady=None):
    from guard_rows.record import Record

    made = Record(row, rule)
    made.add("case", {"field": values})
    made.unsteady = {} if unsteady is None else {"case": np.array(unsteady)}
    return made


def differences(old, new, rule=None, unsteady=None):
    from guard_rows.compare import compare

    return compare("row", record(old, rule, unsteady=unsteady), record(new, rule)).differences


def listed(tmp_path, text):
    from guard_rows.compare import Allowances

    path = tmp_path / "allowed.yaml"
    path.write_text(text, "utf-8")
    return Allowances(path)


def changed(tmp_path, file, old, new):
    """A checkout in which one text of rollingjoint is another one."""
    folder = tmp_path / "changed"
    shutil.copytree(ROOT / "rollingjoint", folder / "rollingjoint", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("rj_gym", "agents", "configs", "docs", "README.md"):
        (folder / name).symlink_to(ROOT / name)
    path = folder / "rollingjoint" / file
    text = path.read_text("utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), "utf-8")
    return folder


@pytest.mark.slow(minutes=1)
def test_a_checkout_equals_itself_in_every_section(tmp_path, capsys):
    import guard

    report = tmp_path / "report.md"
    assert guard.main(["--before", str(ROOT), "--out", str(report), *QUICK]) == 0
    assert capsys.readouterr().out.endswith("rows, none differs\n")
    text = report.read_text("utf-8")
    rows = ("planar, friction: path", "arm, loads: batch", "rj_gym/LatePose-v0: episodes", "shipped policies: means")
    rows += ("rollingjoint.__all__", "options of the commands", "mechanism files", "speed: chain of 200 links")
    rows += ("startup: first solve, empty cache",)
    assert [row for row in rows if f"\n| {row} | " not in text] == []


@pytest.mark.slow  # two processes import everything, and solve
@pytest.mark.parametrize("listing", ["", "- {row: 'arm, plain: alone', field: tip, old: 0, new: 1, reason: gone}"])
def test_a_last_bit_of_one_property_fails_in_the_rows_that_read_it(listing, tmp_path, capsys):
    import guard

    there = "self.poses[..., :2]"
    other = changed(tmp_path, "chain/equilibrium.py", f"return {there}\n", f"return np.nextafter({there}, 1e9)\n")
    allowed = tmp_path / "allowed.yaml"
    allowed.write_text(listing, "utf-8")
    words = ["--before", str(ROOT), "--after", str(other), "--only", "solves", "--allowed", str(allowed), *QUICK]
    assert guard.main(words) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "DIFFERS  planar, plain: batch " in "\n".join(lines) and not any("arm, " in line for line in lines[:-2])
    (at,) = [k for k, line in enumerate(lines) if line.startswith("DIFFERS  planar, plain: batch  ")]
    assert lines[at + 1].startswith("         tip: ") and "plain, 2 links [0, 0] (144 values, at most" in lines[at + 1]
    assert lines[at + 2].startswith('         asked: {"') and '"loads": []' in lines[at + 2]
    assert any("differs no longer: arm, plain: alone" in line for line in lines) == bool(listing)


@pytest.mark.slow  # two processes import everything
def test_a_lost_name_fails_and_is_named(tmp_path, capsys):
    import guard

    other = changed(tmp_path, "__init__.py", '    "uniform",\n', "")
    assert guard.main(["--before", str(ROOT), "--after", str(other), "--only", "names", *QUICK]) == 1
    out = capsys.readouterr().out
    assert "DIFFERS  rollingjoint.__all__" in out and "kind: function -> (absent) at uniform" in out
    assert "2 of them differ" in out  # the name, and its parameters


def test_numbers_are_equal_to_the_bit_and_nan_equals_nan():
    one = np.array([1.0, np.nan, np.inf, 0.0])
    assert differences(one, one.copy()) == []
    (found,) = differences(one, np.array([np.nextafter(1.0, 2.0), np.nan, np.inf, -0.0]))
    assert (found.where, found.old, found.new, found.count) == ("case [0]", 1.0, 1.0 + 2.0**-52, 2)
    (found,) = differences(np.float64(1.0), np.float64(2.0))
    assert (found.where, found.old, found.new) == ("case", 1.0, 2.0)
    (found,) = differences(one, np.array([1.0, 0.0, np.inf, 0.0]))
    assert found.where == "case [1]" and np.isnan(found.old) and np.isinf(found.largest)


def test_other_types_shapes_texts_and_missing_fields_differ():
    assert str(differences(np.zeros(2), np.zeros(2, np.float32))[0].new) == "float32 (2,)"
    assert str(differences(np.zeros(2), np.zeros(3))[0].new) == "float64 (3,)"
    assert differences(np.array("a text"), np.array("a text")) == []
    (found,) = differences(np.array("a text"), np.array("another text"))
    assert (found.old, found.new) == ("a text", "another text")
    from guard_rows.compare import compare

    lost = record(1.0)
    lost.arrays.clear()
    assert compare("row", record(1.0), lost).differences[0].new == "(absent)"
    assert not compare("row", record(1.0), None).ok and not compare("row", None, record(1.0)).ok


def test_a_rule_admits_its_tolerance_and_leaves_unnamed_fields_out():
    old, new = np.array([100.0, np.nan]), np.array([100.0 + 5e-8, np.nan])
    assert differences(old, new, {"field": (1e-7, 0.0)}) == []
    assert differences(old, new, {"*": (0.0, 1e-9)}) == []
    (found,) = differences(old, new, {"field": (1e-8, 0.0)})
    assert found.largest == pytest.approx(5e-8)
    assert differences(old, new, {"other": (0.0, 0.0)}) == []
    assert differences(old, np.array([np.nan, np.nan]), {"field": (1e-7, 0.0)}) != []


def test_rows_that_last_bits_move_anyway_are_left_out():
    old, new = np.zeros((3, 2)), np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    rule = {"field": (1e-7, 0.0)}
    assert differences(old, new, rule, unsteady=[False, True, False]) == []
    assert differences(old, new, rule, unsteady=[True, False, True])[0].where == "case [1, 0]"


def test_records_come_back_from_their_files(tmp_path):
    from guard_rows.record import read_folder

    made = record(np.array([1.0, np.nan]), {"field": (1e-7, 0.0)}, "a row: with / signs", [True, False])
    made.add("case", {"texts": np.array(["ä", "b"])})
    made.write(tmp_path / "000.npz")
    found = read_folder(tmp_path)["a row: with / signs"]
    assert found.unsteady["case"].tolist() == [True, False] and found.rule == {"field": [1e-7, 0.0]}
    assert found.arrays["case", "texts"].tolist() == ["ä", "b"]
    assert np.array_equal(found.arrays["case", "field"], [1.0, np.nan], equal_nan=True)


@pytest.mark.parametrize(
    ("entry", "ok"),
    [
        ("old: 1, new: 2", True),
        ("old: 1.0000000001, new: 2", True),  # the last bits of another machine
        ("old: 3, new: 2", False),
        ("old: 1, new: 3", False),
        ("old: 1, tolerance: 1", True),
        ("old: 1, tolerance: 0.5", False),
    ],
)
def test_a_difference_is_allowed_by_its_old_value_and_what_became_of_it(entry, ok, tmp_path):
    from guard_rows.compare import compare

    allowed = listed(tmp_path, f"- {{row: row, field: field, reason: why, {entry}}}")
    result = compare("row", record([1.0, 1.0]), record([2.0, 1.0]))
    allowed.apply(result)
    assert result.ok == ok and allowed.unused({"other row"}) == []
    assert allowed.unused({"row"}) == ([] if ok else ["row: field (why)"])


def test_an_entry_covers_no_more_values_than_it_counts(tmp_path):
    from guard_rows.compare import compare

    for count, ok in ((1, False), (2, True)):
        allowed = listed(tmp_path, f"- {{row: row, field: field, old: 1, new: 2, count: {count}, reason: why}}")
        result = compare("row", record([1.0, 1.0]), record([2.0, 5.0]))
        allowed.apply(result)
        assert result.ok == ok


def test_an_entry_without_old_value_or_reason_is_refused(tmp_path):
    for entry in ("field: f, new: 2, reason: why", "field: f, old: 1, new: 2", "field: f, old: 1, reason: why"):
        with pytest.raises(SystemExit, match=r"entry 1 = .*expected the keys row, field, reason, old"):
            listed(tmp_path, f"- {{row: row, {entry}}}")


def test_a_timing_fails_where_the_lower_end_of_its_interval_is_above_the_limit(tmp_path):
    from guard_rows.timings import judged

    rng, none = np.random.default_rng(0), listed(tmp_path, "")
    noise = rng.normal(1.0, 0.05, 15)
    assert judged("speed: solve", [(1.0, 1.02 * x) for x in noise], 1.03, none).ok
    slower = [(1.0, 1.2 * x) for x in noise]
    result = judged("speed: solve", slower, 1.03, none)
    assert not result.ok and "limit 1.03" in result.figure
    allowed = listed(tmp_path, "- {row: 'speed: solve', limit: 1.25, reason: checks}")
    assert judged("speed: solve", slower, 1.03, allowed).ok and allowed.unused({"speed: solve"}) == []


def test_pairs_take_turns_in_going_first():
    from guard_rows.timings import in_pairs

    order = []
    measures = [lambda name=name: order.append(name) or name for name in "AB"]
    assert in_pairs(3, measures) == [("A", "B")] * 3
    assert "".join(order) == "ABBAAB"


def test_of_a_warm_up_only_groups_that_the_older_checkout_has_are_what_exists():
    from guard_rows.timings import _of_common_groups

    before = 10.0, "compiling a\ncompiled a in 2.0 s\ncompiled b in 4.0 s\n"
    after = 12.0, "compiled a in 2.0 s\ncompiled b in 4.0 s\ncompiled new in 2.0 s\n"
    assert _of_common_groups(before, after) == (10.0, 9.0)


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a git checkout")
def test_a_revision_is_checked_out_for_as_long_as_it_is_needed(tmp_path):
    from guard_rows.checkout import checked_out

    def trees():
        return subprocess.run(["git", "worktree", "list"], cwd=ROOT, capture_output=True, text=True).stdout

    with checked_out("before", "HEAD", tmp_path) as folder:
        assert (folder / "rollingjoint" / "__init__.py").is_file() and str(folder) in trees()
    assert not folder.exists() and str(folder) not in trees()
    with pytest.raises(SystemExit, match="--before = 'no_such': expected a checkout's folder or a git revision"):
        checked_out("before", "no_such", tmp_path).__enter__()


def test_packages_of_the_checkout_come_before_those_of_the_environment(tmp_path):
    from guard_rows.checkout import Checkout

    (tmp_path / "rollingjoint").mkdir()
    (tmp_path / "rollingjoint" / "__init__.py").write_text("print('mine')", "utf-8")
    process = Checkout("after", tmp_path).start("-c", "import rollingjoint", stdout=subprocess.PIPE)
    assert process.communicate()[0] == "mine\n"


def test_the_inputs_of_a_case_are_found_by_its_name():
    import json

    from guard_rows.drawing import QUICK as SIZES
    from guard_rows.drawing import inputs_of, planar_cases

    (case,) = planar_cases("friction", (5,))
    for name, row in ((case.name, 3), (f"{case.name}, step 1", 8 + 3), (f"{case.name}, row 1", 1 + 3)):
        found = json.loads(inputs_of(name, 3, SIZES))
        assert found["mechanism"] == case.mechanism and found[case.given] == case.inputs[row].tolist()
    assert "beads" in json.loads(inputs_of("hanging, arm 0 of 32 beads", 0, SIZES))["mechanism"]
    assert inputs_of("five_link", 0, SIZES) == ""


def test_drawn_inputs_are_the_same_in_every_process():
    from guard_rows.drawing import ARM_KINDS, KINDS, arm_cases, planar_cases

    for kind in KINDS:
        for one, other in zip(planar_cases(kind, (2, 40)), planar_cases(kind, (2, 40)), strict=True):
            assert np.array_equal(one.inputs, other.inputs, equal_nan=True)
            assert (one.mechanism, one.loads, one.size) == (other.mechanism, other.loads, int(one.name.split()[-2]))
    assert next(arm_cases(ARM_KINDS[0], 1)).size == 32
