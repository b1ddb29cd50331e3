"""Surfaces are integrated exactly, whatever their curvature."""

import contextlib
import copy
import io
import multiprocessing
import pickle
import time

import numpy as np
import pytest
from scipy.integrate import quad

from rollingjoint import InvalidInput, Link, MechanismError, Profile, RollingChain, Surface, Tendon
from rollingjoint.chain.joint_table import profile_table

PROFILES = {
    "constant": Profile.constant(-0.07),
    "flat": Profile.constant(0.0),
    "polynomial": Profile.polynomial([-0.05, 0.001, 0.002 / 25, -1e-6]),
    "piecewise_constant": Profile.piecewise_constant([-15, -3, 4, 15], [-0.04, 0.02, -0.06]),
    "piecewise_polynomial": Profile.piecewise_polynomial([-15, 0, 15], [[-0.1, 0.01, 0.0], [0.0, 0.0, -1e-4]]),
    "spline": Profile.spline([-15, -8, 0, 7, 15], [-0.02, -0.06, 0.01, -0.05, -0.03]),
    "samples": Profile.samples(np.linspace(-15, 15, 11), 0.05 * np.cos(np.arange(11.0))),
}


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_surface_points_match_adaptive_quadrature(profile):
    surface = Surface(profile, (0.3, -2.0), 0.4)
    for s in (-15.0, -7.7, -1e-3, 0.0, 5.1, 15.0):
        breaks = [b for b in profile.breaks if min(0, s) < b < max(0, s)] or None
        x, y = (
            quad(lambda t, f=f: f(surface.tangent_angle(t)), 0.0, s, epsabs=1e-13, limit=400, points=breaks)[0]
            for f in (np.cos, np.sin)
        )
        assert surface.point(s) == pytest.approx((0.3 + x, -2.0 + y), abs=1e-11)


@pytest.mark.parametrize("profile", PROFILES.values(), ids=PROFILES)
def test_turning_is_the_integral_of_curvature(profile):
    s = np.linspace(-15, 15, 4001)
    middle = 0.5 * (s[1:] + s[:-1])
    assert profile.turning(0.0) == pytest.approx(0.0, abs=1e-16)
    smooth = np.min(np.abs(middle[:, None] - profile.breaks), axis=1) > 0.01
    slope = np.diff(profile.turning(s)) / np.diff(s)
    assert slope[smooth] == pytest.approx(profile.curvature(middle)[smooth], abs=1e-6)


def test_profiles_of_the_same_numbers_are_equal_and_share_their_table():
    one, same, other = (Profile.polynomial([-0.05, 0.001], (-12, high)) for high in (12, 12, 12 + 1e-12))
    assert one == same != other and hash(one) == hash(same) and len({one, same, other}) == 2
    assert one != "profile" and Profile.constant(-0.05) != Profile.piecewise_constant([-15, 0, 15], [-0.05, -0.05])
    tables = [profile_table(profile, Profile.constant(0.0)) for profile in (one, same, other)]
    assert tables[0] is tables[1] is not tables[2]
    with pytest.raises(ValueError, match="read-only"):
        tables[0].cells[0, 0] = 0.0


COPIES = {"pickle": lambda profile: pickle.loads(pickle.dumps(profile)), "copy": copy.copy, "deepcopy": copy.deepcopy}


@pytest.mark.parametrize("kind", COPIES)
@pytest.mark.parametrize("name", PROFILES)
def test_a_copy_is_equal_read_only_and_without_what_was_computed(name, kind):
    profile = Profile(PROFILES[name].breaks, PROFILES[name].coefficients)
    points = profile.curve([-3.0, 2.0])
    copied = COPIES[kind](profile)
    assert type(copied) is Profile and set(copied.__dict__) == {"breaks", "coefficients"} < set(profile.__dict__)
    assert copied is not profile and copied == profile and hash(copied) == hash(profile)
    assert np.array_equal(copied.curve([-3.0, 2.0]), points)
    for array in (copied.breaks, copied.coefficients):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_another_process_gets_and_returns_equal_profiles():
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.map(copy.deepcopy, PROFILES.values()) == list(PROFILES.values())


class Calls(pickle.Unpickler):
    """Keeps what a pickle looks up."""

    def __init__(self, pickled):
        super().__init__(io.BytesIO(pickled))
        self.found = []

    def find_class(self, module, name):
        self.found.append(f"{module}.{name}")
        return super().find_class(module, name)


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_a_pickled_profile_calls_nothing_but_its_class_and_numpy(protocol):
    calls = Calls(pickle.dumps(PROFILES["spline"], protocol))
    assert calls.load() == PROFILES["spline"]
    assert [name for name in calls.found if not name.startswith(("numpy.", "_codecs."))] == [
        "rollingjoint.profile.Profile"
    ]


