"""Kernels outside rollingjoint are compiled anew when their own source changes, or that of kernels they are made of."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = """
from rollingjoint.compiled import kernel

@kernel
def moved(x):
    return x + {shift}

print(moved(1.0))
"""

USER = """
from elsewhere import moved
from rollingjoint.compiled import kernel

@kernel
def twice(x):
    return 2.0 * moved(x)

print(twice(1.0))
"""


LAYOUT = """
from typing import Annotated, NamedTuple
from rollingjoint.compiled import Floats

class Task(NamedTuple):
    {fields}
"""

PINNED = """
import numpy as np
from layouts import Task
from rollingjoint.compiled import Pinned, kernel, unpin

@kernel
def scaled(pins):
    task = unpin(pins, Task)
    return task.scale * task.values[0]

pinned = Pinned(Task(**{name: 3.0 if name == "scale" else np.array([5.0]) for name in Task._fields}))
print(scaled(pinned.address))
"""

NAMED = """
from typing import NamedTuple
import numpy as np
from rollingjoint.compiled import kernel

class {name}(NamedTuple):
    values: np.ndarray

@kernel
def first(pair):
    return pair.values[0]

print(first({name}(np.array([5.0]))))
"""


@pytest.fixture
def printed(tmp_path):
    """What a program prints last, in a process of its own, after `elsewhere.py` was written with another number."""
    own = {
        "ROLLINGJOINT_CACHE": str(tmp_path / "cache"),
        "PYTHONPATH": str(Path(__file__).resolve().parents[3]),
        "PYTHONDONTWRITEBYTECODE": "1",  # Python's own would miss two versions of one size within a second
    }

    def run(program, shift):
        (tmp_path / "elsewhere.py").write_text(SOURCE.format(shift=shift))
        command = [sys.executable, tmp_path / program]
        done = subprocess.run(command, env=os.environ | own, capture_output=True, text=True, check=True)
        return float(done.stdout.split()[-1])

    return run


def test_a_kernel_of_another_package_is_compiled_anew_when_its_source_changes(printed, tmp_path):
    assert [printed("elsewhere.py", shift) for shift in (1.0, 2.0, 2.0)] == [2.0, 3.0, 3.0]
    assert list((tmp_path / "cache").rglob("*.nbc"))


def test_a_kernel_is_compiled_anew_when_one_that_it_calls_in_another_file_changes(printed, tmp_path):
    (tmp_path / "user.py").write_text(USER)
    assert [printed("user.py", shift) for shift in (1.0, 2.0, 2.0)] == [4.0, 6.0, 6.0]


def test_a_kernel_is_compiled_anew_when_a_layout_in_another_file_changes(printed, tmp_path):
    (tmp_path / "pinned.py").write_text(PINNED)
    fields = ["scale: float", "values: Annotated[Floats, 'B']"]
    for order in (fields, fields[::-1]):
        (tmp_path / "layouts.py").write_text(LAYOUT.format(fields="\n    ".join(order)))
        assert printed("pinned.py", 0.0) == 15.0


def test_a_kernel_is_compiled_anew_when_a_class_that_it_was_kept_with_is_gone(printed, tmp_path):
    (tmp_path / "main.py").write_text("import named")
    for name in ("One", "Other"):
        (tmp_path / "named.py").write_text(NAMED.format(name=name))
        assert printed("main.py", 0.0) == 5.0


def test_kernels_of_one_name_in_files_of_one_name_do_not_share_a_place_on_disk():
    from rj_gym.arm.kernels import observe, prepare
    from rj_gym.planar.kernels import observe as planar_observe

    names = [one._cache._impl.filename_base for one in (observe, planar_observe, prepare)]
    assert len(set(names)) == 3
