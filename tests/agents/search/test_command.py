"""rj search: search files, the command, its report, the page."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from agents.executors import options
from agents.executors.local import InlineExecutor
from agents.search import compare
from agents.search.__main__ import main
from agents.search.config import load_search
from agents.search.folder import SearchRun
from agents.search.methods import METHODS
from agents.search.outcome import Search, median
from agents.search.problem import KINDS, against, check, design_problem
from agents.search.report import CAPTIONS, SearchReport
from rollingjoint import SpatialChain
from rollingjoint.errors import ConfigError
from rollingjoint.io.mechanism_file import load_mechanism

torch.set_num_threads(1)

SHIPPED = sorted(Path("configs/search").glob("*.yaml"))
SMALL = """
space: {knots: 3}
objectives:
  - {kind: lateral_stiffness, tensions: [[5, 5]]}
limits:
  - {kind: tip_rotation, cases: 3, low: 0.1}
  - {kind: tendon_travel, cases: 3, high: reference}
held_out:
  lateral_stiffness: {tensions: [[6, 4]]}
methods:
  random: {batch: 15}
  cma_es: {population: 15}
  gradient: {starts: 5}
  map_elites: {measures: [tip_rotation, tendon_travel], ranges: [[0, 3], [0, 30]], batch: 5, cells: [5, 5]}
budget: 30
seeds: [1, 2]
"""


def written(tmp_path, text):
    path = tmp_path / "small.yaml"
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A small search, finished in this process, in a folder out/small."""
    folder = tmp_path_factory.mktemp("search")
    command = [str(written(folder, SMALL)), "--out", str(folder / "out" / "small"), "--jobs", "1"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(options, "LocalExecutor", lambda jobs: InlineExecutor())
        assert main(command) == 0
    return folder / "out" / "small"


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_searches_can_be_searched(path):
    config = load_search(path)
    problem = design_problem(config)
    reference = problem.space.reference()
    assert np.isfinite(problem.evaluate(reference[None]).cost).all() and set(config.methods) <= set(METHODS)
    assert load_search(path).to_dict() == config.to_dict()


def test_the_scale_reference_is_what_the_reference_has(tmp_path):
    text = SMALL.replace("kind: lateral_stiffness", "kind: lateral_stiffness, scale: reference", 1)
    config = load_search(written(tmp_path, text))
    problem = design_problem(config)
    assert problem.objectives[0].factor * against(config, problem)[0] == pytest.approx(-1.0, abs=1e-12)


def test_there_is_a_shipped_search_for_every_objective():
    configs = [load_search(path) for path in SHIPPED]
    kinds = {item["kind"] for config in configs for item in (*config.objectives, *config.limits)}
    assert kinds == set(KINDS)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("budget: 30", "bugdet: 30", "unknown key = 'bugdet'.*Did you mean 'budget'"),
        ("budget: 30", "budget: 0", "budget = 0: expected an integer >= 1|budget = 0"),
        ("seeds: [1, 2]", "seeds: [1, 1]", "every seed once"),
        ("kind: lateral_stiffness", "kind: lateral_stifness", "Did you mean 'lateral_stiffness'"),
        (
            "tensions: [[5, 5]]",
            "tension: [[5, 5]]",
            r"objectives\[0\].*unknown key = 'tension'.*Did you mean 'tensions'",
        ),
        ("tensions: [[5, 5]]", "tensions: [[-5, 5]]", r"objectives\[0\].*tensions of 0 or more"),
        ("tensions: [[5, 5]]", "weight: -1", r"objectives\[0\]: weight = -1"),
        ("tensions: [[5, 5]]", "weight: reference", r"objectives\[0\].weight = 'reference'"),
        ("knots: 3", "knot: 3", "space: unknown key = 'knot'.*Did you mean 'knots'"),
        ("knots: 3", "knots: 4", "space"),
        ("high: reference", "high: refrence", r"limits\[1\].high = 'refrence'"),
        ("low: 0.1", "low: 9, high: 1", r"limits\[0\]: limit = \(9.0, 1.0\)"),
        ("  random: {batch: 15}", "  randm: {}", "methods: unknown key = 'randm'.*Did you mean 'random'"),
        ("population: 15", "populations: 15", "Did you mean 'population'"),
        ("lateral_stiffness: {tensions: [[6, 4]]}", "lateral_stiffness: {force: -1}", "held_out|force"),
        ("budget: 30", "reference: small_arm", "reference: mechanism = 'small_arm'.*a planar chain.*not an arm"),
        ("budget: 30", "reference: six_link", "reference: mechanism = 'six_link'.*'five_link'"),
    ],
)
def test_what_is_wrong_in_a_search_file_is_named(tmp_path, old, new, message):
    assert old in SMALL
    with pytest.raises(ConfigError, match=message):
        check(load_search(written(tmp_path, SMALL.replace(old, new, 1))))


