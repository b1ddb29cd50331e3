"""Design spaces: vectors and mechanisms correspond; margins promise what an independent check finds."""

import pickle

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.errors import ConfigError, InvalidInput, MechanismError

torch = pytest.importorskip("torch")

from rollingjoint.design import MARGINS, DesignSpace  # noqa: E402 - needs torch

torch.set_num_threads(1)

SPACES = {
    "default": DesignSpace(),
    "linear": DesignSpace(curve="linear", knots=9, height=(12, 25), half_width=(10, 16), hole=(5, 9)),
    "not alike": DesignSpace(alike=False, n_links=3, height=(15, 25)),
    "not symmetric": DesignSpace(symmetric=False, angle=(-0.2, 0.2), hole=(5, 10)),
    "neither": DesignSpace(
        alike=False, symmetric=False, n_links=3, curve="linear", convexity=(0.0, 0.08), half_width=(10, 18), hole=(5, 8)
    ),
    "round": DesignSpace(
        n_links=2, knots=3, convexity=(-0.1, 0.2), half_width=(12, 25), height=(3, 60), hole=(2, 10), wall=1.0
    ),
    "curled": DesignSpace(
        n_links=2, convexity=(-0.2, 0.25), half_width=(20, 20), height=(90, 90), hole=(2, 2), smallest_radius=3.0
    ),
}


def drawn(space, count, seed, valid=False):
    return space.sample(count, np.random.default_rng(seed), valid)


def margins(space, x):
    with torch.no_grad():
        return space.margins(torch.as_tensor(x)).numpy()


def faults(space, x):
    """What is wrong with a design, by the exact surfaces, whatever its margins."""
    try:
        return space.faults(space.chain(torch.as_tensor(x)).mechanism())
    except MechanismError as error:
        return [str(error)]


def test_the_dimensions_are_those_of_the_fields():
    assert DesignSpace().dimensions == 2 * 3
    assert DesignSpace(symmetric=False).dimensions == 2 * 5
    assert DesignSpace(alike=False).dimensions == 2 * 4 * 3
    full = DesignSpace(
        alike=False, symmetric=False, n_links=3, angle=(-0.1, 0.1), height=(19, 21), half_width=(14, 15), hole=(9, 10)
    )
    assert full.dimensions == 4 * 5 + 4 + 3 + 1 + 2 == len(full.names) == len(full.low) == len(full.high)
    assert DesignSpace().names[1] == "child convexity at s = 7.5 mm [1/mm]"
    assert full.names[-3:] == ("half width [mm]", "left hole [mm]", "right hole [mm]")


@pytest.mark.parametrize("name", SPACES)
def test_unit_and_physical_are_inverse_for_arrays_and_tensors(name):
    space = SPACES[name]
    x = drawn(space, 3, 0)
    assert space.unit(space.physical(x)) == pytest.approx(x, abs=1e-13)
    assert space.physical(torch.as_tensor(x)).numpy() == pytest.approx(space.physical(x), rel=1e-15)
    assert space.physical(np.ones(space.dimensions)) == pytest.approx(space.high)


@pytest.mark.parametrize("name", SPACES)
def test_a_mechanism_leads_back_to_its_vector(name):
    space = SPACES[name]
    for x in drawn(space, 2, 1, valid=True):
        assert space.vector(space.mechanism(x)) == pytest.approx(x, abs=1e-9)


def test_surfaces_are_the_curves_through_the_knots():
    space = SPACES["neither"]
    x = drawn(space, 1, 2, valid=True)[0]
    mechanism, value = space.mechanism(x), dict(zip(space.names, space.physical(x), strict=True))
    width = value["half width [mm]"]
    for place in (-1, -0.5, 0, 0.5, 1):
        child = value[f"link 1 child convexity at s = {place:g} half widths [1/mm]"]
        parent = value[f"link 2 parent convexity at s = {place:g} half widths [1/mm]"]
        assert mechanism.links[1].child.curvature(place * width) == pytest.approx(-child, abs=1e-12)
        assert mechanism.links[2].parent.curvature(place * width) == pytest.approx(parent, abs=1e-12)
    spline = rj.Profile.spline(np.linspace(-15, 15, 5), [0.05, 0.03, 0.02, 0.03, 0.05])
    given = DesignSpace().unit(np.array([0.02, 0.03, 0.05, 0.02, 0.03, 0.05]))
    s = np.linspace(-15, 15, 41)
    built = DesignSpace().mechanism(given).links[2].parent
    assert built.curvature(s) == pytest.approx(spline.curvature(s), abs=1e-15)


def test_what_rolls_on_nothing_mirrors_the_other_surface_of_its_link():
    space = DesignSpace(alike=False, symmetric=False, n_links=3, angle=(-0.1, 0.1), convexity=(0.0, 0.08))
    mechanism = space.mechanism(drawn(space, 1, 3, valid=True)[0])
    for link in (mechanism.links[0], mechanism.links[-1]):
        s = np.linspace(-15, 15, 31)
        assert link.child.point(s) * (1, -1) == pytest.approx(link.parent.point(s), abs=1e-12)


