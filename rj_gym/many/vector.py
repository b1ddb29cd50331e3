"""The native vector environments of tracking with many mechanisms."""

from __future__ import annotations

from typing import ClassVar

from rj_gym.core.env import TaskEnv
from rj_gym.core.vector import TaskVectorEnv
from rj_gym.many.designs import DrawnDesign
from rj_gym.many.env import ManyMechanismsEnv, ManyMechanismsInSpaceEnv


class ManyMechanismsVectorEnv(TaskVectorEnv):
    """`num_envs` independent ManyMechanismsEnv in one batch, each lane with its own mechanism in every episode.

    Lane i is seeded with `seed + i` and equals a ManyMechanismsEnv with that seed step by step.

    Arguments as for TaskVectorEnv; `config` and `overrides` as for ManyMechanismsEnv.
    """

    scalar: ClassVar[type[TaskEnv]] = ManyMechanismsEnv

    @property
    def designs(self) -> list[DrawnDesign | None]:
        """The designs of the lanes, None before they begin."""
        return list(self._buffer.designs)  # type: ignore[attr-defined]


class ManyMechanismsInSpaceVectorEnv(ManyMechanismsVectorEnv):
    """`num_envs` independent ManyMechanismsInSpaceEnv in one batch; all else as ManyMechanismsVectorEnv."""

    scalar: ClassVar[type[TaskEnv]] = ManyMechanismsInSpaceEnv
