"""Lint of names and prose: local names that are nouns, class names with one meaning, and plain English in docstrings.

    python .ci/prose.py          # the rates, and an error where one is above its limit
    python .ci/prose.py --list   # and the places

Rates of mannerisms are per 10,000 words of docstrings and comments, names a share of all assignments and parameters.
"""

from __future__ import annotations

import argparse
import ast
import io
import re
import sys
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PHRASES = {
    "what": r"\bwhat\b",
    "that of, those of": r"\b(?:that|those) of\b",
    "nothing, nobody": r"\b(?:nothing|nobody|somebody)\b",
    "of its own, so many": r"\b(?:of its own|so many|as many|beside)\b",
    "whose": r"\bwhose\b",
}
NO_NOUNS = frozenset(
    word
    for line in (
        "found known made one other some each here there own usual acting given said told seen kept left tried asked",
        "begun rest most least few both either beyond inside away back ahead only usable chosen wanted whole wide mine",
        "yours",
    )
    for word in line.split()
)
MOST_PHRASES, MOST_NAMES, MOST_DOUBLE_CLASSES = 15.0, 1.5, 3  # per 10,000 words; %; class names


class Measures(NamedTuple):
    """Of a package: mannerisms per 10,000 words, share of names that are no nouns [%], and their places."""

    rates: dict[str, float]
    names: float
    places: Counter[str]


def main() -> int:
    """Print the rates; 1 where a limit is passed, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--list", action="store_true", help="print the places, too")
    listed = parser.parse_args().list
    failures = []
    for package in ("rollingjoint", "rj_gym", "agents"):
        measures = measured(package)
        values = measures.rates | {"names": measures.names}
        print(f"{package}:", ", ".join(f"{name} {value:.1f}" for name, value in values.items()))
        for name, value in values.items():
            limit = MOST_NAMES if name == "names" else MOST_PHRASES
            if value > limit:
                failures.append(f"{package}: {name} {value:.1f}, at most {limit:g}")
        if listed:
            print(*(f"    {place} x{count}" for place, count in measures.places.most_common(60)), sep="\n")
    double = double_classes()
    print(f"class names with more than one meaning: {len(double)}, at most {MOST_DOUBLE_CLASSES}")
    if listed or len(double) > MOST_DOUBLE_CLASSES:
        print(*(f"    {name}: {', '.join(files)}" for name, files in sorted(double.items())), sep="\n")
    if len(double) > MOST_DOUBLE_CLASSES:
        failures.append(f"{len(double)} class names with more than one meaning, at most {MOST_DOUBLE_CLASSES}")
    for failure in failures:
        print(f"error: {failure}; python .ci/prose.py --list has the places", file=sys.stderr)
    return int(bool(failures))


def measured(package: str) -> Measures:
    """The measures of a package."""
    prose, places, names = [], Counter[str](), 0
    for path in sources(package):
        text = path.read_text("utf-8")
        tree, file = ast.parse(text), path.relative_to(ROOT).as_posix()
        words = " ".join([*_docstrings(tree), *_comments(text)]).lower()
        prose.append(words)
        for phrase, pattern in PHRASES.items():
            if count := len(re.findall(pattern, words)):
                places[f"{file}: {phrase}"] += count
        for name in _names(tree):
            names += 1
            if name in NO_NOUNS:
                places[f"{file}: name {name}"] += 1
    body = " ".join(prose)
    count = max(1, len(re.findall(r"[a-z']+", body)))
    rates = {phrase: 1e4 * len(re.findall(pattern, body)) / count for phrase, pattern in PHRASES.items()}
    odd = sum(times for place, times in places.items() if ": name " in place)
    return Measures(rates, 100.0 * odd / max(1, names), places)


def double_classes() -> dict[str, list[str]]:
    """Class names at the top level of more than one file, and these files."""
    files = defaultdict(list)
    for package in ("rollingjoint", "rj_gym", "agents"):
        for path in sources(package):
            for node in ast.parse(path.read_text("utf-8")).body:
                if isinstance(node, ast.ClassDef):
                    files[node.name.lstrip("_")].append(path.relative_to(ROOT).as_posix())
    return {name: places for name, places in files.items() if len(places) > 1}


def sources(package: str) -> list[Path]:
    """The files of a package."""
    return sorted((ROOT / package).rglob("*.py"))


def _docstrings(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            yield ast.get_docstring(node) or ""


def _comments(text: str) -> Iterator[str]:
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.string[1:]


def _names(tree: ast.Module) -> Iterator[str]:
    """Names of parameters, and of what is assigned to, of two letters or more."""
    for node in ast.walk(tree):
        if isinstance(node, ast.arg) and len(node.arg) > 1:
            yield node.arg
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and len(node.id) > 1:
            yield node.id


if __name__ == "__main__":
    sys.exit(main())
