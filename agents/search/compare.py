"""Rebuild the page of searches from their folders: python -m agents.search.compare runs/search/*.

It writes the part of docs/design_search.md between its two marks, and the pictures, docs/images/design_search_*. The
same folders give the same page.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from agents.runs.command_line import exit_code
from agents.runs.files import RunFolderError, write_bytes, write_text
from rollingjoint.tables import markdown_table

PAGE = Path("docs/design_search.md")
BEGIN, END = "<!-- begin: python -m agents.search.compare -->", "<!-- end -->"


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 written, 2 an error."""
    parser = argparse.ArgumentParser(
        prog="python -m agents.search.compare", description="Rebuild the page of searches."
    )
    parser.add_argument("searches", type=Path, nargs="+", help="folders of searches, as rj search leaves them")
    parser.add_argument("--page", type=Path, default=PAGE, help=f"with the two marks (default: {PAGE})")
    arguments = parser.parse_args(argv)
    return exit_code(lambda: _command(arguments.searches, arguments.page))


def _command(searches: Sequence[Path], page: Path) -> int:
    from agents.search.outcome import Search, words
    from agents.search.report import SearchReport, draw

    before, after = around(page, BEGIN, END)
    reports = [SearchReport(Search.read(out)) for out in searches]
    sections = []
    for report in reports:
        name, pictures = report.search.name, {}
        for picture, content in draw(report.search).items():
            pictures[picture] = f"images/design_search_{name}_{picture}"
            write_bytes(page.parent / pictures[picture], content)
        sections.append(report.markdown(3, pictures))
    links = [f"[{words(report.search.name)}](#{report.search.name.replace('_', '-')})" for report in reports]
    rows = [[link, *report.in_short()] for link, report in zip(links, reports, strict=True)]
    head = ["search", "best value", "found by", "reference", "held out", "reference, held out"]
    write_text(page, "\n\n".join([before + BEGIN, markdown_table(head, rows), *map(str.strip, sections), END + after]))
    print(f"The page is {page}")
    return 0


def around(page: Path, begin: str, end: str) -> tuple[str, str]:
    """The text of a page before and after its generated part; raises RunFolderError where it has no such part."""
    text = page.read_text("utf-8")
    before, begin_mark, remainder = text.partition(begin)
    _, end_mark, after = remainder.partition(end)
    if not begin_mark or not end_mark:
        raise RunFolderError("page", str(page), f"a page with the lines {begin} and {end}")
    return before, after


if __name__ == "__main__":
    sys.exit(main())
