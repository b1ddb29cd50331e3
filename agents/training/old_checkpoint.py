"""Checkpoints of earlier versions, in pickles: they are read where the command allows it."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.vec_env import VecEnv


def old_state(checkpoint: Path) -> Path:
    """The pickle of the model in a checkpoint, which only earlier versions wrote."""
    return checkpoint / "resume" / "training.pkl"


def load_old(checkpoint: Path, model: Any) -> Any:
    """Give a fresh model the state in a checkpoint; the moment to restore. This unpickles.

    Raises whatever comes of damaged pickles, and of those that name code which is gone.
    """
    content = torch.load(old_state(checkpoint), weights_only=False)
    vars(model).update(content["model"])
    wrappers, lanes = content["environments"]
    _put_back(model.env, wrappers, lanes)
    buffer = checkpoint / "resume" / "replay_buffer.pkl"
    if buffer.is_file():
        with buffer.open("rb") as stream:
            model.replay_buffer = pickle.load(stream)
        if hasattr(model.replay_buffer, "set_env"):  # hindsight recomputes rewards
            model.replay_buffer.set_env(model.env)
    return content["moment"]


def _put_back(env: Any, wrappers: list[dict[str, Any]], lanes: VecEnv) -> None:
    """Give the wrappers, outermost first, their saved attributes, and put the lanes inside into place."""
    for held in wrappers:
        vars(env).update(held)
        outer, env = env, env.venv
    env.close()
    outer.venv = lanes