def test_an_error_is_one_line_and_nothing_is_begun(tmp_path, capsys):
    path = written(tmp_path, SMALL.replace("knots: 3", "knot: 3"))
    assert main([str(path), "--out", str(tmp_path / "out")]) == 2
    assert re.fullmatch(r"error: .*'knots'\?\n", capsys.readouterr().err) and not (tmp_path / "out").exists()


@pytest.mark.slow
def test_every_method_keeps_to_the_same_budget_and_seeds(finished):
    search = Search.read(finished)
    assert list(search.outcomes) == ["random", "cma_es", "gradient", "map_elites"]
    assert all([one.seed for one in some] == [1, 2] for some in search.outcomes.values())
    assert all(len(one.evaluated) == 30 for one in search.all) and not search.left_out


def test_the_reference_sets_the_limit(finished):
    search = Search.read(finished)
    limit = search.problem.limits[1].high
    assert limit == pytest.approx(SearchReport(search).scores[1][2])
    assert all(
        one.evaluated.measured[one.evaluated.feasible, 2].max() <= limit for one in search.all if one.best < np.inf
    )


def test_the_report_says_what_the_runs_hold(finished):
    search, report = Search.read(finished), json.loads((finished / "report.json").read_text())
    costs = [one.best for one in search.outcomes["gradient"]]
    row = next(line for line in (finished / "report.md").read_text().splitlines() if line.startswith("| gradient"))
    assert f"{-median(costs):.4g}" in row
    counts = [one.reached(search.goal) for one in search.outcomes["cma_es"]]
    times = [one.seconds[count - 1] for one, count in zip(search.outcomes["cma_es"], counts, strict=True) if count]
    assert times and any(f"| {time:.1f} |" in (finished / "report.md").read_text() for time in times)
    winner = report["runs"][report["winner"]]
    assert winner["cost"] == min(run["cost"] for run in report["runs"]) == search.winner.best
    assert winner["measured"][0] == pytest.approx(-winner["cost"]) and winner["held_out"][0] != winner["measured"][0]
    assert report["goal"] == median([one.best for one in search.outcomes["cma_es"]])


def test_verdicts_follow_from_the_numbers(finished):
    search, report = Search.read(finished), SearchReport(Search.read(finished))
    ours, theirs = -search.winner.best, report.scores[1][0]
    share = 100 * abs(ours - theirs) / theirs
    assert f"beats five_link by {share:.0f} %: lateral stiffness {ours:.4g} N/mm" in report.verdicts()[0]
    reached = [one.reached(search.goal) for one in search.outcomes["gradient"]]
    known = [count for count in reached if count is not None]
    said = next(verdict for verdict in report.verdicts() if verdict.startswith("Gradient"))
    expected = {
        0: "with any seed",
        1: f"after {min(known, default=0)} at best",
        2: f"after {max(known, default=0)} (median",
    }
    assert expected[len(known)] in said


@pytest.mark.parametrize("chosen", ["", " --methods cma_es sqp", " --methods sqp --jobs 1"])
def test_the_command_of_a_report_runs_all_methods(finished, tmp_path, chosen):
    again = tmp_path / "again"
    shutil.copytree(finished, again)
    for path in again.glob("*/*/command.txt"):
        path.write_text(f"python -m agents.search 'a b.yaml'{chosen}\n")
    rest = " --jobs 1" if "--jobs" in chosen else ""
    assert Search.read(again).command == f"python -m agents.search 'a b.yaml'{rest}"


