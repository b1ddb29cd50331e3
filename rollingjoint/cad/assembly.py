"""Assemblies: the bodies of a mechanism in their poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.body import Body, bodies
from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.outline import to_world
from rollingjoint.chain.rolling import RollingChain, planar
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Assembly:
    """Bodies in poses.

    Attributes:
        chain: the mechanism.
        poses: of its links, (n, 3) [mm, rad].
        making: thickness, channels and tolerance of the bodies.
        bodies: one per link.
        state: a description of the pose.
    """

    chain: RollingChain
    poses: Array
    making: Fabrication
    bodies: list[Body]
    state: str

    @cached_property
    def outlines(self) -> list[Array]:
        """Outlines in the base frame, one (k, 2) per link [mm]."""
        return [to_world(pose, body.outline) for pose, body in zip(self.poses, self.bodies, strict=True)]

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest (x, y) of all bodies in the base frame [mm]."""
        points = np.concatenate(self.outlines)
        return points.min(axis=0), points.max(axis=0)

    @cached_property
    def first_alike(self) -> list[int]:
        """For every link, the first link that is an identical part."""
        return [next(k for k, candidate in enumerate(self.bodies) if body.alike(candidate)) for body in self.bodies]


def assemble(mechanism: RollingChain | Equilibrium, making: Fabrication) -> Assembly:
    """The mechanism's bodies, at s = 0 or in the pose of an equilibrium.

    Raises:
        MechanismError: a link with an outline that is no valid body, or a channel that cannot be drilled.
        InvalidInput: a batch of equilibria, or no planar chain. SolverError: an unusable equilibrium.
    """
    if not isinstance(mechanism, Equilibrium):
        chain = planar(mechanism)
        poses = chain.poses(chain.neutral_angles)
        return Assembly(chain, poses, making, bodies(chain, making), "every contact at s = 0")
    if mechanism.poses.ndim != 2:
        raise InvalidInput("equilibrium", mechanism.poses.shape, "one equilibrium, poses (n, 3)", "Solve a single row.")
    chain = mechanism.require().chain
    tensions = ", ".join(f"{tension:.3g}" for tension in mechanism.tensions)
    return Assembly(chain, mechanism.poses, making, bodies(chain, making), f"equilibrium at tensions of {tensions} N")
