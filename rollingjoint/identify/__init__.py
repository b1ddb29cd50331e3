"""Parameters of a mechanism from measurements: friction, stiffness, offsets, base angle, errors of surfaces.

Modules:
    doubts: limits of the data, as warnings.
    errors: distances between predictions and readings.
    findings: estimates from all runs together and from each run.
    fit: least-squares fits, and the variances of their values.
    identification: the function `identify` and its result.
    lengths: tensions that meet measured tendon lengths.
    measurement_file: YAML -> measurements.
    measurements: runs of steps with their inputs and readings.
    model: predicted readings at given parameters, and their derivatives.
    parameters: the parameters that can be identified.
    path: the equilibria of a run, and their derivatives.
    pictures: profiles, residuals and poses as pictures.
    profile: profiles of a fit, and intervals.
    ranges: ranges for domain randomisation.
    reading: the predicted readings at an equilibrium.
    report: an identification as text and plain values.
"""

from rollingjoint.identify.identification import Identification, identify
from rollingjoint.identify.measurement_file import load_measurements, measurements_from_dict
from rollingjoint.identify.measurements import Input, Measurements, Run, Step
from rollingjoint.identify.parameters import KINDS

__all__ = [
    "KINDS",
    "Identification",
    "Input",
    "Measurements",
    "Run",
    "Step",
    "identify",
    "load_measurements",
    "measurements_from_dict",
]
