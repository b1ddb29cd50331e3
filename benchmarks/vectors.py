"""What vectors of either dimension cost: the gap of eight SIMD lanes through kernels.vectors, and written out.

    python benchmarks/vectors.py     # some seconds after the kernels are compiled

Prints the time of a gap in a lane both ways and their ratio, the median of pairs measured in turn, and whether all
numbers are equal to the last bit.
"""

from __future__ import annotations

import math
import statistics
import time

import numpy as np

from rollingjoint import five_link
from rollingjoint._numba.borrowed import borrow
from rollingjoint._numba.jit import kernel, part
from rollingjoint._numba.simd import WIDTH, any_lane, where
from rollingjoint._numba.views import aligned_simd, carve
from rollingjoint.kernels.joints import CLOSED_GAP, COS, CX, CY, GX, GY, PX, PY, SIN, aligned, normal
from rollingjoint.kernels.rolling import evaluate_gap

JOINTS, TENDONS = 4, 2
PAIRS, ROUNDS = 15, 100_000


@part(inline=True)
def written_out(holes, i, j, joint, gap):
    """`evaluate_gap` in coordinates."""
    x, y = holes[i, j, 2], holes[i, j, 3]
    vx = joint[i, GX] + joint[i, COS] * x - joint[i, SIN] * y - holes[i, j, 0]
    vy = joint[i, GY] + joint[i, SIN] * x + joint[i, COS] * y - holes[i, j, 1]
    length = math.sqrt(vx * vx + vy * vy)
    closed = length <= CLOSED_GAP
    per_length = 1.0 / where(closed, 1.0, length)
    vx, vy = vx * per_length, vy * per_length
    if any_lane(closed):
        nx, ny = normal(joint, i)
        vx, vy = where(closed, nx, vx), where(closed, ny, vy)
    jrx = -(holes[i, j, 1] + length * vy - joint[i, CY])
    jry = holes[i, j, 0] + length * vx - joint[i, CX]
    along = vx * jrx + vy * jry
    turn = (jrx * jrx + jry * jry - along * along) * where(closed, 0.0, per_length)
    gap[i, j, 0], gap[i, j, 1] = length, along
    gap[i, j, 2] = turn - vx * (jry - joint[i, PY]) + vy * (jrx - joint[i, PX])
    gap[i, j, 3], gap[i, j, 4] = vx, vy


@kernel(short_loops=True, title="a benchmark")
def gaps(memory, by_vectors, rounds):
    """Evaluate the gaps in memory so many times: joints, holes, gaps, eight lanes each."""
    _gaps_in(memory, by_vectors, rounds)


@part
def _gaps_in(memory, by_vectors, rounds):
    space = aligned_simd(borrow(memory))
    joint = carve(space, 0, (JOINTS, 8))
    holes = carve(space, 8 * JOINTS, (JOINTS, TENDONS, 4))
    gap = carve(space, 8 * JOINTS + 4 * JOINTS * TENDONS, (JOINTS, TENDONS, 5))
    for _ in range(rounds):
        for i in range(JOINTS):
            joint[i, GX] = joint[i, GX] + 1e-3 * gap[i, 0, 2]  # nothing may be moved out of the loop
            for j in range(TENDONS):
                if by_vectors:
                    evaluate_gap(holes, i, j, joint, gap)
                else:
                    written_out(holes, i, j, joint, gap)


def drawn() -> np.ndarray:
    """Memory of eight lanes: joints near those of the five-link prototype at rest, its holes, no gaps yet."""
    chain, rng = five_link(), np.random.default_rng(0)
    joints, holes, found = 8 * JOINTS, 4 * JOINTS * TENDONS, 5 * JOINTS * TENDONS
    memory = aligned(np.zeros((joints + holes + found) * WIDTH))
    numbers = memory[: (joints + holes) * WIDTH].reshape(-1, WIDTH)
    at_rest = np.tile([1.0, 0.0, 0.0, 9.0, 0.0, 18.0, -4.0, 0.0], JOINTS)
    numbers[:joints] = at_rest[:, None] + rng.normal(scale=0.05, size=(joints, WIDTH))
    numbers[joints:] = chain.arrays.holes[0].reshape(-1, 1) + rng.normal(scale=0.05, size=(holes, WIDTH))
    return memory


def main() -> None:
    """Print the comparison."""
    both = [drawn(), drawn()]
    for by_vectors, memory in enumerate(both):
        gaps(memory, bool(by_vectors), 100)
    equal = np.array_equal(*both)
    seconds: list[list[float]] = [[], []]
    for _ in range(PAIRS):
        for by_vectors, memory in enumerate(both):
            begin = time.process_time()
            gaps(memory, bool(by_vectors), ROUNDS)
            seconds[by_vectors].append(time.process_time() - begin)
    each = 1e9 / (ROUNDS * JOINTS * TENDONS * WIDTH)
    out, vectors = (each * statistics.median(values) for values in seconds)
    ratio = statistics.median(new / old for old, new in zip(*seconds, strict=True))
    print(f"a gap in a lane: written out {out:.2f} ns, through vectors {vectors:.2f} ns, ratio {ratio:.3f}")
    print(f"median of {PAIRS} pairs of {ROUNDS:,} rounds; equal to the last bit: {'yes' if equal else 'no'}")


if __name__ == "__main__":
    main()
