"""Checks of configuration values: those of rollingjoint.checks with their limits set; all raise ConfigError."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from rollingjoint.checks import as_boolean, as_choice, as_integer, as_number
from rollingjoint.errors import ConfigError, InvalidInput

Check = Callable[[str, Any], Any]  # name and value to the value in its plain form

boolean: Check = partial(as_boolean, error=ConfigError)


def integer(low: int, high: float = math.inf) -> Check:
    """Accepts integers in [low, high]; 2.0 becomes 2."""
    return partial(as_integer, low=low, high=high, error=ConfigError)


def number(low: float = -math.inf, high: float = math.inf) -> Check:
    """Accepts finite numbers in [low, high]."""
    return partial(as_number, low=low, high=high, error=ConfigError)


episode_count: Check = integer(1, 100_000)
job_count: Check = integer(1, 1024)
seed_number: Check = integer(0, 2**31)
step_count: Check = integer(1, 10**12)


def choice(*choices: str) -> Check:
    """Accepts one of these words."""
    return partial(as_choice, choices=choices, error=ConfigError)


def integers(low: int, high: float = math.inf, most: int = 1000) -> Check:
    """Accepts a list of at most so many integers in [low, high]; it becomes a tuple."""

    def check(what: str, values: Any) -> tuple[int, ...]:
        if not isinstance(values, list | tuple) or len(values) > most:
            raise ConfigError(what, values, f"a list of at most {most:,} integers")
        return tuple(map(partial(integer(low, high), what), values))

    return check


def optional(check: Check) -> Check:
    """Accepts None, too."""
    return lambda what, value: None if value is None else check(what, value)


@contextmanager
def prefixed(prefix: str, error: type[InvalidInput] = ConfigError) -> Iterator[None]:
    """Puts a prefix before the names in complaints about values, which become `error`."""
    try:
        yield
    except InvalidInput as found:
        raise error(f"{prefix}{found.what}", found.value, found.allowed, found.hint) from found


def check_fields(instance: Any, prefix: str = "", /, **checks: Check) -> None:
    """Check fields of a dataclass and store their plain form; for __post_init__.

    Args:
        instance: the dataclass, frozen or not.
        prefix: of the names in messages, such as "policy.".
        checks: by name of the field.
    """
    for name, check in checks.items():
        object.__setattr__(instance, name, check(f"{prefix}{name}", getattr(instance, name)))
