"""A camera as the tracker of a rig's tip: pictures from a function of the lab's own, poses from balls on the links."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from agents.rig.pace import LoopClock
from agents.rig.protocols import RigReading
from agents.runs.consent import imported
from rollingjoint.camera import Photographs
from rollingjoint.errors import ConfigError

Grab = Callable[[], Any]


class CameraPoses:
    """The tip in the frame of the base, as a camera sees it.

    Args:
        photographs: the camera's view, and the balls. grab: returns the newest picture, as find_balls takes it.
        clock: of the loop; a picture counts as taken when it is asked for.
    """

    def __init__(self, photographs: Photographs, grab: Grab, clock: LoopClock) -> None:
        self.photographs, self.grab, self.clock = photographs, grab, clock

    def read(self) -> RigReading | None:
        """Place of the tip [mm]; None: the base, the tip or a link between them was not seen."""
        t = self.clock.now()
        poses = self.photographs.poses(self.grab())
        return RigReading(poses[-1, :2].copy(), t) if np.isfinite(poses[-1]).all() else None


def grabber(where: str, named: str, folder: Path) -> Grab:
    """The function that FILE.py:NAME or MODULE:NAME stands for; files are looked for in the folder.

    Raises:
        ConfigError: code that cannot be imported, or no function there.
    """
    allowed = "FILE.py:NAME or MODULE:NAME of a function that returns a picture"
    module, _, name = named.rpartition(":")
    beside = folder / module
    try:
        grab = getattr(imported(str(beside) if beside.is_file() else module), name)
    except Exception as error:  # whatever the code there raises
        raise ConfigError(where, named, allowed, f"{type(error).__name__}: {error}") from None
    if not callable(grab):
        raise ConfigError(where, named, allowed)
    return grab
