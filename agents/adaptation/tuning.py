"""Opponents with settings that were searched on robots as they may be after identification."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

import numpy as np

from agents.adaptation.identify import Identified
from agents.adaptation.informed import Informed
from agents.adaptation.world import likely, simulated_errors
from agents.controllers.search_space import Settings, settings_near, with_settings
from agents.controllers.tuned import tunable_in, tuned_settings
from agents.robots.driving import WORLD

ROBOTS, EPISODES = 2, 16  # that every try drives in simulation
_PARENTS = 3  # of the best, near which others are tried


def tuned(name: str, identified: Identified, tries: int, say: Callable[[float], object] = lambda _: None) -> Informed:
    """A tuned opponent of Instrument-v0 that knows the twin, with the best settings of so many tries near its own.

    Args:
        name: of the opponent. identified: what is believed of the robot.
        tries: 0: as it ships. say: called with the error of every try [mm].
    """
    opponent, shipped = tunable_in(WORLD)[name], tuned_settings(WORLD, name)
    rng, drawn = np.random.default_rng(identified.number), list(islice(likely(identified, seed=1), ROBOTS))

    def made(settings: Settings) -> Informed:
        return Informed(opponent.make(with_settings(with_settings(opponent.fixed, shipped), settings)), identified)

    found: list[tuple[float, Settings]] = []
    for _ in range(tries):
        parents = sorted(found, key=lambda each: each[0])[:_PARENTS]
        settings = settings_near(opponent.space, parents[rng.integers(len(parents))][1], rng) if parents else shipped
        found.append((float(simulated_errors(made(settings), drawn, EPISODES).mean()), settings))
        say(found[-1][0])
    return made(min(found, key=lambda each: each[0])[1] if found else shipped)
