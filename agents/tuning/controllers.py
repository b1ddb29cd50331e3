"""Tune settings of controllers: python -m agents.tuning.controllers --world rj_gym/Instrument-v0 --tries 60.

The first half of the tries are random settings, the others near the best so far; all drive the same episodes of the
tuning seeds. The best few drive those of the validation seeds, and the best of these is kept in the file, with its
scores and the number of tries. Scores are the mean tip error over the last 10 steps of an episode [mm].
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.controllers.search_space import Settings, drawn_settings, settings_near, with_settings
from agents.controllers.tuned import TUNED, WORLDS, Tunable, tunable_in
from agents.evaluation.rollout import run_episodes
from agents.runs.command_line import exit_code
from agents.runs.environment import EnvConfig
from agents.runs.seeds import TUNING, VALIDATION
from rollingjoint.checked_yaml import dump_yaml, read_yaml
from rollingjoint.checks import as_choice, as_integer
from rollingjoint.errors import ConfigError

_VALIDATED = 5  # how many of the best drive the validation seeds
_PARENTS = 3  # of the best, near which the others are tried


@dataclass(frozen=True)
class Tuned:
    """What a search found: settings, its scores [mm], and how many it tried."""

    settings: Settings
    tuning_mm: float
    validation_mm: float
    tries: int
    episodes: int

    def to_dict(self) -> dict[str, Any]:
        """Plain values for the file."""
        scores = {"tuning_mm": round(self.tuning_mm, 4), "validation_mm": round(self.validation_mm, 4)}
        return {"tries": self.tries, "episodes": self.episodes, **scores, "settings": self.settings}


def tune(env_id: str, controller: Tunable, tries: int, episodes: int, seed: int = 0, say: Any = None) -> Tuned:
    """Search settings of a controller in a world.

    Args:
        env_id: the world.
        controller: the one that is tuned.
        tries: number of settings.
        episodes: number of seeds, of tuning and of validation.
        seed: of the search.
        say: called with the score [mm] and the settings of every try, if given.
    """
    rng, found = np.random.default_rng(seed), list[tuple[float, Settings]]()
    for number in range(tries):
        if number < (tries + 1) // 2:
            settings = drawn_settings(controller.space, rng)
        else:
            parents = _best(found, _PARENTS)
            settings = settings_near(controller.space, parents[rng.integers(len(parents))][1], rng)
        found.append((last_error(env_id, controller, settings, TUNING.start, episodes), settings))
        if say:
            say(*found[-1])
    chosen = _best(found, _VALIDATED)
    scores = [last_error(env_id, controller, settings, VALIDATION.start, episodes) for _, settings in chosen]
    place = int(np.argmin(scores))
    tuning, settings = chosen[place]
    return Tuned(with_settings(controller.fixed, settings), tuning, scores[place], tries, episodes)


def scored_again(env_id: str, controller: Tunable, kept: Mapping[str, Any], episodes: int) -> Tuned:
    """The entry of a controller in a file, scored again on as many seeds of tuning and of validation."""
    settings = kept["settings"]
    tuning, validation = (
        last_error(env_id, controller, settings, first, episodes) for first in (TUNING.start, VALIDATION.start)
    )
    return Tuned(settings, tuning, validation, kept["tries"], episodes)


def _best(found: Sequence[tuple[float, Settings]], count: int) -> list[tuple[float, Settings]]:
    """The settings with the smallest scores."""
    return sorted(found, key=lambda each: each[0])[:count]


def last_error(env_id: str, controller: Tunable, settings: Settings, first: int, episodes: int) -> float:
    """Mean tip error over the last steps of the episodes of these seeds [mm]."""
    made = controller.make(with_settings(controller.fixed, settings))
    found = run_episodes(EnvConfig(env_id), made, range(first, first + episodes))
    return float(found.last_errors.mean())


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 tuned, 2 an error, 130 stopped by Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python -m agents.tuning.controllers", description="Tune controllers.")
    parser.add_argument("--world", required=True, help=f"one of {', '.join(WORLDS)}")
    parser.add_argument("--controller", "--opponent", action="append", help="only this one; repeatable")
    parser.add_argument(
        "--tries", type=int, default=60, help="settings that are tried, 60; 0: score what is kept again"
    )
    parser.add_argument("--episodes", type=int, default=250, help="of tuning, and of validation, 250")
    parser.add_argument("--seed", type=int, default=0, help="of the search, 0")
    parser.add_argument("--output", type=Path, default=TUNED, help="the file that is changed")
    return exit_code(lambda: _command(parser.parse_args(argv)))


def _command(arguments: argparse.Namespace) -> int:
    env_id, world = arguments.world, tunable_in(arguments.world)
    tries = as_integer("--tries", arguments.tries, 0, error=ConfigError)
    episodes = as_integer("--episodes", arguments.episodes, 1, error=ConfigError)
    for name in arguments.controller or world:
        as_choice("--controller", name, list(world), error=ConfigError)
    for name in arguments.controller or world:
        content: Any = read_yaml(arguments.output) if arguments.output.is_file() else {}
        kept = content.setdefault(env_id, {})
        if tries > 0:
            found = tune(env_id, world[name], tries, episodes, arguments.seed, _say)
        elif name in kept:
            found = scored_again(env_id, world[name], kept[name], episodes)
        else:
            raise ConfigError("--controller", name, f"one of {list(kept)}", "It has not been tuned.")
        kept[name] = found.to_dict()
        arguments.output.write_text(dump_yaml(content), encoding="utf-8")
        print(f"{env_id}, {name}: validation {found.validation_mm:.3f} mm, tuning {found.tuning_mm:.3f} mm")
    return 0


def _say(score: float, settings: Settings) -> None:
    print(f"  {score:.3f} mm  {settings}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
