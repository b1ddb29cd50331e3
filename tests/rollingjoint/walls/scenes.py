"""A chain of two segments in a lumen with two bends, and paths of commands and feed."""

import numpy as np

import rollingjoint as rj

CHAIN = rj.two_segment(4, 4, height=10.0, radius=7.0, half_width=5.0)
RUBBING = CHAIN.replace(friction=rj.CapstanFriction(0.1))
REST = CHAIN.neutral_lengths - 2.0 / CHAIN.stiffnesses
LIMITS = (0.5, 15.0)
S_BEND = rj.Lumen([30, 40, 40, 30], [0.0, 0.02, -0.02, 0.0], radii=7.0, start=(0.0, 0.0, np.pi / 2))


def s_bend(mu=0.0, **settings):
    friction = rj.WallFriction(mu) if mu else None
    return rj.Surroundings([S_BEND], rj.Sleeve(5.0), friction, **settings)


def cycle(steps, cycles=2, deepest=35.0):
    """Commands and bases of closed cycles: tendons ±1 mm, feed 15 mm, a quarter turn apart."""
    turn = 2.0 * np.pi * np.arange(cycles * steps + 1) / steps
    commands = REST + np.sin(turn)[:, None] * [1.0, -1.0, -1.0, 1.0]
    bases = np.zeros((turn.size, 3))
    bases[:, 1] = deepest - 7.5 * (1.0 - np.cos(turn))
    return commands, bases


def way_in(deepest=35.0, count=19):
    """Commands and bases from outside to the start of the cycles."""
    bases = np.zeros((count, 3))
    bases[:, 1] = np.linspace(deepest - 4.0 * (count - 1), deepest, count)
    return np.repeat(REST[None], count, axis=0), bases
