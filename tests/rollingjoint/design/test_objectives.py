"""Objectives of designs against the compiled solver: every one is written a second time here, in plain numpy."""

import dataclasses
import itertools

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint import Status, WorldForce, solve_lengths, solve_tensions

torch = pytest.importorskip("torch")

from rollingjoint.design import loads as loads_module  # noqa: E402 - needs torch
from rollingjoint.design import sweeps as sweeps_module  # noqa: E402
from rollingjoint.design.comparison import measure  # noqa: E402
from rollingjoint.design.loads import LateralStiffness, LoadCapacity, PeakTension  # noqa: E402
from rollingjoint.design.objectives import BendingShapes, TendonTravel, TipRotation, TipTravel  # noqa: E402
from rollingjoint.design.sweeps import shared_sweeps  # noqa: E402
from rollingjoint.differentiable import DifferentiableChain  # noqa: E402

torch.set_num_threads(1)

PLACES = [[[0, 0], [-5, 20], [-10, 40], [-15, 60], [-25, 78]], [[0, 0], [0, 20], [5, 40], [10, 58], [20, 75]]]


def bending_shapes(chain, o):
    misses = []
    for tensions, places, force in zip(o.tensions, o.positions, o.forces, strict=True):
        poses = solve_tensions(chain, tensions, [WorldForce(-1, force)]).require().poses
        misses.append(poses[1:, :2] - np.array(places)[1:])
    return np.sqrt((np.array(misses) ** 2).sum(-1).mean())


def sweep(chain, o):
    """Equilibria of the sweep: ratios in equal steps of their logarithm, the sum constant."""
    found = []
    for ratio in np.exp(np.linspace(-np.log(o.ratio), np.log(o.ratio), o.cases)):
        left = o.tension * ratio / (1 + ratio)
        found.append(solve_tensions(chain, (left, o.tension - left)).require())
    return found


def tip_travel(chain, o):
    tips = [found.tip for found in sweep(chain, o)]
    return sum(np.hypot(*(b - a)) for a, b in itertools.pairwise(tips))


def tip_rotation(chain, o):
    return np.ptp([found.poses[-1, 2] for found in sweep(chain, o)])


def tendon_travel(chain, o):
    lengths = np.array([found.lengths - found.tensions / chain.stiffnesses for found in sweep(chain, o)])
    return np.ptp(lengths, axis=0).max() / (tip_rotation(chain, o) if o.per_radian else 1.0)


def sides(free):
    angle = free.poses[-1, 2]
    right = np.array([np.cos(angle), np.sin(angle)])
    return right, -right


def lateral_stiffness(chain, o):
    found = []
    for tensions in o.tensions:
        free = solve_tensions(chain, tensions).require()
        for side in sides(free):
            loaded = solve_tensions(chain, tensions, [WorldForce(-1, tuple(o.force * side))], start=free).require()
            found.append(o.force / ((loaded.tip - free.tip) @ side))
    return min(found)


def peak_tension(chain, o):
    free = solve_tensions(chain, o.tensions).require()
    locked = free.lengths - free.tensions / chain.stiffnesses
    forces = [tuple(o.force * side) for side in sides(free)]
    return max(solve_lengths(chain, locked, [WorldForce(-1, f)], start=free).require().tensions.max() for f in forces)


def margins(chain, equilibrium, o):
    """Pressing, slipping, running out of surface: of every joint."""
    pairs = [
        (link.child.profile, above.parent.profile) for link, above in zip(chain.links, chain.links[1:], strict=False)
    ]
    first, last = (
        np.array([pick(a.breaks[end], b.breaks[end]) for a, b in pairs]) for pick, end in ((max, 0), (min, -1))
    )
    s = equilibrium.arc_lengths
    ends = s - first - o.reserve, last - s - o.reserve
    return np.concatenate([equilibrium.pressing_margins, equilibrium.slip_margins(o.friction), *ends])


