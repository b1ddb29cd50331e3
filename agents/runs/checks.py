"""Settings with their ranges: checks of values, and of fields that are annotated with one; all raise ConfigError.

A setting states its range once, in its annotation, `goals: Annotated[int, integer(1, 100)] = 4`. The check, its error
and the table of the documentation (docs/_pages/settings.py) follow from that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, get_type_hints

from rollingjoint.checks import as_boolean, as_choice, as_integer, as_number
from rollingjoint.errors import ConfigError, InvalidInput


@dataclass(frozen=True)
class Check:
    """A check, called with the name of a value and the value.

    Args:
        plain: the function behind it: the value in its plain form, or ConfigError. allowed: its range, for tables.
    """

    plain: Callable[[str, Any], Any]
    allowed: str

    def __call__(self, what: str, value: Any) -> Any:
        """The value in its plain form; raises ConfigError."""
        return self.plain(what, value)


boolean = Check(partial(as_boolean, error=ConfigError), "true, false")


def integer(low: int, high: float = math.inf) -> Check:
    """Accepts integers in [low, high]; 2.0 becomes 2."""
    return Check(partial(as_integer, low=low, high=high, error=ConfigError), _range(low, high))


def number(low: float = -math.inf, high: float = math.inf) -> Check:
    """Accepts finite numbers in [low, high]."""
    return Check(partial(as_number, low=low, high=high, error=ConfigError), _range(low, high))


def _range(low: float, high: float) -> str:
    """The range [low, high] for a table."""
    if low == -math.inf:
        return "any number" if high == math.inf else f"at most {_figure(high)}"
    return f"{_figure(low)} or more" if high == math.inf else f"{_figure(low)} to {_figure(high)}"


def _figure(value: float) -> str:
    return f"{value:g}" if value % 1 else f"{int(value):,}"


episode_count = integer(1, 100_000)
job_count = integer(1, 1024)
seed_number = integer(0, 2**31)
step_count = integer(1, 10**12)


def choice(*choices: str) -> Check:
    """Accepts one of these words."""
    return Check(partial(as_choice, choices=choices, error=ConfigError), ", ".join(f"`{word}`" for word in choices))


def integers(low: int, high: float = math.inf, most: int = 1000) -> Check:
    """Accepts a list of at most `most` integers in [low, high]; it becomes a tuple."""
    check_each = integer(low, high)

    def check(what: str, values: Any) -> tuple[int, ...]:
        if not isinstance(values, list | tuple) or len(values) > most:
            raise ConfigError(what, values, f"a list of at most {most:,} integers")
        return tuple(map(partial(check_each, what), values))

    return Check(check, f"a list of at most {most:,}, each {check_each.allowed}")


def optional(check: Check) -> Check:
    """Accepts None, too."""
    return Check(lambda what, value: None if value is None else check(what, value), f"null; {check.allowed}")


@contextmanager
def prefixed(prefix: str, error: type[InvalidInput] = ConfigError) -> Iterator[None]:
    """Puts a prefix before the names in complaints about values, which become `error`."""
    try:
        yield
    except InvalidInput as found:
        raise error(f"{prefix}{found.what}", found.value, found.allowed, found.hint) from found


def check_fields(instance: Any, prefix: str = "") -> None:
    """Check the annotated fields of a dataclass and store their plain form; for __post_init__.

    Args:
        instance: the dataclass, frozen or not. prefix: of the names in messages, such as "policy.".
    """
    for name, check in checks_of(instance.__class__).items():
        object.__setattr__(instance, name, check(f"{prefix}{name}", getattr(instance, name)))


@cache
def checks_of(kind: type) -> Mapping[str, Check]:
    """The checks of a dataclass by name of the field, from annotations such as Annotated[int, integer(1, 100)]."""
    hints = get_type_hints(kind, include_extras=True)
    extras_of = {name: getattr(hint, "__metadata__", ()) for name, hint in hints.items()}
    return {name: check for name, extras in extras_of.items() for check in extras if isinstance(check, Check)}
