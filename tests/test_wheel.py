"""The wheel: its controllers are rj_agents, whatever else is called agents; `rj` has their commands."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
COMMANDS = PROJECT["entry-points"]["rollingjoint.commands"]
SOURCES = ("rollingjoint", "rj_gym", "agents", "configs", "pyproject.toml", "setup.py", "README.md", "LICENSE")
USED = """
import sys
from rollingjoint.cli import main
assert sys.path[0] == ""  # as with python -m
assert main(["train", "apg_instrument", "--write", "mine.yaml"]) == 0  # a configuration of the wheel
assert main(["train", "run.yaml", "--run-dir", "run"]) == 0
assert main(["evaluate", "run", "--episodes", "2"]) == 0
assert "agents" not in sys.modules
"""
RUN = """
total_timesteps: 40
env: {n_envs: 2, settings: {episode_steps: 10}}
parameters: {n_steps: 20, batch_size: 20, n_epochs: 1}
policy: {hidden: [8]}
evaluation: {episodes: 2}
"""


@pytest.mark.parametrize(("name", "place"), COMMANDS.items())
def test_a_command_of_rj_is_one_of_the_controllers(name, place):
    module, _, function = place.partition(":")
    assert module.startswith("rj_agents.")
    found = import_module(module.removeprefix("rj_"))
    with pytest.raises(SystemExit, match="0"):
        getattr(found, function)(["--help"])


def test_every_command_of_the_controllers_is_one_of_rj():
    modules = {place.removeprefix("rj_agents.").partition(":")[0] for place in COMMANDS.values()}
    there = {path.stem for path in (ROOT / "agents").glob("*.py")} - {"__init__", "shipped"}
    there |= {f"{path.parent.name}.__main__" for path in (ROOT / "agents").glob("*/__main__.py")}
    assert modules == there


@pytest.fixture
def page_of_index():
    """The function of setup.py."""
    pytest.importorskip("setuptools")
    spec = spec_from_file_location("setup_of_the_wheel", ROOT / "setup.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.page_of_index


@pytest.mark.parametrize("address", [None, "https://example.org/joint"])
def test_links_on_the_page_of_an_index_lead_somewhere(address, page_of_index):
    page = page_of_index((ROOT / "README.md").read_text("utf-8"), address)
    links = re.findall(r"\]\(([^)]*)\)", page)
    assert [link for link in links if "://" not in link] == []
    assert "docs/friction.md" in page and ("example.org/joint/raw/main/docs/images/demo.gif" in page) is bool(address)
    assert bool(links) is bool(address)


def test_the_address_of_the_repository_is_set_in_one_place(page_of_index):
    assert page_of_index("![a](b.png) [c](d.md#e) [f](https://g.h)", None) == " c [f](https://g.h)"
    assert "readme" in PROJECT["dynamic"] and PROJECT.get("urls", {}).keys() <= {"Repository"}


def _all_but_sources(folder: str, names: list[str]) -> list[str]:
    return [name for name in names if name == "__pycache__" or (Path(folder) == ROOT and name not in SOURCES)]


def test_the_page_on_the_command_line_lists_them_with_their_modules():
    page = (ROOT / "docs/cli.md").read_text("utf-8")
    listed = dict(re.findall(r"^\| `rj ([\w-]+)` \| `agents\.(\w+)` \|", page, re.MULTILINE))
    places = {name: place.removeprefix("rj_agents.").partition(":")[0] for name, place in COMMANDS.items()}
    assert listed == {name: module.removesuffix(".__main__") for name, module in places.items()}


@pytest.mark.slow
def test_the_wheel_works_in_an_empty_folder_beside_other_packages_called_agents(tmp_path):
    """Builds it, unpacks it, trains and evaluates; takes as long as starting torch and compiling kernels do."""
    shutil.copytree(ROOT, tmp_path / "source", ignore=_all_but_sources)
    build = [sys.executable, "-m", "pip", "wheel", "-q", "--no-build-isolation", "--no-deps", "-w", str(tmp_path)]
    subprocess.run([*build, str(tmp_path / "source")], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        tops = {name.partition("/")[0] for name in archive.namelist()}
        assert {top for top in tops if not top.endswith(".dist-info")} == {"rollingjoint", "rj_gym", "rj_agents"}
        archive.extractall(tmp_path / "installed")
    for place in ("installed", "empty"):
        (tmp_path / place / "agents").mkdir(parents=True)
        (tmp_path / place / "agents/__init__.py").write_text("raise ImportError('of somebody else')")
    (tmp_path / "empty/run.yaml").write_text(RUN)
    environ = os.environ | {"PYTHONPATH": str(tmp_path / "installed")}
    used = subprocess.run(
        [sys.executable, "-c", USED], cwd=tmp_path / "empty", env=environ, capture_output=True, text=True
    )
    assert used.returncode == 0, used.stderr
    assert "Next: rj evaluate run" in used.stdout
    assert (tmp_path / "empty/run/command.txt").read_text().startswith("rj train run.yaml")
