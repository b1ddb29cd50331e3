"""Tables of settings between marks of pages in docs/, from annotations and docstrings.

Run: python docs/_pages/settings.py
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any

from agents.codesign.config import PairConfig, SearchAround
from agents.codesign.hold import TipHold
from agents.codesign.lumen import LumenPush
from agents.codesign.pair import PairSettings
from agents.runs.algorithms import PARAMETERS
from agents.runs.checks import checks_of
from agents.runs.config import SECTIONS, TrainConfig
from agents.search.config import SearchConfig
from agents.tuning.study import StudyConfig
from rollingjoint.tables import markdown_table

DOCS = Path(__file__).resolve().parents[1]
HEAD = ("Key", "Values", "Default", "Meaning")
BEGIN, END = "<!-- begin: settings of {} -->", "<!-- end -->"


def training_table() -> str:
    """The keys of a training configuration, those of its sections below it."""
    rows: list[tuple[str, ...]] = []
    for name, row in settings_rows(TrainConfig).items():
        section = SECTIONS.get(name)
        rows += [row] if section is None or name == "her" else []
        rows += [] if section is None else settings_rows(section, f"{name}.").values()
    return markdown_table(HEAD, rows, left=4)


def parameters_table() -> str:
    """The keys of `parameters`: values, and the algorithms that take them."""
    takers: dict[tuple[str, str], list[str]] = {}
    for algorithm, checks in PARAMETERS.items():
        for name, check in checks.items():
            takers.setdefault((name, check.allowed), []).append(f"`{algorithm}`")
    rows = [(f"`{name}`", allowed, ", ".join(names)) for (name, allowed), names in sorted(takers.items())]
    return markdown_table(("Key of `parameters`", "Values", "Algorithms"), rows, left=3)


def study_table() -> str:
    """The keys of a study beside the training configuration and the space."""
    return markdown_table(HEAD, list(settings_rows(StudyConfig).values())[2:], left=4)


def search_table() -> str:
    """The keys of a search file."""
    return markdown_table(HEAD, list(settings_rows(SearchConfig).values()), left=4)


def codesign_table() -> str:
    """The keys of a co-design file, those of `pairs` and `search` below them."""
    rows = [*settings_rows(PairConfig).values()]
    rows += [*settings_rows(PairSettings, "pairs.").values(), *settings_rows(SearchAround, "search.*.").values()]
    return markdown_table(HEAD, rows, left=4)


def lumen_table() -> str:
    """The keys of the task in the lumen."""
    return markdown_table(HEAD, list(settings_rows(LumenPush).values()), left=4)


def hold_table() -> str:
    """The keys of the tasks at the tip."""
    return markdown_table(HEAD, list(settings_rows(TipHold).values()), left=4)


TABLES: dict[str, dict[str, Callable[[], str]]] = {
    "training.md": {"a run": training_table, "parameters": parameters_table, "a study": study_table},
    "design_search.md": {"a search": search_table},
    "codesign.md": {"a co-design": codesign_table, "the lumen": lumen_table, "the tip": hold_table},
}


def settings_rows(kind: type, prefix: str = "") -> dict[str, tuple[str, ...]]:
    """Cells of HEAD for every field of a settings class, by its name."""
    checks, meanings = checks_of(kind), dict(_meanings(kind))
    return {
        field.name: (
            f"`{prefix}{field.name}`",
            checks[field.name].allowed if field.name in checks else "",
            _default(field),
            meanings[field.name],
        )
        for field in fields(kind)
    }


def _meanings(kind: type) -> Iterator[tuple[str, str]]:
    """Names and meanings in the section Args of a docstring."""
    text = inspect.cleandoc(kind.__doc__ or "").partition("\nArgs:\n")[2]
    for name, meaning in re.findall(r"^    (\w+): (.*(?:\n        .*)*)", text, re.MULTILINE):
        yield name, " ".join(meaning.split()).rstrip(".")


def _default(field: Field[Any]) -> str:
    """The default as YAML has it; empty where there is none, or where it is a section of its own."""
    value = field.default
    if field.default_factory is dict:
        return "`{}`"
    if value is MISSING or value == "":
        return ""
    if value is None or isinstance(value, bool):
        return f"`{'null' if value is None else str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`{list(value)}`"
    return f"`{value:_}`" if isinstance(value, int) else f"`{value}`"


def with_tables(page: str, text: str) -> str:
    """The text of a page with its tables written anew."""
    for name, table in TABLES[page].items():
        begin = BEGIN.format(name)
        head, _, rest = text.partition(begin)
        text = f"{head}{begin}\n\n{table()}\n\n{END}{rest.partition(END)[2]}"
    return text


if __name__ == "__main__":
    for page in TABLES:
        path = DOCS / page
        path.write_text(with_tables(page, path.read_text("utf-8")), "utf-8")
