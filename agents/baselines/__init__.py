"""The former name of agents.controllers: scripts and pickles that name modules and classes by it go on working.

Modules:
    tune: the command that tunes settings, under its former name.
"""

import sys
from importlib import import_module

from agents.controllers import DoNothing, JacobianFeedback, LoadEstimate, OpenLoop, Predictive, baselines

__all__ = ["DoNothing", "JacobianFeedback", "LoadEstimate", "OpenLoop", "Predictive", "baselines"]

_MODULES = (
    "do_nothing",
    "feedback_settings",
    "filter_feedback",
    "filter_predictive",
    "friction_open_loop",
    "jacobian_feedback",
    "load_estimate",
    "open_loop",
    "opponents",
    "predictive",
    "privileged_teacher",
    "residual",
    "smith_predictor",
)
sys.modules |= {f"{__name__}.{name}": import_module(f"agents.controllers.{name}") for name in _MODULES}
