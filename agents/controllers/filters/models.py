"""The models of all classes of chains that filters know."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.controllers.filters.arm_model import ArmModel
from agents.controllers.filters.chain_model import ChainModel
from agents.controllers.filters.model import Model
from rj_gym.core.tracking_task import TrackingTask
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.rolling import RollingChain

MODELS: dict[type, Callable[[TrackingTask, NDArray[np.int64]], Model]] = {
    RollingChain: ChainModel,
    HingeChain: ArmModel,
}


def model_of(task: TrackingTask, links: NDArray[np.int64]) -> Model:
    """The model of a task's mechanism, for hypotheses with these loaded links, (H,)."""
    mechanism: Any = task.mechanism
    return MODELS[type(mechanism)](task, links)
