"""Where the formulas are that are stated more than once: the table of docs/architecture.md, with the lines of today.

    python benchmarks/statements.py

A place in the table is `file: function`; files of `rollingjoint` are seen from there, others from the repository.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

REPOSITORY = Path(__file__).resolve().parents[1]
PAGE = REPOSITORY / "docs" / "architecture.md"
HEADING = "## Formulas that are stated more than once"


class Row(NamedTuple):
    """A row of the table: a formula, how many statements it has and should have at most, and where they are."""

    formula: str
    count: int
    goal: int
    places: list[tuple[str, str]]  # files, seen from the repository, and functions


def main() -> int:
    """Print the places; returns 1 where one of them does not exist, else 0."""
    missing = 0
    for formula, count, goal, places in table(PAGE.read_text("utf-8")):
        print(f"{formula}: {count} statements, at most {goal} wanted")
        for file, function in places:
            line = line_of(file, function)
            missing += line is None
            print(f"  {file}:{line or '?'} {function}")
    return int(missing > 0)


def table(page: str) -> list[Row]:
    """The rows of the table in the page."""
    section = page.partition(HEADING)[2].partition("\n## ")[0]
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in section.splitlines() if line.startswith("|")]
    return [Row(formula, int(count), int(goal), list(_places(places))) for formula, count, goal, places in cells[2:]]


def _places(cell: str) -> Iterator[tuple[str, str]]:
    for file, function in re.findall(r"`([\w/]+\.py): ([\w.]+)`", cell):
        is_whole = file.partition("/")[0] in ("rollingjoint", "rj_gym", "agents")
        yield file if is_whole else f"rollingjoint/{file}", function


def line_of(file: str, function: str) -> int | None:
    """The line in which a function, or a method named `Class.method`, begins; None where there is none."""
    path = REPOSITORY / file
    scope: ast.AST | None = ast.parse(path.read_text("utf-8")) if path.is_file() else None
    for name in function.split("."):
        inside = ast.iter_child_nodes(scope) if scope else ()
        named = (node for node in inside if isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name)
        scope = next(named, None)
    return getattr(scope, "lineno", None)


if __name__ == "__main__":
    sys.exit(main())
