"""Design spaces around a mechanism: changes, margins and the independent check, gradients of every kind of chain."""

import pickle

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.chain.random_chain import random_chain
from rollingjoint.errors import ConfigError, InvalidInput, MechanismError

torch = pytest.importorskip("torch")

from rollingjoint.design import (  # noqa: E402 - needs torch
    CHAIN_MARGINS,
    DesignSpace,
    LateralStiffness,
    Limit,
    Problem,
    SpatialDesignSpace,
    Term,
    TiltingMargin,
    TipStiffness,
    TipTravel,
)

torch.set_num_threads(1)


def mixed():
    """Two rolling joints with a hinge between them, and tendons that end at different links."""
    tube, arm = rj.pitch_yaw(2), rj.SpatialChain.from_arm(rj.small_arm(1))
    hinge = rj.PointHinge((0.0, 1.0, 0.0), above=(0.0, 0.0, -4.0), below=(0.0, 0.0, 4.0), stiffness=20.0)
    holes = [((x, y, -1.7), (x, y, 1.7)) for x, y in ((3.0, 0.0), (0.0, 3.0), (-3.0, 0.0), (0.0, -3.0))]
    tendons = [rj.SpaceTendon([hole], end) for hole, end in zip(holes, (3, 2, 3, 2), strict=True)]
    assert arm.n_joints == 1
    return rj.SpatialChain([tube.joints[0], hinge, tube.joints[1]], tendons, name="mixed")


SPACES = {
    "five_link": DesignSpace.of("five_link"),
    "five_link, wide": DesignSpace.of(
        "five_link", convexity=(-0.03, 0.08), height=(-4, 6), hole_radius=(-4, 3), knots=5, smallest_radius=8.0
    ),
    "uniform": DesignSpace.of(
        "uniform",
        convexity=(-0.06, 0.15),
        height=(-12, 5),
        hole_radius=(-8, 4),
        symmetric=True,
        curve="linear",
        knots=7,
    ),
    "every surface": DesignSpace.of(rj.two_segment(1, 1), convexity=(-0.05, 0.1), height=(-8, 4), alike=False),
    "pitch_yaw": DesignSpace.of(
        rj.pitch_yaw(4),
        convexity=(-0.1, 0.5),
        height=(-1, 2),
        hole_radius=(-1, 0.6),
        hole_depth=(-0.6, 0.6),
        azimuth=(-0.5, 0.5),
        half_width=(-1.0, 0.5),
        joint_stiffness=(-1, 3),
        tube_radius=4.3,
    ),
    "mixed": DesignSpace.of(
        mixed(), convexity=(-0.1, 0.1), height=(-0.5, 2), hole_radius=(-0.5, 0.4), azimuth=(-0.3, 0.3), alike=False
    ),
    "arm": DesignSpace.of("small_arm", hole_radius=(-3, 3), hole_depth=(-1.0, 1.0), azimuth=(-0.4, 0.4)),
}


def built(space, x):
    """The mechanism of a vector and its faults, without regard to the margins."""
    try:
        mechanism = space.chain(torch.as_tensor(x)).mechanism()
    except MechanismError as error:
        return [str(error)]
    return space.faults(mechanism)