def test_a_pickle_of_unusable_numbers_is_refused_as_it_is_read():
    pickled = pickle.dumps(Profile.constant(-0.05, (-15.0, 15.0)))
    assert pickled.count(np.float64(15.0).tobytes()) == 1
    with pytest.raises(MechanismError, match="breaks"):
        pickle.loads(pickled.replace(np.float64(15.0).tobytes(), np.float64(-16.0).tobytes()))


def test_constant_curvature_is_a_circular_arc():
    s = np.linspace(-15, 15, 7)
    surface = Surface(Profile.constant(-1 / 12.0), (0.0, 10.0))
    circle = np.stack([12 * np.sin(s / 12), 10 - 12 * (1 - np.cos(s / 12))], axis=-1)
    assert surface.point(s) == pytest.approx(circle, abs=1e-13)


def test_spline_passes_through_its_knots():
    knots, values = [-10, -4, 0, 9], [0.1, -0.2, 0.05, 0.0]
    assert Profile.spline(knots, values).curvature(knots) == pytest.approx(values, abs=1e-15)


def test_pose_is_point_and_tangent_angle():
    surface = Surface(PROFILES["polynomial"], (1.0, 2.0), 0.1)
    assert surface.pose([1.0, 2.0]).shape == (2, 3)
    assert surface.pose(3.0)[2] == surface.tangent_angle(3.0)


@pytest.mark.parametrize(
    "build, name",
    [
        (lambda: Profile.constant(np.nan), "curvature = nan"),
        (lambda: Profile.constant("round"), "curvature = 'round'"),
        (lambda: Profile.constant(-0.05, (1.0, 15.0)), "contain s = 0"),
        (lambda: Profile.constant(-0.05, (5.0, -5.0)), "first < last"),
        (lambda: Profile.polynomial([0.1], 15.0), "profile limits = 15.0"),
        (lambda: Profile.polynomial([]), "at least one"),
        (lambda: Profile.piecewise_polynomial([-1, 0, 1], [[0.1, 0.2], [0.1]]), "rows of finite numbers"),
        (lambda: Profile.piecewise_constant([-1, 2, 1], [0.1, 0.2]), "increasing"),
        (lambda: Profile.piecewise_constant([-1, 0, 1], [0.1]), "one row per piece"),
        (lambda: Profile.spline([0, 0, 1], [1, 2, 3]), "increasing"),
        (lambda: Profile.polynomial("abc"), "numbers"),
        (lambda: Surface(-0.05), "a Profile"),
        (lambda: Surface(Profile.constant(0.1), (0.0, np.inf)), "surface start"),
        (lambda: Surface(Profile.constant(0.1), (0.0, 1.0, 2.0)), "(x, y)"),
    ],
)
def test_invalid_surfaces_name_the_value_and_the_range(build, name):
    with pytest.raises(MechanismError, match=name.replace("(", r"\(").replace(")", r"\)")):
        build()


def test_points_beyond_the_surface_are_refused():
    with pytest.raises(InvalidInput, match=r"\[-15, 15\] mm"):
        Surface(Profile.constant(-0.05)).point(15.1)


@pytest.mark.parametrize(
    "make, expected",
    [
        (lambda: Profile.constant(-0.05, (-6000.0, 6000.0)), "profile length = 12000.0: expected at most 10,000 mm"),
        (lambda: Profile.samples((-6000.0, 0.0, 6000.0), 3 * [-0.05]), "profile length = 12000.0: expected at most"),
        (lambda: Profile.constant(-50_000.0), "turning of a profile = 1500000.0: expected at most 2000 rad"),
        (lambda: Profile.constant(-1e300), "turning of a profile"),
        (lambda: Profile.polynomial([1e300] * 5, (-1.0, 1.0)), "turning of a profile"),
        (lambda: Profile.polynomial([1e-30] * 33, (-1.0, 1.0)), "at most 1,000 pieces with 32 coefficients"),
        (lambda: Profile.samples(np.linspace(-15.0, 15.0, 1002), np.full(1002, -0.05)), "at most 1,000 pieces"),
    ],
)
def test_surfaces_that_would_never_be_tabulated_are_refused_at_once(make, expected):
    begin = time.process_time()
    with pytest.raises(MechanismError, match=expected):
        make()
    assert time.process_time() - begin < 1.0


def _pair(child: Profile, parent: Profile) -> RollingChain:
    link = Link(Surface(parent, (0.0, -10.0)), Surface(child, (0.0, 10.0)))
    return RollingChain([link, link], [Tendon([((5.0, 0.0), (5.0, 0.0))])])


@pytest.mark.slow
@pytest.mark.parametrize("limits", [(-5000.0, 5000.0), (-999.0, 999.0), (-15.0, 15.0)])
def test_the_largest_surfaces_are_tabulated_in_seconds_or_refused(limits):
    u = -1999.0 / (limits[1] - limits[0])
    begin = time.process_time()
    with contextlib.suppress(MechanismError):
        assert _pair(Profile.constant(u, limits), Profile.constant(0.0, limits)).arrays.cells.size
    assert time.process_time() - begin < 5.0
