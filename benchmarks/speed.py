"""Measure the speed of everything and write docs/speed.md.

    python benchmarks/speed.py                     # the page; about half an hour
    python benchmarks/speed.py --only solver       # one section, printed
    python benchmarks/speed.py --quick             # every row with tiny sizes, printed; the numbers mean nothing

One module of `speed_rows` measures one section. Peers are optional: pip install -e ".[benchmarks]"
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from speed_rows.page import Section, page, table
from speed_rows.row import Row, quantity
from speed_rows.sizes import FULL, QUICK, Sizes

PAGE = Path(__file__).resolve().parents[1] / "docs" / "speed.md"
SECTIONS = (
    "solver",
    "batch",
    "growth",
    "pieces",
    "long_chain",
    "friction",
    "arm",
    "spatial",
    "scalar_env",
    "vector_env",
    "training",
    "training_profile",
    "controllers",
    "startup",
    "memory",
    "instructions",
)


def main(argv: Sequence[str] | None = None) -> None:
    arguments = _arguments(argv)
    sizes = QUICK if arguments.quick else FULL
    if arguments.keep_profile:
        from speed_rows import training_profile

        training_profile.keep(arguments.keep_profile, sizes, arguments.commit)
        return
    output = arguments.output or (None if arguments.quick or arguments.only else PAGE)
    with tempfile.TemporaryDirectory() as scratch:
        images = output.parent / "images" if output else Path(scratch)
        names = [arguments.only] if arguments.only else SECTIONS
        repeated = [name for name in names if not getattr(_section(name), "ONCE", False)]
        rows = {name: _measured(name, sizes, images) for name in repeated}
        for _ in range(arguments.rounds - 1):
            for name in repeated:
                again = _measured(name, sizes, Path(scratch))
                rows[name] = [row.best(other) for row, other in zip(rows[name], again, strict=True)]
        rows |= {name: _measured(name, sizes, images) for name in names if name not in rows}
    measured = [(_section(name), rows[name]) for name in names]
    if output:
        output.write_text(page(measured, arguments.rounds), "utf-8")
        _report(f"wrote {output}")
    else:
        print("\n\n".join(f"## {section.TITLE}\n\n{table(rows)}" for section, rows in measured))


def _section(name: str) -> Section:
    """The module of a section."""
    section: Section = import_module(f"speed_rows.{name}")
    return section


def _measured(name: str, sizes: Sizes, images: Path) -> list[Row]:
    """The rows of a section; each is reported as it comes."""
    rows, begin = [], time.perf_counter()
    for row in _section(name).measure(sizes, images):
        value = row.note if row.value is None else quantity(row.value, row.unit)
        _report(f"{name}: {row.what}: {value}")
        rows.append(row)
    _report(f"{name}: {time.perf_counter() - begin:.0f} s")
    return rows


def _report(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=SECTIONS, metavar="NAME", help=f"one section: {', '.join(SECTIONS)}")
    parser.add_argument("--quick", action="store_true", help="tiny sizes: a test that every row is measured")
    parser.add_argument("--rounds", type=int, help="times through the sections (default: 3 for the page, else 1)")
    parser.add_argument("--output", type=Path, help="write the page here, pictures into images/ beside it")
    parser.add_argument("--keep-profile", type=Path, metavar="FILE", help="only keep the training profile in a file")
    parser.add_argument("--commit", default="unknown", help="what the kept profile is a profile of")
    arguments = parser.parse_args(argv)
    if arguments.rounds is None:
        arguments.rounds = 1 if arguments.quick or arguments.only else 3
    return arguments


if __name__ == "__main__":
    main()
