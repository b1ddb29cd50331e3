"""One page of reference for every module that users import from, written by mkdocstrings.

Its public names are those in `__all__`; where there is none, functions and classes that it defines, without underscore.
"""

from __future__ import annotations

import inspect
from types import ModuleType

MODULES = (
    "rollingjoint",
    "rollingjoint.statics.sensitivity",
    "rollingjoint.transmission",
    "rollingjoint.differentiable",
    "rollingjoint.design",
    "rollingjoint.identify",
    "rollingjoint.inverse",
    "rollingjoint.plan",
    "rollingjoint.estimate",
    "rollingjoint.plotting",
    "rollingjoint.io.mechanism_file",
    "rollingjoint.io.surroundings_file",
    "rollingjoint.cad",
    "rollingjoint.camera",
    "rollingjoint.mujoco",
    "rj_gym",
    "rj_gym.sb3",
    "rj_gym.torch_env",
    "rj_gym.vector_checker",
    "agents.shipped",
    "agents.evaluate",
    "agents.controllers.controller",
    "agents.controllers",
    "agents.dataset",
    "agents.results",
    "agents.robots",
)


def public_names(module: ModuleType) -> list[str]:
    """Names that users may import from a module, former ones left out."""
    if hasattr(module, "__all__"):
        return sorted(module.__all__)
    defined = {name: value for name, value in vars(module).items() if inspect.getmodule(value) is module}
    return sorted(name for name, value in defined.items() if value.__name__ == name and not name.startswith("_"))


def pages() -> dict[str, str]:
    """A page for every module, which mkdocstrings fills, by its path on the site."""
    return {f"reference/{module}.md": page(module) for module in MODULES}


def page(module: str) -> str:
    """The page of a module."""
    installed = f"\nInstalled: `rj_{module}`.\n" if module.startswith("agents.") else ""
    return f"# {module}\n{installed}\n::: {module}\n"
