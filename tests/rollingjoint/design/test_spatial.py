"""Design of chains in space: designs, margins and faults, objectives against the compiled solver."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.errors import ConfigError, InvalidInput, MechanismError

torch = pytest.importorskip("torch")

from rollingjoint.design import (  # noqa: E402 - needs torch
    SPATIAL_MARGINS,
    DesignSpace,
    FrictionRequired,
    LateralStiffness,
    Limit,
    PlacementError,
    PressingMargin,
    Problem,
    SpatialDesignSpace,
    Term,
    TiltingMargin,
    TipReach,
    TipStiffness,
    ToothMargin,
    measure,
)

torch.set_num_threads(1)

TENSIONS = ((3.0, 3.0, 3.0, 3.0), (7.0, 3.0, 2.0, 3.0), (3.0, 6.0, 4.0, 2.0))
FORCES = ((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0, 0.1, -0.1))
SPACES = {
    "default": SpatialDesignSpace(),
    "planes and springs": SpatialDesignSpace(
        6, (3, 6), azimuth=(-0.5, 0.5), joint_stiffness=(1.0, 4.0), hole_radius=(2, 2.5)
    ),
    "joints of their own": SpatialDesignSpace(4, (4,), knots=5, convexity=(0.1, 0.3), alike=False, reach=(1.0, 1.5)),
}


def test_the_preset_is_a_point_of_the_default_space():
    space, preset = SPACES["default"], rj.pitch_yaw()
    x = space.vector(convexity=0.2, height=5.0, half_width=4.0, hole_radius=3.0, hole_depth=0.8)
    chain = space.mechanism(x)
    assert chain.neutral_lengths == pytest.approx(preset.neutral_lengths, rel=1e-14)
    here, there = rj.solve_tensions(chain, TENSIONS[1]), rj.solve_tensions(preset, TENSIONS[1])
    assert here.tip == pytest.approx(there.tip, abs=1e-11)
    assert here.tilting_margins == pytest.approx(there.tilting_margins, abs=1e-11)
    assert space.physical(x)[space.names.index("height [mm]")] == pytest.approx(5.0)


@pytest.mark.parametrize("name", SPACES)
def test_designs_with_margins_can_be_built_and_others_are_refused(name):
    space = SPACES[name]
    x = space.sample(400, np.random.default_rng(0), valid=False)
    margins = space.margins(torch.as_tensor(x)).numpy()
    assert margins.shape == (400, len(SPATIAL_MARGINS))
    good = (margins >= 0.0).all(-1)
    assert good.sum() > 0
    for vector in x[good][:10]:
        chain = space.mechanism(vector)
        assert chain.n_joints == space.n_joints and space.faults(chain) == []
        assert rj.solve_tensions(chain, np.full(chain.n_tendons, 3.0)).ok
    clear = x[(margins < -0.02).any(-1)]
    for vector in clear[:10]:
        with pytest.raises(MechanismError):
            space.mechanism(vector)


def test_each_margin_falls_below_zero_where_its_fault_begins():
    space = SpatialDesignSpace(convexity=(-0.1, 2.0), height=(1.0, 7.0), hole_radius=(2.0, 5.0), hole_depth=(0.0, 3.0))
    plain = {"convexity": 0.2, "height": 5.0, "half_width": 3.0, "hole_radius": 3.0, "hole_depth": 0.8}
    faults = {
        "rolling": {"convexity": -0.05},
        "radius": {"convexity": 1.5},
        "gaps": {"hole_depth": 0.1},
        "thickness": {"hole_depth": 2.4},
        "tube": {"hole_radius": 4.0},
    }
    assert (space.margins(torch.as_tensor(space.vector(**plain))) > 0.0).all()
    for i, name in enumerate(SPATIAL_MARGINS):
        vector = space.vector(**plain | faults[name])
        assert space.margins(torch.as_tensor(vector))[i] < 0.0, name
        with pytest.raises(MechanismError):
            space.mechanism(vector)


def held(chain, found):
    """The smallest force per deflection of the tip with held motors, by differences of the compiled solver."""
    lengths = found.lengths - found.tensions / chain.stiffnesses
    columns = []
    for axis in np.eye(3):
        tips = [
            rj.solve_lengths(chain, lengths, [rj.WorldForce(-1, tuple(sign * 1e-3 * axis))]).tip for sign in (1.0, -1.0)
        ]
        columns.append((tips[0] - tips[1]) / 2e-3)
    return 1.0 / np.linalg.eigvalsh(0.5 * (np.array(columns) + np.array(columns).T))[-1]


def test_objectives_are_those_of_the_compiled_solver():
    chain = rj.pitch_yaw(6)
    poses = [[rj.solve_tensions(chain, t, [rj.WorldForce(-1, f)]) for f in FORCES] for t in TENSIONS]
    flat = [pose for row in poses for pose in row]
    free = [rj.solve_tensions(chain, t) for t in TENSIONS]
    rest = rj.solve_tensions(chain, np.full(4, np.mean(TENSIONS)))
    moved = [[np.sum((pose.tip - start.tip) ** 2) for pose in row] for row, start in zip(poses, free, strict=True)]
    expected = {
        TiltingMargin(TENSIONS, FORCES): min(pose.tilting_margins.min() for pose in flat),
        ToothMargin(TENSIONS, FORCES): min(pose.tooth_margins().min() for pose in flat),
        PressingMargin(TENSIONS, FORCES): min(pose.pressing_margins.min() for pose in flat),
        FrictionRequired(TENSIONS, FORCES): max(pose.friction_required.max() for pose in flat),
        PlacementError(TENSIONS, FORCES): np.sqrt(np.mean(moved)),
        TipReach(TENSIONS[1:]): min(np.linalg.norm(pose.tip - rest_of(chain, TENSIONS[1:]).tip) for pose in free[1:]),
    }
    assert rest.ok
    assert measure(chain, expected) == pytest.approx(list(expected.values()), rel=1e-9)
    stiffest = measure(chain, [TipStiffness(TENSIONS)])[0]
    assert stiffest == pytest.approx(min(held(chain, pose) for pose in free), rel=1e-5)


def rest_of(chain, tensions):
    return rj.solve_tensions(chain, np.full(chain.n_tendons, np.mean(tensions)))


@pytest.mark.slow
@pytest.mark.parametrize("name", SPACES)
def test_gradients_of_costs_match_differences(name):
    space = SPACES[name]
    rows = tuple(row * len(space.ends) for row in TENSIONS)
    stiff, tilt = TipStiffness(rows), TiltingMargin(rows, FORCES)
    limits = (
        Limit(tilt, low=14.0),
        Limit(FrictionRequired(rows, FORCES), high=0.02),
        Limit(TipReach(rows[1:]), low=60.0),
    )
    problem = Problem(space, (Term(stiff, scale=0.01), Term(PlacementError(rows))), limits)
    rng = np.random.default_rng(3)
    x = 0.9 * space.sample(6, rng)
    step = rng.normal(size=x.shape)
    evaluation, gradient = problem.with_gradient(x)
    assert evaluation.ok.all() and not evaluation.feasible.any()
    h = 1e-5
    costs = [problem.evaluate(x + sign * h * step).cost for sign in (1.0, -1.0)]
    numeric = (costs[0] - costs[1]) / (2 * h)
    assert (gradient * step).sum(-1) == pytest.approx(numeric, rel=1e-5, abs=1e-7)
    _, jacobian = problem.with_jacobian(x[:2])
    assert jacobian.shape == (2, 1 + len(SPATIAL_MARGINS) + 3, space.dimensions)


def test_a_lifted_line_counts_as_the_most_friction():
    narrow = SpatialDesignSpace(half_width=(0.3, 4.0))
    x = narrow.vector(convexity=0.2, height=5.0, half_width=0.3, hole_radius=3.0, hole_depth=0.8)
    values = measure(narrow.mechanism(x), [TiltingMargin(TENSIONS), FrictionRequired(TENSIONS)])
    assert values[0] < 0.0 and values[1] == 10.0


@pytest.mark.parametrize(
    "settings",
    [
        {"n_joints": 0},
        {"ends": (3,)},
        {"ends": (6, 4, 12)},
        {"ends": 12},
        {"knots": 4},
        {"convexity": (0.3, 0.1)},
        {"wall": 0.0},
        {"alike": 1},
        {name: (1.0, 1.0) for name in ("height", "half_width", "hole_radius", "hole_depth")}
        | {"convexity": (0.2, 0.2)},
    ],
)
def test_wrong_spaces_are_refused(settings):
    with pytest.raises(ConfigError):
        SpatialDesignSpace(**settings)


def test_wrong_vectors_and_objectives_of_other_chains_are_refused():
    space = SPACES["default"]
    with pytest.raises(InvalidInput, match="one of"):
        space.vector(reach=1.25)
    with pytest.raises(InvalidInput, match=r"\[4, 7\]"):
        space.vector(height=9.0)
    with pytest.raises(InvalidInput, match="DifferentiableChain"):
        Problem(space, (Term(LateralStiffness()),))
    with pytest.raises(InvalidInput, match="DifferentiableSpatialChain"):
        Problem(DesignSpace(), (Term(TipStiffness(TENSIONS)),))
    with pytest.raises(InvalidInput, match="DifferentiableSpatialChain"):
        measure(rj.five_link(), [TipStiffness(TENSIONS)])
    with pytest.raises(InvalidInput, match="forces"):
        TipStiffness(TENSIONS, ((0.0, 1.0),))
