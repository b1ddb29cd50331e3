"""Parameters of a mechanism from measurements: friction, stiffness, offsets, base angle, errors of surfaces.

Modules:
    doubts: what the data cannot tell.
    errors: how far predictions are from readings.
    findings: what fits to all runs and to each found.
    fit: least-squares fits, and the variances of what they find.
    identification: the function that does it all, and its result.
    lengths: measured tendon lengths met by tensions.
    measurement_file: YAML -> measurements.
    measurements: runs of steps with their inputs and readings.
    model: what would be read at given parameters, and its derivatives.
    parameters: what can be identified.
    path: the equilibria of a run, and their derivatives.
    pictures: profiles, residuals and poses as pictures.
    profile: profiles of a fit, and intervals.
    ranges: ranges for domain randomisation.
    reading: what would be read at an equilibrium.
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
