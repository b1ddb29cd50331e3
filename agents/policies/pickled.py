"""Policies in the pickles of Stable-Baselines3: from earlier run folders, or without a form in NumPy."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

from agents.controllers.policy import Policy
from agents.runs.algorithms import algorithm_class, schedules
from agents.runs.config import TrainConfig
from agents.runs.consent import check_pickles
from agents.runs.files import RunFolderError
from agents.runs.folder import PolicyFiles


def load_pickled(config: TrainConfig, files: PolicyFiles) -> Policy:
    """The policy of a run with this configuration; RunFolderError if it is damaged, or pickles are not allowed."""
    check_pickles(files.model, files.normaliser)
    import torch

    torch.set_num_threads(config.torch_threads)
    objects = {"lr_schedule": None, **schedules(config.parameters)}  # their classes may have moved since
    try:
        model = algorithm_class(config.algorithm).load(files.model, device="cpu", custom_objects=objects)
        return Policy(model, _load_normaliser(files.normaliser))
    except Exception as error:  # any error of SB3, torch and pickle about a damaged file
        allowed = "files that can be read: a zip that Stable-Baselines3 can load, its normaliser"
        raise RunFolderError("policy", str(files.model), allowed, repr(error)) from error


def _load_normaliser(path: Path) -> Any:
    """The VecNormalize saved at `path`, frozen, without environments; None if the run does not normalise."""
    if not path.is_file():
        return None
    with path.open("rb") as stream:
        normaliser = pickle.load(stream)
    normaliser.training = False
    vars(normaliser).update(class_attributes={}, returns=None)  # pickling removes them: policies go to workers
    return normaliser
