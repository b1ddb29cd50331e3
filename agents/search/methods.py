"""The optimisers by name; a new one is a class as agents.search.optimiser describes it, and a line here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from importlib import import_module
from typing import Any

from agents.runs.checks import prefixed
from agents.search.optimiser import Optimiser, Setup
from rollingjoint.checked_yaml import mapping

METHODS = {
    "random": "sampling.RandomSearch",
    "latin_hypercube": "sampling.LatinHypercube",
    "cma_es": "cma_es.CmaEs",
    "bayesian": "bayesian.Bayesian",
    "gradient": "gradient.Gradient",
    "sqp": "sqp.Sqp",
    "map_elites": "map_elites.MapElites",
}


def make(name: str, setup: Setup, settings: Mapping[str, Any]) -> Optimiser:
    """The optimiser of that name; raises ConfigError for settings that it does not have, or that it does not take."""
    module, kind = METHODS[name].split(".")
    optimiser = getattr(import_module(f"agents.search.{module}"), kind)
    settings_fields = [field for field in fields(optimiser) if field.name != "setup"]
    needed = [field.name for field in settings_fields if field.default is MISSING]
    checked = mapping(f"methods.{name}", settings, [field.name for field in settings_fields], needed)
    with prefixed(f"methods.{name}."):
        return optimiser(setup, **checked)
