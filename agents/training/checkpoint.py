"""Checkpoints: from the newest one a training run continues as if it had never been interrupted.

A checkpoint is a folder checkpoints/STEPS of the run folder. It appears whole, by renaming, or not at all.

    policy.safetensors, policy.zip, normaliser.pkl      the policy as it was
    resume/                                 more for resuming; deleted from all but the newest two checkpoints
        training.safetensors                model, optimisers, lanes, random numbers, the pending row of the log
        replay_buffer.safetensors           where the algorithm has one
        evaluations.csv, progress.csv, best/     copies of those in the run folder

The hash of every file is next to it. Where the newest checkpoint is damaged, a run goes on from the one before. Earlier
versions wrote pickles in place of the two files (old_checkpoint.py). Checkpoints are taken where a rollout begins:
there the loops of Stable-Baselines3 keep no state in local variables.
"""

from __future__ import annotations

import io
import os
import pickle
import random
import shutil
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm

from agents.policies.parameters import parameters_of
from agents.policies.trained import TrainedPolicy, policy_of
from agents.runs.config import TrainConfig
from agents.runs.consent import check_pickles
from agents.runs.files import (
    RunFolderError,
    check_as_written,
    is_as_written,
    unseal,
    write_bytes,
    write_hashed_bytes,
)
from agents.runs.folder import PolicyFiles, RunFolder
from agents.runs.state_file import packed, unpacked
from agents.training.build import build_model, close
from agents.training.old_checkpoint import load_old, old_state
from agents.training.state import buffer_state, restore, restore_buffer, state_of

NO_PART_OF_A_POLICY = ("replay_buffer_class", "replay_buffer_kwargs")  # hindsight would ask for environments
KEPT = 2  # checkpoints from which a run can be resumed: the second one for the day that the newest is damaged
PENDING = ("name_to_value", "name_to_count", "name_to_excluded")
UNREADABLE = (
    pickle.PickleError,
    RuntimeError,
    AttributeError,
    ImportError,
    LookupError,
    TypeError,
    ValueError,
    EOFError,
)
STATE, BUFFER = "training.safetensors", "replay_buffer.safetensors"


@dataclass(frozen=True)
class Moment:
    """The state outside model and environments when a rollout begins.

    Args:
        generators: states of the global random number generators of Python, NumPy and torch.
        exploration: matrices of state-dependent exploration, which Stable-Baselines3 draws just before.
        log: values recorded for the next row of the log.
        elapsed: time spent on training so far [ns].
    """

    generators: tuple[Any, Any, Any]
    exploration: Mapping[str, Any]
    log: Mapping[str, Mapping[str, Any]]
    elapsed: int

    @classmethod
    def now(cls, model: BaseAlgorithm) -> Moment:
        """The moment at which `model` is."""
        return cls(
            (random.getstate(), np.random.get_state(), torch.get_rng_state()),
            {name: value.detach() for name, value in _exploration(model).items()},
            {name: dict(getattr(model.logger, name)) for name in PENDING},
            int(time.time_ns() - model.start_time),
        )

    def restore(self, model: BaseAlgorithm) -> None:
        """Restore this moment; to be called at the start of a rollout."""
        python, numpy, of_torch = self.generators
        random.setstate(python)
        np.random.set_state(numpy)
        torch.set_rng_state(of_torch)
        for name, matrix in self.exploration.items():
            setattr(_actor(model).action_dist, name, matrix)
        for name, values in self.log.items():
            getattr(model.logger, name).update(values)
        model.start_time = time.time_ns() - self.elapsed
        model._num_timesteps_at_start = 0


def save_policy(model: BaseAlgorithm, files: PolicyFiles) -> None:
    """Save the policy as commands read it and, with its critic, as Stable-Baselines3 does; each file whole or not."""
    normaliser = model.get_vec_normalize_env()
    policy = policy_of(model, normaliser)
    if isinstance(policy, TrainedPolicy):
        write_hashed_bytes(files.network, policy.to_bytes())
        _remove(files.parameters)
    else:
        write_hashed_bytes(files.parameters, parameters_of(model, normaliser))
        _remove(files.network)
    if normaliser is not None:
        write_hashed_bytes(files.normaliser, pickle.dumps(normaliser))
    stream = io.BytesIO()  # so that a full disk is an OSError: torch would make something else of it
    model.save(stream, exclude=NO_PART_OF_A_POLICY)
    write_hashed_bytes(files.model, stream.getvalue())


def _remove(file: Path) -> None:
    unseal(file)
    file.unlink(missing_ok=True)


