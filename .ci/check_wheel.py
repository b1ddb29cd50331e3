"""Builds the wheel, installs it alone for every interpreter named, and uses it from an empty folder.

    python .ci/check_wheel.py                           # this interpreter
    python .ci/check_wheel.py python3.11 python3.14     # these

Prints the size of what each installation brings, without and with the extra `plot`; stops at the first failure.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ("rollingjoint", "rj_gym", "agents", "pyproject.toml", "setup.py", "README.md", "LICENSE")
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


class Installation:
    """A fresh environment of an interpreter, beside an empty folder in which its programs run."""

    def __init__(self, interpreter: str, folder: Path) -> None:
        self.empty = folder / "empty"
        self.empty.mkdir(parents=True)
        subprocess.run([interpreter, "-m", "venv", folder / "venv"], check=True)
        self.programs = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
        self.before = self._bytes()

    def run(self, program: str, *arguments: str, fails: bool = False) -> str:
        """What a program of the environment printed; raises SystemExit where it ends otherwise than expected."""
        environ = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
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


def build(folder: Path) -> Path:
    """The wheel, built in a folder from a copy of the sources."""
    source = folder / "source"
    source.mkdir()
    for path in map(ROOT.joinpath, SOURCES):
        if path.is_dir():
            shutil.copytree(path, source / path.name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(path, source)
    subprocess.run([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, source], check=True)
    return next(folder.glob("*.whl"))


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


def main(interpreters: Sequence[str]) -> None:
    """Check the wheel with each interpreter."""
    with tempfile.TemporaryDirectory() as folder:
        wheel = build(Path(folder))
        for number, interpreter in enumerate(interpreters):
            made = Installation(interpreter, Path(folder, str(number)))
            print(f"{made.run('python', '--version').strip()}: {check(made, wheel)}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:] or [sys.executable])