def test_the_best_design_is_a_mechanism_file(finished):
    search = Search.read(finished)
    mechanism = load_mechanism(finished / "best.yaml")
    assert np.allclose(search.problem.space.vector(mechanism), search.winner.best_x, atol=1e-9)


def test_finished_runs_stay_and_a_changed_search_is_refused(finished, tmp_path, capsys, no_pictures):
    config = finished.parent.parent / "small.yaml"
    before = {path: path.stat().st_mtime_ns for path in finished.glob("*/*/evaluations.jsonl")}
    assert main([str(config), "--out", str(finished), "--jobs", "1", "--methods", "random"]) == 0
    assert main([str(written(tmp_path, SMALL.replace("0.1", "0.2"))), "--out", str(finished)]) == 2
    assert "--force replaces the runs" in capsys.readouterr().err
    assert before == {path: path.stat().st_mtime_ns for path in finished.glob("*/*/evaluations.jsonl")}


@pytest.mark.slow
def test_the_page_is_rebuilt_from_the_folders_alone(finished, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"# Title\n\n{compare.BEGIN}\nold\n{compare.END}\n\nLast words.\n")
    assert compare.main([str(finished), "--page", str(page)]) == 0
    text = page.read_text()
    assert text.startswith("# Title") and text.endswith("Last words.\n") and "old" not in text
    pictures = re.findall(r"\]\((images/.*?)\)", text)
    assert len(pictures) == len(CAPTIONS) - 1 and all((tmp_path / picture).is_file() for picture in pictures)


def test_a_page_without_its_marks_is_left_alone(finished, tmp_path, capsys):
    page = tmp_path / "page.md"
    page.write_text("# Title\n")
    assert compare.main([str(finished), "--page", str(page)]) == 2
    assert page.read_text() == "# Title\n" and "expected a page with the lines" in capsys.readouterr().err


def test_unfinished_runs_are_left_out_and_named(finished, tmp_path):
    copy = tmp_path / "small"
    shutil.copytree(finished, copy)
    journal = SearchRun(copy / "random" / "seed_2").journal
    journal.write_bytes(journal.read_bytes().split(b"\n")[0] + b"\n")
    search = Search.read(copy)
    assert [path.name for path in search.left_out] == ["seed_2"]
    assert "left out" in SearchReport(search).markdown(1, {})


@pytest.mark.slow
@pytest.mark.posix
def test_ctrl_c_stops_and_the_same_command_ends_as_if_it_had_not(tmp_path):
    text = SMALL.replace("budget: 30", "budget: 150").replace("seeds: [1, 2]", "seeds: [1]")
    path, outs = written(tmp_path, text), [tmp_path / "whole", tmp_path / "parts"]
    commands = [[sys.executable, "-m", "agents.search", str(path), "--out", str(out), "--jobs", "2"] for out in outs]
    subprocess.run(commands[0], check=True)
    process = subprocess.Popen(commands[1], stdout=subprocess.PIPE, text=True)
    while not list(outs[1].glob("*/*/evaluations.jsonl")):
        time.sleep(0.1)
    os.kill(process.pid, signal.SIGINT)
    said, _ = process.communicate()
    assert process.returncode == 130 and "stopped by SIGINT; to go on" in said
    subprocess.run(commands[1], check=True)
    for one, other in zip(Search.read(outs[0]).all, Search.read(outs[1]).all, strict=True):
        assert np.array_equal(one.evaluated.x, other.evaluated.x)


IN_SPACE = """
space: {kind: space, n_joints: 4}
objectives:
  - {kind: tip_stiffness, tensions: [[3, 3, 3, 3], [5, 3, 2, 3]], scale: reference}
limits:
  - {kind: tilting_margin, tensions: [[5, 3, 2, 3]], low: 0}
held_out:
  tip_stiffness: {tensions: [[4, 4, 4, 4]]}
reference: pitch_yaw
methods:
  random: {batch: 4}
  sqp: {}
budget: 8
seeds: [1]
"""


