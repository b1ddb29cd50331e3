"""Builds a wheel that brings compiled kernels, for one interpreter and this machine's kind of processor, and times it.

    python .ci/platform_wheel.py                             # this interpreter
    python .ci/platform_wheel.py python3.11 python3.14       # these
    python .ci/platform_wheel.py --out dist                  # and keeps the wheels

For each interpreter the plain wheel is installed alone, `rj warmup` compiles all kernels once for every family of
processors of rollingjoint/_numba/shipped.py that runs here, and the wheel is built again with them inside. That one is
installed alone, too; with an empty cache it solves and steps an environment in processes of their own. Prints the
seconds from the start of the import, beside those of the plain wheel, and stops where a kernel was compiled.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path

from check_wheel import TOOLS, Installation, build

FAMILIES = "from rollingjoint._numba.shipped import FAMILIES, runnable; print(*filter(runnable, FAMILIES))"
TARGET = """
import json
from numba.core.registry import cpu_target
print(json.dumps(cpu_target.target_context.codegen().magic_tuple()))
"""
STARTS = {
    "first solve": "import rollingjoint as rj; rj.solve_tensions(rj.five_link(), [6.0, 3.0])",
    "first environment step": (
        "import gymnasium, rj_gym; env = gymnasium.make('rj_gym/RollingJoint-v0'); env.reset(seed=0);"
        " env.step(env.action_space.sample())"
    ),
}
TIMED = """
import os, pathlib, time
start = time.perf_counter()
{program}
seconds = time.perf_counter() - start
compiled = list(pathlib.Path(os.environ["ROLLINGJOINT_CACHE"]).rglob("*.nbc"))
print(f"{{seconds:.2f}} s, {{len(compiled)}} kernels compiled")
"""


def compiled(made: Installation, folder: Path) -> Path:
    """All kernels of an installation, compiled for each family that runs here: FAMILY/target.json and numba's files."""
    for family in made.run("python", "-c", FAMILIES).split():
        cache, out = folder / f"cache-{family}", folder / "machine_code" / family
        environ = {"NUMBA_CPU_NAME": family, "NUMBA_CPU_FEATURES": "", "ROLLINGJOINT_CACHE": str(cache)}
        print(made.run("rj", "warmup", **environ).strip().splitlines()[-1], f"({family})", flush=True)
        [kernels] = cache.glob("kernels-*")
        shutil.copytree(kernels, out)
        target = json.loads(made.run("python", "-c", TARGET, **environ))
        (out / "target.json").write_text(json.dumps(target), "utf-8")
    return folder / "machine_code"


def starts(made: Installation, folder: Path) -> dict[str, str]:
    """Seconds and compiled kernels of each first use, with an empty cache, after bytecode is on disk."""
    timed = {}
    for name, program in STARTS.items():
        for attempt in ("bytecode", "timed"):
            cache = tempfile.mkdtemp(dir=folder)
            timed[name] = made.run("python", "-c", TIMED.format(program=program), ROLLINGJOINT_CACHE=cache).strip()
            if attempt == "bytecode" and "0 kernels" not in timed[name]:
                break
    return timed


def main() -> None:
    """Build and time a wheel for each interpreter."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("interpreters", nargs="*", default=[sys.executable])
    parser.add_argument("--out", type=Path, help="folder for the wheels")
    options = parser.parse_args()
    for interpreter in options.interpreters:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            tools = Installation(interpreter, folder / "tools")
            tools.install(*TOOLS)
            plain = Installation(interpreter, folder / "plain")
            plain.install(str(build(folder / "plain", tools)))
            kernels = compiled(plain, folder)
            wheel = build(folder, tools, kernels)
            made = Installation(interpreter, folder / "made")
            made.install(str(wheel))
            print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.0f} MB", flush=True)
            before, after = starts(plain, folder), starts(made, folder)
            for start in STARTS:
                print(f"{start}: {after[start]}; with the plain wheel {before[start]}", flush=True)
            if any("0 kernels" not in text for text in after.values()):
                raise SystemExit("A kernel is not in the wheel: its warm-up misses it, or its key differs.")
            if options.out:
                options.out.mkdir(parents=True, exist_ok=True)
                print(shutil.copy(wheel, options.out), flush=True)


if __name__ == "__main__":
    main()
