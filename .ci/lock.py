"""Writes what `make setup` and CI install: exact releases, with the hashes of all their files, for every platform.

    make lock                           # after a change in pyproject.toml; releases stay where it admits them
    make lock UPGRADE=1                 # the newest releases
    make lock TORCH=2.13.0              # another torch
    make lock WITH="--find-links DIR"   # torch's CPU build from a folder

constraints.txt has the packages of the extras, .ci/uv.txt and .ci/wheel.txt tools. uv resolves for all releases of
Python from 3.11 on Linux, macOS and Windows at once. torch has two entries: on Linux only the CPU build, so that no
CUDA package comes along, elsewhere the public one. Hashes of releases that stay are kept.
"""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LOCK = ROOT / "constraints.txt"
TOOLS = {ROOT / ".ci/uv.txt": "uv", ROOT / ".ci/wheel.txt": "setuptools\ncyclonedx-bom"}
HEADER = "# Written by `make lock` (.ci/lock.py): exact versions, and the hashes that their files must have.\n"
PYTHON = "3.11.5"  # the first that what `make docs` needs admits
COMPILE = (sys.executable, "-m", "uv", "pip", "compile", "--quiet", "--universal", "--python-version", PYTHON)
FORM = ("--generate-hashes", "--no-header", "--no-annotate")
ENTRY = re.compile(r"^\w.*\\\n(?: .*\\\n)* .*\n", re.MULTILINE)


def compiled(source: str, known: str, *options: str) -> list[str]:
    """Locked entries of pyproject.toml or of a requirement; versions and hashes of `known` stay."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "locked.txt")
        out.write_text(known, "utf-8")
        name, text = (source, "") if source.endswith(".toml") else ("-", source)
        command = [*COMPILE, *FORM, *options, "-o", str(out), name]
        done = subprocess.run(command, cwd=ROOT, input=text, text=True, stdout=subprocess.DEVNULL)
        if done.returncode:
            raise SystemExit(f"uv found no releases for {source!r}: nothing was renewed")
        return ENTRY.findall(out.read_text("utf-8"))


def packages(extras: list[str], version: str, known: str, with_cpu: list[str]) -> list[str]:
    """Entries of what the extras bring, with this version of torch."""
    torch = (f"torch=={version} ; sys_platform != 'linux'", f"torch=={version}+cpu ; sys_platform == 'linux'")
    with tempfile.TemporaryDirectory() as folder:
        constraints = Path(folder, "torch.txt")
        constraints.write_text("\n".join(torch), "utf-8")
        named = [word for extra in extras for word in ("--extra", extra)]
        found = compiled("pyproject.toml", known, *named, "-c", str(constraints), *with_cpu)
    old = LOCK.read_text("utf-8")
    entries = compiled(torch[0], old, "--no-deps") + compiled(torch[1], old, "--no-deps", *with_cpu)
    return sorted(entry for entry in found if not entry.startswith("torch==")) + entries


def main() -> None:
    """Write the three files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--extras", required=True, help="of pyproject.toml, with commas between")
    parser.add_argument("--torch", required=True, help="its version")
    parser.add_argument("--with-cpu", default="--torch-backend cpu", help="options of uv that find torch's CPU build")
    parser.add_argument("--upgrade", action="store_true", help="take the newest versions")
    options = parser.parse_args()
    known = {path: "" if options.upgrade else path.read_text("utf-8") for path in (LOCK, *TOOLS)}
    cpu = shlex.split(options.with_cpu)
    found = {LOCK: packages(options.extras.split(","), options.torch, known[LOCK], cpu)}
    found |= {path: compiled(names, known[path]) for path, names in TOOLS.items()}
    for path, entries in found.items():
        path.write_text(HEADER + "".join(entries), "utf-8")


if __name__ == "__main__":
    main()
