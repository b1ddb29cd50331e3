"""Hidden numbers of a mechanism in operation, from what its motors have measured.

Modules:
    hidden: the hidden numbers of an episode, and what is known of them before any measurement.
    surfaces: what displaced contact surfaces change.
    kernels: histories of motors followed by many hidden numbers at once, compiled.
    derivatives: what hidden numbers change at an equilibrium.
    equations: the normal equations of a history.
    arrays: of all these.
    smoother: the most likely hidden numbers of episodes, step by step.
"""

from rollingjoint.estimate.arrays import MeasurementLaw
from rollingjoint.estimate.hidden import HiddenLayout, HiddenPrior, HiddenRanges
from rollingjoint.estimate.smoother import Effort, Smoothed, Smoother

__all__ = ["Effort", "HiddenLayout", "HiddenPrior", "HiddenRanges", "MeasurementLaw", "Smoothed", "Smoother"]
