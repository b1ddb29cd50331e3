"""One warm solve of the five-link prototype, compiled and public, beside other ways to the same equilibrium."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from rollingjoint import prepare, solve_lengths
from speed_rows.limit import BareWalk
from speed_rows.mujoco_chain import MujocoChain
from speed_rows.row import LIMIT, Row, Target, timed_row
from speed_rows.scipy_equilibrium import solve_by_root
from speed_rows.sizes import Sizes
from speed_rows.timing import Contestant, race
from speed_rows.walk import TENSION_LIMITS, CompiledWalk, Walk, random_walk
from tests.second_opinions.published import PublishedSolution, solve_lengths_published, solve_tensions_published

TITLE = "One warm solve"
TEXT = """Five links, two tendons. Tendon lengths and a dead force at the tip change at random by at most 1 mm and
0.05 N per step (`random_walk` in `benchmarks/speed_rows/walk.py`); every solve starts at the equilibrium before and
ends with a residual below 1e-8 N·mm. *Compiled* is the solve alone on arrays prepared before: *one by one* is a
call from Python for every step, *side by side* is one call for all of them. *Public* is `solve_lengths`, with its
checks and its `Equilibrium`; *prepared* is `prepare` once, for the load of the first step, and its `solve` for all.

The peers: `scipy.optimize.root` on the paper's 6 (n - 1) equations (`scipy_equilibrium.py`; plain NumPy, numerical
Jacobian); the paper's algorithms (`tests.second_opinions.published`), plain NumPy too; and a MuJoCo model of the
same size (`mujoco_chain.py`: hinges for rolling contacts, masses, dampers and time step tuned for the shortest way
to rest), which needs a simulation until it rests. MuJoCo's is compiled code called from Python a few times per
solve."""

GRADIENT = 1e-3  # mm²/N: where the published descent is stopped


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    walk = random_walk(sizes.walk)
    compiled, bare = CompiledWalk(walk), BareWalk(walk)
    one_by_one = Contestant(bare.one_by_one, len(walk))
    iterations = f"{np.mean([result.iterations for result in walk.equilibria]):.1f} Newton steps on average"
    timings = race({"": Contestant(compiled.one_by_one, len(walk)), LIMIT: one_by_one}, sizes.repeats)
    yield timed_row("warm solve, compiled, one by one", "µs", timings, Target(3.0), iterations)
    contestants = {"": compiled.side_by_side, LIMIT: bare.side_by_side}
    timings = race({name: Contestant(work, len(walk)) for name, work in contestants.items()}, sizes.repeats)
    yield timed_row("warm solve, compiled, side by side", "µs", timings, note="1 thread")

    count = min(sizes.slow_peer_solves, len(walk) - 1)
    slow = {
        "scipy.optimize.root": over_steps(lambda step: _root(walk, step), count),
        "published tension algorithm": over_steps(lambda step: _tension_recursion(walk, step), count),
        "published displacement algorithm": over_steps(lambda step: _length_descent(walk, step), count),
    }
    prepared = race({"": Contestant(lambda: prepared_walk(walk), len(walk)), LIMIT: one_by_one}, sizes.repeats)
    yield timed_row("warm solve, prepared", "µs", prepared, Target(5.0), note="under one load")
    timings = race(
        {
            "public": Contestant(lambda: public_walk(walk), len(walk)),
            LIMIT: one_by_one,
            "MuJoCo until rest": _mujoco(walk),
            **slow,
        },
        sizes.repeats,
    )
    yield timed_row("warm solve, public", "µs", timings, Target(20.0), peer_notes=_notes(walk, count))


def public_walk(walk: Walk) -> None:
    """Every step of the walk by `solve_lengths`, as a user would write it."""
    equilibrium = None
    for step in range(len(walk)):
        equilibrium = solve_lengths(
            walk.mechanism, walk.commands[step], walk.loads(step), start=equilibrium, tension_limits=TENSION_LIMITS
        )


def prepared_walk(walk: Walk) -> None:
    """Every step of the walk by a prepared problem, under the load of the first."""
    problem, equilibrium = prepare(walk.mechanism, walk.loads(0), tension_limits=TENSION_LIMITS), None
    for command in walk.commands:
        equilibrium = problem.solve(command, start=equilibrium)


def over_steps(solve: Callable[[int], object], count: int) -> Contestant:
    """Steps 1 to `count` of a walk, one by one."""
    return Contestant(lambda: [solve(step) for step in range(1, count + 1)], count)


def _root(walk: Walk, step: int) -> np.ndarray:
    start = walk.equilibria[step - 1]
    return solve_by_root(walk.mechanism, walk.commands[step], walk.loads(step), start, TENSION_LIMITS)


def _tension_recursion(walk: Walk, step: int) -> PublishedSolution:
    tensions, start = walk.equilibria[step].tensions, walk.equilibria[step - 1]
    return solve_tensions_published(walk.mechanism, tensions, walk.loads(step), start)


def _length_descent(walk: Walk, step: int) -> PublishedSolution:
    before, after = walk.equilibria[step - 1 : step + 1]
    return solve_lengths_published(
        walk.mechanism,
        after.lengths,
        walk.loads(step),
        before.tensions,
        before,
        gradient_tolerance=GRADIENT,
    )


def _mujoco(walk: Walk) -> Contestant | str:
    try:
        chain = MujocoChain(walk.mechanism, TENSION_LIMITS)
    except ImportError:
        return "not installed"
    shortening = walk.mechanism.neutral_lengths - walk.commands

    def settle() -> None:
        for pull, force in zip(shortening, walk.forces, strict=True):
            chain.settle(pull, force)

    return Contestant(settle, len(walk))


def _notes(walk: Walk, count: int) -> dict[str, str]:
    """How near the peers' answers are to ours."""
    steps, ours = range(1, count + 1), walk.equilibria
    root = max(np.abs(_root(walk, step) - ours[step].poses[1:]).max() for step in steps)
    descent = max(np.abs(_length_descent(walk, step).poses[-1] - ours[step].poses[-1])[:2].max() for step in steps)
    return {
        "scipy.optimize.root": f"equal to {root:.0e} mm and rad",
        "published tension algorithm": "given the tensions",
        "published displacement algorithm": (
            f"given the lengths, stopped at a gradient of {GRADIENT:g} mm²/N, its tip then up to {descent:.2f} mm off"
        ),
        "MuJoCo until rest": "its tip is then within 0.01 mm of where it stays",
    }