def test_the_uniform_preset_is_a_design():
    space = DesignSpace()
    assert space.vector(rj.preset("uniform")) == pytest.approx(space.reference(), abs=1e-12)
    assert (margins(space, space.reference()) > 0).all()


@pytest.mark.parametrize(
    ("mechanism", "message"),
    [
        (rj.uniform(4), "links of the mechanism = 4: expected 5"),
        (rj.two_segment(2, 2), "tendons"),
        (rj.uniform(radius=8.0), r"child convexity at s = 0 mm .* = 0.125: expected .*-0.03, 0.08"),
        (rj.uniform(height=22.0), r"height .* = 22.0: expected .*\[20, 20\]"),
        (rj.uniform(stiffness=4.0), "stiffnesses"),
        (rj.five_link(), "angle"),
    ],
)
def test_a_mechanism_outside_the_space_is_refused_by_name(mechanism, message):
    with pytest.raises(InvalidInput, match=message):
        DesignSpace().vector(mechanism)


def test_curvature_that_is_not_even_or_no_curve_through_the_knots_is_refused():
    skew = DesignSpace(symmetric=False, convexity=(0.02, 0.08))
    mechanism = skew.mechanism(drawn(skew, 1, 4, valid=True)[0])
    with pytest.raises(InvalidInput, match="curvature of the parent surface of link 0"):
        DesignSpace(convexity=(0.0, 0.09)).vector(mechanism)
    with pytest.raises(InvalidInput, match="curvature of the parent surface of link 0"):
        DesignSpace(symmetric=False, convexity=(0.0, 0.09), curve="linear").vector(mechanism)


@pytest.mark.slow
@pytest.mark.parametrize("name", SPACES)
def test_margins_promise_what_the_hard_check_finds(name):
    """And do not refuse much that it passes: the share over all spaces is in docs/design.md."""
    space = SPACES[name]
    x = drawn(space, 600, 5)
    least = margins(space, x).min(1)
    promised = np.flatnonzero(least >= 0)
    for i in promised[np.argsort(least[promised])][:6]:  # those next to the border
        assert faults(space, x[i]) == [], (least[i], x[i])
    assert len(promised) > 0


def test_margins_refuse_few_designs_without_a_fault():
    space = DesignSpace()
    x = drawn(space, 25, 6)
    good = np.array([not faults(space, row) for row in x])
    accepted = (margins(space, x) >= 0).all(1)
    assert not (accepted & ~good).any()
    assert accepted.sum() >= 0.9 * good.sum() > 7


@pytest.mark.parametrize(
    ("changes", "numbers", "margin", "fault"),
    [
        ({}, [0.02, 0.02, 0.02, -0.02, -0.02, -0.019], "rolling", "relative curvature"),
        ({"smallest_radius": 25.0}, [0.05] * 6, "radius", "radius of 20 mm, below 25"),
        ({"wall": 6.0, "hole": (5, 10)}, [0.05] * 6 + [9.5], "holes", "5.5 mm beside its hole"),
        ({"wall": 12.0, "hole": (3, 3), "height": (20, 21)}, [0.05] * 6 + [20.0], "thickness", "thick, below 12"),
    ],
)
def test_each_margin_and_the_hard_check_name_the_same_trouble(changes, numbers, margin, fault):
    space = DesignSpace(**changes)
    x = space.unit(np.array(numbers))
    found = margins(space, x)
    assert MARGINS[int(found.argmin())] == margin and found.min() < 0
    with pytest.raises(MechanismError, match=margin if margin != "rolling" else "curvature") as error:
        space.mechanism(x)
    assert margin == "rolling" or fault in str(error.value)


def test_surfaces_that_cut_into_each_other_away_from_the_contact_lack_clearance():
    """Curled surfaces: a share of those that roll everywhere meet elsewhere, and all those are refused."""
    space = SPACES["curled"]
    x = drawn(space, 400, 7)
    found = margins(space, x)
    rolling = np.flatnonzero(found[:, 0] > 0)[:12]
    overlapping = [i for i in rolling if any("overlap" in fault for fault in faults(space, x[i]))]
    assert len(overlapping) > 1
    assert (found[overlapping, 1] < 0).all()


