"""Writes the sources of the site, of which `zensical build` makes the site: python docs/_pages. `make docs` does both.

Modules:
    environments: a page for every registered environment.
    reference: a page for every module that users import from.
    settings: tables of settings in docs/, a command of its own.
    repository: the pages in docs/ and files that they link to, with links that hold on the site.
    notebooks: notebooks as pages.
    replays: episodes of the shipped policies.
    formulas: LaTeX as MathML.
    math_font: the font of formulas, a command of its own.
"""

import shutil

import environments
import reference
import replays
import repository
from formulas import with_formulas

SOURCES = repository.ROOT / "build" / "docs"  # docs_dir of mkdocs.yml
FOLDERS = ("assets", "images")  # of docs/, copied as they are


def main() -> None:
    """Write them all anew."""
    shutil.rmtree(SOURCES, ignore_errors=True)
    for folder in FOLDERS:
        shutil.copytree(repository.ROOT / "docs" / folder, SOURCES / folder)
    if replays.can_be_recorded():
        replays.record(environments.replayed(), SOURCES / "replays")
    for name, content in (repository.pages() | environments.pages() | reference.pages()).items():
        path = SOURCES / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else with_formulas(content).encode())
    print(f"wrote {sum(1 for _ in SOURCES.rglob('*.md'))} pages into {SOURCES}")


if __name__ == "__main__":
    main()