@pytest.mark.parametrize("name", rj.chain.presets.PRESETS)
def test_the_reference_is_the_mechanism_itself(name):
    space, mechanism = DesignSpace.of(name), rj.preset(name)
    design = space.mechanism(space.reference())
    assert design.neutral_lengths == pytest.approx(mechanism.neutral_lengths, abs=1e-12)
    tensions = np.linspace(3.0, 5.0, mechanism.n_tendons)
    here, there = rj.solve_tensions(design, tensions), rj.solve_tensions(mechanism, tensions)
    assert here.tip[:2] == pytest.approx(there.tip[:2], abs=1e-9)
    assert (space.margins(torch.as_tensor(space.reference())) >= 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", SPACES)
def test_designs_with_margins_can_be_made(name):
    space = SPACES[name]
    x = space.sample(300, np.random.default_rng(0), valid=False)
    margins = space.margins(torch.as_tensor(x)).numpy()
    assert margins.shape == (300, len(CHAIN_MARGINS)) and np.isfinite(margins).all()
    good = np.flatnonzero((margins >= 0.0).all(-1))
    assert len(good) >= 3
    for vector in x[good][:8]:
        assert built(space, vector) == []
        chain = space.mechanism(vector)
        assert chain.n_tendons == space.base.n_tendons and chain.n_links == space.n_links
        assert rj.solve_tensions(chain, np.full(chain.n_tendons, 3.0)).ok


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_random_chains_have_designs_around_them(seed):
    rng = np.random.default_rng(seed)
    mechanism = random_chain(rng, 6)
    space = DesignSpace.of(mechanism, height=(-1.0, 1.0), alike=bool(seed % 2))
    own = space.chain(torch.as_tensor(space.reference())).mechanism()
    assert own.neutral_lengths == pytest.approx(mechanism.neutral_lengths, abs=1e-10)
    x = space.sample(40, rng, valid=False)
    good = x[(space.margins(torch.as_tensor(x)).numpy() >= 0.0).all(-1)]
    assert [built(space, vector) for vector in good[:4]] == [[]] * len(good[:4])


def test_a_link_with_surfaces_that_cross_is_too_thin():
    space = DesignSpace.of("uniform", height=(-19.0, 0.0), convexity=(0.0, 0.0))
    margins = space.margins(torch.as_tensor(space.vector(height=-19.0))).numpy()
    assert margins[CHAIN_MARGINS.index("thickness")] < 0.0
    with pytest.raises(MechanismError, match="thickness"):
        space.mechanism(space.vector(height=-19.0))


def test_springs_friction_and_weights_stay_the_mechanisms():
    friction, spring = rj.CapstanFriction(0.1), rj.TorsionSpring(1, 3.0)
    plain = rj.five_link()
    links = [rj.Link(link.parent, link.child, 0.3, (1.0, 2.0)) for link in plain.links]
    chain = rj.RollingChain(links, plain.tendons, "rubbing", [spring], friction)
    space = DesignSpace.of(chain)
    design = space.mechanism(space.reference())
    assert list(design.springs) == [spring] and design.has_friction
    assert [(link.weight, link.centre) for link in design.links] == [(0.3, (1.0, 2.0))] * 5
    assert design.friction_coefficients == pytest.approx(chain.friction_coefficients)
    heavy = rj.pitch_yaw(3, weight=0.2)
    assert DesignSpace.of(heavy).mechanism(DesignSpace.of(heavy).reference()).weights == pytest.approx(heavy.weights)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["five_link, wide", "uniform", "every surface", "pitch_yaw"])
def test_most_designs_that_can_be_made_have_margins(name):
    space = SPACES[name]
    x = space.sample(40, np.random.default_rng(1), valid=False)
    margins = space.margins(torch.as_tensor(x)).numpy()
    sound = np.array([not built(space, row) for row in x])
    assert sound.any()
    assert (margins[sound] >= 0.0).all(-1).mean() > 0.7


def test_a_change_moves_what_its_name_says():
    space = DesignSpace.of("five_link", convexity=(-0.01, 0.01), height=(-4.0, 4.0), hole_radius=(-2.0, 2.0))
    before, after = rj.five_link(), space.mechanism(space.vector(height=2.0, hole_radius=-1.0))
    assert [link.height for link in after.links] == pytest.approx([link.height + 2.0 for link in before.links])
    assert [hole.s for hole in after.tendons[0].holes[0]] == pytest.approx([-9.0, -9.0])
    grown = space.mechanism(space.vector(convexity=0.004))
    s = np.linspace(-15.0, 14.9, 7)
    for there, here in zip(before.links[1:-1], grown.links[1:-1], strict=True):
        assert here.child.curvature(s) == pytest.approx(there.child.curvature(s) - 0.004)
        assert here.parent.curvature(s) == pytest.approx(there.parent.curvature(s) + 0.004)
    tube = DesignSpace.of("pitch_yaw", azimuth=(-1.0, 1.0), hole_depth=(0.0, 0.5), joint_stiffness=(0.0, 2.0))
    turned = tube.mechanism(tube.vector(azimuth=np.linspace(-0.5, 0.6, 12), hole_depth=0.3, joint_stiffness=1.0))
    preset = rj.pitch_yaw()
    assert [joint.azimuth for joint in turned.joints] == pytest.approx(
        [joint.azimuth + turn for joint, turn in zip(preset.joints, np.linspace(-0.5, 0.6, 12), strict=True)]
    )
    assert turned.hole_points[0][3, :, 2] == pytest.approx([-1.4, 1.4])
    assert turned.joint_stiffnesses == pytest.approx(np.full(12, 3.0))
    arm = DesignSpace.of("small_arm", azimuth=(-1.0, 1.0))
    axis = arm.mechanism(arm.vector(azimuth=0.3)).joints[0].axis
    assert axis == pytest.approx((np.cos(0.3), np.sin(0.3), 0.0))


