"""Processor times of equilibria among walls and of their gradients in torch: python benchmarks/wall_gradients.py.

An instrument of nine links, each row pushed into a lumen with two bends by another way, and an arm of beads in a tube
in space; least of five on one thread.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import torch

from rollingjoint import Lumen, Sleeve, SpatialChain, Surroundings, Tube, small_arm, two_segment
from rollingjoint.differentiable import (
    DifferentiableChain,
    DifferentiableSpatialChain,
    DifferentiableSpatialSurroundings,
    DifferentiableSurroundings,
    solve_lengths,
)
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


def times_of(chain: Any, walls: Any, design: Any, feeds: tuple[float, float], place: int, count: int) -> list[str]:
    """A row of the table: so many rows, whose bases are pushed in by feeds along an axis."""
    lengths = chain.neutral_lengths - 2.0 / chain.stiffnesses
    base = torch.zeros(count, walls.base_size, dtype=torch.float64)
    base[:, place] = torch.linspace(*feeds, count)

    def solved() -> torch.Tensor:
        pushed = solve_lengths(design, lengths, surroundings=walls, base=base, solver="compiled")
        return pushed.insertion_force.sum()

    push = solved()
    backward = milliseconds(lambda: push.backward(retain_graph=True))
    pressing = solve_lengths(design, lengths, surroundings=walls, base=base).wall_normals.detach() > 0.0
    return [str(count), str(int(pressing.sum())), f"{milliseconds(solved):.0f} ms", f"{backward:.0f} ms"]


def main() -> None:
    """Print the table."""
    torch.set_num_threads(1)
    arm, beads = two_segment(4, 4, height=10, radius=7, half_width=5), SpatialChain.from_arm(small_arm())
    lumen = Surroundings([Lumen([30, 40, 40, 30], [0, 0.02, -0.02, 0], 8.0)], Sleeve(5.0))
    tube = Surroundings([Tube.through([(0, 0, -60), (0, 0, 30), (8, 4, 60), (2, 8, 110)], 16.0, 40.0)], Sleeve(15.0))
    by = ["curvatures", "radii"]
    planar = DifferentiableSurroundings.of(lumen, arm, by), DifferentiableChain.from_mechanism(arm), (10.0, 40.0), 1
    spatial = DifferentiableSpatialSurroundings.of(tube, beads, by), DifferentiableSpatialChain.from_mechanism(beads)
    rows = [["lumen", *times_of(arm, *planar, count)] for count in (1, 16, 256)]
    rows += [["tube in space", *times_of(beads, *spatial, (0.0, 20.0), 2, count)] for count in (1, 16, 256)]
    print(markdown_table(["walls", "rows", "contacts", "solve", "backward pass"], rows))


if __name__ == "__main__":
    main()
