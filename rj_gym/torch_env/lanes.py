"""Running episodes of B lanes as tensors on a device."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rj_gym.core.columns import TENSIONS
from rj_gym.torch_env.host import HostEpisodes


@dataclass(frozen=True)
class Lanes:
    """State of the episodes, and their values fixed at the start: names, shapes and units of rj_gym/tracking/arrays.py.

    From `half_play` on the fields of Hardware there, with no lanes where motors and sensors are not active.
    Rings over steps are queues here, the newest step first; as an episode begins, both hold the same.
    """

    angles: Tensor
    responses: Tensor
    poses: Tensor
    actions: Tensor
    readings: Tensor
    tip_rates: Tensor
    targets: Tensor
    forces: Tensor
    stiffnesses: Tensor
    actuator_offsets: Tensor
    noise: Tensor
    loads: Tensor
    half_play: Tensor
    sheath: Tensor
    encoder_noise: Tensor
    tension_noise: Tensor
    phase: Tensor
    cells: Tensor
    limits: Tensor
    motors: Tensor
    measured: Tensor
    pictures: Tensor
    picture: Tensor
    past: Tensor

    @classmethod
    def of(cls, host: HostEpisodes, device: torch.device) -> Lanes:
        """All lanes as they are on the host."""
        return cls(*(torch.tensor(array, device=device) for array in _arrays(host).values()))

    def begun(self, rows: NDArray[np.int64], host: HostEpisodes) -> Lanes:
        """The lanes, these of which have just begun on the host."""
        device = self.angles.device
        if len(rows) == len(self.angles):
            return Lanes.of(host, device)
        at = torch.as_tensor(rows, device=device)
        return Lanes(*(_with_rows(getattr(self, name), at, rows, array) for name, array in _arrays(host).items()))


def tendons(lanes: Lanes) -> tuple[Tensor, Tensor]:
    """True tensions [N] and commands [mm], (B, m) each."""
    m = lanes.actions.shape[-1]
    return lanes.readings[:, TENSIONS : TENSIONS + m], lanes.readings[:, TENSIONS + m : TENSIONS + 2 * m]


def at_step(series: Tensor, steps: Tensor) -> Tensor:
    """The entries of series (B, 1 or T + 1, ...) at a step of every lane, (B,), (B, ...)."""
    if series.shape[1] == 1:
        return series[:, 0]
    step = steps.long().clamp(max=series.shape[1] - 1)
    return series[torch.arange(len(series), device=series.device), step]


def _with_rows(tensor: Tensor, at: Tensor, rows: NDArray[np.int64], array: NDArray[np.float64]) -> Tensor:
    """A copy with some of its rows replaced by an array's; the array where its series have become longer."""
    if tensor.shape[1:] != array.shape[1:]:
        return torch.tensor(array, device=tensor.device)
    if not array.size:
        return tensor
    return tensor.index_copy(0, at, torch.tensor(array[rows], device=tensor.device))


def _arrays(host: HostEpisodes) -> dict[str, Any]:
    """The arrays of the host, in the order of the fields."""
    places = {name: place for place in (host.state, host.course, host.hardware) for name in place._fields}
    names = [field.name for field in fields(Lanes)]
    return {name: host.load_tables if name == "loads" else getattr(places[name], name) for name in names}
