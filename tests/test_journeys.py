"""The journeys of docs/architecture.md are counted by watching calls, and its table of formulas is true."""

import json
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"


@pytest.fixture
def statements(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import statements

    return statements


@pytest.fixture
def journeys(run_python):
    def counted(*names):
        return json.loads(run_python(str(BENCHMARKS / "journeys.py"), "--json", "--only", *names))

    return counted


@pytest.mark.slow
def test_the_way_from_lengths_to_the_formula_has_its_known_files(journeys):
    python, compiled = journeys("lengths")["lengths"].values()
    assert "solve_lengths" in python["rollingjoint/statics/solve.py"]
    assert "WorldForce.rows" in python["rollingjoint/load/kinds.py"]
    of_tendons = [name for names in compiled.values() for name in names if name == "evaluate_tendons"]
    assert len(of_tendons) == 1
    kernels = {name for names in compiled.values() for name in names}
    assert kernels >= {"solve_alone", "advance", "evaluate_gap", "factor_stiffness", "where", "unpin"}
    assert not kernels & {"step", "solve_pinned", "step_side_by_side", "solve_lanes", "stiffness"}  # other solvers'
    files = {*python, *compiled}
    assert len(files) > 8 and all(file.startswith("rollingjoint/") for file in files)


@pytest.mark.slow
def test_a_step_enters_the_solver_by_its_address(journeys):
    python, compiled = journeys("step")["step"].values()
    assert "TaskEnv.step" in python["rj_gym/core/env.py"]
    kernels = {name for names in compiled.values() for name in names}
    assert kernels >= {"step", "reward_terms", "call_range", "solve_alone", "advance", "evaluate_tendons"}


def test_every_listed_statement_exists(statements, capsys):
    assert statements.main() == 0
    assert "?" not in capsys.readouterr().out
    rows = statements.table(statements.PAGE.read_text("utf-8"))
    assert [len(set(row.places)) for row in rows] == [row.count for row in rows]
    assert len(rows) == 6 and all(row.count > 0 for row in rows)


def test_a_listed_statement_that_has_moved_is_told(statements, monkeypatch, tmp_path, capsys):
    page = tmp_path / "architecture.md"
    page.write_text(statements.PAGE.read_text("utf-8").replace(": gap_rates`", ": gap_rate`"), "utf-8")
    monkeypatch.setattr(statements, "PAGE", page)
    assert statements.main() == 1
    assert "joints.py:? gap_rate" in capsys.readouterr().out