def save(model: BaseAlgorithm, run: RunFolder) -> None:
    """Save a checkpoint of a model at the start of a rollout.

    Raises OSError, on a full disk for example, and leaves no files behind.
    """
    folder = run.checkpoints / f"{model.num_timesteps:09d}"
    partial = folder.with_name(f".{folder.name}")
    try:
        save_policy(model, PolicyFiles.within(partial))
        _save_rest(model, run, partial / "resume")
        shutil.rmtree(folder, ignore_errors=True)
        os.rename(partial, folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    for older in resumable(run)[KEPT:]:
        _delete(older / "resume")


def resumable(run: RunFolder) -> list[Path]:
    """The checkpoints from which the run can be resumed unless they are damaged, the newest first."""
    complete = [folder for folder in run.checkpoint_folders if (folder / "resume").is_dir()]
    return sorted(complete, key=steps_of, reverse=True)


def newest(run: RunFolder) -> Path | None:
    """The newest checkpoint from which the run can be resumed; None if there is none.

    Damaged ones that are newer become checkpoints/damaged-STEPS, and a line on standard error names the loss.

    Raises:
        RunFolderError: all are damaged; they stay where they are.
    """
    checkpoints = resumable(run)
    damages = [damaged_file(checkpoint) for checkpoint in checkpoints]
    if checkpoints and None not in damages:
        hint = f"Its policies can still be evaluated. To train again: {_again(run)}"
        raise RunFolderError("damaged file", str(damages[0]), "the content that was written", hint)
    for checkpoint, damage, before in zip(checkpoints, damages, checkpoints[1:], strict=False):
        if damage is None:
            return checkpoint
        first, lost = steps_of(before), steps_of(checkpoint) - steps_of(before)
        print(f"note: {damage} is damaged: from step {first} on, {lost} steps are lost and done again", file=sys.stderr)
        aside = checkpoint.with_name(f"damaged-{checkpoint.name}")
        shutil.rmtree(aside, ignore_errors=True)
        os.rename(checkpoint, aside)
    return checkpoints[-1] if checkpoints else None


def damaged_file(checkpoint: Path) -> Path | None:
    """A file of a checkpoint that is not as it was written, or that is missing; None where all is well."""
    state, hashes = checkpoint / "resume" / STATE, sorted(checkpoint.rglob("*.sha256"))
    hashed = (path.with_suffix("") for path in hashes)
    is_there = state.is_file() or old_state(checkpoint).is_file()
    return next((path for path in hashed if not is_as_written(path)), None if is_there else state)


def steps_of(checkpoint: Path) -> int:
    """Environment steps that were done when the checkpoint was made."""
    return int(checkpoint.name)


def load(checkpoint: Path, config: TrainConfig) -> tuple[BaseAlgorithm, Moment]:
    """The model with its environments, and the moment to restore.

    Raises:
        RunFolderError: a checkpoint that cannot be read, or pickles of an earlier version that are not allowed.
    """
    folder = checkpoint / "resume"
    is_old = old_state(checkpoint).is_file()
    if is_old:
        check_pickles(*folder.glob("*.pkl"))
    model: Any = build_model(config)
    try:
        if is_old:
            return model, load_old(checkpoint, model)
        state = unpacked((folder / STATE).read_bytes(), str(folder / STATE))
        if (folder / BUFFER).is_file():
            restore_buffer(model.replay_buffer, unpacked((folder / BUFFER).read_bytes(), str(folder / BUFFER)))
        if not restore(model, state["model"]):
            print(
                f"note: episodes of {config.env.id} begin anew, since only those of rj_gym are saved", file=sys.stderr
            )
        return model, Moment(**state["moment"])
    except UNREADABLE as error:
        close(model)
        raise _unreadable(checkpoint, error) from error


def _unreadable(checkpoint: Path, error: Exception) -> RunFolderError:
    """The message for a checkpoint that was damaged, or that another version of the packages wrote."""
    run = RunFolder(checkpoint.parents[1])
    hint = (
        f"{type(error).__name__}: {error}. The run was begun with {run.begun_with}: a resumed run needs the same code. "
        f"Its policies can still be evaluated and exported; to train again: {_again(run)}"
    )
    return RunFolderError("checkpoint", str(checkpoint), "a checkpoint that this version can read", hint)


def _again(run: RunFolder) -> str:
    return f"rj train --config {run.path / 'config.yaml'} --run-dir NEW"


def bring_back_files(checkpoint: Path, run: RunFolder) -> None:
    """Restore log, evaluations and best policy from the checkpoint; whatever came after it is deleted."""
    for copy, original in _copies(run, checkpoint / "resume"):
        if not copy.is_file():
            original.unlink(missing_ok=True)
            unseal(original)
        elif original.suffix == ".csv":  # which grow
            write_bytes(original, copy.read_bytes())
        else:
            write_hashed_bytes(original, copy.read_bytes())


def _save_rest(model: BaseAlgorithm, run: RunFolder, folder: Path) -> None:
    state = {"model": state_of(model), "moment": vars(Moment.now(model))}
    write_hashed_bytes(folder / STATE, packed(state))
    buffer = getattr(model, "replay_buffer", None)
    if buffer is not None:
        write_hashed_bytes(folder / BUFFER, packed(buffer_state(buffer)))
    for copy, original in _copies(run, folder):
        check_as_written(original)
        if original.is_file():
            write_hashed_bytes(copy, original.read_bytes())


def _delete(folder: Path) -> None:
    """Delete a folder that others may look for: it is gone at once."""
    gone = folder.with_name(".0")  # one that RunFolder.tidy deletes
    shutil.rmtree(gone, ignore_errors=True)
    os.rename(folder, gone)
    shutil.rmtree(gone, ignore_errors=True)


def _copies(run: RunFolder, folder: Path) -> list[tuple[Path, Path]]:
    """Files of a checkpoint that are copies, each with its original in the run folder."""
    best = [(folder / "best" / path.name, path) for path in run.policy_files("best")]
    return [(folder / path.name, path) for path in run.tables] + best


def _actor(model: Any) -> Any:
    return getattr(model, "actor", model.policy)


def _exploration(model: Any) -> dict[str, torch.Tensor]:
    held = vars(_actor(model).action_dist) if model.use_sde else {}
    return {name: held[name] for name in ("exploration_mat", "exploration_matrices") if name in held}
