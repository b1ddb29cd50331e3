"""Builds the wheel, installs it alone for every interpreter named, and uses it from an empty folder.

    python .ci/check_wheel.py                           # this interpreter
    python .ci/check_wheel.py python3.11 python3.14     # these
    python .ci/check_wheel.py --out dist                # and keeps the wheel, beside a CycloneDX SBOM

Prints the size of what each installation brings, without and with the extra `plot`; stops at the first failure. The
wheel is built and described by the tools of .ci/wheel.txt, whose hashes pip compares. The SBOM names the wheel by its
hash, and the releases that pip chooses today for this interpreter: what the wheel needs, without extras.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ("rollingjoint", "rj_gym", "agents", "pyproject.toml", "setup.py", "README.md", "LICENSE")
TOOLS = ("--require-hashes", "--only-binary", ":all:", "-r", str(ROOT / ".ci/wheel.txt"))
SOLVE = ["solve", "five_link", "--tensions", "6", "3"]
PLOT = ["plot", "five_link", "--out", "five_link.png"]
ACT = """
import gymnasium, rj_gym
from rj_agents.shipped import load_policy

env = gymnasium.make("rj_gym/RollingJoint-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
policy = load_policy("fixed_target")
env = policy.make_env()
observation, info = env.reset(seed=20000)
for _ in range(50):
    observation, reward, terminated, truncated, info = env.step(policy(observation))
assert info["error_mm"] < 0.5, info
"""
RENDER = """
import gymnasium, rj_gym

env = gymnasium.make("rj_gym/RollingJoint-v0", render_mode="rgb_array")
env.reset(seed=0)
assert env.render().std() > 0
"""
VALIDATE = """
import sys
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

with open(sys.argv[1], encoding="utf-8") as file:
    sys.exit(JsonStrictValidator(SchemaVersion.V1_6).validate_str(file.read()))  # None, or the error
"""


class Installation:
    """A fresh environment of an interpreter, beside an empty folder in which its programs run."""

    def __init__(self, interpreter: str, folder: Path, *options: str) -> None:
        self.empty = folder / "empty"
        self.empty.mkdir(parents=True)
        subprocess.run([interpreter, "-m", "venv", *options, folder / "venv"], check=True)
        self.programs = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
        self.before = self._bytes()

    def run(self, program: str, *arguments: str, fails: bool = False, **variables: str) -> str:
        """What a program of the environment printed; raises SystemExit where it ends otherwise than expected."""
        environ = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")} | variables
        command = [str(self.programs / program), *arguments]
        done = subprocess.run(command, cwd=self.empty, env=environ, capture_output=True, text=True)
        if bool(done.returncode) is not fails:
            raise SystemExit(f"{' '.join(command)}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
        return done.stdout + done.stderr

    def install(self, *what: str) -> None:
        """Install packages."""
        self.run("python", "-m", "pip", "install", "--quiet", *what)

    def megabytes(self) -> int:
        """The size of what was installed, without compiled bytecode and kernels."""
        return round((self._bytes() - self.before) / 1e6)

    def _bytes(self) -> int:
        files = (path for path in self.programs.parent.rglob("*") if path.is_file() and not path.is_symlink())
        return sum(path.stat().st_size for path in files if "__pycache__" not in path.parts)


def build(folder: Path, tools: Installation, kernels: Path | None = None) -> Path:
    """The wheel, built in a folder from a copy of the sources; with compiled kernels, one of this platform."""
    source = folder / "source"
    source.mkdir()
    for path in map(ROOT.joinpath, SOURCES):
        if path.is_dir():
            shutil.copytree(path, source / path.name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(path, source)
    if kernels is not None:
        shutil.copytree(kernels, source / "rollingjoint/machine_code")
    options = ("-q", "--no-deps", "--no-build-isolation", "-w", str(folder))
    tools.run("python", "-m", "pip", "wheel", *options, str(source))
    return next(folder.glob("*.whl"))


def describe(wheel: Path, tools: Installation) -> Path:
    """The SBOM of a wheel and of what it needs, written beside it."""
    out = wheel.with_name(f"{wheel.stem}.cdx.json")
    bare = Installation(sys.executable, wheel.with_name("bare"), "--without-pip")  # pip would be a component
    python = str(bare.programs / "python")
    tools.run("python", "-m", "pip", "--python", python, "install", "--quiet", str(wheel))
    tools.run("cyclonedx-py", "environment", "--output-reproducible", "--sv", "1.6", "-o", str(out), python)
    out.write_text(json.dumps(with_subject(json.loads(out.read_text("utf-8")), wheel), indent=2) + "\n", "utf-8")
    tools.run("python", "-c", VALIDATE, str(out))
    return out


def with_subject(sbom: dict[str, Any], wheel: Path) -> dict[str, Any]:
    """An environment's SBOM with the wheel as its subject, by its name and hash."""
    [subject] = (part for part in sbom["components"] if part["name"] == wheel.name.partition("-")[0])
    [file] = (link for link in subject["externalReferences"] if link["type"] == "distribution")
    file["url"] = wheel.name
    others = [part for part in sbom["components"] if part is not subject]
    return {**sbom, "metadata": {**sbom["metadata"], "component": subject}, "components": others}


def check(made: Installation, wheel: Path) -> str:
    """The sizes of the installation; raises SystemExit where something does not work."""
    made.install(str(wheel))
    alone = made.megabytes()
    assert "CONVERGED" in made.run("rj", *SOLVE)
    made.run("rj", "robots", "--list", "--robots", "2")
    made.run("python", "-c", ACT)
    assert made.run("rj", *PLOT, fails=True).rstrip().endswith('pip install "rollingjoint[plot]"')
    made.install(f"{wheel}[plot]")
    drawn = made.megabytes()
    made.run("rj", *PLOT)
    made.run("python", "-c", RENDER)
    return f"{alone} MB, with plot {drawn} MB"


def main() -> None:
    """Check the wheel with each interpreter."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("interpreters", nargs="*", default=[sys.executable])
    parser.add_argument("--out", type=Path, help="folder for the wheel and its SBOM")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        tools = Installation(sys.executable, Path(folder, "tools"))
        tools.install(*TOOLS)
        wheel = build(Path(folder), tools)
        if options.out:
            options.out.mkdir(parents=True, exist_ok=True)
            for file in (wheel, describe(wheel, tools)):
                print(shutil.copy(file, options.out), flush=True)
        for number, interpreter in enumerate(options.interpreters):
            made = Installation(interpreter, Path(folder, str(number)))
            print(f"{made.run('python', '--version').strip()}: {check(made, wheel)}", flush=True)


if __name__ == "__main__":
    main()
