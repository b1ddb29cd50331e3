"""Tables for the panel of a browser."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

STYLE = "width:100%;font-size:0.85em;border-spacing:0 2px;text-align:right;white-space:nowrap"


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of HTML cells, the first column left, the others right."""
    lines = [_row("th", head), *(_row("td", cells) for cells in rows)]
    return f'<table style="{STYLE}">{"".join(lines)}</table>'


def coloured(colour: str, mark: str = "&#9632;") -> str:
    """A mark of a legend in a colour that CSS knows."""
    return f'<span style="color:{colour}">{mark}</span>'


def _row(kind: str, cells: Sequence[str]) -> str:
    first, *others = cells
    rest = "".join(f"<{kind}>{cell}</{kind}>" for cell in others)
    return f'<tr><{kind} style="text-align:left">{first}</{kind}>{rest}</tr>'
