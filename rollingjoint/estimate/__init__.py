"""Hidden numbers of a mechanism in operation, from what its motors have measured (docs/estimation.md).

Modules:
    rig: what users call: estimators of rigs, with intervals.
    contact: the same beside a wall that they may touch.
    wall: this wall, and histories beside it.
    contact_kernels: as kernels, beside it.
    simulated: rigs whose truth is known.
    sampling: samples of a normal distribution within a box, compiled.
    hidden: the hidden numbers of an episode, and their distribution before any measurement.
    surfaces: the effects of displaced contact surfaces.
    kernels: histories of motors followed by many hidden numbers at once, compiled.
    derivatives: the effects of hidden numbers on an equilibrium.
    equations: the normal equations of a history.
    arrays: of all these.
    smoother: the most likely hidden numbers of episodes, step by step.
    arm_hidden: as hidden, for arms and chains in space with friction in their holes.
    arm_derivatives: as derivatives, for arms.
    arm_rows: as kernels, for arms.
    arm_smoother: as smoother, for arms.
"""

from rollingjoint.estimate.arm_hidden import LARGEST_TILT, ArmPrior, ArmRanges
from rollingjoint.estimate.arm_rows import ArmLaw, ArmRows, FollowedArm
from rollingjoint.estimate.arm_smoother import ArmEffort, ArmSmoother, is_served
from rollingjoint.estimate.arrays import MeasurementLaw, MotorHistory
from rollingjoint.estimate.contact import ContactSmoother
from rollingjoint.estimate.hidden import HiddenLayout, HiddenPrior, HiddenRanges
from rollingjoint.estimate.rig import Estimated, RigEstimator, RigFilter, RigSensors, RigSmoother, Samples
from rollingjoint.estimate.simulated import SimulatedRigs, simulated_rigs
from rollingjoint.estimate.smoother import Effort, Smoothed, Smoother
from rollingjoint.estimate.wall import Touching, WallRanges

__all__ = [
    "LARGEST_TILT",
    "ArmEffort",
    "ArmLaw",
    "ArmPrior",
    "ArmRanges",
    "ArmRows",
    "ArmSmoother",
    "ContactSmoother",
    "Effort",
    "Estimated",
    "FollowedArm",
    "HiddenLayout",
    "HiddenPrior",
    "HiddenRanges",
    "MeasurementLaw",
    "MotorHistory",
    "RigEstimator",
    "RigFilter",
    "RigSensors",
    "RigSmoother",
    "Samples",
    "SimulatedRigs",
    "Smoothed",
    "Smoother",
    "Touching",
    "WallRanges",
    "is_served",
    "simulated_rigs",
]  # fmt: skip