@pytest.mark.parametrize("name", SPACES)
def test_gradients_of_chain_and_margins_match_differences(name):
    space = SPACES[name]
    x = torch.as_tensor(0.9 * drawn(space, 3, 8)).requires_grad_()
    direction = torch.as_tensor(np.random.default_rng(9).normal(size=x.shape))

    def outputs(at):
        chain = space.chain(at)
        parts = [chain.coefficients, chain.breaks, chain.starts, chain.angles, chain.hole_arcs]
        return [space.margins(at), *(part.flatten(1) for part in parts)]

    for place, output in enumerate(outputs(x)):
        weights = torch.as_tensor(np.random.default_rng(10).normal(size=output.shape))
        slope = torch.zeros(())
        if output.requires_grad:
            slope = (torch.autograd.grad((weights * output).sum(), x, retain_graph=True)[0] * direction).sum()
        h = 1e-5
        ahead, behind = (outputs(x.detach() + step * direction)[place] for step in (h, -h))
        assert float(slope) == pytest.approx(float((weights * (ahead - behind)).sum() / (2 * h)), rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("name", SPACES)
def test_any_numbers_have_finite_margins_and_rows_do_not_notice_each_other(name):
    space = SPACES[name]
    x = drawn(space, 6, 11)
    alone = margins(space, x)
    x = np.concatenate([x, 1e300 * x[:1], x[:1] + np.nan, x[:1] - np.inf, 3.0 * x[:1]])
    found = margins(space, x)
    assert np.isfinite(found).all()
    assert found[:6] == pytest.approx(alone, abs=1e-12)
    assert (found[7:9] == -1.0).all()
    assert found[9] == pytest.approx(margins(space, np.clip(x[9], -1, 1)), abs=1e-12)
    chain = space.chain(torch.as_tensor(x))
    assert chain.batch == (10,) and bool(chain.finite().all())
    plain = space.chain(torch.as_tensor(space.reference()))
    assert chain.coefficients[7].numpy() == pytest.approx(plain.coefficients.numpy(), abs=1e-16)


def test_leading_axes_of_any_number_are_kept():
    space = DesignSpace()
    x = torch.as_tensor(drawn(space, 6, 12))
    assert space.chain(x.reshape(2, 3, -1)).batch == (2, 3)
    flat = space.margins(x.reshape(2, 3, -1)).reshape(6, -1)
    assert flat.numpy() == pytest.approx(margins(space, x), abs=1e-12)
    assert space.margins(x[0]).shape == (len(MARGINS),)
    assert space.chain(x[0]).batch == ()
    assert space.margins(x[:0]).shape == (0, len(MARGINS))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("knots", 4, "Take 5"),
        ("knots", 1, "odd number"),
        ("n_links", 1, "2 to 1000"),
        ("curve", "quadratic", "linear"),
        ("convexity", (0.1, 0.0), "low <= high"),
        ("convexity", (0.0, float("nan")), "a finite number from -1 to 1"),
        ("height", (0.0, 20.0), "from 0.1 to 1000"),
        ("height", 20.0, r"\(low, high\)"),
        ("hole", (14.0, 15.0), "Move the holes inwards"),
        ("angle", (-0.1, 0.1), "symmetric to false"),
        ("stiffness", -1.0, "1e-06"),
        ("wall", "thick", "a number"),
        ("alike", 1, "true or false"),
        ("convexity", (0.05, 0.05), "needs a dimension"),
    ],
)
def test_a_field_that_cannot_be_used_is_refused_with_the_hint(field, value, message):
    with pytest.raises(ConfigError, match=message):
        DesignSpace(**{field: value})


def test_spaces_come_from_plain_values_and_survive_pickling():
    space = DesignSpace(**{"n_links": 3, "convexity": [0, 0.05], "height": [15, 20]})
    assert space == DesignSpace(n_links=3, convexity=(0.0, 0.05), height=(15.0, 20.0))
    assert pickle.loads(pickle.dumps(space)) == space and hash(space) == hash(pickle.loads(pickle.dumps(space)))
    assert repr(space) == "DesignSpace(n_links=3, convexity=(0.0, 0.05), height=(15.0, 20.0))"


def test_valid_samples_are_valid_and_repeat_with_the_seed():
    space = SPACES["not symmetric"]
    x = drawn(space, 300, 13, valid=True)
    assert x.shape == (300, space.dimensions) and (margins(space, x) >= 0).all()
    assert np.array_equal(x, drawn(space, 300, 13, valid=True))
    assert (margins(space, drawn(space, 300, 13)) < 0).any()


def test_more_than_a_fifth_of_the_default_space_is_valid():
    assert (margins(DesignSpace(), drawn(DesignSpace(), 2000, 14)) >= 0).all(1).mean() == pytest.approx(0.55, abs=0.03)


def test_a_space_without_valid_designs_says_how_many_it_drew(monkeypatch):
    monkeypatch.setattr("rollingjoint.design.box._MOST_DRAWN", 1000)
    with pytest.raises(InvalidInput, match="0 valid of 1024 drawn"):
        drawn(DesignSpace(convexity=(-0.03, 0.0)), 1, 15, valid=True)


@pytest.mark.parametrize("x", [np.zeros(5), np.full(6, 1.1), np.full(6, np.nan), "x"])
def test_a_mechanism_needs_a_vector_of_the_box(x):
    with pytest.raises(InvalidInput, match="in \\[-1, 1\\]"):
        DesignSpace().mechanism(x)
