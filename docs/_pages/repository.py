"""Pages of files outside docs/ that pages link to, and the links of all pages as the site needs them.

Files keep their links as a code host wants them: `../examples/fidelity.py`. On the site that is a page with the source.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from notebooks import page_of_notebook

ROOT = Path(__file__).parents[2]
FOLDER = "repository"
LINK = re.compile(r"(?P<opening>\]\(|<(?:img|iframe) [^>]*?src=\")(?![\w+]+:|#)(?P<link>[^)#\s\"]+)")
LANGUAGES = {".py": "python", ".yaml": "yaml", ".json": "json", ".toml": "toml", ".cff": "yaml"}
LARGEST = 100_000  # characters of a file that is shown


def links(text: str, path: str) -> dict[str, str]:
    """The links of a page to files of the repository, each with the path of the file, which is relative to the root."""
    found = {each["link"]: os.path.join(os.path.dirname(path), each["link"]) for each in LINK.finditer(text)}
    targets = {link: Path(os.path.normpath(target)).as_posix() for link, target in found.items()}
    return {link: target for link, target in targets.items() if (ROOT / target).is_file()}


def site_path(path: str) -> str:
    """Where a file of the repository is on the site."""
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    return f"{FOLDER}/{path}" if path.endswith(".md") else f"{FOLDER}/{path}.md"


def linked_outside(page: str) -> set[str]:
    """Files outside docs/ that a page of the repository links to, and that those link to in their turn."""
    found: set[str] = set()
    waiting = {page}
    while waiting:
        path = waiting.pop()
        text = (ROOT / path).read_text("utf-8") if path.endswith(".md") else ""
        new = {target for target in links(text, path).values() if not target.startswith("docs/")} - found
        found |= new
        waiting |= new
    return found


def pages() -> dict[str, str | bytes]:
    """The pages in docs/ and all that they link to, by their path on the site."""
    inside = [path.relative_to(ROOT).as_posix() for path in sorted((ROOT / "docs").glob("*.md"))]
    outside = sorted(set().union(*map(linked_outside, inside)))
    return {name: content for path in [*inside, *outside] for name, content in page_of(path).items()}


def page_of(path: str) -> dict[str, str | bytes]:
    """The page of a file: itself with moved links, its source as a block of code, or a notebook with its pictures."""
    if path.endswith(".ipynb"):
        text, pictures = page_of_notebook(ROOT / path, site_path(path))
        return {site_path(path): moved(text, path)} | pictures
    text = (ROOT / path).read_text("utf-8")
    if path.endswith(".md"):
        return {site_path(path): moved(text, path)}
    language = LANGUAGES.get(Path(path).suffix, "text")
    return {site_path(path): f"# {path}\n\n````{language}\n{text[:LARGEST]}\n````\n"}


def moved(text: str, path: str) -> str:
    """The text of a page of the repository with links that hold on the site."""
    targets = links(text, path)
    folder = os.path.dirname(site_path(path)) or "."

    def relative(found: re.Match[str]) -> str:
        if found["link"] not in targets:
            return found.group()
        return found["opening"] + Path(os.path.relpath(site_path(targets[found["link"]]), folder)).as_posix()

    return LINK.sub(relative, text)
