"""Hidden numbers of a mechanism in operation, from what its motors have measured.

Modules:
    hidden: the hidden numbers of an episode, and what is known of them before any measurement.
    surfaces: what displaced contact surfaces change.
    kernels: histories of motors followed by many hidden numbers at once, compiled.
    smoother: the most likely hidden numbers of episodes, step by step.
"""

from rollingjoint.estimate.hidden import HiddenLayout, HiddenPrior, HiddenRanges
from rollingjoint.estimate.kernels import MeasurementLaw
from rollingjoint.estimate.smoother import Effort, Smoothed, Smoother

__all__ = ["Effort", "HiddenLayout", "HiddenPrior", "HiddenRanges", "MeasurementLaw", "Smoothed", "Smoother"]
