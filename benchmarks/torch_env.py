"""Steps per second of environments of tensors, and solves per second: python benchmarks/torch_env.py --device cuda.

The native vector environment, on the CPU, steps in turns with them. Numbers of lanes grow until one takes longer than
the limit, or more memory than there is. Without a CUDA device the CPU is measured, and the table says so.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import gymnasium
import numpy as np
import torch

from rj_gym.torch_env import TorchTrackingEnv
from rollingjoint import five_link
from rollingjoint.differentiable import DifferentiableChain, SideBySide, solve_lengths
from rollingjoint.load import LOAD_COLUMNS
from rollingjoint.tables import markdown_table

ENV_ID = "rj_gym/RollingJoint-v0"  # without --id
LANES = (64, 256, 1024, 4096, 16_384, 65_536, 262_144)
STEPS = 12  # Newton's method from neutral poses
OUT_OF_MEMORY = (MemoryError, torch.OutOfMemoryError) if hasattr(torch, "OutOfMemoryError") else (MemoryError,)


def chosen_device(name: str | None) -> torch.device:
    """The device of this name; a CUDA device if there is one, else the CPU."""
    return torch.device(name or ("cuda" if torch.cuda.is_available() else "cpu"))


def device_name(device: torch.device) -> str:
    if device.type == "cuda":
        return f"{torch.cuda.get_device_name(device)} (cuda)"
    note = "" if torch.cuda.is_available() else "; this machine has no CUDA device"
    return f"CPU, {torch.get_num_threads()} threads of torch{note}"


def seconds(work: Callable[[], object], device: torch.device, repeats: int) -> float:
    """The shortest of some runs, when the device has finished [s]."""
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        if device.type == "cuda":
            torch.cuda.synchronize(device)
        best = min(best, time.perf_counter() - start)
    return best


def stepping(env_id: str, lanes: int, device: torch.device, repeats: int) -> list[str]:
    """Lanes; steps/s on the device and of the native environment; their ratio; how many lanes the host solves, %."""
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1.0, 1.0, (16, lanes, 2)).astype(np.float32)
    tensors = torch.tensor(actions, device=device)
    ours = TorchTrackingEnv(env_id, lanes, device)
    native = gymnasium.make_vec(env_id, lanes, "vector_entry_point")
    ours.reset(seed=0), native.reset(seed=0)
    turns = itertools.count()
    steps = 0

    def step_ours() -> None:
        nonlocal steps
        steps += 1
        ours.step(tensors[next(turns) % 16])

    step_ours(), native.step(actions[0])  # caches fill
    fastest = [np.inf, np.inf]
    for turn in range(repeats):  # in turns, and fewer than an episode has, so that nobody resets
        fastest[0] = min(fastest[0], seconds(step_ours, device, 1))
        fastest[1] = min(fastest[1], seconds(lambda turn=turn: native.step(actions[turn % 16]), torch.device("cpu"), 1))
    left = 100.0 * ours.host_solves / (steps * lanes)
    rates = [lanes / each for each in fastest]
    return [f"{lanes:,}", f"{rates[0]:,.0f}", f"{rates[1]:,.0f}", f"{rates[0] / rates[1]:.3f}", f"{left:.1f}"]


def solving(rows: int, device: torch.device, repeats: int) -> list[str]:
    """Rows; solves/s with as many Newton steps as rows need, with a fixed number, and side by side."""
    rng = np.random.default_rng(0)
    chain = five_link()
    commands = torch.tensor(chain.neutral_lengths - 1.0 + rng.uniform(-3.0, 1.0, (rows, 2)), device=device)
    loads = torch.zeros(rows, 1, len(LOAD_COLUMNS), dtype=torch.float64, device=device)
    loads[:, 0, 0] = 4.0
    loads[:, 0, 3:5] = torch.tensor(rng.uniform(-0.5, 0.5, (rows, 2)), device=device)
    design = DifferentiableChain.from_mechanism(chain, device=device)
    solver = SideBySide(chain.arrays, np.zeros(rows, np.int64), device)
    starts = torch.tensor(np.tile(chain.neutral_angles, (rows, 1)), device=device)
    stiffnesses = design.stiffnesses.expand(rows, 2)
    low, high = (torch.tensor(limit, dtype=torch.float64, device=device) for limit in (0.5, 15.0))

    def with_looks() -> None:
        solve_lengths(design, commands, loads, starts, tension_limits=(low, high))

    def with_steps() -> None:
        solve_lengths(design, commands, loads, starts, tension_limits=(low, high), steps=STEPS)

    def side_by_side() -> None:
        solver.solve(commands, stiffnesses, (low, high), loads, starts)

    rates = [rows / seconds(work, device, repeats) for work in (with_looks, with_steps, side_by_side)]
    return [f"{rows:,}", *(f"{rate:,.0f}" for rate in rates)]


def growing(
    measure: Callable[[int, torch.device, int], list[str]],
    sizes: Sequence[int],
    device: torch.device,
    args: argparse.Namespace,
) -> Iterator[list[str]]:
    """A row for every size, up to one that takes longer than the limit or more memory than there is."""
    for size in sizes:
        start = time.perf_counter()
        try:
            with torch.no_grad():
                yield measure(size, device, args.repeats)
        except OUT_OF_MEMORY:
            print(f"{size:,}: not enough memory")
            return
        if time.perf_counter() - start > args.limit:
            print(f"{size:,} took longer than {args.limit:g} s: larger ones are left out")
            return


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", help="cpu or cuda; default: a CUDA device if there is one")
    parser.add_argument("--id", default=ENV_ID, help="of the environment; default: %(default)s")
    parser.add_argument("--lanes", type=int, nargs="+", default=LANES, help="numbers of lanes and rows, growing")
    parser.add_argument("--limit", type=float, default=60.0, help="of the time for one number of lanes [s]")
    parser.add_argument("--repeats", type=int, default=5, help="the shortest of so many is counted")
    args = parser.parse_args(arguments)
    device = chosen_device(args.device)
    print(f"Device: {device_name(device)}\n\nSteps of {args.id}:\n")
    header = ["lanes", "steps/s on the device", "steps/s, native (CPU)", "ratio", "solved by the host, %"]
    print(markdown_table(header, list(growing(partial(stepping, args.id), args.lanes, device, args))), "\n")
    header = ["rows", "solves/s, solve_lengths", f"solves/s, steps={STEPS}", "solves/s, SideBySide"]
    print(markdown_table(header, list(growing(solving, args.lanes, device, args))))


if __name__ == "__main__":
    main()