def test_alike_parts_share_a_number_and_others_have_their_own():
    assert DesignSpace.of("uniform", knots=3).dimensions == 6
    assert DesignSpace.of("uniform", knots=3, symmetric=True).dimensions == 4
    assert DesignSpace.of("uniform", knots=3, alike=False).dimensions == 2 * 4 * 3
    names = DesignSpace.of("uniform", hole_radius=(-1, 1), convexity=(0, 0)).names
    assert len(names) == 2 and names[0].startswith("tendon 0 link 0 child hole radius")
    assert len(DesignSpace.of("uniform", hole_radius=(-1, 1), convexity=(0, 0), symmetric=True).names) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", SPACES)
def test_gradients_match_differences(name):
    space = SPACES[name]
    rng = np.random.default_rng(3)
    x = 0.8 * space.sample(4, rng)
    step = rng.normal(size=x.shape)
    if space.base.dimension == 2:
        pull = [tuple(np.linspace(4.0, 5.0, space.base.n_tendons))]
        term, limit = Term(LateralStiffness(pull), scale=0.01), Limit(LateralStiffness(pull, 0.02), low=1.0)
    else:
        rows = ((3.0,) * 4, (5.0, 3.0, 2.0, 3.0))
        term, limit = Term(TipStiffness(rows), scale=0.01), Limit(TipStiffness(rows), low=1.0)
        if name == "pitch_yaw":
            limit = Limit(TiltingMargin(rows), low=40.0)
    problem = Problem(space, (term,), (limit,))
    evaluation, gradient = problem.with_gradient(x)
    assert evaluation.ok.all()
    h = 1e-6
    costs = [problem.evaluate(x + sign * h * step).cost for sign in (1.0, -1.0)]
    assert (gradient * step).sum(-1) == pytest.approx((costs[0] - costs[1]) / (2 * h), rel=2e-5, abs=1e-5)


def test_a_search_improves_a_mechanism_with_four_tendons():
    space = DesignSpace.of("two_segment", height=(-2.0, 4.0))
    problem = Problem(space, (Term(LateralStiffness([(3.0, 3.0, 4.0, 4.0)]), scale=0.01),))
    x = space.sample(64, np.random.default_rng(0))
    found = problem.evaluate(x)
    own = problem.against(rj.two_segment())
    assert found.feasible.mean() > 0.9 and found.values[found.feasible].max() > 1.3 * own


def test_a_space_survives_a_process_boundary():
    space = SPACES["mixed"]
    again = pickle.loads(pickle.dumps(space))
    assert again == space and hash(again) == hash(space)
    x = torch.as_tensor(space.sample(2, np.random.default_rng(0)))
    assert torch.equal(again.margins(x), space.margins(x))


@pytest.mark.parametrize(
    ("mechanism", "settings", "words"),
    [
        ("five_lnk", {}, "five_link"),
        (3, {}, "mechanism"),
        ("five_link", {"knots": 4}, "Take 5"),
        ("five_link", {"convexity": (0.1, -0.1)}, "Write"),
        ("five_link", {"azimuth": (-0.1, 0.1)}, "has no azimuth"),
        ("five_link", {"hole_depth": (-0.1, 0.1)}, "has no hole depth"),
        ("five_link", {"colour": 3}, "unknown key"),
        ("five_link", {"convexity": (0, 0)}, "low < high"),
        ("five_link", {"wall": 9.0}, "'holes'"),
        ("pitch_yaw", {"tube_radius": 3.0}, "'holes'"),
        ("small_arm", {"convexity": (-0.1, 0.1)}, "has no convexity"),
        ("five_link", {"curve": "round"}, "curve"),
        ("pitch_yaw", {"half_width": (-4.0, 0.0)}, "-3.8 or more"),
        ("pitch_yaw", {"joint_stiffness": (-5.0, 0.0)}, "-1.9 or more"),
    ],
)
def test_wrong_spaces_are_refused(mechanism, settings, words):
    with pytest.raises(ConfigError, match=words):
        DesignSpace.of(mechanism, **settings)


def test_wrong_vectors_are_refused():
    space = SPACES["uniform"]
    with pytest.raises(InvalidInput, match="one of convexity, height, hole_radius"):
        space.vector(azimuth=0.1)
    with pytest.raises(InvalidInput, match=r"\[-12, 5\]"):
        space.vector(height=9.0)
    with pytest.raises(InvalidInput, match="3"):
        space.vector(height=(1.0, 2.0, 3.0))
    with pytest.raises(InvalidInput, match="DifferentiableSpatialChain"):
        Problem(SPACES["arm"], (Term(TipTravel()),))
    assert isinstance(DesignSpace(), DesignSpace) and SpatialDesignSpace().margin_names != CHAIN_MARGINS
