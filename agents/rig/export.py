"""Recordings of a rig as Minari datasets: motors, tensions and tips, and the goals that were sent."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from gymnasium import spaces

from agents.rig.protocols import Array
from rollingjoint.errors import naming_extras
from rollingjoint.identify import RecordedRun, read_recording


def write_minari(path: str | Path, where: str | Path) -> tuple[Path, int]:
    """The folder of a new Minari dataset with an episode per run of a recording, and its number of steps.

    Observations are motors [mm], tensions [N] and the tip [mm] in one row, NaN where not read; actions are the goals of
    the motors [mm] that led from one to the next, or where the motors went, if no goals were recorded. Rewards are 0.

    Args:
        path: of the recording. where: id of the dataset, or a folder.
    Raises:
        ConfigError: a file that cannot be read. RunFolderError: a dataset or folder that is there already.
        MissingPackage: without the extra `data`.
    """
    recording = read_recording(path)
    with naming_extras("data"):
        from minari.data_collector import EpisodeBuffer

        from agents.evaluation.minari_dataset import write_episodes
    m, d = recording.n_tendons, recording.runs[0].tips.shape[1]
    goals = _goals(Path(path)) if Path(path).suffix.lower() != ".csv" else {}
    episodes, steps = [], 0
    for number, run in enumerate(recording.runs):
        observations = np.concatenate([run.motors, run.tensions, run.tips], axis=1)
        actions, count = _actions(run, goals), len(run.t) - 1
        ends = {"terminations": np.zeros(count, bool), "truncations": np.arange(count) == count - 1}
        infos = {"t": run.t}
        episodes.append(EpisodeBuffer(number, None, None, observations, actions, np.zeros(count), **ends, infos=infos))
        steps += count
    both = spaces.Box(-np.inf, np.inf, (2 * m + d,), np.float64), spaces.Box(-np.inf, np.inf, (m,), np.float64)
    about = {
        "description": f"recording of a rig: {Path(path).name}",
        "algorithm_name": str(recording.header.get("policy", "rig")),
    }
    return write_episodes(where, both, episodes, about), steps


def _actions(run: RecordedRun, goals: dict[tuple[str, float], Array]) -> Array:
    """Goals of all steps but the first of a run, (T - 1, m) [mm]; where motors went, if there is none."""
    rows = [goals.get((run.name, float(t)), motors) for t, motors in zip(run.t[1:], run.motors[1:], strict=True)]
    return np.array(
        [row if np.shape(row) == motors.shape else motors for row, motors in zip(rows, run.motors[1:], strict=True)]
    )


def _goals(path: Path) -> dict[tuple[str, float], Array]:
    """Goals by run and time, of a recording that was read without an error."""
    goals, run = {}, "1"
    for line in path.read_text("utf-8", errors="replace").splitlines():
        try:
            values = json.loads(line)
        except ValueError:  # the last line of a run that was cut off
            continue
        run = str(values.get("run", run))
        if isinstance(values.get("goal"), list) and isinstance(values.get("t"), (int, float)):
            goals[run, float(values["t"])] = np.array(values["goal"], float)
    return goals
