"""Processor times of equilibria among walls and of their gradients in torch: python benchmarks/wall_gradients.py.

An instrument of nine links, each row pushed into a lumen with two bends by another way; least of five on one thread.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import torch

from rollingjoint import Lumen, Sleeve, Surroundings, two_segment
from rollingjoint.differentiable import DifferentiableChain, DifferentiableSurroundings, solve_lengths
from rollingjoint.tables import markdown_table

ROUNDS = 5


def milliseconds(call: Callable[[], object]) -> float:
    """The least processor time of some calls after a first one [ms]."""
    call()
    times = []
    for _ in range(ROUNDS):
        begun = time.process_time()
        call()
        times.append(time.process_time() - begun)
    return 1e3 * min(times)


def main() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    arm = two_segment(4, 4, height=10, radius=7, half_width=5)
    around = Surroundings([Lumen([30, 40, 40, 30], [0, 0.02, -0.02, 0], 8.0)], Sleeve(5.0))
    walls = DifferentiableSurroundings.of(around, arm, ["curvatures", "radii"])
    design, lengths = DifferentiableChain.from_mechanism(arm), arm.neutral_lengths - 2.0 / arm.stiffnesses
    rows = []
    for count in (1, 16, 256):
        base = torch.zeros(count, 3, dtype=torch.float64)
        base[:, 1] = torch.linspace(10.0, 40.0, count)

        def solved(base: torch.Tensor = base) -> torch.Tensor:
            return solve_lengths(
                design, lengths, surroundings=walls, base=base, solver="compiled"
            ).insertion_force.sum()

        push = solved()
        backward = milliseconds(lambda push=push: push.backward(retain_graph=True))
        pressing = solve_lengths(design, lengths, surroundings=walls, base=base).wall_normals.detach() > 0.0
        rows.append([str(count), str(int(pressing.sum())), f"{milliseconds(solved):.0f} ms", f"{backward:.0f} ms"])
    print(markdown_table(["rows", "contacts", "solve", "backward pass"], rows))


if __name__ == "__main__":
    main()
