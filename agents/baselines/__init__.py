"""The former name of agents.controllers: scripts and pickles that name modules and classes by it go on working.

Modules:
    tune: the command that tunes settings, under its former name.
"""

import sys
from importlib import import_module
from typing import Any

from agents import controllers

_MODULES = {
    "do_nothing": "controller",
    "feedback_settings": "steps",
    "filter_feedback": "filter_feedback",
    "filter_predictive": "filter_feedback",
    "friction_open_loop": "open_loop",
    "jacobian_feedback": "jacobian_feedback",
    "load_estimate": "predictive",
    "open_loop": "open_loop",
    "opponents": "tuned",
    "predictive": "predictive",
    "privileged_teacher": "privileged_feedback",
    "residual": "residual",
    "smith_predictor": "smith_predictor",
}
_modules = {name: import_module(f"agents.controllers.{place}") for name, place in _MODULES.items()}
sys.modules |= {f"{__name__}.{name}": module for name, module in _modules.items()}


def __getattr__(name: str) -> Any:
    return getattr(controllers, name)
