"""A tracker beside the run folder: Weights & Biases, which reads the TensorBoard events as they are written."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from agents.runs.config import TrainConfig
from agents.runs.files import write_text
from agents.runs.folder import RunFolder
from rollingjoint.errors import ConfigError, naming_extras


def wandb_of() -> Any:
    """The module wandb; where it is missing, the extra is named."""
    with naming_extras("track"):
        import wandb  # type: ignore[import-not-found, unused-ignore]
    return wandb


@contextmanager
def tracked(config: TrainConfig, run: RunFolder) -> Iterator[None]:
    """A context of training whose log the tracker of the configuration follows; without one no effect.

    The same run of the tracker goes on where the training is resumed.

    Raises:
        ConfigError: a tracker that does not begin.
    """
    if config.tracker is None:
        yield
        return
    ((_, arguments),) = config.tracker.items()
    tracker, place = wandb_of(), {"dir": str(run.path), "id": _id(run), "resume": "allow"}
    given = {"project": "rolling-joint", "name": run.path.name, **arguments}
    try:
        following = tracker.init(config=config.to_dict(), sync_tensorboard=True, **place, **given)
    except Exception as error:  # of the account, the network or the service
        hint = f"{type(error).__name__}: {error} To go on then: rj train --resume {run.path}"
        allowed = "a run that W&B begins, or mode: offline"
        raise ConfigError("tracker.wandb", dict(arguments), allowed, hint) from error
    with following:
        yield


def _id(run: RunFolder) -> str:
    """The id of this training in the tracker, kept with its log."""
    file = run.logs / "wandb_id.txt"
    if not file.is_file():
        run.logs.mkdir(exist_ok=True)
        write_text(file, secrets.token_hex(4))
    return file.read_text("utf-8").strip()
