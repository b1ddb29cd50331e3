"""The exceptions: each names the value, what was expected and how to fix it."""

from __future__ import annotations


class RollingJointError(Exception):
    """Base of everything this project raises on purpose."""


class InvalidInput(RollingJointError, ValueError):
    """An argument that cannot be used.

    Args:
        what: the argument, as the caller knows it.
        value: the offending value.
        allowed: what was expected, in words.
        hint: what to do about it (optional).
    """

    def __init__(self, what: str, value: object, allowed: str, hint: str = "") -> None:
        self.what, self.value, self.allowed, self.hint = what, value, allowed, hint
        super().__init__(what, value, allowed, hint)

    def __str__(self) -> str:
        text = f"{self.what} = {_short(self.value)}: expected {self.allowed}."
        return f"{text} {self.hint}" if self.hint else text


class MechanismError(InvalidInput):
    """A mechanism that cannot be built."""


class ConfigError(InvalidInput):
    """A configuration file, or one of its keys, that cannot be used."""


class SolverError(RollingJointError, RuntimeError):
    """An equilibrium that the caller required and the solver could not give."""


def _short(value: object, limit: int = 120) -> str:
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits, which Python does not print
        text = f"a very large {type(value).__name__}"
    return text if len(text) <= limit else text[: limit - 3] + "..."