def load_capacity(chain, o):
    free = solve_tensions(chain, o.tensions).require()
    found = []
    for side in sides(free):
        before = margins(chain, free, o)
        if before.min() < 0:
            return 0.0
        for level in range(1, o.levels + 1):
            force = o.force * level / o.levels
            loaded = solve_tensions(chain, o.tensions, [WorldForce(-1, tuple(force * side))], start=free).require()
            now = margins(chain, loaded, o)
            if now.min() < 0:
                below = now < 0
                part = (before[below] / (before[below] - now[below])).min()
                found.append(o.force / o.levels * (level - 1 + part))
                break
            before = now
    return min([*found, o.force])


CASES = {  # objective, the same in numpy
    "shapes": (BendingShapes([[3, 1], [2, 4]], PLACES, [[0.2, -0.1], [0, 0.3]]), bending_shapes),
    "shape at a joint's limit": (BendingShapes([[0.4, 0.5]], PLACES[:1], [[-1.0, -0.1]]), bending_shapes),
    "one shape without load": (BendingShapes([[3, 1]], PLACES[:1]), bending_shapes),
    "travel": (TipTravel(), tip_travel),
    "travel, far": (TipTravel(ratio=30.0, cases=4), tip_travel),
    "rotation": (TipRotation(tension=2.0, ratio=2.0, cases=5), tip_rotation),
    "tendon travel": (TendonTravel(), tendon_travel),
    "tendon travel per radian": (TendonTravel(per_radian=True, cases=2), tendon_travel),
    "stiffness": (LateralStiffness(), lateral_stiffness),
    "stiffness with a slack tendon": (LateralStiffness(((5.0, 0.0), (1.0, 1.0)), 0.01), lateral_stiffness),
    "peak tension": (PeakTension(), peak_tension),
    "peak tension, a tendon goes slack": (PeakTension((0.5, 0.5), 1.0), peak_tension),
    "peak tension without force": (PeakTension(force=0.0), peak_tension),
    "capacity": (LoadCapacity(), load_capacity),
    "capacity, finer, less friction": (LoadCapacity((8.0, 6.0), 6.0, 11, 0.2, 0.0), load_capacity),
    "capacity that is not reached": (LoadCapacity(force=0.5), load_capacity),
    "capacity, at the limit without load": (LoadCapacity((9.0, 0.2)), load_capacity),
}


def family(x):
    """Designs near five_link: curvature, holes and heights are 10 % larger per unit of the last axis of x, (..., 3)."""
    base = DifferentiableChain.from_mechanism(rj.five_link())
    curved, drilled, high = (1.0 + 0.1 * x).unbind(-1)
    return base.replace(
        coefficients=base.coefficients * curved[..., None, None, None, None],
        hole_arcs=base.hole_arcs * drilled[..., None, None, None],
        starts=base.starts * high[..., None, None, None],
    )


DESIGNS = torch.tensor([[0.0, 0.0, 0.0], [0.5, -1.0, 0.3], [-1.0, 0.4, -0.5]], dtype=torch.float64)


@pytest.mark.parametrize("name", CASES)
def test_objectives_are_those_of_the_compiled_solver(name):
    objective, plain = CASES[name]
    found = objective.measure(family(DESIGNS))
    assert found.ok.all() and found.values.shape == (3,)
    expected = [plain(chain, objective) for chain in family(DESIGNS).mechanisms()]
    assert found.values.numpy() == pytest.approx(expected, rel=1e-8, abs=1e-12)
    assert measure(family(DESIGNS).mechanism(1), [objective]) == pytest.approx(expected[1:2], rel=1e-8, abs=1e-12)


def richardson(function, h):
    """Derivative at 0 by two central differences, error O(h⁴)."""
    wide, narrow = ((function(x) - function(-x)) / (2 * x) for x in (h, 0.5 * h))
    return (4 * narrow - wide) / 3


