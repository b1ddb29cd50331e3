"""Compiled kernels are kept where they can be written, and forgotten when any kernel source changes."""

import os
import pickle
import shutil
import stat
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from rollingjoint._numba import cache

ROOT = Path(__file__).resolve().parents[3]

PROGRAM = """
from rollingjoint._numba.cache import cache_directory
from rollingjoint._numba.jit import kernel
from rollingjoint import Profile, Surface, Link, RollingChain, Tendon
import numpy as np
link = Link(Surface(Profile.constant(0.05), (0, -10)), Surface(Profile.constant(-0.05), (0, 10)))
chain = RollingChain([link, link], [Tendon.on_surfaces(5.0)])
print(chain.arc_lengths([-0.1])[0], cache_directory())
"""


def run(folder: Path, program: str = PROGRAM, sources: Path = ROOT, **settings: str) -> list[str]:
    """Words that a program prints in a new process that keeps its kernels in that folder (empty: where it may)."""
    environment = os.environ | {"ROLLINGJOINT_CACHE": str(folder), "PYTHONPATH": str(sources)} | settings
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, cwd=sources, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""  # the announcement is for terminals only
    return done.stdout.split()


@pytest.mark.slow
def test_kernels_are_kept_on_disk(tmp_path):
    arc, folder = run(tmp_path)
    assert float(arc) == pytest.approx(1.0)
    assert Path(folder).parent == tmp_path
    kept = {path: path.stat().st_mtime_ns for path in Path(folder).glob("*.nbc")}
    assert kept
    assert run(tmp_path)[0] == arc
    assert {path: path.stat().st_mtime_ns for path in Path(folder).glob("*.nbc")} == kept


@pytest.mark.slow
def test_damaged_files_and_read_only_places_cost_time_and_nothing_else(tmp_path):
    folder = Path(run(tmp_path)[1])
    for path in folder.iterdir():
        path.write_bytes(b"")
    assert float(run(tmp_path)[0]) == pytest.approx(1.0)
    blocked = tmp_path / "file"
    blocked.write_text("a file where a folder should be")
    assert float(run(blocked)[0]) == pytest.approx(1.0)


