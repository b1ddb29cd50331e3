"""Steps with friction beside the same solves without."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rollingjoint import (
    CapstanFriction,
    Equilibrium,
    FrictionState,
    RollingChain,
    WorldForce,
    set_threads,
    solve_lengths,
    solve_lengths_batch,
    solve_tensions,
    uniform,
)
from speed_rows.batch import batch_of, threads_in_words
from speed_rows.long_chain import power_law
from speed_rows.machine import threads
from speed_rows.row import Row, Target, timed_row
from speed_rows.sizes import Sizes
from speed_rows.solver import public_walk
from speed_rows.timing import Contestant, fastest, race
from speed_rows.walk import TENSION_LIMITS, Walk, random_walk

TITLE = "Friction"
TEXT = """The walk of the sections above with capstan friction, μ = 0.1, presliding 0.02 mm: every step is solved from
the history of the one before. The peer is the walk without friction. Target: 2.5 times its time."""
PICTURES: dict[str, str] = {}

FRICTION = CapstanFriction(0.1)
LONG = (50, 100, 200, 400)  # links
LONG_STEPS = 12


def measure(sizes: Sizes, images: Path) -> Iterator[Row]:
    """Rows of the section."""
    plain = random_walk(sizes.walk)
    walk, histories = _with_friction(plain)
    contestants = {
        "ours": Contestant(lambda: _public_walk(walk, histories), len(walk)),
        "without friction": Contestant(lambda: public_walk(plain), len(walk)),
    }
    yield timed_row("public solve_lengths with history", "µs", race(contestants, sizes.repeats), note=_iterations(walk))
    for count in dict.fromkeys([1, threads()]):
        set_threads(count)
        contestants = {
            "ours": Contestant(_batch_of(walk, histories, sizes.lanes), sizes.lanes),
            "without friction": Contestant(batch_of(plain, sizes.lanes), sizes.lanes),
        }
        timings = race(contestants, sizes.repeats)
        yield timed_row(f"{sizes.lanes:,} lanes, {threads_in_words(count)}", "solves/s", timings)
    set_threads(threads())
    yield from _long_chains(sizes)


def _with_friction(plain: Walk) -> tuple[Walk, list[Equilibrium]]:
    """The walk with friction, and the equilibrium before each of its steps."""
    mechanism = plain.mechanism.replace(friction=FRICTION)
    found: Equilibrium = solve_tensions(mechanism, [3.0] * mechanism.n_tendons)
    histories: list[Equilibrium] = []
    for step, command in enumerate(plain.commands):
        histories.append(found)
        found = solve_lengths(
            mechanism, command, plain.loads(step), tension_limits=TENSION_LIMITS, history=found
        ).require()
    starts = np.array([each.joint_angles for each in histories])
    return replace(plain, mechanism=mechanism, starts=starts, equilibria=(*histories[1:], found)), histories


def _public_walk(walk: Walk, histories: list[Equilibrium]) -> None:
    for step, history in enumerate(histories):
        solve_lengths(
            walk.mechanism, walk.commands[step], walk.loads(step), tension_limits=TENSION_LIMITS, history=history
        )


def _iterations(walk: Walk) -> str:
    return f"{np.mean([each.iterations for each in walk.equilibria]):.1f} Newton steps"


def _batch_of(walk: Walk, histories: list[Equilibrium], lanes: int) -> Callable[[], object]:
    commands, loads, _ = walk.tiled(lanes)
    states = [histories[k % len(walk)].friction_state for k in range(lanes)]
    history = FrictionState(*map(np.array, zip(*states, strict=True)))
    limits = TENSION_LIMITS
    return lambda: solve_lengths_batch(walk.mechanism, commands, loads, tension_limits=limits, history=history)


def _long_chains(sizes: Sizes) -> Iterator[Row]:
    """Steps of long chains: the time at 200 links beside that without friction, and how it grows."""
    lengths = [n for n in LONG if n <= sizes.links[-1]] or [sizes.links[-1]]
    times = []
    for n in lengths:
        ours, plain = (_pulls(uniform(n).replace(friction=friction)) for friction in (FRICTION, None))
        if n in (lengths[0], 200):
            contestants = {"ours": Contestant(ours, LONG_STEPS), "without friction": Contestant(plain, LONG_STEPS)}
            yield timed_row(f"step of {n} links", "µs", race(contestants, sizes.repeats))
        times.append((n, 1e6 * fastest(ours, LONG_STEPS, sizes.repeats).seconds))
    if len(times) > 1:
        exponent, _ = power_law(times)
        yield Row(f"exponent from {lengths[0]} links on", exponent, "", f"{len(times)} lengths of chain", Target(1.1))


def _pulls(mechanism: RollingChain) -> Callable[[], None]:
    """Pulling one tendon in and letting the other out, 0.2 mm a step, under a force at the tip."""
    start: Equilibrium = solve_tensions(mechanism, [3.0, 3.0])
    lengths = start.lengths - 3.0 / mechanism.stiffnesses

    def work() -> None:
        found = start
        for step in range(1, LONG_STEPS + 1):
            command = lengths + 0.2 * step * np.array([-1.0, 1.0])
            found = solve_lengths(
                mechanism, command, [WorldForce(-1, (0.02, 0.0))], tension_limits=TENSION_LIMITS, history=found
            )

    return work
