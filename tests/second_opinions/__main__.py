"""Iterations of the published algorithms and of the compiled solver on the cases of the rolling-contact paper.

Run: python -m tests.second_opinions
"""

import numpy as np

import rollingjoint as rj
from tests.second_opinions.published import PublishedSolution, solve_lengths_published, solve_tensions_published

FIGURE_3 = [(3, 1), (1, 1), (1, 3), (6, 2), (2, 2), (2, 6)]
FIGURE_4 = [0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5]
FIGURE_8 = [(90.52, 100.88), (98.06, 95.92), (102.65, 94.34), (87.94, 104.17), (86.02, 107.82)]
FIXED_STEP = 2e-3  # N²/mm²; 1e-2 fails on four of the five length pairs of figure 8
LIMIT = 500


def main() -> None:
    print(*tension_table(), "", *length_table(), sep="\n")


def tension_table() -> list[str]:
    """Given tensions: figures 3 and 4, every case from s = 0, and figure 4 with the force raised step by step."""
    mechanism, lines = rj.five_link(), ["Given tensions: Newton iterations to a residual of 1e-10 (mm, N)"]
    lines.append(f"{'tensions':>10} {'force':>6} {'start':>9} {'published':>10} {'compiled':>9} {'apart [mm]':>11}")
    for tensions in FIGURE_3:
        lines.append(tension_row(mechanism, tensions, 0.0, None, None)[0])
    for force in FIGURE_4:
        lines.append(tension_row(mechanism, (6, 3), force, None, None)[0])
    published, compiled = None, None
    for force in FIGURE_4:
        row, published, compiled = tension_row(mechanism, (6, 3), force, published, compiled)
        lines.append(row)
    return lines


def tension_row(
    mechanism: rj.RollingChain,
    tensions: tuple[float, float],
    force: float,
    published: PublishedSolution | None,
    compiled: rj.Equilibrium | None,
) -> tuple[str, PublishedSolution, rj.Equilibrium]:
    """One row, and both solutions to start the next one from."""
    loads, start = [rj.WorldForce(-1, (force, 0.0))], "s = 0" if compiled is None else "previous"
    published = solve_tensions_published(mechanism, tensions, loads, start=published)
    compiled = rj.solve_tensions(mechanism, tensions, loads, start=compiled)
    row = f"{tensions!s:>10} {force:6.2f} {start:>9} {count(published):>10} {compiled.iterations:>9}"
    return f"{row} {apart(published, compiled):>11}", published, compiled


def length_table() -> list[str]:
    """Given lengths, least squares: the measured lengths of figure 8, then two pairs reachable under a load."""
    mechanism = rj.five_link()
    lines = [
        "Given lengths, least squares: iterations to a gradient of 1e-10 mm²/N from tensions (1, 1), or (5, 3) loaded",
        f"{'lengths':>17} {'force':>6} {'1/|J|²':>13} {'apart [mm]':>11}"
        f" {f'step {FIXED_STEP:g}':>13} {'apart [mm]':>11} {'compiled':>9}",
    ]
    for lengths in FIGURE_8:
        lines.append(length_row(mechanism, lengths, 0.0, (1, 1)))
    for force in (0.25, 0.5):
        lengths = rj.solve_tensions(mechanism, (6, 3), [rj.WorldForce(-1, (force, 0.0))]).lengths
        lines.append(length_row(mechanism, lengths, force, (5, 3)))
    lines.append(f"over {LIMIT}: not there after {LIMIT} iterations; failed: left a surface or met a singular matrix.")
    return lines


def length_row(
    mechanism: rj.RollingChain, lengths: tuple[float, float], force: float, tensions: tuple[float, float]
) -> str:
    loads = [rj.WorldForce(-1, (force, 0.0))]
    compiled = rj.solve_lengths(mechanism, lengths, loads, method="least_squares")
    row = f"({lengths[0]:.2f}, {lengths[1]:.2f})".rjust(17) + f" {force:6.2f}"
    for step in (None, FIXED_STEP):
        published = solve_lengths_published(mechanism, lengths, loads, tensions, step=step, max_iterations=LIMIT)
        row += f" {count(published):>13} {apart(published, compiled):>11}"
    return f"{row} {compiled.iterations:>9}"


def count(solution: PublishedSolution) -> str:
    if solution.converged:
        return str(solution.iterations)
    return f"over {LIMIT}" if solution.iterations == LIMIT else f"failed at {solution.iterations}"


def apart(published: PublishedSolution, compiled: rj.Equilibrium) -> str:
    """Distance of the two tips [mm]."""
    if not published.converged and published.iterations < LIMIT:
        return "-"
    return f"{np.linalg.norm(published.poses[-1, :2] - compiled.tip):.1e}"


if __name__ == "__main__":
    main()
