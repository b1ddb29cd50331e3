"""Compiled kernels inside the package: used where the processor runs them and the sources are theirs, else compiled."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rollingjoint._numba import shipped

ROOT = Path(__file__).resolve().parents[3]
PROGRAM = """
import sys
from pathlib import Path
from rollingjoint._numba import cache, shipped
shipped.FOLDER = Path(sys.argv[1])
shipped.FAMILIES["x86-64-v4"] = ("x86_64", tuple(sys.argv[2:]))
shipped.FAMILIES["generic"] = ("aarch64", tuple(sys.argv[2:]))
from rollingjoint import Link, Profile, RollingChain, Surface, Tendon
link = Link(Surface(Profile.constant(0.05), (0, -10)), Surface(Profile.constant(-0.05), (0, 10)))
arc = RollingChain([link, link], [Tendon.on_surfaces(5.0)]).arc_lengths([-0.1])[0]
assert abs(arc - 1.0) < 1e-12
print(len(list(cache.cache_directory().glob("*.nbc"))))
"""
TARGET = """
import json
from numba.core.registry import cpu_target
print(json.dumps(cpu_target.target_context.codegen().magic_tuple()))
"""


def run(cache: Path, program: str, *arguments: str, **settings: str) -> str:
    """What a program prints in a new process that keeps its kernels in that folder."""
    environ = os.environ | {"ROLLINGJOINT_CACHE": str(cache), "PYTHONPATH": str(ROOT)} | settings
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, env=environ, capture_output=True, text=True, check=True).stdout


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """A folder of kernels as in a platform wheel, and the number of kernels that the program compiled."""
    folder = tmp_path_factory.mktemp("machine_code")
    count = run(folder / "cache", PROGRAM, str(folder))
    family = "x86-64-v4" if json.loads(run(folder, TARGET))[0].startswith("x86_64") else "generic"
    [kernels] = (folder / "cache").iterdir()
    kernels.rename(folder / family)
    (folder / family / shipped.TARGET).write_text(run(folder, TARGET))
    return folder, int(count)


@pytest.mark.slow
def test_nothing_is_compiled_where_the_package_brings_kernels(package, tmp_path):
    folder, count = package
    assert count > 0
    assert int(run(tmp_path, PROGRAM, str(folder))) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "settings"),
    [
        (["a feature of later processors"], {}),
        ([], {"NUMBA_CPU_NAME": "generic"}),
        ([], {"ROLLINGJOINT_CHECK_BOUNDS": "1"}),
    ],
    ids=["another processor", "a processor that the user names", "checked kernels"],
)
def test_elsewhere_kernels_are_compiled_as_before(arguments, settings, package, tmp_path):
    assert int(run(tmp_path, PROGRAM, str(package[0]), *arguments, **settings)) > 0


@pytest.mark.slow
def test_kernels_of_other_sources_and_damaged_ones_are_not_used(package, tmp_path):
    folder, count = package
    changed = tmp_path / "changed"
    for path in [path for path in folder.rglob("*") if path.is_file()]:
        copy = changed / path.relative_to(folder)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes()[: 100 if path.suffix == ".nbc" else None])
    assert int(run(tmp_path / "damaged", PROGRAM, str(changed))) == count
    for path in changed.rglob("*.nbi"):
        path.write_bytes(path.read_bytes().replace(_stamp(path), b"0" * 32))
    for path in folder.rglob("*.nbc"):
        (changed / path.relative_to(folder)).write_bytes(path.read_bytes())
    assert int(run(tmp_path / "others", PROGRAM, str(changed))) == count


def _stamp(index: Path) -> bytes:
    """The hash of the sources in an index."""
    import pickle

    with index.open("rb") as file:
        pickle.load(file)
        return pickle.load(file)[0].encode()


def test_the_package_names_families_of_both_architectures_by_llvms_features():
    import llvmlite.binding

    here = llvmlite.binding.get_host_cpu_features()
    architecture = llvmlite.binding.get_process_triple().split("-")[0]
    ours = {name: needs for name, (kind, needs) in shipped.FAMILIES.items() if kind == architecture}
    assert all(need in here for needs in ours.values() for need in needs)
    assert [name for name, needs in ours.items() if all(map(here.get, needs))] == [
        name for name in ours if shipped.runnable(name)
    ]
