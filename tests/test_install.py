"""What is installed for what: bounds, extras, docs/install.md, and one line where an extra is missing."""

import re
import sys
import tomllib
from pathlib import Path

import gymnasium
import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import rj_gym  # noqa: F401 (registers the ids)
from rollingjoint import errors, five_link, small_arm, trace_loop
from rollingjoint.cli import main
from rollingjoint.friction import CapstanFriction
from rollingjoint.plotting import figure_of, plot_arm, plot_loops, plot_mechanism, save_animation

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
PAGE = (ROOT / "docs/install.md").read_text("utf-8")
DISTRIBUTIONS = {"PIL": "pillow", "h5py": "minari[hdf5]", "minari": "minari[hdf5]"}
DRAWING = ("matplotlib", "PIL", "pygame")
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
NOT_LOCKED = {"video", "track", "step"}  # 250 MB whose tests need none of it
LOCKED = ("constraints.txt", ".ci/uv.txt", ".ci/wheel.txt")
ENTRY = re.compile(
    r"(\S+==[^;\\]+(?: ; [^\\]+)?) \\\n((?:    --hash=sha256:[0-9a-f]{64} \\\n)*    --hash=sha256:[0-9a-f]{64})\n"
)


def loop():
    return trace_loop(five_link().replace(friction=CapstanFriction(0.1)), (-5, 5), steps=5, cycles=1)


def requirements(extra):
    """What an extra brings, with the extras that it names."""
    for requirement in EXTRAS[extra]:
        inner = re.fullmatch(r"rollingjoint\[(.*)\]", requirement)
        if inner:
            for name in inner[1].split(","):
                yield from requirements(name)
        else:
            yield requirement


@pytest.mark.parametrize(("extra", "packages"), errors._EXTRAS.items())
def test_the_extra_that_an_error_names_brings_the_package(extra, packages):
    brought = {re.split("[><=]", requirement)[0] for requirement in requirements(extra)}
    assert {DISTRIBUTIONS.get(name, name.replace("_", "-")) for name in packages} <= brought


def test_a_package_has_one_lower_bound():
    everything = [*PROJECT["dependencies"], *(one for extra in EXTRAS for one in requirements(extra))]
    bounds = {}
    for requirement in everything:
        name, _, bound = requirement.partition(" ")[0].partition(">=")
        bounds.setdefault(name, set()).add(bound)
    assert {name for name, found in bounds.items() if len(found) > 1} == {"scipy"}  # a higher one in search


def test_the_page_has_every_extra_and_the_bounds():
    assert set(re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)) == EXTRAS.keys() - {"dev", "benchmarks"}
    written = re.findall(r"^\| ([\w-]+) \| (\d[\d.]*)(?:; ([\d.]+) with `(\w+)`)? \|", PAGE, re.MULTILINE)
    assert len(written) == 7
    known = {*PROJECT["dependencies"], *requirements("train")}
    assert [name for name, bound, *_ in written if f"{name.lower()}>={bound}" not in known] == []
    assert all(f"scipy>={bound}" in EXTRAS[extra] for *_, bound, extra in written if extra)


def test_commands_of_the_page_exist():
    named = {extra for listed in re.findall(r'"\.\[(.*?)\]"', PAGE) for extra in listed.split(",")}
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert named <= EXTRAS.keys()
    assert set(re.findall(r"make ([a-z-]+)", PAGE)) <= set(targets)


