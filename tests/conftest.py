"""Settings for every test: no screen is needed, kernels are compiled once, programs start from the sources."""

import gc
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

os.environ["MPLBACKEND"] = "Agg"
os.environ["SDL_VIDEODRIVER"] = "dummy"
os.environ["PYGAME_HIDE_SUPPORT_PROMPT"] = "1"

signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background of a shell ignores Ctrl-C

ROOT = Path(__file__).resolve().parent.parent

BROWSER_FLAGS = """
--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking
--disable-component-update --disable-sync --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader
"""
BROWSERS = ("chromium", "chromium-browser", "google-chrome")

# Modules whose tests share what takes long to make: runs, a search, a cluster, a process to fork from, what ribs
# compiles.
ON_ONE_WORKER = {
    f"tests/agents/{module}.py": group
    for group, modules in {
        "cluster": ("executors/test_cluster",),
        "processes": ("training/test_campaign", "training/test_resume", "tuning/test_tune"),
        "results": ("results/test_results",),
        "search": ("search/test_command", "search/test_search"),
        "train": ("training/test_train",),
        "unseen": ("search/test_unseen",),
    }.items()
    for module in modules
} | {"tests/test_site.py": "site"}  # built in one folder


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Tests go to any worker, groups as a whole (the marks of pytest-xdist 3.8 have no effect under pytest 9.2)."""
    from xdist.scheduler import LoadScopeScheduling

    class GroupScheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return ON_ONE_WORKER.get(nodeid.partition("::")[0], nodeid)

    return GroupScheduling(config, log)


def pytest_configure(config: pytest.Config) -> None:
    """Compile the kernels before several workers would each compile all; collect no garbage before the tests."""
    gc.disable()
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        import rj_gym.warmup
        from rollingjoint.warmup import GROUPS, compile_kernels, missing
        from tests import warmup

        if not compile_kernels(missing((*warmup.GROUPS, *rj_gym.warmup.GROUPS, *GROUPS))):
            raise pytest.UsageError("the kernels do not compile")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the tests of several minutes: one at the end would leave the other workers without work."""
    items.sort(key=lambda item: -max((mark.kwargs.get("minutes", 0) for mark in item.iter_markers("slow")), default=0))


def pytest_collection_finish() -> None:
    """Let garbage collections leave out what all tests share: modules and tests are millions of objects."""
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True)
def _forgotten_modules(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Forget the modules that a test wrote and imported: another test's may have the same name."""
    before = set(sys.modules)
    yield
    written = str(tmp_path_factory.getbasetemp())
    for name in sys.modules.keys() - before:
        if str(getattr(sys.modules[name], "__file__", None)).startswith(written):
            del sys.modules[name]


def sources_first() -> dict[str, str]:
    """An environment in which a program imports the packages from the sources."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths)}


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """Chromium of the operating system, driven by Playwright."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip("no Chromium: install your system's, for example apt install chromium")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=found, args=BROWSER_FLAGS.split())
        yield chromium
        chromium.close()


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, empty but for the project's `configs/` and `examples/data/`."""
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    (tmp_path / "examples").mkdir()
    (tmp_path / "examples" / "data").symlink_to(ROOT / "examples" / "data")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run_python(workplace: Path) -> Callable[..., str]:
    """Runs this interpreter on some arguments in the workplace; returns what it printed.

    The program has to succeed and must not warn.
    """

    def run(*arguments: str) -> str:
        done = subprocess.run([sys.executable, *arguments], env=sources_first(), capture_output=True, text=True)
        assert done.returncode == 0, f"{arguments} failed:\n{done.stdout}\n{done.stderr}"
        assert "Warning" not in done.stderr, f"{arguments} warned:\n{done.stderr}"
        return done.stdout

    return run


@pytest.fixture
def one_torch_thread() -> Iterator[None]:
    """Small tensors are fastest on one thread, and workers side by side have no more."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
