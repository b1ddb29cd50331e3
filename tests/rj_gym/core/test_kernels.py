"""Kernels outside rollingjoint are compiled anew when their own source changes, or that of kernels they are made of."""

import importlib.util
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
    """The numbers that a program prints, in a process of its own, after some files were written beside it."""
    own = {
        "ROLLINGJOINT_CACHE": str(tmp_path / "cache"),
        "PYTHONPATH": str(Path(__file__).resolve().parents[3]),
        "PYTHONDONTWRITEBYTECODE": "1",  # Python's own would miss two versions of one size within a second
    }

    def run(program, **modules):
        for name, text in modules.items():
            (tmp_path / f"{name}.py").write_text(text)
        (tmp_path / "main.py").write_text(program)
        command = [sys.executable, tmp_path / "main.py"]
        done = subprocess.run(command, env=os.environ | own, capture_output=True, text=True, check=True)
        return [float(word) for word in done.stdout.split()]

    return run


@pytest.mark.slow
def test_kernels_of_other_packages_are_compiled_anew_when_their_source_changes_or_that_of_one_that_they_call(
    printed, tmp_path
):
    """In the order of the program: the kernel of the changed file, and one in another file that calls it."""
    found = [printed(USER, elsewhere=SOURCE.format(shift=shift)) for shift in (1.0, 2.0, 2.0)]
    assert found == [[2.0, 4.0], [3.0, 6.0], [3.0, 6.0]]
    assert list((tmp_path / "cache").rglob("*.nbc"))


@pytest.mark.slow
def test_a_kernel_is_compiled_anew_when_a_layout_changes_and_when_a_class_that_it_was_kept_with_is_gone(printed):
    fields = ["scale: float", "values: Annotated[Floats, 'B']"]
    for order, name in ((fields, "One"), (fields[::-1], "Other")):
        layouts = LAYOUT.format(fields="\n    ".join(order))
        found = printed("import pinned, named", pinned=PINNED, layouts=layouts, named=NAMED.format(name=name))
        assert found == [15.0, 5.0]


def test_kernels_of_one_name_in_files_of_one_name_do_not_share_a_place_on_disk(tmp_path):
    places = set()
    for folder in ("one", "other"):
        file = tmp_path / folder / "kernels.py"
        file.parent.mkdir()
        file.write_text("from rollingjoint.compiled import kernel\n\n\n@kernel\ndef twice(x):\n    return x + x\n")
        module = importlib.util.module_from_spec(spec := importlib.util.spec_from_file_location("kernels", file))
        spec.loader.exec_module(module)
        places.add(module.twice._cache._impl.filename_base)
    assert len(places) == 2
