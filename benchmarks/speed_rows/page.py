"""The speed page, wholly generated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from speed_rows import machine
from speed_rows.row import HEAD, Row, quantity
from speed_rows.sizes import Sizes

INTRO = """# Speed

This page is the output of

```sh
python benchmarks/speed.py
```

which measures everything below anew and takes half an hour; peers run in the same process and take turns with ours.
Speeds are those of the fastest of several repeats unless the sample says otherwise, and of the fastest of {rounds}
rounds through the sections, ours and every peer's, since a machine that others share has slower minutes; pictures show
the first round. What is no speed, and what is counted or profiled, is measured once. "Times faster" is ours against
the peer: below 1, the peer is faster. Compare ratios: seconds are those of this machine.

"Limit" is what a bare kernel makes of the same solves in the same run, and how many times as long ours takes
(`benchmarks/speed_rows/bare_kernel.py`): Newton's method written out for the five-link prototype and one force, tables
of cubics, fused and reordered arithmetic, joint angles and nothing else. It knows no other mechanism, load or tendon,
no end of a surface, no stability, no line search and no status. Before it is timed its answers are compared with the
solver's: they agree to 1e-8 rad. Where the work is a step of an environment, the limit is the solve in it. Rows without
a limit are of other work.
Peers need `pip install -e ".[train,benchmarks]"`; a missing one has no number."""


class Section(Protocol):
    """A module of measurements; PICTURES (file name: caption) and ONCE (whether one round is enough) are optional."""

    TITLE: str
    TEXT: str

    def measure(self, sizes: Sizes, images: Path) -> Iterator[Row]:
        """Rows, as they are measured; pictures go into the folder."""
        ...


def page(measured: Sequence[tuple[Section, Sequence[Row]]], rounds: int, images: str = "images") -> str:
    """The page of sections measured in so many rounds, as Markdown."""
    rows = [row for _, section_rows in measured for row in section_rows]
    parts = [INTRO.format(rounds=rounds), f"Measured on: {machine.in_words()}", _targets(rows)]
    for section, section_rows in measured:
        parts += [f"## {section.TITLE}", section.TEXT, table(section_rows)]
        pictures: Mapping[str, str] = getattr(section, "PICTURES", {})
        parts += [f"![{caption}]({images}/{name})" for name, caption in pictures.items()]
    return "\n\n".join(parts) + "\n"


def table(rows: Sequence[Row]) -> str:
    """Rows as a Markdown table."""
    return "\n".join([HEAD, *(row.markdown() for row in rows)])


def _targets(rows: Sequence[Row]) -> str:
    """How many targets are met, and which are not."""
    judged = [row for row in rows if row.target and row.value is not None]
    missed = [f"- {row.what}: {quantity(row.value or 0.0, row.unit)}" for row in judged if row.missed]
    if not missed:
        return f"All {len(judged)} targets are met."
    return "\n".join([f"{len(judged) - len(missed)} of {len(judged)} targets are met. Missed:", "", *missed])
