"""Tune settings of controllers: python -m agents.tuning.controllers --world rj_gym/Instrument-v0 --tries 60.

With --file configs/env/NAME.yaml in the environment with these settings. Where episodes draw their mechanisms, they are
designs to choose on, hardly ever the same one twice.

The first half of the tries are random settings, the others near the best so far; with --near the first is what the file
has, and all others lie near the best so far. All drive the same episodes of the tuning seeds. The best few drive the
episodes of the validation seeds, and the best of these is stored in the file, with its scores and the number of tries.
Scores are the mean tip error over the last 10 steps of an episode [mm].
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from agents.controllers.search_space import Settings, drawn_settings, settings_near, with_settings
from agents.controllers.tuned import BLIND, TUNED, WORLDS, Tunable, tunable_in, world_of
from agents.evaluation.rollout import run_episodes
from agents.runs.command_line import exit_code
from agents.runs.config import env_settings
from agents.runs.environment import EnvConfig
from agents.runs.seeds import DESIGNS_TO_CHOOSE, TUNING, VALIDATION
from rollingjoint.checked_yaml import dump_yaml, read_yaml
from rollingjoint.checks import as_choice, as_integer
from rollingjoint.errors import ConfigError

_VALIDATED = 5  # number of the best settings that drive the validation seeds
_PARENTS = 3  # of the best, near which the others are tried


@dataclass(frozen=True)
class Tuned:
    """The best settings of a search, their scores [mm], the number of tries and of episodes."""

    settings: Settings
    tuning_mm: float
    validation_mm: float
    tries: int
    episodes: int

    def to_dict(self) -> dict[str, Any]:
        """Plain values for the file."""
        scores = {"tuning_mm": round(self.tuning_mm, 4), "validation_mm": round(self.validation_mm, 4)}
        return {"tries": self.tries, "episodes": self.episodes, **scores, "settings": self.settings}


def tune(
    env: EnvConfig,
    controller: Tunable,
    tries: int,
    episodes: int,
    seed: int = 0,
    say: Any = None,
    near: Settings | None = None,
) -> Tuned:
    """Search settings of a controller in a world.

    Args:
        env: of the world.
        controller: the one that is tuned.
        tries: number of settings.
        episodes: number of seeds, of tuning and of validation.
        seed: of the search.
        say: called with the score [mm] and the settings of every try, if given.
        near: the first try, with all others near the best so far; None: the first half of the tries are random.
    """
    rng, results = np.random.default_rng(seed), list[tuple[float, Settings]]()
    for number in range(tries):
        if near is not None and number == 0:
            settings = with_settings(drawn_settings(controller.space, rng), near)  # complete where the space has grown
        elif near is None and number < (tries + 1) // 2:
            settings = drawn_settings(controller.space, rng)
        else:
            parents = _best(results, _PARENTS)
            settings = settings_near(controller.space, parents[rng.integers(len(parents))][1], rng)
        results.append((last_error(env, controller, settings, TUNING.start, episodes), settings))
        if say:
            say(*results[-1])
    candidates = _best(results, _VALIDATED)
    scores = [last_error(env, controller, settings, VALIDATION.start, episodes) for _, settings in candidates]
    place = int(np.argmin(scores))
    tuning, settings = candidates[place]
    return Tuned(with_settings(controller.fixed, settings), tuning, scores[place], tries, episodes)


def scored_again(env: EnvConfig, controller: Tunable, entry: Mapping[str, Any], episodes: int) -> Tuned:
    """The entry of a controller in a file, scored again on `episodes` seeds of tuning and of validation each."""
    settings = entry["settings"]
    tuning, validation = (
        last_error(env, controller, settings, first, episodes) for first in (TUNING.start, VALIDATION.start)
    )
    return Tuned(settings, tuning, validation, entry["tries"], episodes)


def _best(results: Sequence[tuple[float, Settings]], count: int) -> list[tuple[float, Settings]]:
    """The settings with the smallest scores."""
    return sorted(results, key=lambda result: result[0])[:count]


def last_error(env: EnvConfig, controller: Tunable, settings: Settings, first: int, episodes: int) -> float:
    """Mean tip error over the last steps of the episodes of these seeds [mm]."""
    tuned = controller.make(with_settings(controller.fixed, settings))
    results = run_episodes(env, tuned, range(first, first + episodes))
    return float(results.last_errors.mean())


def on_designs_to_choose(env: EnvConfig) -> EnvConfig:
    """The environment; where episodes draw their mechanisms, with designs that neither training nor the tables have."""
    if not hasattr(env.arguments()["config"], "mechanisms"):
        return env
    designs = (DESIGNS_TO_CHOOSE.start, DESIGNS_TO_CHOOSE.stop)
    mechanisms = {**env.settings.get("mechanisms", {}), "designs": designs}
    return replace(env, settings={**env.settings, "mechanisms": mechanisms})


def main(argv: Sequence[str] | None = None) -> int:
    """Exit code of the command: 0 tuned, 2 an error, 130 stopped by Ctrl-C."""
    parser = argparse.ArgumentParser(prog="python -m agents.tuning.controllers", description="Tune controllers.")
    ids = ", ".join(world for world in WORLDS if not world.endswith(BLIND))
    parser.add_argument("--world", required=True, help=f"one of {ids}, or another id with --file")
    parser.add_argument("--file", type=Path, help="settings of its environment, YAML (default: those of the id)")
    parser.add_argument("--controller", "--opponent", action="append", help="only this one; repeatable")
    parser.add_argument(
        "--tries", type=int, default=60, help="settings that are tried, 60; 0: score what is kept again"
    )
    parser.add_argument("--episodes", type=int, default=250, help="of tuning, and of validation, 250")
    parser.add_argument("--seed", type=int, default=0, help="of the search, 0")
    parser.add_argument("--near", action="store_true", help="begin with what is kept, and search near it")
    parser.add_argument("--output", type=Path, default=TUNED, help="the file that is changed")
    return exit_code(lambda: _command(parser.parse_args(argv)))


def _command(arguments: argparse.Namespace) -> int:
    env = EnvConfig(arguments.world, settings=env_settings(arguments.file) if arguments.file else {})
    world = world_of(env)
    env = on_designs_to_choose(env)
    tunable = tunable_in(world)
    tries = as_integer("--tries", arguments.tries, 0, error=ConfigError)
    episodes = as_integer("--episodes", arguments.episodes, 1, error=ConfigError)
    for name in arguments.controller or tunable:
        as_choice("--controller", name, list(tunable), error=ConfigError)
    for name in arguments.controller or tunable:
        content: Any = read_yaml(arguments.output) if arguments.output.is_file() else {}
        stored = content.setdefault(world, {})
        if name not in stored and (tries == 0 or arguments.near):
            raise ConfigError(
                "--controller",
                name,
                f"one of {list(stored)}",
                "It has not been tuned: leave out --near, with --tries 1 or more.",
            )
        if tries > 0:
            near = stored[name]["settings"] if arguments.near else None
            result = tune(env, tunable[name], tries, episodes, arguments.seed, _say, near)
        else:
            result = scored_again(env, tunable[name], stored[name], episodes)
        stored[name] = result.to_dict()
        arguments.output.write_text(dump_yaml(content), encoding="utf-8")
        print(f"{world}, {name}: validation {result.validation_mm:.3f} mm, tuning {result.tuning_mm:.3f} mm")
    return 0


def _say(score: float, settings: Settings) -> None:
    print(f"  {score:.3f} mm  {settings}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
