"""The optimisers by name. For another one: a class as agents.search.optimiser describes it, and its line here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from importlib import import_module
from typing import Any

from agents.search.optimiser import Optimiser, Setup
from rollingjoint.checked_yaml import mapping
from rollingjoint.errors import ConfigError

METHODS = {
    "random": "random_search.RandomSearch",
    "latin_hypercube": "latin_hypercube.LatinHypercube",
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
    own = [field for field in fields(optimiser) if field.name != "setup"]
    needed = [field.name for field in own if field.default is MISSING]
    checked = mapping(f"methods.{name}", settings, [field.name for field in own], needed)
    try:
        return optimiser(setup, **checked)
    except ConfigError as error:
        raise ConfigError(f"methods.{name}.{error.what}", error.value, error.allowed, error.hint) from error