def test_ci_has_the_lowest_and_newest_releases_and_the_wheel_with_every_python():
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text("utf-8"))["jobs"]
    pythons = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if "Python :: 3." in line]
    assert jobs["wheel"]["strategy"]["matrix"]["python"] == pythons
    assert PROJECT["requires-python"] == f">={pythons[0]}"
    assert {"run": "make test-lowest"} in jobs["lowest"]["steps"]
    assert "constraints" not in str(jobs["newest"])


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_an_action_is_named_by_its_commit_beside_its_version(path):
    used = re.findall(r"uses: (.*)", path.read_text("utf-8"))
    assert [one for one in used if not re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+", one)] == []
    assert len({one.partition("@")[0] for one in used}) == len(set(used))  # one version of each


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_checkout_leaves_no_credentials(path):
    steps = [step for job in yaml.safe_load(path.read_text("utf-8"))["jobs"].values() for step in job["steps"]]
    checkouts = [step for step in steps if step.get("uses", "").startswith("actions/checkout@")]
    assert checkouts and all(step["with"]["persist-credentials"] is False for step in checkouts)


def locked(name):
    """The requirements of a file whose every line belongs to an exact release and its hashes, or is a comment."""
    text = (ROOT / name).read_text("utf-8")
    assert re.sub("#.*\n", "", ENTRY.sub("", text)) == ""
    return [Requirement(requirement) for requirement, _ in ENTRY.findall(text)]


@pytest.mark.parametrize("name", LOCKED)
def test_an_installation_is_of_exact_releases_with_hashes(name):
    found = locked(name)
    assert found and all(len(one.specifier) == 1 and "*" not in str(one.specifier) for one in found)
    names = [one.name for one in found]
    assert all(one.marker for one in found if names.count(one.name) > 1)  # torch, whose CPU build is Linux's


def test_what_pyproject_asks_for_is_locked_within_its_bounds():
    releases = {canonicalize_name(one.name): str(one.specifier)[2:] for one in locked("constraints.txt")}
    installed = re.search(r"^EXTRAS := (\S+)$", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)[1].split(",")
    assert {*installed} == EXTRAS.keys() - NOT_LOCKED - {"plot", "design"}  # these come with others
    everything = [*PROJECT["dependencies"], *(one for extra in installed for one in requirements(extra))]
    wanted = [(canonicalize_name(one.name), one.specifier) for one in map(Requirement, everything)]
    assert [name for name, bounds in wanted if not bounds.contains(releases[name])] == []


def test_only_jobs_about_other_releases_install_without_hashes():
    lines = [*(ROOT / "Makefile").read_text("utf-8").splitlines(), *WORKFLOWS[0].read_text("utf-8").splitlines()]
    installing = [line for line in lines if re.search(r"pip\)? install|PIP\) (install|\$\(VERIFIED)", line)]
    verified = ("$(VERIFIED)", "--require-hashes", "-c constraints.txt", "--no-deps --no-build-isolation -e .")
    others = [line for line in installing if not any(option in line for option in verified)]
    assert len(installing) > 6 and len(others) == 2
    assert "--resolution lowest-direct" in others[0] and "uv pip install --system --torch-backend cpu -e" in others[1]


def test_ci_keeps_the_wheel_beside_its_bill_of_materials():
    run, kept = yaml.safe_load(WORKFLOWS[0].read_text("utf-8"))["jobs"]["wheel"]["steps"][-2:]
    assert run == {"run": "python .ci/check_wheel.py --out dist"}
    assert kept["uses"].startswith("actions/upload-artifact@") and kept["with"]["path"] == "dist"


@pytest.fixture
def without_plot(monkeypatch):
    """The packages of the extra cannot be imported."""
    for name in {*DRAWING, *(loaded for loaded in sys.modules if loaded.partition(".")[0] in DRAWING)}:
        monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.parametrize(
    "draw",
    [
        lambda: figure_of(five_link()),
        lambda: plot_mechanism(five_link()),
        lambda: plot_arm(small_arm()),
        lambda: plot_loops([loop()], ["loop"]),
        lambda: save_animation(loop(), "loop.gif"),
        lambda: gymnasium.make("rj_gym/RollingJoint-v0", render_mode="rgb_array"),
        lambda: gymnasium.make("rj_gym/FlexibleArm-v0", render_mode="human"),
        lambda: gymnasium.make_vec("rj_gym/RollingJoint-v0", 2, "vector_entry_point", render_mode="rgb_array"),
    ],
)
def test_a_picture_without_the_extra_is_an_error_that_names_it(draw, without_plot):
    with pytest.raises(errors.MissingPackage, match=r'^\w+ is not installed: run pip install "rollingjoint\[plot\]"$'):
        draw()


def test_a_command_without_the_extra_says_what_the_page_says(without_plot, capsys):
    command, line = re.search(r"^\$ rj (.*)\n(.*)$", PAGE, re.MULTILINE).groups()
    assert main(command.split()) == 2
    assert capsys.readouterr().err == f"{line}\n"
