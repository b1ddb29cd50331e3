"""Recordings of a rig as Minari datasets and Parquet tables: motors, tensions, tips, and the goals that were sent."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from gymnasium import spaces

from agents.rig.protocols import Array
from agents.runs.command_line import note
from rollingjoint.errors import ConfigError, naming_extras
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
    recording = read_recording(path, note)
    with naming_extras("data"):
        from minari.data_collector import EpisodeBuffer

        from agents.evaluation.minari_dataset import write_episodes
    m, d = recording.n_tendons, recording.runs[0].tips.shape[1]
    goals = _goals(Path(path), m)
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


def write_parquet(path: str | Path, table: str | Path) -> int:
    """Write a recording as a Parquet table with a row per step, and return their number.

    Columns are those of a recording in CSV, t [s], motor0 ... [mm], tension0 ... [N], tip_x ... [mm] and run, and the
    goals of the motors goal0 ... [mm]; null where not read, seen or recorded. The metadata have the header of the
    recording under "rollingjoint-recording".

    Args:
        path: of the recording. table: the new file.
    Raises:
        ConfigError: a recording that cannot be read, a file that is there or cannot be written. MissingPackage: without
            the extra `parquet`.
    """
    recording, table = read_recording(path, note), Path(table)
    with naming_extras("parquet"):
        import pyarrow
        import pyarrow.parquet
    runs, m = recording.runs, recording.n_tendons
    goals, missing = _goals(Path(path), m), np.full(m, np.nan)
    sent = [[goals.get((run.name, float(t)), missing) for t in run.t] for run in runs]
    parts = {
        "motor": np.concatenate([run.motors for run in runs]),
        "tension": np.concatenate([run.tensions for run in runs]),
        "tip": np.concatenate([run.tips for run in runs]),
        "goal": np.concatenate(sent),
    }
    columns = {"t": np.concatenate([run.t for run in runs])}
    for name, values in parts.items():
        places = ("_x", "_y", "_z") if name == "tip" else range(values.shape[1])
        columns |= {f"{name}{place}": column for place, column in zip(places, values.T, strict=False)}
    arrays = {name: pyarrow.array(column, from_pandas=True) for name, column in columns.items()}
    arrays["run"] = pyarrow.array([run.name for run in runs for _ in run.t])
    about = {"rollingjoint-recording": json.dumps(recording.header)}
    try:
        with table.open("xb") as file:
            pyarrow.parquet.write_table(pyarrow.table(arrays).replace_schema_metadata(about), file)
    except OSError as error:
        hint = f"{error.strerror}: take another name, in a folder that is there."
        raise ConfigError("table", str(table), "a new file that can be written", hint) from None
    return recording.steps


def _actions(run: RecordedRun, goals: dict[tuple[str, float], Array]) -> Array:
    """Goals of all steps but the first of a run, (T - 1, m) [mm]; where motors went, if there is none."""
    steps = zip(run.t[1:], run.motors[1:], strict=True)
    return np.array([goals.get((run.name, float(t)), motors) for t, motors in steps])


def _goals(path: Path, m: int) -> dict[tuple[str, float], Array]:
    """Goals of m motors by run and time, of a recording that was read without an error; a CSV file has none."""
    goals, run = {}, "1"
    for line in path.read_text("utf-8", errors="replace").splitlines() if path.suffix.lower() != ".csv" else ():
        try:
            values = json.loads(line)
        except ValueError:  # the last line of a run that was cut off
            continue
        run = str(values.get("run", run))
        goal, t = values.get("goal"), values.get("t")
        if isinstance(goal, list) and len(goal) == m and isinstance(t, (int, float)):
            goals[run, float(t)] = np.array(goal, float)
    return goals
