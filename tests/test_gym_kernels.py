"""Kernels outside rollingjoint are compiled anew when their own source changes."""

import os
import subprocess
import sys
from pathlib import Path

SOURCE = """
from rollingjoint._jit import kernel

@kernel
def moved(x):
    return x + {shift}

print(moved(1.0))
"""


def test_a_kernel_of_another_package_is_compiled_anew_when_its_source_changes(tmp_path):
    paths = {"ROLLINGJOINT_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(Path(__file__).parent.parent)}
    source = tmp_path / "elsewhere.py"

    def printed(shift):
        source.write_text(SOURCE.format(shift=shift))
        done = subprocess.run(
            [sys.executable, source], env=os.environ | paths, capture_output=True, text=True, check=True
        )
        return float(done.stdout)

    assert [printed(1.0), printed(2.0), printed(2.0)] == [2.0, 3.0, 3.0]
    kept = list((tmp_path / "cache").rglob("*.nbc"))
    assert kept
