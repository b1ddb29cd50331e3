"""A mode in which kernels check every index, and what is said where kernels cannot be compiled."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import rollingjoint._numba as numba_layer

ROOT = Path(__file__).resolve().parents[3]

WRONG_KERNELS = """
import numpy as np
from typing import Annotated, NamedTuple
from rollingjoint.compiled import Floats, Pinned, borrow, call_range, carve, entry_address, kernel, machine_code, unpin

@kernel
def read(a, i, j):
    return borrow(a)[i, j]

@kernel
def read_row(a, i, j):
    return borrow(a)[i][j]

@kernel
def read_array(a, i, j):
    return a[i, j]

@kernel
def write(a, i, j):
    borrow(a)[i, j] = 1.0
    return 0.0

@kernel
def read_carved(memory, at, length):
    return carve(borrow(memory), at, (length,))[0]

class Task(NamedTuple):
    values: Annotated[Floats, "B", 3]

@kernel
def read_pinned(pins, first, last):
    return int(unpin(pins, Task).values[first, last])

@kernel
def call(entry, pins):
    return call_range(entry, pins, Task, 1, 7)

def outcome(work, *arguments):
    try:
        return float(work(*arguments))
    except (IndexError, ValueError) as error:
        return f"{type(error).__name__}: {error}"

values = np.arange(6.0).reshape(2, 3)
for work in read, read_row, read_array, write:
    print(work.__name__, *(outcome(work, values, *at) for at in ((1, 2), (1, 3), (2, 0))), sep="; ")
print(outcome(read, values, -1, 0))
print(outcome(read_carved, np.ones(6), 2, 4), outcome(read_carved, np.ones(6), 2, 5), sep="; ")
pinned = Pinned(Task(values))
print(outcome(read_pinned, pinned.address, 1, 1), outcome(read_pinned, pinned.address, 1, 4), sep="; ")
print(outcome(call, entry_address(read_pinned, int, int, int), pinned.address))
print(outcome(machine_code(read_array, Annotated[Floats, "a", "b"], int, int), values[:, ::2], 0, 0))
"""


def run(*arguments: str, **settings: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | settings
    return subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True)


@pytest.mark.slow
def test_checked_kernels_say_which_index_is_beyond_its_axis(tmp_path):
    program = tmp_path / "wrong_kernels.py"
    program.write_text(WRONG_KERNELS)
    done = run(str(program), ROLLINGJOINT_CHECK_BOUNDS="1", ROLLINGJOINT_CACHE=str(tmp_path))
    assert done.returncode == 0, done.stderr
    *four, negative, carved, pinned, called, arguments = done.stdout.splitlines()
    for line, value in zip(four, (5.0, 5.0, 5.0, 0.0), strict=True):
        name, fine, column, row = line.split("; ")
        assert float(fine) == value
        assert column.startswith("OutOfRange: axis ") and column.endswith(f"{name}: 3 is not in 0 ... 2"), column
        assert row.startswith("OutOfRange: axis 0 of ") and row.endswith(f"{name}: 2 is not in 0 ... 1"), row
    assert negative.startswith("OutOfRange: axis 0 of Borrowed(float64") and ": -1 is not" in negative
    assert carved.startswith("1.0; OutOfRange: the end of what is carved") and carved.endswith("7 is not in 0 ... 6")
    assert pinned.startswith("4.0; OutOfRange: axis 1") and called.startswith("OutOfRange: axis 1")
    assert called.endswith("read_pinned: 7 is not in 0 ... 2")
    assert arguments.startswith("InvalidInput") and "contiguous" in arguments
    assert all(path.name.endswith("-checked") for path in tmp_path.glob("kernels-*"))


STRETCH = "test_one_joint_whose_tendons_hardly_stretch_in_their_channels_ends_as_without"
SUITE = (
    "chain/test_equilibrium.py",
    "chain/test_batch.py",
    "chain/test_hinge_equilibrium.py",
    "chain/test_long_chain.py",
    f"chain/test_friction.py::{STRETCH}",
)
LATER = ("test_arm_tangent.py", "test_pitch_yaw.py")


@pytest.mark.slow(minutes=10)
def test_kernels_index_nothing_beyond_its_axis(tmp_path):
    """What solves, steps and resets mechanisms of both families, in the mode above.

    What LATER alone compiles takes six minutes; the standing attack's part `checked` steps those environments.
    """
    tests = [ROOT / "tests" / "rollingjoint" / name for name in SUITE]
    tests += [ROOT / "tests" / "rj_gym" / room for room in ("tracking", "core")]
    later = [f"--ignore={ROOT / 'tests' / 'rj_gym' / 'tracking' / name}" for name in LATER]
    checked = {"ROLLINGJOINT_CHECK_BOUNDS": "1", "ROLLINGJOINT_CACHE": str(tmp_path)}
    options = ("-q", "-p", "no:cacheprovider", "--rootdir", str(ROOT), *later)
    done = run("-m", "pytest", *options, *map(str, tests), **checked)
    assert done.returncode == 0, done.stdout[-8000:]


def test_kernels_that_may_not_be_compiled_are_refused_in_one_line():
    done = run("-c", "import rollingjoint", NUMBA_DISABLE_JIT="1")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        "ImportError: rollingjoint's kernels have to be compiled: unset NUMBA_DISABLE_JIT"
    )


def test_another_numba_than_the_one_that_is_declared_is_refused_in_one_line():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    (requirement,) = [line for line in declared if line.startswith("numba")]
    with pytest.raises(ImportError, match=f"rollingjoint needs {requirement}, found 0.69.0: run pip install") as caught:
        numba_layer._check("0.69.0", False)
    assert "\n" not in str(caught.value)
    for refused in ("0.67.1", "1.0.0"):
        with pytest.raises(ImportError, match=refused):
            numba_layer._check(refused, False)
    for accepted in ("0.68.0", "0.68.1", "0.68.0rc1"):
        numba_layer._check(accepted, False)
