"""Animations of the results page: three episodes of the best learner of every task."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.controllers.controller import Controller
from agents.evaluation.pictures import animation
from agents.evaluation.rollout import film
from agents.policies.shipped import ShippedPolicy
from agents.policies.trained import load_driving
from agents.results.record import POLICY, TEST, BenchmarkRecord, Results
from agents.results.runs import CHECKPOINT, Benchmark, file_name
from agents.runs.environment import EnvConfig
from agents.runs.files import write_bytes

SIZES = ((300, 60), (260, 45), (220, 35), (180, 25))
"""Width of one episode in an animation [pixels] and its most pictures, of the episode evenly: the first that fits."""

LARGEST = 700_000  # bytes of an animation


def three_episodes(benchmark: Benchmark, record: BenchmarkRecord) -> dict[str, tuple[bytes, str]]:
    """GIF of the episodes of the table with the smallest, the median and the largest error; by name, with a caption.

    Of the best learner's run that did best in the evaluations during training; of the first learner where none is known
    to be the best.
    """
    name = record.best(POLICY) or record.names(POLICY)[0]
    recipe = next(recipe for recipe in benchmark.recipes if recipe.name == name)
    run = recipe.chosen
    policy = load_driving(run.folder, CHECKPOINT)
    return _filmed(record, name, list(recipe.runs).index(run), run.config.env, policy)


def three_of_shipped(policy: ShippedPolicy, record: BenchmarkRecord) -> dict[str, tuple[bytes, str]]:
    """The same of a shipped policy, the only learner of its record."""
    return _filmed(record, record.names(POLICY)[0], 0, policy.environment, policy)


def bring_films(sources: Mapping[Path, Results], results: Results, out: Path) -> None:
    """Copy to OUT/images the animations of `results` from images/ in the folders of the files that it was merged from.

    Args:
        sources: the content of these files. A file with another caption is not copied.
    """
    captions = {name: caption for films in results.films.values() for name, caption in films.items()}
    for path, source in sources.items():
        for name, caption in (item for films in source.films.values() for item in films.items()):
            origin, copy = path.parent / "images" / name, out / "images" / name
            if Path(name).name == name and captions.get(name) == caption and origin.is_file():
                write_bytes(copy, origin.read_bytes())


def _filmed(
    record: BenchmarkRecord, name: str, place: int, env: EnvConfig, policy: Controller
) -> dict[str, tuple[bytes, str]]:
    """`place` tells which of the learner's runs the policy is of."""
    (world, *_), learner = record.of_role(TEST), record.controller(name)
    errors, training_seed = learner.errors(world.name)[place], learner.training_seeds[place]
    order = np.argsort(errors, kind="stable")
    places = {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}
    seeds = {text: world.first_seed + int(at) for text, at in places.items()}
    frames = {f"{text}: {errors[at]:.2g} mm": film(env, policy, seeds[text]) for text, at in places.items()}
    episodes = ", ".join(f"{text} (seed {seed})" for text, seed in seeds.items())
    caption = f"{name}, training seed {training_seed}: of the episodes of the table the {episodes}."
    return {f"results_{file_name(record.title)}.gif": (small_animation(frames), caption)}


def small_animation(frames: Mapping[str, Sequence[Any]]) -> bytes:
    """GIF of the pictures of every episode, side by side, of at most LARGEST bytes if any of SIZES has so few."""
    for width, longest in SIZES:
        content = animation({name: _shortened(pictures, longest) for name, pictures in frames.items()}, width)
        if len(content) <= LARGEST:
            break
    return content


def _shortened(frames: Sequence[Any], longest: int) -> Sequence[Any]:
    """At most `longest` of the pictures, evenly spaced, with the last one."""
    return frames[:: -math.ceil(len(frames) / longest)][::-1]
