"""The designs of a search as points, and how a chosen one bends."""

import numpy as np
import pytest

from agents.runs.files import RunFolderError
from agents.search.config import SearchConfig
from agents.search.folder import SearchRun
from agents.search.optimiser import Evaluated
from agents.search.pictures import archive
from agents.search.problem import design_problem
from agents.viewer.designs import Designs
from rollingjoint import pitch_yaw
from rollingjoint.errors import InvalidInput

CONFIG = SearchConfig(
    objectives=[{"kind": "lateral_stiffness", "tensions": [[5, 5]]}, {"kind": "tip_rotation", "cases": 3}],
    methods={
        "random": {},
        "map_elites": {
            "measures": ["tip_rotation", "lateral_stiffness"],
            "ranges": [[0, 3], [0, 0.1]],
            "cells": [4, 5],
        },
    },
    space={"knots": 3},
    budget=25,
    seeds=(1,),
)


def search_in(folder, config=CONFIG):
    """A finished search, of which every method found random designs."""
    problem = design_problem(config)
    for seed, run in enumerate(config.runs()):
        made = SearchRun.begin(folder / run.run_name, run, ["rj", "search"])
        x = problem.space.sample(config.budget, np.random.default_rng(seed))
        made.append(Evaluated.of(problem.evaluate(x)), 1.0)
    return folder


@pytest.fixture(scope="module")
def designs(tmp_path_factory):
    return Designs.read(search_in(tmp_path_factory.mktemp("search") / "two"))


def test_points_are_the_feasible_designs_and_no_other_beats_those_of_the_pareto_set(designs):
    points = designs.points(0, 1)
    found = designs.search.everything
    assert set(points.rows) == set(np.flatnonzero(found.feasible))
    best = points.kinds == 2
    for x, y in zip(points.x[best], points.y[best], strict=True):
        assert not ((points.x > x) & (points.y > y)).any()
    np.testing.assert_array_equal(points.y, found.measured[points.rows, 1])


def test_the_archive_has_the_best_design_of_every_cell(designs):
    found, kept = designs.search.everything, designs.search.archive
    rows = np.flatnonzero(found.feasible)[-25:]
    rows = rows[rows >= 25]
    cell = lambda row: tuple(np.clip((found.measured[row, [1, 0]] // [0.75, 0.02]).astype(int), 0, [3, 4]))  # noqa: E731
    for row in rows:
        assert found.cost[kept.designs[cell(row)]] <= found.cost[row]
    assert set(kept.designs[kept.designs >= 0]) <= set(rows)
    assert archive(designs.search).startswith(b"\x89PNG")


def test_a_design_bends_to_either_side(designs):
    design = designs.design(designs.best)
    left, straight, right = (design.bent(share) for share in (1.0, 0.0, -1.0))
    assert left.ok and straight.ok and right.ok
    assert left.tip[0] < straight.tip[0] < right.tip[0]
    assert left.tensions.sum() == pytest.approx(10.0) and left.tensions[0] == pytest.approx(3 * left.tensions[1])
    with pytest.raises(InvalidInput, match="bend"):
        design.bent(1.5)


def test_the_nearest_point_is_the_design_that_was_clicked(designs):
    points = designs.points(1, 0)
    for place in (0, len(points.rows) - 1):
        assert points.nearest(points.x[place], points.y[place]) == points.rows[place]


def test_two_designs_are_compared_in_all_that_was_measured(designs):
    best = designs.design(designs.best)
    rows = designs.compared([best, designs.reference])
    assert [row[0] for row in rows] == designs.quantities and rows[0][0] == "lateral stiffness [N/mm]"
    for place, (_, ours, theirs) in enumerate(rows):
        assert float(ours) == pytest.approx(best.values[place], rel=1e-3)
        assert float(theirs) == pytest.approx(designs.reference.values[place], rel=1e-3)
    assert designs.reference.title == "five link" and designs.reference.row is None


def test_what_is_no_search_or_no_design_is_refused(designs, tmp_path):
    with pytest.raises(RunFolderError, match="finished run"):
        Designs.read(tmp_path)
    with pytest.raises(InvalidInput, match="design"):
        designs.design(10_000)


def test_searches_of_chains_in_space_are_refused_in_one_line(designs, monkeypatch):
    monkeypatch.setattr("agents.viewer.designs.reference", lambda config: pitch_yaw(2))
    with pytest.raises(InvalidInput, match="a search of planar chains"):
        _ = Designs(designs.search).reference
