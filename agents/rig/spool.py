"""Spools: ticks of m motors <-> unstretched lengths of their tendons."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.rig.protocols import Array
from rollingjoint.checks import as_positive
from rollingjoint.errors import ConfigError


@dataclass(frozen=True)
class Spools:
    """Where tendons are wound up.

    Args:
        radius_mm: of the winding. signs: 1 where rising ticks pull in, -1 where they let out, (m,).
        zero_ticks: ticks at which lengths are `zero_mm`, (m,) each, turns counted.
        offsets_mm: true length minus length of the zero, (m,), as rj identify finds them.
        ticks_per_turn: of the motors.
    """

    radius_mm: float
    signs: tuple[int, ...]
    zero_ticks: tuple[int, ...]
    zero_mm: tuple[float, ...]
    offsets_mm: tuple[float, ...] = ()
    ticks_per_turn: int = 4096

    def __post_init__(self) -> None:
        as_positive("radius_mm", self.radius_mm, "a positive number [mm]", ConfigError)
        if any(sign not in (-1, 1) for sign in self.signs):
            raise ConfigError("signs", self.signs, "1 where rising ticks pull in, -1 where they let out")
        if len({len(self.signs), len(self.zero_ticks), len(self.zero_mm)} | {len(self.lengths_at_zero)}) > 1:
            raise ConfigError("spools", len(self.zero_mm), f"{len(self.signs)} zeros, one per motor")

    @property
    def mm_per_tick(self) -> float:
        """Tendon that a tick winds up [mm]."""
        return 2.0 * math.pi * self.radius_mm / self.ticks_per_turn

    @property
    def lengths_at_zero(self) -> tuple[float, ...]:
        """True lengths at the zero [mm]."""
        offsets = self.offsets_mm or (0.0,) * len(self.zero_mm)
        return tuple(zero + offset for zero, offset in zip(self.zero_mm, offsets, strict=False))

    def lengths(self, ticks: ArrayLike) -> Array:
        """Lengths [mm] at these ticks, (m,) each."""
        turned = np.asarray(ticks, float) - self.zero_ticks
        return np.asarray(self.lengths_at_zero - np.asarray(self.signs) * self.mm_per_tick * turned)

    def ticks(self, lengths: ArrayLike) -> NDArray[np.int64]:
        """Ticks nearest to these lengths [mm], (m,) each."""
        let_out = np.asarray(lengths, float) - self.lengths_at_zero
        turned = np.asarray(self.signs) * let_out / self.mm_per_tick
        return np.rint(np.asarray(self.zero_ticks) - turned).astype(np.int64)
