"""Notebooks as pages: their text, code and committed outputs."""

from __future__ import annotations

from pathlib import Path

from nbconvert import MarkdownExporter


def page_of_notebook(notebook: Path, path: str) -> tuple[str, dict[str, bytes]]:
    """The Markdown of a notebook whose page is at `path` on the site, and its pictures by theirs."""
    name = Path(path).stem
    resources = {"output_files_dir": f"{name}_files", "unique_key": name}
    text, found = MarkdownExporter().from_filename(str(notebook), resources=resources)
    folder = Path(path).parent
    return text, {(folder / picture).as_posix(): content for picture, content in found["outputs"].items()}
