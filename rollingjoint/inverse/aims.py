"""What may be wanted beyond the place of the tip: its stiffness in a direction, its force on walls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.checks import as_positive, as_vector
from rollingjoint.errors import InvalidInput
from rollingjoint.inverse.goal import LEVER
from rollingjoint.statics.sensitivity import joint_response

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Aims:
    """What is wanted beyond the place.

    Attributes:
        direction: (d,) of length 1, in which the tip is to have a stiffness [N/mm]; None: any.
        contact_force: of the last link on walls [N]; None: any.
    """

    direction: Array | None = None
    stiffness: float | None = None
    contact_force: float | None = None

    @classmethod
    def of(cls, chain: AnyChain, stiffness: tuple[ArrayLike, float] | None, contact_force: float | None) -> Aims:
        """The aims, checked."""
        direction = value = force = None
        if stiffness is not None:
            allowed = "(direction, N/mm)"
            try:
                along, wanted = stiffness
            except (TypeError, ValueError):
                raise InvalidInput("stiffness", stiffness, allowed) from None
            direction = unit_direction("direction of the stiffness", along, chain.dimension)
            value = as_positive("stiffness", wanted, "a positive number [N/mm]")
        if contact_force is not None:
            force = as_positive("contact_force", contact_force, "a positive number [N]")
        return cls(direction, value, force)

    def __bool__(self) -> bool:
        return self.stiffness is not None or self.contact_force is not None

    def misses(self, equilibrium: Any, size: float) -> Array:
        """(Q,) relative deviations of one equilibrium, of which 1 counts as a turn of 1 rad [mm]."""
        shares = []
        if self.direction is not None and self.stiffness is not None:
            shares.append(stiffness_along(equilibrium, self.direction) / self.stiffness - 1.0)
        if self.contact_force is not None:
            shares.append(contact_force_of(equilibrium) / self.contact_force - 1.0)
        return LEVER * size * np.array(shares)

    def along_wall(self, equilibrium: Any, misses: Array) -> Array:
        """Misses of the tip, (C,) or (C, k), without the part across the wall on which it is to press, if it does."""
        pressing = [] if self.contact_force is None else _contacts_of_tip(equilibrium)
        if not pressing:
            return misses
        normal = np.zeros(len(misses))
        normal[: len(pressing[0].normal)] = np.sum([contact.force * contact.normal for contact in pressing], axis=0)
        normal /= np.linalg.norm(normal)
        return np.asarray(misses - np.multiply.outer(normal, normal @ misses))


NO_AIMS = Aims()


def unit_direction(what: str, along: ArrayLike, dimension: int) -> Array:
    """The vector of length 1 along another one, (dimension,); InvalidInput for one without a direction."""
    vector = as_vector(what, along, dimension, "coordinates")
    length = float(np.linalg.norm(vector))
    if not 0.0 < length < np.inf:
        raise InvalidInput(what, along, "finite numbers that are not all 0")
    return np.asarray(vector / length)


def held_stiffness(equilibrium: Any) -> Array:
    """(n - 1, n - 1) stiffness with all lengths held, no tendon yielding [N·mm/rad]."""
    at, k = equilibrium, equilibrium.mechanism.stiffnesses
    return np.asarray(at.stiffness + (at.torques_per_tension * (k - at.tendon_stiffness)) @ at.tendon_rates.T)


def stiffness_along(equilibrium: Any, direction: Array) -> float:
    """Force per displacement of the tip along a direction, free to move across it, lengths held [N/mm].

    direction: (d,), of length 1. Infinite where joints at their limits leave it no way to move.
    """
    jacobian = equilibrium.point_jacobian(equilibrium.joint_angles.size)[: len(direction)]
    pulled = direction @ jacobian
    compliance = pulled @ joint_response(equilibrium, held_stiffness(equilibrium), pulled[:, None])[:, 0]
    return float(1.0 / compliance) if compliance != 0.0 else np.inf


def contact_force_of(equilibrium: Any) -> float:
    """Sum of the normal forces with which the last link presses on walls [N]."""
    return float(sum(contact.force for contact in _contacts_of_tip(equilibrium)))


def _contacts_of_tip(equilibrium: Any) -> list[Any]:
    last = equilibrium.joint_angles.size
    return [contact for contact in equilibrium.wall_contacts if contact.link == last]
