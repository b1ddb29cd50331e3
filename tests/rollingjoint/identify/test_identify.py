"""Known parameters are found again, with honest intervals; what data cannot tell is said."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rollingjoint as rj
from rj_gym.tracking.config import RandomizationConfig, TrackingConfig
from rollingjoint.errors import InvalidInput, SolverError
from rollingjoint.identify import Measurements, Run, Step, identify, load_measurements
from rollingjoint.identify.fit import fit
from rollingjoint.identify.model import MeasurementModel
from rollingjoint.identify.parameters import coefficients_of, varied
from rollingjoint.identify.profile import linear_profile, profile
from tests.rollingjoint.identify.synthetic import LENGTHS, TENSIONS, run_of, stretched

DATA = Path(__file__).parents[3] / "examples" / "data"
CHAIN = rj.five_link()


def fitted(measurements, *parameters):
    return fit(MeasurementModel(measurements, coefficients_of(parameters, measurements)))


def test_friction_and_base_angle_are_found_again_from_poses_under_tensions():
    run = run_of(CHAIN.replace(friction=rj.CapstanFriction(0.13)), TENSIONS, "tensions", base_angle=0.03)
    found = identify(Measurements(CHAIN, [run]), ["mu", "base_angle"], intervals="linear")
    assert found.values == pytest.approx({"mu": 0.13, "base_angle": 0.03}, abs=1e-6)
    assert all(high - low < 1e-4 for low, high in found.intervals.values())


def test_stiffness_offsets_and_friction_are_found_again_from_lengths_and_tensions():
    true = stretched(CHAIN, 1.3).replace(friction=rj.CapstanFriction(0.05))
    run = run_of(true, LENGTHS, "lengths", offsets=np.array([0.4, -0.7]), tensions=True)
    measurements = Measurements(CHAIN, [run], {"tension": 0.1}, "lengths")  # the pose is not fitted
    found = fitted(measurements, "stiffness", "offsets", "mu")
    assert found.values == pytest.approx([1.3, 0.4, -0.7, 0.05], abs=1e-5)


def test_offsets_are_found_again_from_lengths_read_under_tensions():
    run = run_of(CHAIN, TENSIONS, "tensions", offsets=np.array([0.4, -0.7]), lengths=True)
    found = fitted(Measurements(CHAIN, [run], {"length": 0.1}), "offsets")
    assert found.values == pytest.approx([0.4, -0.7], abs=1e-9)


def presliding_run(size):
    """Moves of so many mm of a mechanism with mu = 0.1 and a presliding of 0.3 mm, fitted for both."""
    true = CHAIN.replace(friction=rj.CapstanFriction(0.1, presliding=0.3))
    moves = np.array([[0.0, 0.0], [-1.0, 1.0], [-2.0, 2.0], [-1.5, 1.6], [-1.0, 1.5], [0.0, 0.0]])
    lengths = np.array([90.0, 99.5]) + size * moves
    nominal = CHAIN.replace(friction=rj.CapstanFriction(0.05))
    measurements = Measurements(nominal, [run_of(true, lengths, "lengths")], given="lengths")
    return identify(measurements, ["mu", "presliding"], intervals="linear")


def test_presliding_is_found_again_from_moves_that_slip_and_turn_back():
    found = presliding_run(1.0)
    assert found.values == pytest.approx({"mu": 0.1, "presliding": 0.3}, abs=1e-4)
    assert found.ranges["friction"]["presliding"] == 0.3


def test_small_moves_tell_only_the_ratio_of_mu_and_presliding():
    found = presliding_run(0.05)
    assert found.values["mu"] / found.values["presliding"] == pytest.approx(1 / 3, rel=1e-3)
    assert any("cannot tell mu and presliding apart" in line for line in found.warnings)
    assert found.ranges == {}


def test_errors_of_surfaces_are_found_again():
    names = ["surface_height", "surface_turn"]
    nominal = MeasurementModel(Measurements(CHAIN, [run_of(CHAIN, TENSIONS, "tensions")]), ())
    values = nominal.values_in(nominal.measurements.runs[0], np.empty(0))
    true = varied(CHAIN, values | {"surface_height": 0.3, "surface_turn": -0.02})
    found = fitted(Measurements(CHAIN, [run_of(true, TENSIONS, "tensions")]), *names)
    assert found.values == pytest.approx([0.3, -0.02], abs=1e-6)


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say():
    """Errors shared by all links of a step, which intervals for independent readings would miss."""
    rng, hits, count = np.random.default_rng(1), 0, 60
    run = run_of(CHAIN, TENSIONS, "tensions")
    for _ in range(count):
        turns = 0.01 * rng.normal(size=len(run.steps))
        steps = [
            replace(step, positions=turned(step.positions, turn)) for step, turn in zip(run.steps, turns, strict=True)
        ]
        found = fitted(Measurements(CHAIN, [Run("A", steps)]), "base_angle")
        low, high = linear_profile(found, 0, 0.9).interval
        hits += low <= 0.0 <= high
    assert 0.8 < hits / count < 0.98


def turned(positions, angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return positions @ np.array([[cos, sin], [-sin, cos]])


def test_inflation_is_that_of_the_jackknife_over_steps():
    run = run_of(CHAIN, TENSIONS, "tensions", noise=0.3, seed=3)
    shifted = [replace(step, positions=step.positions + 0.4 * k) for k, step in enumerate(run.steps)]
    whole = fitted(Measurements(CHAIN, [Run("A", shifted)]), "base_angle")
    left = [
        fitted(Measurements(CHAIN, [Run("A", shifted[:k] + shifted[k + 1 :])]), "base_angle").values[0]
        for k in range(len(shifted))
    ]
    jackknife = (len(left) - 1) / len(left) * np.sum((np.array(left) - whole.values[0]) ** 2)
    assert whole.inflations[0] * whole.variances[0] == pytest.approx(jackknife, rel=0.1)
    assert whole.inflations[0] > 2


def test_an_interval_ends_where_the_data_fit_worse_by_its_limit():
    run = run_of(CHAIN.replace(friction=rj.CapstanFriction(0.1)), TENSIONS, "tensions", noise=0.5)
    measurements = Measurements(CHAIN, [run], {"position": 0.5}, absolute=True)
    found = fitted(measurements, "mu", "base_angle")
    curve = profile(found, 0, 0.95)
    for end in curve.interval:
        fixed = replace(measurements, mechanism=CHAIN.replace(friction=rj.CapstanFriction(end)))
        assert fitted(fixed, "base_angle").cost - found.cost == pytest.approx(3.841, rel=2e-3)
    assert linear_profile(found, 0, 0.95).interval == pytest.approx(curve.interval, abs=0.005)
    assert curve.bounded == (True, True)


def test_what_the_readings_say_nothing_about_keeps_its_nominal_value():
    found = identify(Measurements(CHAIN, [run_of(CHAIN, TENSIONS, "tensions", noise=0.1)]), ["stiffness", "mu"])
    assert found.values["stiffness"] == 1.0
    assert any("say nothing about stiffness" in line for line in found.warnings)
    assert any("one run: no cross-validation" in line for line in found.warnings)
    assert "not determined" in found.report()
    assert "randomization" not in found.ranges


def test_parameters_with_the_same_effect_are_named():
    lengths = [(92.0, 96.0), (88.0, 102.0)]  # one unstretched length each would do for two numbers, not for four
    run = run_of(CHAIN, lengths, "lengths", tensions=True)
    steps = [replace(step, positions=None, angles=None) for step in run.steps[:1]]
    measurements = Measurements(CHAIN, [Run("A", steps)], {"tension": 1.0}, "lengths")
    found = identify(measurements, ["offsets", "stiffness"])
    assert any("cannot tell" in line and "stiffness" in line for line in found.warnings)
    assert "not determined" in found.report()


@pytest.mark.slow
def test_a_run_is_predicted_from_the_others_alone():
    runs = [
        run_of(CHAIN.replace(friction=rj.CapstanFriction(mu)), TENSIONS, "tensions", name, noise=0.05, seed=seed)
        for seed, (name, mu) in enumerate({"A": 0.05, "B": 0.15, "C": 0.05}.items())
    ]
    found = identify(Measurements(CHAIN, runs), ["mu", "base_angle:run"], intervals="linear")
    without = fitted(Measurements(CHAIN, runs[:2]), "mu", "base_angle:run")
    assert found.held_out["C"][[0, 3]] == pytest.approx([without.values[0], np.mean(without.values[1:])], abs=1e-7)
    assert found.errors("position", "held out", "B").mean > found.errors("position", "alone", "B").mean
    assert any(line.startswith("mu differs between the runs A and B") for line in found.warnings)
    assert not any("runs A and C" in line for line in found.warnings)
    settings = TrackingConfig(friction=found.ranges["friction"])
    low, high = settings.friction.mu
    assert low < 0.05 and high > 0.15


def test_two_photographed_runs_want_different_friction():
    for kind, together, runs, last in (
        ("raw", 0.036, {"A": 0.011, "B": 0.061}, (1.51, 1.11)),
        ("calibrated", 0.035, {"A": 0.007, "B": 0.063}, (1.25, 0.81)),
    ):
        measurements = load_measurements(DATA / f"two_runs_{kind}.yaml")
        found = identify(measurements, ["mu"], intervals="linear")
        assert found.values["mu"] == pytest.approx(together, abs=5e-4)
        assert {run: each.values[0] for run, each in found.alone.items()} == pytest.approx(runs, abs=5e-4)
        errors = [found.errors("position", which).last for which in ("nominal", "together")]
        assert errors == pytest.approx(last, abs=0.005)
        assert any("mu differs between the runs A and B" in line for line in found.warnings)


def test_ranges_are_settings_of_the_environment():
    run = run_of(stretched(CHAIN, 1.1), LENGTHS, "lengths", offsets=-0.3, noise=0.2, tensions=True)
    measurements = Measurements(CHAIN, [run], {"position": 1.0, "tension": 1.0}, "lengths")
    parameters = ["stiffness", "offsets", "surface_height", "surface_turn"]
    found = identify(measurements, parameters, intervals="linear")
    settings = RandomizationConfig(**found.ranges["randomization"])
    assert settings.stiffness_spread > 0.09 and settings.actuator_offset_mm > 0.25
    assert set(found.ranges["randomization"]) == {
        "stiffness_spread", "actuator_offset_mm", "link_tolerance_mm", "link_tolerance_rad",
    }  # fmt: skip
    json.dumps(found.as_dict(), allow_nan=False)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ([], "at least one of mu"),
        (["my"], "Did you mean 'mu'"),
        (["mu", "mu:run"], "every name once"),
        (["mu:runs"], "mu, or mu:run"),
    ],
)
def test_wrong_parameters_are_refused(parameters, message):
    measurements = Measurements(CHAIN, [run_of(CHAIN, TENSIONS, "tensions")])
    with pytest.raises(InvalidInput, match=message):
        identify(measurements, parameters)


def test_inputs_without_any_equilibrium_are_refused():
    steps = [Step(tensions=(0.0, 0.0), positions=np.zeros((5, 2)))]
    with pytest.raises(SolverError, match="no equilibrium"):
        identify(Measurements(CHAIN, [Run("A", steps)]), ["base_angle"])
