"""The sdist: everything under version control, so that its tests run."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a git checkout")
def test_it_has_every_file_of_the_repository_and_no_other(tmp_path):
    made = subprocess.run(
        [sys.executable, "setup.py", "-q", "egg_info", "--egg-base", str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert made.returncode == 0, made.stderr
    [sources] = tmp_path.glob("*.egg-info/SOURCES.txt")
    inside = {name for name in sources.read_text("utf-8").splitlines() if ".egg-info" not in name}
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    assert inside == {name for name in names if (ROOT / name).is_file()}
