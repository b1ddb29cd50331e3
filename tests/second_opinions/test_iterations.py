"""The table of iterations of docs/convergence.md."""

from pathlib import Path

import pytest

from tests.second_opinions import __main__ as iterations

CONVERGENCE = (Path(__file__).parents[2] / "docs" / "convergence.md").read_text("utf-8")
SHOWN = CONVERGENCE.partition("python -m tests.second_opinions")[2].partition("```text\n")[2].partition("```")[0]


def counts(text):
    """The words of every line but those that follow rounding errors: distances, and counts of all trial equilibria."""
    rows = [[word for word in line.split() if "e-" not in word] for line in text.splitlines()]
    return [row[:-1] if row and row[0].startswith("(") and "." in row[0] else row for row in rows]


@pytest.mark.slow
def test_the_page_shows_what_the_command_prints(capsys):
    iterations.main()
    assert counts(capsys.readouterr().out) == counts(SHOWN)