@pytest.mark.parametrize("name", CASES)
def test_gradients_are_those_of_differences_of_the_compiled_solver(name):
    objective, plain = CASES[name]
    x = DESIGNS[1:].clone().requires_grad_()
    (gradient,) = torch.autograd.grad(objective.measure(family(x)).values.sum(), x, allow_unused=True)
    for row, own in zip(DESIGNS[1:], gradient.numpy(), strict=True):

        def moved(h, direction, row=row):
            return plain(family(row + h * direction).mechanism(), objective)

        numeric = np.array([richardson(lambda h, e=e: moved(h, e), 1e-2) for e in torch.eye(3)])
        assert own == pytest.approx(numeric, abs=1e-6 * np.abs(numeric).max() + 1e-9)


def test_objectives_that_need_the_same_sweep_share_it_and_keep_their_gradients(monkeypatch):
    judges = TipTravel(), TipRotation(), TendonTravel(), TendonTravel(per_radian=True), TipTravel(cases=4)
    x = DESIGNS.clone().requires_grad_()

    def total():
        chain = family(x)
        return sum(judge.measure(chain).values.sum() for judge in judges)

    apart = torch.autograd.grad(total(), x)[0]
    solve, solved = sweeps_module.solve_tensions, []
    monkeypatch.setattr(sweeps_module, "solve_tensions", lambda *a: solved.append(len(a[1])) or solve(*a))
    with shared_sweeps():
        (together,) = torch.autograd.grad(total(), x)
        assert solved == [9, 4]
        with torch.no_grad():  # a sweep with a graph is no sweep without one, another chain not the same
            total()
    assert solved == [9, 4, 9, 4]
    assert together.numpy() == pytest.approx(apart.numpy(), rel=1e-12)
    total()
    assert len(solved) == 4 + len(judges)


def test_a_mechanism_has_its_own_shapes_at_no_distance_and_without_a_gradient():
    shapes = BendingShapes.of(rj.five_link(), [(3.0, 1.0), (1.0, 2.0)], [(0.1, 0.2), (0.0, 0.0)])
    x = torch.zeros(1, 3, dtype=torch.float64, requires_grad=True)
    found = shapes.measure(family(x))
    assert found.values.item() < 1e-9
    assert torch.isfinite(torch.autograd.grad(found.values.sum(), x)[0]).all()


def test_more_tendons_are_swept_as_pairs():
    mechanism, judge = rj.two_segment(), TipRotation(tension=8.0, ratio=1.4, cases=3)
    angles = [solve_tensions(mechanism, [*row, *row]).require().poses[-1, 2] for row in judge.tensions]
    assert measure(mechanism, [judge])[0] == pytest.approx(np.ptp(angles), rel=1e-9) and np.ptp(angles) > 0.1


def test_joints_at_their_limits_count():
    at_limit, _ = CASES["shape at a joint's limit"]
    force = WorldForce(-1, at_limit.forces[0])
    for chain in family(DESIGNS).mechanisms():
        assert solve_tensions(chain, at_limit.tensions[0], [force]).status == Status.AT_LIMIT


def test_tendons_alone_pull_no_contact_beyond_their_holes():
    chain = rj.five_link()
    for found in sweep(chain, TipTravel(ratio=1e3, cases=9)):
        assert found.status == Status.CONVERGED and np.abs(found.arc_lengths).max() < 10.0


def test_between_its_levels_the_capacity_is_where_the_compiled_solver_finds_it():
    chain, objective = rj.five_link(), LoadCapacity(levels=64)
    (capacity,) = measure(chain, [objective])
    free = solve_tensions(chain, objective.tensions)
    least = [
        min(
            margins(
                chain, solve_tensions(chain, objective.tensions, [WorldForce(-1, tuple(f * side))], free), objective
            ).min()
            for side in sides(free)
        )
        for f in (0.998 * capacity, 1.002 * capacity)
    ]
    assert least[0] > 0 > least[1]


