"""Kernels outside rollingjoint are compiled anew when their own source changes, or that of kernels they are made of."""

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

USER = """
from elsewhere import moved
from rollingjoint._jit import kernel

@kernel
def twice(x):
    return 2.0 * moved(x)

print(twice(1.0))
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


def test_a_kernel_is_compiled_anew_when_one_that_it_calls_in_another_file_changes(tmp_path):
    user, source = tmp_path / "user.py", tmp_path / "elsewhere.py"
    user.write_text(USER)
    paths = {"ROLLINGJOINT_CACHE": str(tmp_path / "cache"), "PYTHONPATH": str(Path(__file__).parent.parent)}

    def printed(shift):
        source.write_text(SOURCE.format(shift=shift))
        done = subprocess.run(
            [sys.executable, user], env=os.environ | paths, capture_output=True, text=True, check=True
        )
        return float(done.stdout.split()[-1])

    assert [printed(1.0), printed(2.0), printed(2.0)] == [4.0, 6.0, 6.0]


def test_kernels_of_one_name_in_files_of_one_name_do_not_share_a_place_on_disk():
    from rj_gym.arm.kernels import observe, prepare
    from rj_gym.tracking.kernels import observe as planar_observe

    names = [one._cache._impl.filename_base for one in (observe, planar_observe, prepare)]
    assert len(set(names)) == 3
