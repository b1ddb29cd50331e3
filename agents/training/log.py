"""The log of a training run, progress.csv and TensorBoard events, which a resumed run continues."""

from __future__ import annotations

import csv
import os
import time
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import CSVOutputFormat, Logger, TensorBoardOutputFormat
from torch.utils.tensorboard import SummaryWriter

from agents.runs.folder import PROCESSOR, RunFolder

ITERATIONS = "time/iterations"
ELAPSED = "time/time_elapsed"


def training_log(run: RunFolder, steps: int = 0) -> Logger:
    """The log of a run with `steps` steps done: rows up to there are kept, later ones are dropped."""
    run.logs.mkdir(exist_ok=True)
    return Logger(str(run.logs), [_Rows(run.progress), _Events(run.logs, steps)])


class _Rows(CSVOutputFormat):
    """Appends rows to a CSV file; Stable-Baselines3's own class would overwrite it."""

    def __init__(self, path: Path) -> None:
        self.file = path.open("r+" if path.is_file() else "w+", encoding="utf-8", newline="")
        rows = list(csv.DictReader(self.file))
        self.keys = list(rows[0]) if rows else []
        self.separator, self.quotechar = ",", '"'
        self.iterations = int(_largest(rows, ITERATIONS))
        self.seconds = _largest(rows, PROCESSOR) - time.process_time()
        self.file.seek(0, os.SEEK_END)

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        """Add a row; iterations and processor time are counted from the beginning of the run."""
        if ITERATIONS in key_values:
            key_values = key_values | {ITERATIONS: self.iterations + key_values[ITERATIONS]}
        if ELAPSED in key_values:
            key_values = key_values | {PROCESSOR: round(self.seconds + time.process_time(), 3)}
        super().write(key_values, key_excluded, step)


def _largest(rows: list[dict[str, str]], column: str) -> float:
    """The largest number in a column; 0 where there is none."""
    return max((float(row[column]) for row in rows if row.get(column)), default=0.0)


class _Events(TensorBoardOutputFormat):
    """Writes events; TensorBoard drops an interrupted run's events behind `steps`."""

    def __init__(self, folder: Path, steps: int) -> None:
        _wait_for_a_later_name(folder)
        self.writer = SummaryWriter(str(folder), purge_step=steps + 1 if steps else None)
        self._is_closed = False


def _wait_for_a_later_name(folder: Path) -> None:
    """Wait until the name of a new event file sorts after the existing ones: TensorBoard reads them in that order.

    The names hold the second in which the files were made.
    """
    seconds = [int(path.name.split(".")[3]) for path in folder.glob("events.out.tfevents.*")]
    time.sleep(min(max(max(seconds, default=0) + 1 - time.time(), 0.0), 1.0))
