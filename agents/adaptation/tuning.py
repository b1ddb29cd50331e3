"""Opponents with settings that were searched on robots as they may be after identification."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice

import numpy as np

from agents.adaptation.driving import WORLD
from agents.adaptation.identify import Identified
from agents.adaptation.informed import Informed
from agents.adaptation.world import likely, simulated_errors
from agents.controllers.search_space import Settings, settings_near, with_settings
from agents.controllers.tuned import tunable_in, tuned_settings

ROBOTS, EPISODES = 2, 16  # that every try drives in simulation
_PARENTS = 3  # of the best, near which others are tried


def tuned(name: str, identified: Identified, tries: int, say: Callable[[float], object] = lambda _: None) -> Informed:
    """A tuned opponent of Instrument-v0 that knows the twin, with the best settings of `tries` near its own.

    Args:
        name: of the opponent. identified: beliefs about the robot.
        tries: 0: as it ships. say: called with the error of every try [mm].
    """
    opponent, shipped = tunable_in(WORLD)[name], tuned_settings(WORLD, name)
    rng, drawn = np.random.default_rng(identified.number), list(islice(likely(identified, seed=1), ROBOTS))

    def made(settings: Settings) -> Informed:
        return Informed(opponent.make(with_settings(with_settings(opponent.fixed, shipped), settings)), identified)

    scored: list[tuple[float, Settings]] = []
    for _ in range(tries):
        parents = sorted(scored, key=lambda pair: pair[0])[:_PARENTS]
        settings = settings_near(opponent.space, parents[rng.integers(len(parents))][1], rng) if parents else shipped
        scored.append((float(simulated_errors(made(settings), drawn, EPISODES).mean()), settings))
        say(scored[-1][0])
    return made(min(scored, key=lambda pair: pair[0])[1] if scored else shipped)
