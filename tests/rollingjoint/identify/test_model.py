"""Derivatives of what would be read, along paths with and without friction."""

import numpy as np
import pytest

import rollingjoint as rj
from rollingjoint.identify.measurements import Input, Measurements, Run, Step
from rollingjoint.identify.model import MeasurementModel
from rollingjoint.identify.parameters import coefficients_of
from tests.rollingjoint.identify.synthetic import LENGTHS, TENSIONS, run_of

CLOSED = ["mu", "offsets", "stiffness", "base_angle"]
EVERY = {"position": 1.0, "angle": 0.1, "length": 0.5, "tension": 0.7}


def differences(model, values, step=1e-6):
    columns = [
        (model.predictions(values + change) - model.predictions(values - change)) / (2 * step)
        for change in step * np.eye(len(values))
    ]
    return -np.stack([(column * model.weights)[model.weights > 0] for column in columns], axis=-1)


@pytest.mark.parametrize("compliance", [0.0, 0.05])
@pytest.mark.parametrize(("given", "inputs"), [("tensions", TENSIONS), ("lengths", LENGTHS)])
def test_derivatives_along_a_path_with_stick_and_slip_are_central_differences(given, inputs, compliance):
    friction = rj.CapstanFriction(0.1, presliding=0.3, compliance=compliance)
    nominal = rj.five_link().replace(friction=friction)
    run = run_of(nominal, inputs, given, lengths=True, tensions=True)
    measurements = Measurements(nominal, [run], EVERY, given)
    model = MeasurementModel(measurements, coefficients_of(CLOSED, measurements))
    values = np.array([0.12, 0.1, -0.2, 1.1, 0.02])
    states = np.array([each.friction_states for each in model.equilibria(run, values)[1:]])
    assert np.any(np.abs(states) == 1) and np.any(np.abs(states) < 0.99)
    wanted = differences(model, values)
    assert np.abs(model.jacobian(values) - wanted).max() < 2e-6 * np.abs(wanted).max()


def test_derivatives_of_two_segments_with_tendons_of_different_ends():
    friction = rj.CapstanFriction(0.08, presliding=0.2)
    chain = rj.two_segment().replace(friction=friction)
    start = chain.neutral_lengths - 0.4
    moves = np.array([[0, 0, 0, 0], [-1, 1, 0, 0], [-0.8, 0.9, -0.5, 0.5], [0.5, -0.5, 0.2, -0.1]])
    run = run_of(chain, start + moves, "lengths", tensions=True)
    measurements = Measurements(chain, [run], EVERY, "lengths")
    model = MeasurementModel(measurements, coefficients_of(CLOSED, measurements))
    values = np.array([0.1, 0.02, -0.01, 0.03, 0.0, 0.95, 0.01])
    wanted = differences(model, values)
    assert np.abs(model.jacobian(values) - wanted).max() < 2e-6 * np.abs(wanted).max()


def test_derivative_by_mu_at_no_friction_is_that_of_the_smallest_friction():
    chain = rj.five_link()
    measurements = Measurements(chain, [run_of(chain, TENSIONS, "tensions")])
    model = MeasurementModel(measurements, coefficients_of(["mu"], measurements))
    forward = (model.residuals(np.array([1e-5])) - model.residuals(np.zeros(1))) / 1e-5
    assert np.abs(model.jacobian(np.zeros(1))[:, 0] - forward).max() < 1e-3 * np.abs(forward).max()


@pytest.mark.parametrize("name", ["surface_height", "surface_shift", "surface_turn", "presliding"])
def test_what_has_no_closed_derivative_is_differentiated_numerically(name):
    chain = rj.five_link().replace(friction=rj.CapstanFriction(0.1, presliding=0.5))
    measurements = Measurements(chain, [run_of(chain, LENGTHS, "lengths")], given="lengths")
    model = MeasurementModel(measurements, coefficients_of([name], measurements))
    values = model.nominal + 0.01
    wanted = differences(model, values, step=1e-5)
    assert np.abs(model.jacobian(values) - wanted).max() < 1e-4 * np.abs(wanted).max() > 0


@pytest.mark.parametrize(("friction", "names"), [(None, CLOSED[1:3]), (rj.CapstanFriction(0.1, 0.3), CLOSED[:3])])
def test_an_arm_has_the_same_derivatives(friction, names):
    arm = rj.small_arm().replace(friction=friction)
    inputs = arm.neutral_lengths + np.array([[-2.0, 0, 1, 0], [-1.0, -2, 0, 1], [-1.2, -1.5, 0, 1], [-2, 0, 1, 0]])
    path = rj.trace(arm, inputs)
    steps = [
        Step(lengths=lengths, tensions=tensions, positions=poses[:, :3, 3])
        for lengths, tensions, poses in zip(inputs, path.tensions, path.poses, strict=True)
    ]
    measurements = Measurements(arm, [Run("A", steps)], {"position": 1.0, "tension": 1.0}, "lengths")
    model = MeasurementModel(measurements, coefficients_of(names, measurements))
    assert np.abs(model.residuals(model.nominal)).max() < 1e-9
    values = np.array([0.12, 0.1, -0.1, 0.2, 0.0, 1.2][-len(model.coefficients) :])
    wanted = differences(model, values)
    assert np.abs(model.jacobian(values) - wanted).max() < 2e-6 * np.abs(wanted).max()


def test_lengths_met_by_tensions_are_those_of_the_solver():
    chain = rj.five_link()
    lengths = [(97.89, 95.41), (85.82, 108.33), (102.11, 93.65)]
    wanted = [rj.solve_lengths(chain, each, method="least_squares") for each in lengths]
    steps = [Step(lengths=each, positions=eq.poses[:, :2]) for each, eq in zip(lengths, wanted, strict=True)]
    measurements = Measurements(chain, [Run("A", steps)], given="lengths", method="least_squares")
    model = MeasurementModel(measurements, coefficients_of(["offsets"], measurements))
    assert np.abs(model.residuals(model.nominal)).max() < 1e-6


def test_an_approach_matters_with_friction_and_not_without():
    chain = rj.five_link()
    runs = [
        Run("direct", [Step(tensions=(3.0, 3.0), positions=np.zeros((5, 2)))]),
        Run("round", [Step((3.0, 3.0), approach=[Input("tensions", (9.0, 3.0))], positions=np.zeros((5, 2)))]),
    ]
    measurements = Measurements(chain, runs)
    model = MeasurementModel(measurements, coefficients_of(["mu"], measurements))
    apart = [np.ptp(model.predictions(np.array([mu])), axis=0)[:10].max() for mu in (0.0, 0.1)]
    assert apart[0] < 1e-9 and apart[1] > 1.0
