"""Tables and text for the panel of a browser, in which names are shown as they are, never as HTML or Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape

STYLE = "width:100%;padding:0 0.5em;font-size:0.85em;border-spacing:0 2px;text-align:right"


class Html(str):
    """A cell that is HTML; html_table escapes all others."""

    __slots__ = ()


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of cells, the first column left, the others right."""
    lines = [_row("th", head), *(_row("td", cells) for cells in rows)]
    return f'<table style="{STYLE}">{"".join(lines)}</table>'


def coloured(colour: str, text: str, mark: str = "&#9632;") -> Html:
    """Text of a legend after a mark, an HTML entity, in a colour that CSS knows."""
    return Html(f'<span style="color:{colour}">{mark}</span>&nbsp;{escape(text)}')


def markdown(text: str) -> str:
    """Markdown that shows this text."""
    return re.sub(r"([!-/:-@\[-`{-~])", r"\\\1", text)


def code_block(text: str, language: str = "text") -> str:
    """Markdown that shows this text as code; its fence is longer than any run of backticks in the text."""
    fence = "`" * max(3, 1 + max(map(len, re.findall("`+", text)), default=0))
    return f"{fence}{language}\n{text.rstrip()}\n{fence}"


def _row(kind: str, cells: Sequence[str]) -> str:
    first, *others = (cell if isinstance(cell, Html) else escape(cell) for cell in cells)
    figures = "" if kind == "th" else ' style="white-space:nowrap"'  # heads and names may take two lines
    cells_text = "".join(f"<{kind}{figures}>{cell}</{kind}>" for cell in others)
    return f'<tr><{kind} style="text-align:left">{first}</{kind}>{cells_text}</tr>'
