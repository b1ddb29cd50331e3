"""Problems: what a design costs, its gradient, rows that know nothing of each other, numbers that are no design."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import rollingjoint as rj

torch = pytest.importorskip("torch")

from rollingjoint.design import problem as problem_module  # noqa: E402 - needs torch
from rollingjoint.design import sweeps  # noqa: E402
from rollingjoint.design.comparison import measure, nondominated  # noqa: E402
from rollingjoint.design.loads import LateralStiffness, LoadCapacity, PeakTension  # noqa: E402
from rollingjoint.design.objectives import BendingShapes, Measured, TendonTravel, TipRotation, TipTravel  # noqa: E402
from rollingjoint.design.problem import FAILED, Limit, Problem, Term  # noqa: E402
from rollingjoint.design.space import DesignSpace  # noqa: E402
from rollingjoint.differentiable import DifferentiableChain, solve_tensions  # noqa: E402

torch.set_num_threads(1)

SPACE = DesignSpace(n_links=4, knots=3, hole=(8.0, 11.0), height=(18.0, 24.0))
PLACES = [[[0, 0], [-5, 20], [-12, 40], [-25, 55]]]


def everything():
    """A problem with an objective of every kind, and limits, one of them on an objective of the cost."""
    terms = [
        Term(BendingShapes([[3, 1]], PLACES, [[0.2, 0.0]]), 2.0, 10.0),
        Term(TipTravel(cases=3), 0.5, 100.0),
        Term(LateralStiffness(((5, 5),)), 1.0, 0.01),
        Term(PeakTension(), 1.0, 5.0),
        Term(LoadCapacity(levels=2, force=1.0), 0.1, 1.0),
    ]
    return Problem(SPACE, terms, [Limit(TendonTravel(cases=3), high=30.0), Limit(TipTravel(cases=3), 80.0, 110.0)])


def rows():
    """Designs that are feasible, that break limits, margins and the box, that cannot be built, that are no numbers."""
    x = np.concatenate([SPACE.sample(4, np.random.default_rng(3)), np.tile(SPACE.reference(), (8, 1))])
    x[5] = -0.95  # hollow on hollow
    x[6, 0] = 1.5
    x[7], x[8, 1], x[9, 0], x[10], x[11] = np.nan, np.inf, -np.inf, 1e300, -1e300
    return x


def test_the_cost_is_its_formula():
    problem, found = everything(), everything().evaluate(rows())
    factors = np.array([2.0 / 10.0, -0.5 / 100.0, -1.0 / 0.01, 1.0 / 5.0, -0.1])
    broken = np.maximum(-found.margins, 0.0).sum(1) + np.maximum(np.abs(np.clip(rows(), -1e6, 1e6)) - 1.0, 0.0).sum(1)
    travel, path = found.limited.T
    over = np.maximum(travel / 30.0 - 1.0, 0.0) + np.maximum(path / 110.0 - 1.0, 0) + np.maximum(1.0 - path / 80.0, 0.0)
    known = np.isfinite(rows()).all(1)
    violation = np.where(known, broken + np.where(found.ok, over, 0.0), FAILED)
    assert found.violation == pytest.approx(violation, rel=1e-12)
    worth = np.where(found.ok, found.values @ factors, FAILED)
    assert found.cost == pytest.approx(worth + problem.penalty * (violation + violation**2), rel=1e-12)
    assert path == pytest.approx(found.values[:, 1], abs=0)
    assert (found.feasible == (found.ok & (found.violation == 0))).all()
    assert found.ok[:5].all() and not found.ok[[5, 7, 8, 9]].any()
    assert found.feasible.any() and (found.violation[found.ok] > 0).any()


def test_values_are_those_of_the_mechanisms():
    problem = everything()
    x = rows()[:5]
    found = problem.evaluate(x)
    for row, values in zip(x, found.values, strict=True):
        assert problem.against(SPACE.mechanism(row)) == pytest.approx(values, rel=1e-9)


def test_numbers_that_are_no_design_fail_in_finite_numbers():
    found, gradient = everything().with_gradient(rows())
    for numbers in (found.values, found.limited, found.margins, found.violation, found.cost, gradient):
        assert np.isfinite(numbers).all()
    assert not found.feasible[5:].any() and (found.cost[5:] > found.cost[:5].max()).all()
    assert (gradient[7:10] == 0).all()


@pytest.mark.slow
def test_rows_do_not_know_each_other(monkeypatch):
    monkeypatch.setattr(problem_module, "_CHUNK", 5)
    problem = everything()
    (together, gradient), (threaded, _) = (problem.with_gradient(rows(), threads) for threads in (1, 3))
    plain, threaded_plain = (problem.evaluate(rows(), threads) for threads in (1, 3))
    monkeypatch.setattr(problem_module, "_CHUNK", 1)
    alone, own = problem.with_gradient(rows())
    for row, expected in zip(gradient, own, strict=True):
        assert row == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())
    for found in (together, threaded, plain, threaded_plain):
        assert (found.ok == alone.ok).all() and (found.feasible == alone.feasible).all()
        for name in ("values", "limited", "margins", "violation", "cost"):
            assert getattr(found, name) == pytest.approx(getattr(alone, name), rel=1e-9, abs=1e-9), name


def numeric_gradient(problem, row):
    """Central differences of the cost, twice, error O(h⁴)."""
    steps = np.eye(len(row))[None] * np.array([1e-4, -1e-4, 5e-5, -5e-5])[:, None, None]
    wide_on, wide_back, on, back = problem.evaluate((row + steps).reshape(-1, len(row))).cost.reshape(4, -1)
    return (4 * (on - back) / 1e-4 - (wide_on - wide_back) / 2e-4) / 3


@pytest.mark.slow
@pytest.mark.parametrize("row", range(7))
def test_the_gradient_is_that_of_the_cost(row):
    x = rows()[row]
    problem = everything()
    _, gradient = problem.with_gradient(x[None])
    numeric = numeric_gradient(problem, x)
    assert gradient[0] == pytest.approx(numeric, abs=1e-6 * np.abs(numeric).max())
    assert np.abs(gradient).max() > 0


@pytest.mark.slow
@pytest.mark.parametrize("row", range(5))
def test_the_jacobian_is_that_of_worth_and_constraints(row):
    x, problem = rows()[row], everything()
    found, jacobian = problem.with_jacobian(x[None])
    assert jacobian.shape == (1, 1 + found.constraints.shape[1], len(x))
    assert found.cost == pytest.approx(problem.evaluate(x[None]).cost, rel=1e-9)
    steps = 1e-5 * np.eye(len(x))
    ends = [problem.evaluate(x + sign * steps) for sign in (1, -1)]
    on, back = (np.column_stack([end.worth, end.constraints]) for end in ends)
    numeric = ((on - back) / 2e-5).T
    assert jacobian[0] == pytest.approx(numeric, abs=1e-5 * np.abs(numeric).max())


def test_objectives_with_the_same_sweep_solve_it_once(monkeypatch):
    asked = []
    monkeypatch.setattr(sweeps, "solve_tensions", lambda *case: asked.append(case) or solve_tensions(*case))
    terms = (Term(TipTravel()), Term(TipRotation()), Term(TendonTravel()))
    together, gradient = Problem(SPACE, terms).with_gradient(SPACE.reference()[None])
    assert len(asked) == 1
    alone = [Problem(SPACE, (term,)).with_gradient(SPACE.reference()[None]) for term in terms]
    assert together.cost == pytest.approx(sum(found.cost for found, _ in alone), rel=1e-12)
    assert gradient == pytest.approx(sum(own for _, own in alone), rel=1e-9, abs=1e-9)


@dataclass(frozen=True)
class Counted:
    """The height of the first link, and how often it was asked for."""

    name: ClassVar[str] = "counted"
    unit: ClassVar[str] = "mm"
    maximise: ClassVar[bool] = False
    asked: ClassVar[list[int]] = []

    def measure(self, chain: DifferentiableChain) -> Measured:
        self.asked.append(len(chain.starts))
        height = chain.starts[:, 0, 1, 1]
        return Measured(height, torch.ones_like(height, dtype=torch.bool))


def test_an_objective_in_a_term_and_a_limit_is_measured_once():
    problem = Problem(SPACE, (Term(Counted()), Term(Counted(), 2.0)), (Limit(Counted(), high=1.0),))
    found = problem.evaluate(np.zeros((3, problem.dimensions)))
    assert Counted.asked == [3]
    assert found.values == pytest.approx(10.5) and found.violation == pytest.approx(9.5)


def test_a_problem_of_limits_alone_costs_its_violation():
    problem = Problem(SPACE, (), (Limit(Counted(), low=12.0),), penalty=3.0)
    found, gradient = problem.with_gradient(SPACE.reference()[None])
    v = 1.0 - 10.5 / 12.0
    assert found.cost == pytest.approx(3.0 * (v + v * v)) and found.values.shape == (1, 0)
    assert (gradient != 0).sum() == 1


def test_objectives_of_any_mechanism_can_be_measured():
    shapes = BendingShapes.of(rj.five_link(), [(3.0, 1.0)])
    assert measure(rj.five_link(), [shapes, Counted()]) == pytest.approx([0.0, 10.0], abs=1e-9)
    with pytest.raises(rj.SolverError, match="bending_shapes: 'uniform'"):
        measure(rj.uniform(), [BendingShapes([[1e13, 1]], [[[0, 0]] * 5])])


def test_nondominated_rows_are_those_that_none_beats():
    rng = np.random.default_rng(0)
    values, maximise = rng.integers(0, 6, (60, 3)).astype(float), (True, False, True)
    costs = values * np.where(maximise, -1.0, 1.0)
    beaten = [any((other <= row).all() and (other < row).any() for other in costs) for row in costs]
    assert nondominated(values, maximise).tolist() == [not b for b in beaten]
    assert 0 < sum(beaten) < 60
    assert nondominated([[1.0, np.nan], [2.0, 1.0], [2.0, 1.0]], (False, False)).tolist() == [False, True, True]
    assert nondominated(np.empty((0, 2)), (True, True)).shape == (0,)


REFUSED = {
    "nothing to judge by": lambda: Problem(SPACE, ()),
    "no penalty": lambda: Problem(SPACE, (Term(TipTravel()),), penalty=0.0),
    "a negative weight": lambda: Term(TipTravel(), weight=-1.0),
    "no scale": lambda: Term(TipTravel(), scale=0.0),
    "bounds in the wrong order": lambda: Limit(TipTravel(), 2.0, 1.0),
    "a bound that is no number": lambda: Limit(TipTravel(), low=np.nan),
    "a limit without bounds": lambda: Limit(TipTravel()),
    "other dimensions": lambda: everything().evaluate(np.zeros((2, 17))),
    "one design without its axis": lambda: everything().evaluate(SPACE.reference()),
    "no design": lambda: everything().evaluate(np.zeros((0, SPACE.dimensions))),
    "text": lambda: everything().with_gradient([["a"] * SPACE.dimensions]),
    "no thread": lambda: everything().evaluate(SPACE.reference()[None], threads=0),
    "columns without a direction": lambda: nondominated([[1.0, 2.0]], (True,)),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_means_nothing_is_refused(what):
    with pytest.raises(rj.InvalidInput):
        REFUSED[what]()
