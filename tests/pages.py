"""Tables of the documentation and of docstrings, as tests compare them with the code."""

import re


def rows(page: str, heading: str) -> list[list[str]]:
    """Cells of the first table below a heading."""
    section = page.split(heading, 1)[1].split("\n#", 1)[0]
    return [
        [cell.strip(" `") for cell in line.strip("|").split(" | ")] for line in section.splitlines() if line[:2] == "| "
    ]


def examples(page: str) -> list[tuple[str, str]]:
    """Programs of a page, each with the output below it."""
    return re.findall(r"^```python\n(.*?)^```\n\n```text\n(.*?)^```", page, re.MULTILINE | re.DOTALL)


def bounds(docstring: str) -> dict[str, tuple[str, str]]:
    """Low and high of every kind of observation entry in the table of an environment's docstring."""
    table = {}
    for line in re.findall(r"^ *\| (.*) \|$", docstring, re.MULTILINE):
        names, _, _, low, high = line.split(" | ") if line.count(" | ") == 4 else [""] * 5
        table |= {name.strip(): (low, high) for name in re.sub(r"\(.*\)", "", names).split(",")}
    return table
