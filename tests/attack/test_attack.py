"""The attack itself: it notices what is wrong, keeps what it finds, adds up what it has done; a few seconds of it."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from rollingjoint import (
    CapstanFriction,
    Sleeve,
    Sphere,
    Status,
    Surroundings,
    five_link,
    pitch_yaw,
    small_arm,
    solve_lengths,
)
from rollingjoint.chain.random_chain import HARD_KINDS
from tests.attack import __main__ as command
from tests.attack import environments, found, inputs, ledger, minima, signals, solves, walls, walls_in_space
from tests.attack.around_space import Recomputed
from tests.pages import rows

ROWS = 64


@pytest.fixture
def report(monkeypatch, tmp_path):
    monkeypatch.setattr(found, "FOLDER", tmp_path / "found")
    return ledger.Report("solves", 1)


def a_case(mechanism, given="tensions"):
    rng = np.random.default_rng(0)
    inputs = solves.drawing.draw_inputs(rng, mechanism, given, ROWS)
    planar = mechanism.name == "five_link"
    tables = np.zeros((ROWS, 1, 14 if planar else 23))
    tables[:, 0, 0], tables[:, 0, 3 if planar else 4] = 1, 0.2
    starts = np.repeat(mechanism.neutral_angles[None], ROWS, axis=0)
    return solves.Case(mechanism, given, inputs, tables, starts, (0.0, np.inf))


@pytest.mark.parametrize("mechanism", [five_link(), small_arm(), pitch_yaw(5)], ids=lambda chain: chain.name)
@pytest.mark.parametrize(
    ("field", "change", "name"),
    [
        ("poses", 1e-5, "poses"),
        ("lengths", 1e-5, "lengths"),
        ("tensions", 1e-3, "balance"),
        ("joint_angles", 1e-6, "balance"),
    ],
)
def test_numbers_that_are_wrong_are_noticed(mechanism, field, change, name):
    case, invalid = a_case(mechanism), np.zeros(ROWS, bool)
    result = case.solve()
    faults, checked = case.faults(result, invalid)
    assert not faults and checked > ROWS // 2
    wrong = replace(result, **{field: getattr(result, field) * (1.0 + change) + change})
    assert name in case.faults(wrong, invalid)[0]


@pytest.mark.parametrize("component", range(6))
def test_a_reaction_that_is_wrong_is_noticed(component):
    case, invalid = a_case(pitch_yaw(5)), np.zeros(ROWS, bool)
    result = case.solve()
    reactions = np.array(result.reactions)
    reactions[..., component] += 1e-3
    assert "balance of links" in case.faults(replace(result, reactions=reactions), invalid)[0]


@pytest.mark.parametrize("mechanism", [five_link(), pitch_yaw(5)], ids=lambda chain: chain.name)
def test_friction_with_another_history_is_noticed(mechanism):
    case = a_case(mechanism.replace(friction=CapstanFriction(0.1, 0.05, rolling=0.1)), "lengths")
    begin = case.solve()
    case.before, case.starts = begin.friction_state, np.array(begin.joint_angles)
    case.inputs = case.inputs - 0.5
    result, invalid = case.solve(), np.zeros(ROWS, bool)
    assert not case.faults(result, invalid)[0]
    case.before = case.before._replace(states=case.before.states + 0.3)
    assert "gap tensions" in case.faults(result, invalid)[0]


def test_a_status_of_unusable_numbers_is_noticed(report):
    case = a_case(five_link())
    result = case.solve()
    faults, _ = case.faults(result, np.arange(ROWS) == 3)
    assert list(faults["status of unusable numbers"][0]) == [3]


def test_a_counterexample_is_kept_small_and_read_back(report, monkeypatch):
    case = a_case(five_link())
    monkeypatch.setattr(solves, "BALANCE", 1e-30)  # nothing is exact
    report.fail("balance", case=case, rows=[5])
    (path,) = found.FOLDER.iterdir()
    again = found.read_solve(path)
    assert again.inputs.shape == (1, 2) and again.tables.shape[1] == 0
    assert found.fails(again)
    monkeypatch.undo()
    assert not found.fails(again)


def test_an_input_that_is_not_survived_is_kept_small(report, tmp_path):
    path = tmp_path / "mutated.train"
    path.write_bytes(b"much text, in which one x is too much, and more text")

    def read():
        if b"x is" in path.read_bytes():
            raise TypeError("x")

    inputs.tried(report, "YAML of train", read, path=path)
    (kept,) = found.FOLDER.iterdir()
    assert kept.read_bytes() == b"x is"
    assert "TypeError" in report.failures[0]["what"] and "--round 0" in report.failures[0]["again"]


def test_the_page_states_the_counts_of_the_last_long_run():
    root = Path(__file__).parents[2]
    run = json.loads((root / "tests/attack/last_long_run.json").read_text("utf-8"))
    page = (root / "docs/reliability.md").read_text("utf-8")
    stated = rows(page, "## The last long run")[2:]
    assert {name: int(count.replace(",", "")) for name, count in stated if name != "failures"} == {
        name: run["counts"][name] for name, _ in stated if name != "failures"
    }
    assert dict(stated)["failures"] == str(len(run["failures"])) and len(stated) > 12
    assert ", ".join(map(str, run["seeds"])) in page


def test_twins_that_differ_are_noticed(report):
    one, other = (environments._made("rj_gym/RollingJoint-v0", 2, False, "NextStep", {}) for _ in range(2))
    assert environments._same(report, one.reset(seed=1), other.reset(seed=1), "reset")
    action = np.ones((2, 2), np.float32)
    one.step(action)
    assert not environments._same(report, one.step(action), other.step(action), "step")
    assert len(report.failures) == 1


def test_a_crash_is_a_failure_and_counts_add_up(tmp_path, monkeypatch, capsys):
    out = tmp_path / "attack.json"
    slices = [
        {"counts": {"solves recomputed": 10, "rounds: solves": 2}, "failures": []},
        {"counts": {"solves recomputed": 999_995, "rounds: solves": 1}, "failures": []},
    ]
    first = []

    def a_slice(part, seed, begin, seconds):
        first.append(begin)
        return slices.pop(0)

    monkeypatch.setattr(command, "_slice", a_slice)
    arguments = ["--goals", "--parts", "solves", "--seed", "7", "--out", str(out)]
    assert command.main(arguments) == 0
    assert first == [0, 2] and json.loads(out.read_text())["counts"]["solves recomputed"] == 1_000_005
    monkeypatch.setattr(command, "PARTS", {"solves": command.Part(1.0, "solves recomputed", 2_000_000)})
    slices.append({"counts": {}, "failures": [{"part": "solves", "what": "crash", "again": "so"}]})
    slices.append({"counts": {"solves recomputed": 2_000_000}, "failures": []})
    assert command.main(arguments) == 1
    assert first[2] == 3 and "crash" in capsys.readouterr().out


def test_a_worker_that_dies_is_a_failure(monkeypatch):
    killed = SimpleNamespace(wait=lambda seconds: -11, poll=lambda: -11)
    monkeypatch.setattr(command.subprocess, "Popen", lambda *_: killed)
    done = command._slice("solves", 1, 5, 1.0)
    assert "exit code -11" in done["failures"][0]["what"] and "round 5" in done["failures"][0]["what"]


SITE = "Fatal Python error: init_import_site: Failed to import the site module\nTraceback"


def ended(output="", errors="interrupted\n"):
    return SimpleNamespace(output=lambda: output, errors=lambda: errors)


@pytest.mark.parametrize(
    ("started", "code", "seconds", "left", "fault"),
    [
        (ended(), 130, 1.0, [], None),
        (ended("stopped by SIGINT; to go on: so\n", ""), 130, 1.0, [], None),
        (ended(), 130, 6.0, [], "ended late"),
        (ended(), None, 60.0, [], "does not end"),
        (ended(), 2, 1.0, [], "exit code 2"),
        (ended("all done\n", ""), 0, 3.0, [], "exit code 0"),
        (ended(), 130, 1.0, ["7 a worker"], "left running: 7 a worker"),
        (
            ended(errors=f'Traceback\n  File "{signals.ROOT}/agents/tune.py"\ninterrupted\n'),
            130,
            1.0,
            [],
            "a traceback",
        ),
        (ended(errors="interrupted\ninterrupted\n"), 130, 1.0, [], "not one line"),
        (ended(errors=""), 130, 1.0, [], "not one line"),
        (ended(errors='Traceback\n  File "site.py"\nKeyboardInterrupt'), 1, 0.1, [], "Python's"),
        (ended(errors=f'{SITE}\n  File "{signals.ROOT}/.venv/finder.py"'), 1, 0.1, [], "Python's"),
    ],
)
def test_a_bad_end_after_ctrl_c_is_noticed(started, code, seconds, left, fault):
    faults = signals._faults(started, code, seconds, left, 0)
    assert fault in faults[0] if fault else not faults


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
@pytest.mark.parametrize("name", ["rj loop", "campaign", "evaluate, two jobs", "campaign, killed"])
def test_ctrl_c_and_kills_at_a_moment_of_a_command(name, report):
    report.round = signals.ROUND.index(name)
    signals.attack(np.random.default_rng(), report)
    assert report.failures == []
    assert report.counts["signals"] + report.counts["parents killed"] == 1


@pytest.mark.slow
def test_a_few_seconds_of_the_attack(report, monkeypatch):
    monkeypatch.setattr(solves, "ROWS", 256)
    counts = {one: 6 for one in inputs.COUNTS if one is not inputs._run_folder}  # which trains
    monkeypatch.setattr(inputs, "COUNTS", counts)
    for part, rounds in ((solves, 3), (environments, 1), (inputs, 1)):
        for number in range(rounds):
            report.run(part.attack, number)
    assert report.failures == []
    assert report.counts["solves recomputed"] > 500 and report.counts["inputs"] > 24


def test_an_equilibrium_that_only_the_second_solver_finds_is_a_failure(report):
    case, rng = a_case(five_link(), "lengths"), np.random.default_rng(0)
    result = case.solve()
    solves.missed(rng, case, result, report)
    assert report.failures == [] and report.counts["rows with a potential"] == ROWS
    lost = replace(result, status=np.where(np.arange(ROWS) == 7, Status.NOT_CONVERGED, result.status))
    solves.missed(rng, case, lost, report)
    assert "row 7" in report.failures[0]["what"]
    case.tables[7, 0, 5] = 0.3  # a force that turns with its link has no potential
    solves.missed(rng, case, lost, report)
    assert len(report.failures) == 1


@pytest.mark.slow
@pytest.mark.parametrize("mechanism", [five_link(), small_arm(), pitch_yaw(5)], ids=lambda chain: chain.name)
@pytest.mark.parametrize("given", ["tensions", "lengths"])
def test_the_second_solver_ends_where_the_solver_does(mechanism, given):
    case, rng = a_case(mechanism, given), np.random.default_rng(1)
    result, geometry = case.solve(), solves.geometry_of(mechanism)
    for row in np.flatnonzero(result.ok)[:2].tolist():
        at = geometry.coordinates(solves._Rows(result, np.array([row])))[0]
        one = minima.Row(case, geometry, row)
        step = 1e-6 * rng.normal(size=at.shape)
        slope = (one.energy(at + 0.05 + step) - one.energy(at + 0.05 - step)) / 2.0
        assert one.gradient(at + 0.05) @ step == pytest.approx(slope, rel=1e-4, abs=1e-12)
        assert one.balances(at) and not one.balances(at + 0.05)
        best = minima.minimum(rng, case, geometry, row, at + 0.05)
        assert one.balances(best) and one.energy(best) <= one.energy(at) + 1e-7


def test_draws_in_space_bring_rolling_mixed_and_hinged_chains_springs_and_tendons_that_end_early():
    rng, kinds, names = np.random.default_rng(0), set(), set()
    for _ in range(60):
        chain = solves.drawing.draw_space(rng, False)
        kinds.add(frozenset(type(joint).__name__ for joint in chain.joints))
        names |= {chain.name, *(type(spring).__name__ for spring in chain.springs)}
        names |= {"early"} if min(chain.last_links) < chain.n_joints else set()
    assert len(kinds) == 3
    assert names == {"pitch_yaw", "pitch_yaw_two_segment", "space", "Spring", "TorsionSpring", "early"}


def test_hard_draws_bring_every_kind_of_chain(report):
    rng, names = np.random.default_rng(0), set()
    for _ in range(60):
        case = solves.draw_hard(rng)
        names.add(case.mechanism.name)
        assert case.inputs.shape == (solves.HARD_ROWS, case.mechanism.n_tendons)
    assert names == set(HARD_KINDS)


def in_contact():
    """The first case among walls that some rows touch, and its equilibria."""
    for seed in range(20):
        case = next(walls.cases(np.random.default_rng(seed)))
        result = case.solve()
        if (result.walls.normals > 0.0).any():
            return case, result
    raise AssertionError("no walls are touched")


@pytest.mark.slow
@pytest.mark.parametrize(("field", "change"), [("poses", 1e-3), ("tensions", 1e-3), ("joint_angles", 1e-4)])
def test_numbers_that_are_wrong_are_noticed_among_walls(field, change):
    case, result = in_contact()
    assert not case.faults(result, np.zeros(walls.ROWS, bool))[0]
    wrong = replace(result, **{field: getattr(result, field) + change})
    assert case.faults(wrong, np.zeros(walls.ROWS, bool))[0]


@pytest.mark.slow
def test_wall_forces_and_friction_that_are_wrong_are_noticed():
    case, result = in_contact()
    more = replace(result.walls, forces=result.walls.forces * 1.001)
    assert "wall forces" in case.faults(replace(result, walls=more), np.zeros(walls.ROWS, bool))[0]
    slipping = replace(result.walls, states=result.walls.states + 1.01)
    assert "friction cones" in case.faults(replace(result, walls=slipping), np.zeros(walls.ROWS, bool))[0]


@pytest.mark.slow
def test_a_round_among_walls_finds_nothing(report):
    for number in range(3):
        report.run(walls.attack, number)
    assert not report.failures
    assert report.counts["solves in contact"] > 100


def in_contact_in_space():
    """A sphere beside an arm that leans on it, and the equilibrium."""
    arm = small_arm()
    command = arm.neutral_lengths - 2.0 / arm.stiffnesses + np.array([-4.0, -2.0, 4.0, 2.0])
    around = Surroundings([Sphere((19.0, 14.5, 62.0), 8.0, stiffness=2.0)], Sleeve(15.0))
    result = solve_lengths(arm, command, tension_limits=(0.5, 30.0), surroundings=around)
    return Recomputed(arm, around, command, (0.5, 30.0), (0.0, 0.0, 0.0)), result


def test_numbers_that_are_wrong_are_noticed_among_walls_in_space():
    case, result = in_contact_in_space()
    assert result.wall_contacts and not walls_in_space.faults(case, result)
    assert "joint moments" in walls_in_space.faults(case, replace(result, joint_angles=result.joint_angles + 1e-4))
    more = replace(result.walls, forces=result.walls.forces * 1.01)
    assert "wall forces" in walls_in_space.faults(case, replace(result, walls=more))


@pytest.mark.slow
def test_rounds_among_walls_in_space_find_nothing(report):
    for number in range(6):
        report.run(walls_in_space.attack, number)
    assert not report.failures
    assert report.counts["solves in contact in space"] > 3
