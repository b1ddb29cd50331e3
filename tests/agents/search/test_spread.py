"""Runs of a search whose batches are scored in chunks: the journals of one process, whatever happens on the way."""

import json
import os
import re
import signal
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from agents.executors import local
from agents.executors.driver import work_through
from agents.executors.folders import FolderUnit, marked
from agents.executors.local import InlineExecutor, LocalExecutor
from agents.executors.progress import Progress
from agents.search import spread
from agents.search.config import SearchConfig, load_search
from agents.search.folder import SearchRun
from agents.search.problem import design_problem, optimiser
from agents.search.run import chunks, search_in
from agents.search.spread import SpreadRuns
from rollingjoint.checked_yaml import parse_yaml
from rollingjoint.errors import ConfigError
from tests.agents.forked import CONTEXT

PROBLEM = {
    "space": {"knots": 3},
    "objectives": [{"kind": "lateral_stiffness", "tensions": [[5, 5]]}],
    "limits": [{"kind": "tip_rotation", "cases": 3, "low": 0.1}],
    "chunk": 100,
    "seeds": (1,),
}
LARGE = {"cma_es": {"population": 220}, "gradient": {"starts": 310}}

SCORED = spread.scored


def begun(out, methods=LARGE, budget=700):
    """Runs that have not searched yet."""
    config = SearchConfig(methods=methods, budget=budget, **PROBLEM)
    return [SearchRun.begin(out / one.run_name, one, ["python"]) for one in config.runs()]


def journal(run):
    """The lines, without their times."""
    return [json.loads(line) | {"seconds": 0} for line in run.journal.read_text().splitlines()]


def searched(runs, executor=None, signals=(), submitted=None):
    """What the command does with runs: values and failures by name of the method; the display."""
    out, signals = runs[0].path.parent.parent, list(signals)
    with marked(out) as home, Progress(len(runs), "run") as progress:
        units = [FolderUnit(str(run.path), search_in, (), home, run.path.relative_to(out).as_posix()) for run in runs]
        with SpreadRuns(units, progress) as made:
            seen = (one for one in made.units() if submitted is None or submitted.append(one) is None)
            ended = list(made.runs(work_through(executor or InlineExecutor(), seen, progress, signals)))
    method = {one: one.unit.place.split("/")[0] for one in ended}
    values = {method[one]: one.value for one in ended if not one.failure}
    return values, {method[one]: one.failure for one in ended if one.failure}, progress


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The runs, each searched by one process from its beginning to its end."""
    runs = begun(tmp_path_factory.mktemp("alone"))
    for run in runs:
        search_in(run.path)
    return runs


def test_chunks_are_equal_parts_that_are_large_enough():
    x = np.arange(350.0)[:, None]
    assert [len(part) for part in chunks(x, 100)] == [117, 117, 116]
    assert [len(part) for part in chunks(x[:199], 100)] == [199]
    assert [len(part) for part in chunks(x, 0)] == [350]


@pytest.mark.slow
def test_runs_in_chunks_have_the_journals_of_one_process(alone, tmp_path, monkeypatch):
    monkeypatch.setattr(local, "get_context", lambda method: CONTEXT)
    executor, submitted, runs = LocalExecutor(2), [], begun(tmp_path)
    values, failures, progress = searched(runs, executor, submitted=submitted)
    executor.shutdown()
    assert [journal(run) for run in runs] == [journal(run) for run in alone]
    assert (values["cma_es"].evaluations, failures, progress.done) == (700, {}, 2)
    assert 0 < values["cma_es"].seconds == runs[0].batches()[-1][1]
    sizes = [len(one.arguments[2]) for one in submitted if one is not None]
    assert sizes.count(110) == 6 and min(sizes) == 40  # three populations of CMA-ES; what the budget leaves
    assert sum(sizes) == 1400


@pytest.mark.slow
def test_a_run_in_chunks_that_was_interrupted_ends_like_one_that_was_not(alone, tmp_path):
    runs = begun(tmp_path)
    for run, whole in zip(runs, alone, strict=True):
        line = whole.journal.read_bytes().split(b"\n")[0]
        run.journal.write_bytes(line + b'\n{"seconds": 3.0, "x": [[0.1, 0.')
    assert searched(runs, signals=[signal.SIGINT])[0] == {}
    values, _, _ = searched(runs)
    assert values.keys() == LARGE.keys()
    assert [journal(run) for run in runs] == [journal(run) for run in alone]


def test_small_batches_stay_with_the_process_of_their_run(tmp_path):
    submitted, runs = [], begun(tmp_path, {"random": {"batch": 199}}, budget=199)
    assert searched(runs, submitted=submitted)[0]["random"].evaluations == 199
    assert [type(one) for one in submitted] == [FolderUnit]


@pytest.mark.slow
def test_a_chunk_that_fails_ends_its_run_alone(alone, tmp_path, monkeypatch):
    def broken(problem, wants, x):
        if wants == "gradient":
            raise ValueError("two\nlines")
        return scored(problem, wants, x)

    scored = spread.scored
    monkeypatch.setattr(spread, "scored", broken)
    runs = begun(tmp_path)
    values, failures, progress = searched(runs)
    assert (values.keys(), failures) == ({"cma_es"}, {"gradient": "ValueError('two\\nlines')"})
    assert (progress.done, progress.failed) == (1, 1)
    assert journal(runs[0]) == journal(alone[0])
    with runs[1].locked():  # nobody holds it any longer
        pass


def test_a_run_that_cannot_go_on_fails_alone(tmp_path):
    runs = begun(tmp_path, budget=220)
    runs[0].journal.write_text("no json\n")
    with runs[1].locked():
        values, failures, progress = searched(runs)
    assert values == {} and progress.failed == 2
    assert "--force begins the run anew" in failures["cma_es"] and "Wait for it to end" in failures["gradient"]


@pytest.mark.parametrize("chunk", [1, 99, -1, "all"])
def test_chunks_that_do_not_pay_are_refused(chunk):
    with pytest.raises(ConfigError, match="chunk = "):
        SearchConfig(methods=LARGE, **PROBLEM | {"chunk": chunk})


def score_unless_third(folder, *arguments):
    """Score, but kill this process the third time."""
    with (folder / "calls").open("a") as calls:
        calls.write("x")
    if len((folder / "calls").read_text()) == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return SCORED(*arguments)


@pytest.mark.slow
def test_a_lost_worker_costs_a_chunk_and_no_more(alone, tmp_path, monkeypatch):
    monkeypatch.setattr(local, "get_context", lambda method: CONTEXT)
    monkeypatch.setattr(spread, "scored", partial(score_unless_third, tmp_path))
    executor, runs = LocalExecutor(1), begun(tmp_path / "out", {"cma_es": LARGE["cma_es"]})
    _, _, progress = searched(runs, executor)
    executor.shutdown()
    assert journal(runs[0]) == journal(alone[0])
    assert progress.lost == 1 and len((tmp_path / "calls").read_text()) == 7 + 1


def test_the_example_of_the_page_is_scored_in_ten_chunks():
    (block,) = re.findall(r"```yaml\n(.*?)```", Path("docs/scaling.md").read_text("utf-8"), re.DOTALL)
    config = replace(load_search(Path("configs/search/stiffness.yaml")), seeds=(1,), **parse_yaml(block, "block"))
    first = optimiser(config, design_problem(config)).ask(config.budget)
    assert spread.has_chunks(config) and [len(part) for part in chunks(first, config.chunk)] == [100] * 10
