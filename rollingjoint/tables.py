"""Tables of text cells, aligned for a terminal, as Markdown or CSV, and printing where some characters are unknown."""

from __future__ import annotations

import csv
import io
import math
import os
import select
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple


def text_table(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1, ruled: bool = False) -> str:
    """Aligned columns, two spaces apart: the first `left` ones to the left, the others to the right.

    Args:
        head: the names of the columns.
        rows: one cell per column.
        left: how many columns are aligned to the left.
        ruled: whether a line separates the head from the rows.
    """
    lines = [list(head), *map(list, rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    texts = [
        "  ".join(
            cell.ljust(width) if place < left else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    return "\n".join([texts[0], "-" * len(texts[0]), *texts[1:]] if ruled else texts)


def number_table(head: Sequence[str], rows: Iterable[Sequence[float]], digits: Sequence[int]) -> str:
    """Aligned columns: an index, then numbers with that many digits each."""
    body = [[str(row[0]), *(fixed(value, d) for value, d in zip(row[1:], digits, strict=True))] for row in rows]
    return text_table(head, body, left=0)


class Column(NamedTuple):
    """A column of a table: numbers, one per row.

    Attributes:
        key: in JSON, with the unit; empty for a column of tables alone.
        head: in tables, with the unit; empty for a column of JSON alone.
        values: an array with a leading axis of the rows.
        digits: behind the decimal point, in tables.
    """

    key: str
    head: str
    values: Any
    digits: int = 4


def column_table(thing: str, columns: Sequence[Column]) -> str:
    """Aligned columns, one row per thing, numbered from 0."""
    shown = [column for column in columns if column.head]
    rows = ((index, *row) for index, row in enumerate(zip(*(column.values for column in shown), strict=True)))
    return number_table((thing, *(column.head for column in shown)), rows, [column.digits for column in shown])


def column_dicts(thing: str, columns: Sequence[Column]) -> list[dict[str, Any]]:
    """A dict of plain values for every thing; None for numbers that are not finite, which JSON cannot express."""
    keyed = [(column.key, _finite(column.values.tolist())) for column in columns if column.key]
    count = len(keyed[0][1])
    return [{thing: index, **{key: values[index] for key, values in keyed}} for index in range(count)]


def _finite(value: Any) -> Any:
    """A number, or nested lists of numbers, with None for those that are not finite."""
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return value if not isinstance(value, float) or math.isfinite(value) else None


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1) -> str:
    """A Markdown table: the first `left` columns aligned to the left, the others to the right."""
    align = [":--" if place < left else "--:" for place in range(len(head))]
    return "\n".join(f"| {' | '.join(line)} |" for line in [head, align, *rows])


def csv_text(head: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """Rows under a head as CSV, without a newline at the end."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows([head, *rows])
    return stream.getvalue().rstrip("\n")


def fixed(value: float, digits: int) -> str:
    """Fixed-point text with so many digits behind the point, without a negative zero."""
    return f"{round(float(value), digits) + 0.0:.{digits}f}"


def print_any_character() -> None:
    """Let standard output and standard error show "?" for characters that their encoding lacks, as on Windows."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


@contextmanager
def readers_may_leave() -> Iterator[None]:
    """A context whose command ends without a word where the reader of standard output, such as `head`, has gone."""
    try:
        try:
            yield
        finally:
            sys.stdout.flush()  # here, where Python can still be told; it also ends a command by SystemExit
    except BrokenPipeError:
        if not _reader_has_gone():  # a pipe to another process
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _reader_has_gone() -> bool:
    """Whether standard output is a pipe that nobody reads."""
    poll = select.poll()
    poll.register(sys.stdout.fileno(), select.POLLOUT)
    return any(events & select.POLLERR for _, events in poll.poll(0))
