"""Settings for every test: no screen is needed, and tests start their programs from the sources."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

os.environ["MPLBACKEND"] = "Agg"
os.environ["SDL_VIDEODRIVER"] = "dummy"
os.environ["PYGAME_HIDE_SUPPORT_PROMPT"] = "1"

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def run_python(tmp_path: Path) -> Callable[..., str]:
    """Runs this interpreter on some arguments in an empty folder beside `configs/`; returns what it printed.

    The program has to succeed and must not warn.
    """
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths)}

    def run(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, *arguments], cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{arguments} failed:\n{done.stdout}\n{done.stderr}"
        assert "Warning" not in done.stderr, f"{arguments} warned:\n{done.stderr}"
        return done.stdout

    return run