@pytest.mark.slow
def test_chains_in_space_are_searched_reported_and_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(options, "LocalExecutor", lambda jobs: InlineExecutor())
    out = tmp_path / "out"
    assert main([str(written(tmp_path, IN_SPACE)), "--out", str(out), "--jobs", "1"]) == 0
    best = load_mechanism(out / "best.yaml")
    assert isinstance(best, SpatialChain) and best.n_joints == 4
    assert (out / "shapes.png").stat().st_size > 0 and "pitch_yaw" in (out / "report.md").read_text("utf-8")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("kind: space", "kind: round", "space.kind: unknown key = 'round'"),
        ("reference: pitch_yaw", "reference: five_link", "a chain in space"),
        ("n_joints: 4", "knots: 4", "knots"),
        (
            "kind: tip_stiffness, tensions: [[3, 3, 3, 3], [5, 3, 2, 3]]",
            "kind: tip_travel",
            "DifferentiableSpatialChain",
        ),
    ],
)
def test_a_search_in_space_that_cannot_be_is_refused(old, new, message, tmp_path):
    assert old in IN_SPACE
    with pytest.raises(ConfigError, match=message):
        check(load_search(written(tmp_path, IN_SPACE.replace(old, new).replace("scale: reference", "scale: 1"))))


OWN = '''
from dataclasses import dataclass
from typing import ClassVar

import torch

from rollingjoint.design import Measured
from rollingjoint.differentiable import solve_tensions


@dataclass(frozen=True)
class TipHeight:
    """Height of the tip under equal tensions [mm]."""

    tension: float = 3.0
    name: ClassVar[str] = "tip_height"
    unit: ClassVar[str] = "mm"
    maximise: ClassVar[bool] = True

    def measure(self, chain):
        found = solve_tensions(chain, torch.full((chain.n_tendons,), self.tension, dtype=torch.float64))
        return Measured(found.tip[..., 1], found.ok)


@dataclass(frozen=True)
class Wrong(TipHeight):
    def measure(self, chain):
        return super().measure(chain).values


class Plain:
    pass
'''
OWN_SEARCH = """
space: {mechanism: two_segment, height: [-2, 3]}
objectives:
  - {kind: "own_objective:TipHeight", scale: reference, tension: 4}
limits:
  - {kind: lateral_stiffness, tensions: [[3, 3, 4, 4]], low: 0.001}
held_out:
  "own_objective:TipHeight": {tension: 5}
methods:
  random: {batch: 10}
budget: 10
seeds: [1]
"""


@pytest.mark.slow
def test_an_objective_of_your_own_searches_a_mechanism_with_four_tendons(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_objective.py").write_text(OWN)
    command = [str(written(tmp_path, OWN_SEARCH)), "--out", "out", "--jobs", "1"]
    assert main(command) == 2
    assert "--import own_objective" in capsys.readouterr().err
    monkeypatch.setattr(options, "LocalExecutor", lambda jobs: InlineExecutor())
    assert main([*command, "--import", "own_objective.py"]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["reference"][0] == pytest.approx(6 * 15.0) and "tip_height" in str(report)
    assert load_mechanism(tmp_path / "out" / "best.yaml").n_tendons == 4
    assert (tmp_path / "out" / "shapes.png").is_file()
    for kind, words in {"Wrong": "Measured", "Plain": "dataclass", "Missing": "no such class"}.items():
        text = OWN_SEARCH.replace("TipHeight", kind)
        assert main([str(written(tmp_path, text)), "--out", "new", "--import", "own_objective.py"]) == 2
        assert words in capsys.readouterr().err


def test_a_space_of_a_mechanism_that_is_wrong_is_named(tmp_path):
    for change, words in {
        "mechanism: two_segmnt": "two_segment",
        "mechanism: two_segment, azimuth: [0, 1]": "azimuth",
        "mechanism: two_segment, kind: space": "kind",
        "mechanism: 3": "mechanism = 3",
    }.items():
        with pytest.raises(ConfigError, match=words):
            check(load_search(written(tmp_path, OWN_SEARCH.replace("mechanism: two_segment", change))))
