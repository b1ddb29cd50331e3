"""The files of an evaluation: its report as text and JSON, with pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from agents.controllers.controller import Controller
from agents.evaluation.pictures import animation, error_distribution, error_over_time
from agents.evaluation.report import OPEN_LOOP, POLICY, EvaluationReport
from agents.evaluation.rollout import film
from agents.runs.environment import EnvConfig
from agents.runs.files import write_bytes, write_json, write_text

FILMED = (POLICY, "jacobian feedback", OPEN_LOOP)


def write_report(report: EvaluationReport, controllers: Mapping[str, Controller], env: EnvConfig, folder: Path) -> None:
    """Write report.md, report.json and pictures into the folder."""
    errors = {name: episodes.errors for name, episodes in report.episodes.items()}
    pictures = {
        "error_over_time.png": error_over_time(errors, report.floors_at),
        "error_distribution.png": error_distribution(errors, report.known_floors),
    }
    captions = {
        "error_over_time.png": "Tip error after every step; equally good controllers lie on each other."
        + (" A point is the floor of its own step." if report.floors_at else ""),
        "error_distribution.png": "Tip error at the end of every episode; box: quartiles, whiskers: 5 to 95 %; errors "
        "below 0.001 mm are drawn there.",
    }
    if env.is_tracking:
        seed, pictures["animation.gif"] = _film(report, controllers, env)
        captions["animation.gif"] = f"The episode of seed {seed}, in which open loop ends with its median error."
    for name, content in pictures.items():
        write_bytes(folder / name, content)
    write_json(folder / "report.json", report.to_dict())
    notes = {name: (type(controller).__doc__ or "").split("\n")[0] for name, controller in controllers.items()}
    write_text(folder / "report.md", report.markdown(notes, captions))


def _film(report: EvaluationReport, controllers: Mapping[str, Controller], env: EnvConfig) -> tuple[int, bytes]:
    """Seed and animation of the episode in which open loop's final error is its median one."""
    order = np.argsort(report.episodes[OPEN_LOOP].final_errors)
    seed = report.seeds[int(order[len(order) // 2])]
    return seed, animation({name: film(env, controllers[name], seed) for name in FILMED if name in controllers})
