"""Infos as tensors, in Gymnasium's vector form: names as in rj_gym/tracking/task.py, a status as a Status's number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rj_gym.core.columns import EFFORT, ERROR, FAILURE, FORCE, LINK, SMOOTHNESS, STATUS, TARGET, TENSIONS, TIP, TRACKING

_TERMS = {"tracking": TRACKING, "effort": EFFORT, "smoothness": SMOOTHNESS, "failure": FAILURE}


def state_info(readings: Tensor, m: int) -> dict[str, Any]:
    """The info of m tendons in every step, tensors (B, ...): parts of the readings (B, columns)."""
    return {
        "error_mm": readings[:, ERROR],
        "status": readings[:, STATUS].long(),
        "tip": readings[:, TIP : TIP + 2],
        "target": readings[:, TARGET : TARGET + 2],
        "load": {"link": readings[:, LINK].long(), "force": readings[:, FORCE : FORCE + 2]},
        "tensions": readings[:, TENSIONS : TENSIONS + m],
        "command": readings[:, TENSIONS + m : TENSIONS + 2 * m],
    }


def reward_info(readings: Tensor) -> dict[str, Tensor]:
    """The terms of the reward, (B,) each."""
    return {name: readings[:, column] for name, column in _TERMS.items()}


def on_device(info: Mapping[str, Any], device: torch.device) -> dict[str, Any]:
    """The arrays of numbers of an info as tensors; arrays of names are left out."""
    return {
        key: on_device(value, device) if isinstance(value, dict) else torch.tensor(value, device=device)
        for key, value in info.items()
        if isinstance(value, dict) or value.dtype != np.dtype(object)
    }


def masked_info(info: Mapping[str, Any], mask: Tensor) -> dict[str, Any]:
    """A batch's info in Gymnasium's vector form: `_key` says which lanes have `key`; the others hold zero."""
    masked: dict[str, Any] = {}
    for key, value in info.items():
        if isinstance(value, dict):
            masked[key] = masked_info(value, mask)
        else:
            masked[key] = torch.where(mask[(..., *(None,) * (value.ndim - 1))], value, torch.zeros_like(value))
        masked[f"_{key}"] = mask
    return masked


def whole_info(info: Mapping[str, Any], mask: Tensor) -> dict[str, Any]:
    """masked_info where every lane has everything, as the mask says."""
    result: dict[str, Any] = {}
    for key, value in info.items():
        result[key] = whole_info(value, mask) if isinstance(value, dict) else value
        result[f"_{key}"] = mask
    return result


def unmasked_info(infos: Mapping[str, Any]) -> dict[str, Any]:
    """Infos without their `_key` masks."""
    return {
        key: unmasked_info(value) if isinstance(value, dict) else value
        for key, value in infos.items()
        if not key.startswith("_")
    }