@pytest.mark.parametrize("source", ["kernels/rolling.py", "transmission/kernels.py", "_numba/jit.py"])
def test_every_kernel_source_is_part_of_the_key(tmp_path, monkeypatch, source):
    before = cache._source_hash()
    copy = tmp_path / "rollingjoint"
    for room in ("_numba", "kernels", "transmission"):
        shutil.copytree(cache._PACKAGE / room, copy / room, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(cache, "_PACKAGE", copy)
    assert cache._source_hash.__wrapped__() == before
    (copy / source).write_text((copy / source).read_text() + "\n")
    assert cache._source_hash.__wrapped__() != before


def test_a_kernel_of_this_package_outside_the_rooms_is_keyed_by_the_files_of_its_parts():
    from rollingjoint.estimate import equations, kernels

    files, _ = cache._sources(kernels.advance.py_func)
    assert {Path(kernels.__file__), Path(equations.__file__)} <= set(files)


def test_constants_that_a_kernel_imports_are_part_of_its_key(monkeypatch):
    from rj_gym.tracking import kernels

    function = kernels.all_finite.py_func
    before = cache._KernelLocator(function, function.__code__.co_filename).get_source_stamp()
    monkeypatch.setitem(function.__globals__, "TENSIONS", kernels.TENSIONS + 1)
    assert cache._KernelLocator(function, function.__code__.co_filename).get_source_stamp() != before


@pytest.mark.slow
def test_a_home_that_cannot_be_written_leaves_scratch_space(tmp_path):
    blocked, scratch = tmp_path / "file", tmp_path / "scratch"
    blocked.write_text("a file where a folder should be: not even an administrator can write there")
    scratch.mkdir()
    places = {"ROLLINGJOINT_CACHE": "", "XDG_CACHE_HOME": str(blocked), "TMPDIR": str(scratch)}
    arc, folder = run(Path(), **places)
    assert float(arc) == pytest.approx(1.0)
    assert Path(folder).parent.parent == scratch
    assert list(Path(folder).glob("*.nbc"))


@pytest.mark.slow
def test_checkouts_of_one_version_share_their_kernels(tmp_path):
    shutil.copytree(ROOT / "rollingjoint", tmp_path / "rollingjoint", ignore=shutil.ignore_patterns("__pycache__"))
    home = {"ROLLINGJOINT_CACHE": "", "XDG_CACHE_HOME": str(tmp_path / "home")}
    kept = []
    for sources in (ROOT, tmp_path):
        folder = Path(run(Path(), sources=sources, **home)[1])
        assert folder.parent == tmp_path / "home" / "rollingjoint"
        kept.append({path: path.stat().st_mtime_ns for path in folder.iterdir()})
    assert kept[0] and kept[0] == kept[1]


def test_kernels_that_nobody_has_used_for_a_month_are_deleted(tmp_path, monkeypatch):
    monkeypatch.setenv("ROLLINGJOINT_CACHE", str(tmp_path))
    long_ago = time.time() - 31 * 24 * 3600
    for name, used in (("kernels-old", long_ago), ("kernels-new", time.time()), ("of somebody else", long_ago)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").touch()
        os.utime(tmp_path / name, (used, used))
    ours = _found()
    assert {path.name for path in tmp_path.iterdir()} == {"kernels-new", "of somebody else", ours.name}
    os.utime(ours, (long_ago, long_ago))
    assert _found().stat().st_mtime > time.time() - 60.0


@pytest.fixture
def only_scratch(tmp_path, monkeypatch):
    """Scratch space as the only place for kernels that can be written."""
    blocked = tmp_path / "file"
    blocked.write_text("a file where a folder should be")
    monkeypatch.setenv("XDG_CACHE_HOME", str(blocked))
    monkeypatch.delenv("ROLLINGJOINT_CACHE", raising=False)
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    return scratch


def _found() -> Path:
    return cache.cache_directory.__wrapped__()


@pytest.mark.posix
def test_the_folder_of_kernels_belongs_to_its_user_alone(only_scratch):
    folder = _found()
    assert folder.parent.parent == only_scratch
    assert [stat.S_IMODE(each.stat().st_mode) for each in (folder, folder.parent)] == [0o700, 0o700]
    assert _found() == folder


def _open_to_all(folder: Path) -> None:
    folder.chmod(0o777)


def _open_above(folder: Path) -> None:
    folder.parent.chmod(0o777)


def _of_another_user(folder: Path) -> None:
    os.chown(folder, 12345, -1)


def _above_of_another_user(folder: Path) -> None:
    os.chown(folder.parent, 12345, -1)


def _a_link(folder: Path) -> None:
    folder.rename(folder.parent / "elsewhere")
    folder.symlink_to(folder.parent / "elsewhere")


@pytest.mark.posix
@pytest.mark.parametrize("spoil", [_open_to_all, _open_above, _of_another_user, _above_of_another_user, _a_link])
def test_kernels_are_not_read_where_others_could_have_put_them(only_scratch, spoil):
    if "another_user" in spoil.__name__ and os.getuid() != 0:
        pytest.skip("only an administrator can give a folder away")
    expected = _found()
    spoil(expected)
    fresh = _found()
    assert fresh.parent == only_scratch and fresh not in (expected, expected.parent)
    assert stat.S_IMODE(fresh.stat().st_mode) == 0o700 and not list(fresh.iterdir())


class _Evil:
    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self):
        return Path.write_text, (self.marker, "code of another user")


@pytest.mark.slow
@pytest.mark.posix
def test_a_planted_file_is_not_run(tmp_path):
    chosen = tmp_path / "cache"
    folder, marker = Path(run(chosen)[1]), tmp_path / "marker"
    for path in folder.glob("*.nbi"):
        path.write_bytes(pickle.dumps(_Evil(marker)))
    chosen.chmod(0o777)
    environment = os.environ | {"ROLLINGJOINT_CACHE": str(chosen), "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, cwd=ROOT, capture_output=True, text=True)
    assert not marker.exists()
    assert float(done.stdout.split()[0]) == pytest.approx(1.0)
    assert done.stderr == (
        f"rollingjoint: ROLLINGJOINT_CACHE = {str(chosen)!r}: expected a folder of your own that nobody else can "
        "write to; not used\n"
    )
    assert not Path(done.stdout.split()[1]).exists()  # the fresh folder goes with its process


ANNOUNCED = """
import sys
sys.stderr.isatty = lambda: True
from rollingjoint._numba.cache import NotCompiled, without_compiling
from rollingjoint._numba.jit import kernel
import rollingjoint as rj

@kernel(title="a kernel")
def once(x):
    return x

@kernel(title="a kernel")
def twice(x):
    return once(x) + once(x)

try:
    with without_compiling():
        twice(1.0)
except NotCompiled as error:
    print("NotCompiled:", error)
print(twice(1.0), twice(1))
"""


@pytest.mark.slow
def test_what_is_compiled_is_announced_once_and_never_when_it_is_kept(tmp_path):
    (tmp_path / "program.py").write_text(ANNOUNCED)
    environment = os.environ | {"ROLLINGJOINT_CACHE": str(tmp_path / "kernels"), "PYTHONPATH": str(ROOT)}
    line = "rollingjoint: compiling a kernel, some seconds; kept for next time\n"
    for before, said in (("NotCompiled: a kernel\n", line), ("", "")):
        command = [sys.executable, str(tmp_path / "program.py")]
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        assert (done.stdout, done.stderr) == (before + "2.0 2\n", said)


def test_every_kernel_of_the_solvers_has_a_title():
    rooms = (ROOT / "rollingjoint" / room for room in ("kernels", "transmission"))
    names = [path.read_text(encoding="utf-8") for room in rooms for path in room.rglob("*.py")]
    decorators = [line for text in names for line in text.splitlines() if line.startswith("@kernel")]
    assert decorators and all("title=" in line for line in decorators)


ONE_GROUP = """
from rollingjoint.cli import main, warmup_command
from rollingjoint.warmup import GROUPS
warmup_command.all_groups = lambda *chosen: GROUPS[-1:]
main(["warmup"]), main(["warmup"])
"""


@pytest.mark.slow
def test_the_command_keeps_what_its_processes_compile(tmp_path):
    title = ["motors", "and", "sheaths"]
    said = run(tmp_path, ONE_GROUP)
    assert [word for word in said if word.isalpha()][:10] == ["compiling", *title, "compiled", *title, "in", "s"]
    (folder,) = tmp_path.iterdir()
    assert " ".join(said).endswith(f"all kernels are there, kept in {folder}") and list(folder.glob("*.nbc"))


WARM_UP = """
import shutil, sys
from pathlib import Path
from rollingjoint._numba.cache import cache_directory
from rollingjoint.warmup import all_groups, compile_kernels, missing

opened = set()
sys.addaudithook(lambda event, arguments: opened.add(str(arguments[0])) if event == "open" else None)
assert compile_kernels(missing(all_groups())) and not missing(all_groups())
copy = Path(sys.argv[1]) / cache_directory().name
copy.mkdir(mode=0o700)
for path in filter(lambda path: path.suffix in (".nbi", ".nbc"), map(Path, sorted(opened))):
    shutil.copy2(path, copy)
"""


@pytest.fixture(scope="module")
def warm_folder(tmp_path_factory):
    """A folder with the kernels that `rj warmup` leaves in an empty one: the files that its groups read."""
    folder = tmp_path_factory.mktemp("kernels")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", WARM_UP, str(folder)], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


COMPILED = """
from pathlib import Path
from rollingjoint._numba.cache import cache_directory
from rollingjoint.kernels.batch import solve_lanes, stiffness_of
from rollingjoint.kernels.rolling_lanes import solve_alone, solve_pinned
from rollingjoint.kernels.rolling import arc_lengths_of, poses_of

KERNELS = solve_alone, solve_pinned, solve_lanes, stiffness_of, arc_lengths_of, poses_of

def compiled():
    return [kernel.__name__ for kernel in KERNELS if kernel.stats.cache_misses]

def used():
    return [kernel.__name__ for kernel in KERNELS if kernel.signatures]
"""

EVERYTHING = (
    COMPILED
    + """
import numpy as np
import rollingjoint as rj
from rollingjoint.io import report
from rollingjoint.statics import sensitivity

arm, long, loads = rj.five_link(), rj.uniform(40), [rj.WorldForce(-1, (0.3, 0.1)), rj.Spring(2, 0.01, (9.0, 9.0))]
loads.append(rj.BodyWrench(1, (0.1, 0.0)))
loads.append(rj.Gravity([0.1] * 5))
solved = [
    rj.solve_tensions(arm, (3, 2)),
    rj.solve_tensions(arm, (0, 0)),
    rj.solve_tensions(arm, (float("nan"), 1), loads),
    rj.solve_lengths(arm, (88, 98), loads, start=[0.0] * 4),
    rj.solve_lengths(arm, (88, 98), loads, method="least_squares", tension_limits=(0.5, 20)),
    rj.solve_tensions(long, (3, 2)),
    rj.solve_lengths(long, long.neutral_lengths - 1.0, [rj.WorldForce(-1, (1e-4, 0.0))]),
    rj.solve_tensions_batch(arm, [(3, 2), (0, 0)], loads),
    rj.solve_lengths_batch([arm, rj.five_link()], [(88, 98), (86, 99)]),
]
for equilibrium in solved:
    assert equilibrium.stiffness.size and equilibrium.arc_lengths.size and equilibrium.free_joints.size
    assert np.all(equilibrium.smallest_eigenvalue > -1e9)
for function in (sensitivity.dposes_dtensions, sensitivity.dlengths_dtensions, sensitivity.dposes_dlengths):
    function(solved[0]), function(solved[3])
for chain in (arm, long):
    chain.poses(chain.neutral_angles[None]), chain.arc_lengths(chain.neutral_angles), chain.neutral_lengths
report.as_table(solved[0]), report.as_json(solved[3])
print(*compiled(), "of", *used(), *sorted(path.name for path in Path(cache_directory()).iterdir()))
"""
)

WORKER = (
    COMPILED
    + """
def work(tensions):
    import rollingjoint as rj
    equilibrium = rj.solve_tensions(rj.five_link(), tensions)
    return str(equilibrium.status.name), equilibrium.stiffness.shape, compiled(), used()
"""
)

SPAWN = """
import multiprocessing, sys
sys.path.insert(0, {folder!r})
from worker import work
if __name__ == "__main__":
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        for status, shape, compiled, used in pool.map(work, [(3, 2), (0, 0)]):
            print(status, *shape, *compiled, "of", len(used))
"""


@pytest.mark.slow
def test_after_warmup_no_public_call_compiles(warm_folder):
    (folder,) = warm_folder.iterdir()
    kept = sorted(path.name for path in folder.iterdir())
    kernels = ["solve_alone", "solve_pinned", "solve_lanes", "stiffness_of", "arc_lengths_of", "poses_of"]
    assert run(warm_folder, EVERYTHING) == ["of", *kernels, *kept]


@pytest.mark.slow
def test_worker_processes_load_what_is_kept(warm_folder, tmp_path):
    (tmp_path / "worker.py").write_text(WORKER)
    (folder,) = warm_folder.iterdir()
    kept = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    words = run(warm_folder, SPAWN.format(folder=str(tmp_path)))
    assert words == ["CONVERGED", "4", "4", "of", "2", "INDETERMINATE", "4", "4", "of", "3"]
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == kept
