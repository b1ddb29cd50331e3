"""Measurements that a known mechanism would give, read from the solvers alone."""

import numpy as np

import rollingjoint as rj
from rollingjoint.identify import Input, Measurements, Run, Step

TENSIONS = [(3.0, 3.0), (6.0, 3.0), (4.0, 3.0), (3.0, 6.0), (3.0, 3.5), (9.0, 3.0), (5.0, 5.0), (3.0, 8.0)]
LENGTHS = [(92.0, 96.0), (88.0, 102.0), (89.0, 101.0), (97.0, 93.0), (96.0, 94.5), (86.0, 105.0), (87.0, 104.0)]


def run_of(mechanism, inputs, given, name="A", *, base_angle=0.0, offsets=0.0, noise=0.0, seed=0, **read):
    """A run: poses (and `read`, "lengths" or "tensions") of a mechanism along a path, with errors of measurement."""
    rng = np.random.default_rng(seed)
    inputs = np.asarray(inputs, float)
    driven = inputs + (offsets if given == "lengths" else 0.0)
    path = rj.trace(mechanism, driven, given=given)
    assert path.ok.all()
    cos, sin = np.cos(base_angle), np.sin(base_angle)
    steps = []
    for row, values in enumerate(inputs):
        positions = path.poses[row, :, :2] @ np.array([[cos, sin], [-sin, cos]])
        known = {given: values, "positions": positions + noise * rng.normal(size=positions.shape)}
        known["angles"] = path.poses[row, :, 2] + base_angle
        if given == "tensions" and "lengths" in read:
            known["lengths"] = path.lengths[row] - offsets
        if given == "lengths" and "tensions" in read:
            known["tensions"] = path.tensions[row] + noise * rng.normal(size=len(values))
        steps.append(Step(**known))
    return Run(name, steps)


def measured(nominal, runs, given, **options):
    """Measurements of these runs, compared with a nominal mechanism."""
    return Measurements(nominal, runs, given=given, **options)


def stretched(mechanism, factor):
    """The mechanism with other tendons."""
    tendons = [rj.Tendon(each.holes, each.end, factor * each.stiffness) for each in mechanism.tendons]
    return mechanism.replace(tendons=tendons)


__all__ = ["LENGTHS", "TENSIONS", "Input", "measured", "run_of", "stretched"]
