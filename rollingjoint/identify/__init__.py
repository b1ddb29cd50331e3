"""Parameters of a mechanism from measurements: friction, stiffness, offsets, base angle, errors of surfaces.

`identify` fits poses that were measured one by one; `identify_rig` a recording over time, with play and sheaths.

Modules:
    beliefs: numbers of a rig as vectors, with beliefs about them.
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
    recording: recordings of a rig, read and written.
    report: an identification as text and plain values.
    rig: the function `identify_rig` and its result.
    rig_files: an identified rig as text and files.
    twin: the model of a recorded rig.
"""

from rollingjoint.identify.identification import Identification, identify
from rollingjoint.identify.measurement_file import load_measurements, measurements_from_dict
from rollingjoint.identify.measurements import Input, Measurements, Run, Step
from rollingjoint.identify.parameters import KINDS
from rollingjoint.identify.recording import RecordedRun, RecordingWriter, RigRecording, read_recording, write_recording
from rollingjoint.identify.rig import IdentifiedRig, identify_rig
from rollingjoint.identify.rig_files import save_rig

__all__ = [
    "KINDS",
    "Identification",
    "IdentifiedRig",
    "Input",
    "Measurements",
    "RecordedRun",
    "RecordingWriter",
    "RigRecording",
    "Run",
    "Step",
    "identify",
    "identify_rig",
    "load_measurements",
    "measurements_from_dict",
    "read_recording",
    "save_rig",
    "write_recording",
]
