"""What the loop asks of a rig: motors, load cells, and a tracker of the tip; every reading has its time.

Positions and goals are unstretched lengths of tendon that motors leave [mm]: more is slacker. Tensions are in N.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import RollingJointError

Array = NDArray[np.float64]


class RigError(RollingJointError, RuntimeError):
    """A rig that cannot be used as it is."""


class BusLost(RigError):
    """The port has gone, or a device does not answer."""


class HardwareAlert(RigError):
    """A motor reports a hardware error, has no torque, or its watchdog has stopped it."""


class Stopped(RigError):
    """The guard has ended the motion; motors hold."""


@dataclass(frozen=True)
class RigReading:
    """Values (m,), or (d,) of a tip, their time [s], and how often the device had to be asked again."""

    values: Array
    t: float
    retries: int = 0


class RigMotors(Protocol):
    """Motors that wind up tendons, m of them."""

    def read(self) -> RigReading:
        """Positions [mm]."""

    def write(self, goals: Array) -> None:
        """Send goals [mm]."""

    def hold(self) -> bool:
        """Stay where motors are, whatever was interrupted before; whether that was sent."""

    def close(self) -> None:
        """Leave the port; motors hold."""


class RigTensions(Protocol):
    """Load cells at the motors."""

    def read(self) -> RigReading:
        """Tensions [N]."""

    def close(self) -> None:
        """Leave the port."""


class RigPoses(Protocol):
    """A tracker of the tip."""

    def read(self) -> RigReading | None:
        """Place of the tip in the frame of the base [mm]; None: not seen."""