def test_a_level_without_an_equilibrium_bounds_the_capacity_and_a_design_without_one_fails(monkeypatch):
    objective = LoadCapacity(force=0.8, levels=4)
    x = DESIGNS[:2].clone().requires_grad_()
    whole = objective.measure(family(x))
    assert whole.ok.all() and whole.values.tolist() == [0.8, 0.8]
    solved = []

    def failing(*arguments, **options):
        found = solve_tensions_torch(*arguments, **options)
        solved.append(found)
        status = found.status.clone()
        if status.shape[-1] == 4:
            status[0, 1, 2] = Status.UNSTABLE  # the third level on one side
        else:
            status[1] = Status.INDETERMINATE
        return dataclasses.replace(found, status=status)

    solve_tensions_torch = loads_module.solve_tensions
    monkeypatch.setattr(loads_module, "solve_tensions", failing)
    found = objective.measure(family(x))
    assert found.ok.tolist() == [True, False] and torch.isfinite(found.values).all()
    free, loaded = (one.smallest_eigenvalue[0].detach() for one in solved)
    second = loaded[1, 1] / (loaded[1, 1] + free[0, 0])
    assert found.values[0].item() == pytest.approx(0.2 * (2 + second.item()), rel=1e-12)
    (gradient,) = torch.autograd.grad(found.values[0], x)
    assert gradient[0].abs().max() > 0 and gradient[1].abs().max() == 0


@pytest.mark.parametrize("name", CASES)
def test_a_design_that_cannot_be_built_is_not_ok_and_leaves_the_others_alone(name):
    objective, _ = CASES[name]
    x = torch.tensor([[-40.0, 0.0, 0.0], [0.1, 0.2, 0.3], [torch.nan, 0.0, 0.0]], dtype=torch.float64).requires_grad_()
    found = objective.measure(family(x))
    alone = objective.measure(family(DESIGNS.new_tensor([[0.1, 0.2, 0.3]])))
    assert found.ok.tolist() == [False, True, False] and torch.isfinite(found.values).all()
    assert found.values[1].item() == pytest.approx(alone.values.item(), rel=1e-9)
    (gradient,) = torch.autograd.grad(found.values.where(found.ok, 0.0).sum(), x)
    assert gradient[::2].nan_to_num().abs().max() == 0


def test_equal_objectives_are_equal_whatever_their_numbers_came_in():
    lists, arrays = BendingShapes([[3, 1]], PLACES[:1]), BendingShapes(np.array([[3.0, 1.0]]), np.array(PLACES[:1]))
    assert lists == arrays and hash(lists) == hash(arrays) and lists.forces == ((0.0, 0.0),)
    assert (
        TipTravel() != TipRotation() and TendonTravel().unit == "mm" and TendonTravel(per_radian=True).unit == "mm/rad"
    )


REFUSED = {
    "no case": lambda: BendingShapes((), ()),
    "not a number": lambda: BendingShapes([[np.nan, 1.0]], PLACES[:1]),
    "a pushing tendon": lambda: BendingShapes([[-1.0, 1.0]], PLACES[:1]),
    "slack tendons": lambda: LateralStiffness([[5.0, 5.0], [0.0, 0.0]]),
    "as many shapes as cases": lambda: BendingShapes([[3, 1], [1, 1]], PLACES[:1]),
    "as many forces as cases": lambda: BendingShapes([[3, 1]], PLACES[:1], [[0, 0], [0, 1]]),
    "infinite places": lambda: BendingShapes([[3, 1]], [[[0.0, np.inf]] * 5]),
    "text": lambda: PeakTension(("five", "six")),
    "no stiffness without force": lambda: LateralStiffness(force=0.0),
    "a force of no number": lambda: PeakTension(force=np.nan),
    "a negative force": lambda: LoadCapacity(force=-1.0),
    "no level": lambda: LoadCapacity(levels=0),
    "no friction": lambda: LoadCapacity(friction=0.0),
    "a negative reserve": lambda: LoadCapacity(reserve=-1.0),
    "a ratio that bends to no side": lambda: TipTravel(ratio=1.0),
    "one case of a sweep": lambda: TipRotation(cases=1),
    "no tension": lambda: TendonTravel(tension=0.0),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_means_nothing_is_refused(what):
    with pytest.raises(rj.InvalidInput):
        REFUSED[what]()


def test_shapes_of_other_mechanisms_are_refused():
    with pytest.raises(rj.InvalidInput, match="links"):
        measure(rj.uniform(4), [BendingShapes([[3, 1]], PLACES[:1])])
