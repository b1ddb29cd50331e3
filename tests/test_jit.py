"""Compiled kernels are kept where they can be written, and forgotten when any kernel source changes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rollingjoint import _jit

PROGRAM = """
from rollingjoint._jit import cache_directory, kernel
from rollingjoint._kernels.joint import arc_length
from rollingjoint import Profile, Surface, Link, RollingChain, Tendon
import numpy as np
link = Link(Surface(Profile.constant(0.05), (0, -10)), Surface(Profile.constant(-0.05), (0, 10)))
chain = RollingChain([link, link], [Tendon.on_surfaces(5.0)])
print(chain.joint_angles([1.0])[0], cache_directory())
"""


def run(cache: Path) -> list[str]:
    environment = os.environ | {"ROLLINGJOINT_CACHE": str(cache), "PYTHONPATH": str(Path(__file__).parent.parent)}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""  # the announcement is for terminals only
    return done.stdout.split()


def test_kernels_are_kept_on_disk(tmp_path):
    angle, folder = run(tmp_path)
    assert float(angle) == pytest.approx(-0.1)
    assert Path(folder).parent == tmp_path
    kept = {path: path.stat().st_mtime_ns for path in Path(folder).glob("*.nbc")}
    assert kept
    assert run(tmp_path)[0] == angle
    assert {path: path.stat().st_mtime_ns for path in Path(folder).glob("*.nbc")} == kept


def test_damaged_files_and_read_only_places_cost_time_and_nothing_else(tmp_path):
    folder = Path(run(tmp_path)[1])
    for path in folder.iterdir():
        path.write_bytes(b"")
    assert float(run(tmp_path)[0]) == pytest.approx(-0.1)
    blocked = tmp_path / "file"
    blocked.write_text("a file where a folder should be")
    assert float(run(blocked)[0]) == pytest.approx(-0.1)


def test_every_kernel_source_is_part_of_the_key(tmp_path, monkeypatch):
    before = _jit._source_hash()
    copy = tmp_path / "rollingjoint"
    (copy / "_kernels").mkdir(parents=True)
    for path in [*_jit._PACKAGE.glob("_jit.py"), *(_jit._PACKAGE / "_kernels").glob("*.py")]:
        (copy / path.relative_to(_jit._PACKAGE)).write_bytes(path.read_bytes())
    monkeypatch.setattr(_jit, "_PACKAGE", copy)
    assert _jit._source_hash.__wrapped__() == before
    source = copy / "_kernels" / "joint.py"
    source.write_text(source.read_text() + "\n")
    assert _jit._source_hash.__wrapped__() != before
