"""Recordings that a known rig would give: its own loop over the solvers, with play and sheath written out."""

from dataclasses import replace

import numpy as np

from rollingjoint import five_link, solve_lengths, solve_tensions
from rollingjoint.identify import RecordedRun, RigRecording

TRUE = {"play": [0.9, 1.4], "sheath": [0.25, 0.4], "stiffness": [0.8, 1.15], "offsets": [1.3, -0.8]}


def with_stiffness(chain, factors):
    """The chain with other tendons."""
    tendons = zip(chain.tendons, factors, strict=True)
    return chain.replace(tendons=[replace(t, stiffness=t.stiffness * factor) for t, factor in tendons])


def sweeps(steps, chain, seed=0):
    """Motor positions that bend to and fro by at most a millimetre a step, taut throughout, (T, m) [mm]."""
    rng, start = np.random.default_rng(seed), solve_tensions(chain, [3.5, 3.5])
    at, side, path = np.zeros(2), 1.0, []
    while len(path) < steps:
        goal = side * rng.uniform(4.0, 6.0) * np.array([1.0, -1.0]) - rng.uniform(0.0, 1.5)
        count = int(np.ceil(np.abs(goal - at).max()))
        path += [at + (goal - at) * k / count for k in range(1, count + 1)]
        at, side = goal, -side
    return np.array(path[:steps]) + start.lengths - 3.5 / chain.stiffnesses


def recorded(steps=240, seed=0, true=None, delay=0, noise=(0.05, 0.05), name="1", rate=20.0, mm=None):
    """A recording of a rig with these numbers; delay: of tensions and tips, in steps."""
    values = {name: np.array(each) for name, each in (TRUE | (true or {})).items()}
    nominal, rng = five_link(), np.random.default_rng([seed, 1])
    chain = with_stiffness(nominal, values["stiffness"])
    motors = sweeps(steps, nominal, seed) - values["offsets"] if mm is None else mm
    p, half, found, rows = motors[0], 0.5 * values["play"], None, []
    for q in motors:
        p = np.minimum(np.maximum(p, q - half), q + half)
        found = solve_lengths(chain, p + values["offsets"], start=found)
        assert found.ok
        tension = found.tensions * np.exp(values["sheath"] * (p - q) / half)
        rows.append((tension + noise[0] * rng.normal(size=2), found.tip[:2] + noise[1] * rng.normal(size=2)))
    late = np.maximum(np.arange(steps) - delay, 0)
    tensions, tips = (np.array(column)[late] for column in zip(*rows, strict=True))
    run = RecordedRun(np.arange(steps) / rate, motors, np.maximum(tensions, 0.0), tips, name)
    return RigRecording([run], nominal)
