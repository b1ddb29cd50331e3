"""Beliefs about a rig: its unknown numbers as vectors, each with a mean, a standard deviation and bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.variations import varied_chain
from rollingjoint.checks import as_choice
from rollingjoint.errors import InvalidInput, MechanismError
from rollingjoint.friction import CapstanFriction

Array = NDArray[np.float64]

_LEAST_MU = 1e-6  # where friction is sought: chains with and without it have different solvers


@dataclass(frozen=True)
class Belief:
    """A normal distribution, and bounds beyond which a number cannot be; each a number or an array."""

    mean: ArrayLike
    sd: ArrayLike
    low: ArrayLike
    high: ArrayLike


@dataclass(frozen=True)
class RigKind:
    """A kind of number of a rig.

    Args:
        meaning: one line. unit: empty for a pure number. nominal: the value where it is not sought.
        belief: before anything is measured. of: "tendon", "rig" or "surface".
        mechanisms: classes of chains that have it.
    """

    meaning: str
    unit: str
    nominal: float
    belief: Belief
    of: str = "tendon"
    mechanisms: tuple[type, ...] = (object,)


_PLANAR, _ARM = (RollingChain,), (HingeChain,)
RIG_KINDS = {
    "play": RigKind("width of the play between motor and tendon", "mm", 0.0, Belief(1.75, 1.5, 0.0, 8.0)),
    "sheath": RigKind("coefficient of friction times turn of the sheath", "", 0.0, Belief(0.3, 0.3, 0.0, 1.0)),
    "mu": RigKind("coefficient of friction in the holes", "", 0.0, Belief(0.05, 0.05, 0.0, 0.25)),
    "stiffness": RigKind("factor on the stiffness of a tendon", "", 1.0, Belief(1.0, 0.2, 0.4, 2.0)),
    "offsets": RigKind("true unstretched length minus position of the motor", "mm", 0.0, Belief(0.0, 2.0, -50.0, 50.0)),
    "delay": RigKind("by which tensions and tips are read late", "s", 0.0, Belief(0.0, 0.05, 0.0, 0.5), "rig"),
    "surfaces": RigKind(
        "displacement (x, y, turn) of contact surfaces",
        "mm, rad",
        0.0,
        Belief(0.0, (0.15, 0.15, 0.015), (-0.5, -0.5, -0.05), (0.5, 0.5, 0.05)),
        "surface",
        _PLANAR,
    ),
    "hinge_stiffness": RigKind("factor on all hinges", "", 1.0, Belief(1.0, 0.2, 0.3, 3.0), "rig", _ARM),
    "hole_angles": RigKind(
        "turn of a tendon's holes about the axis", "rad", 0.0, Belief(0.0, 0.05, -0.5, 0.5), "tendon", _ARM
    ),
}
"""What can be sought in a recording, by name."""


class RigSpace:
    """Rigs as vectors (P,): kind after kind.

    Args:
        mechanism: as designed. kinds: names from RIG_KINDS. beliefs: in place of those of RIG_KINDS.

    Attributes:
        mean, sd, low, high: of the beliefs, (P,).
    """

    def __init__(self, mechanism: AnyChain, kinds: Sequence[str], beliefs: Mapping[str, Belief] | None = None) -> None:
        if not kinds or len(set(kinds)) < len(kinds):
            raise InvalidInput("parameters", list(kinds), f"different names of {', '.join(RIG_KINDS)}")
        for name in kinds:
            as_choice("parameters", name, tuple(RIG_KINDS))
            if not isinstance(mechanism, RIG_KINDS[name].mechanisms):
                raise InvalidInput("parameters", name, f"a parameter of {mechanism.title}")
        self.mechanism, self.kinds = mechanism, tuple(kinds)
        n, m = mechanism.n_links, mechanism.n_tendons
        shapes = {"tendon": (m,), "rig": (1,), "surface": (n, 2, 3)}
        self.shapes = {name: shapes[RIG_KINDS[name].of] for name in kinds}
        own = {name: RIG_KINDS[name].belief for name in kinds} | dict(beliefs or {})
        self.mean, self.sd, self.low, self.high = (
            self.vector({name: getattr(own[name], part) for name in kinds}) for part in ("mean", "sd", "low", "high")
        )

    def __len__(self) -> int:
        return sum(math.prod(shape) for shape in self.shapes.values())

    @property
    def labels(self) -> list[str]:
        """Name of every number, such as "play[0]" or "surfaces[1, 0, 2]"."""
        return [
            name if RIG_KINDS[name].of == "rig" else f"{name}{list(place)}"
            for name, shape in self.shapes.items()
            for place in np.ndindex(*shape)
        ]

    def vector(self, values: Mapping[str, ArrayLike]) -> Array:
        """The vector of these kinds, each spread to its shape."""
        parts = [np.broadcast_to(np.asarray(values[name], float), shape) for name, shape in self.shapes.items()]
        return np.concatenate([part.ravel() for part in parts])

    def fields(self, vector: Array) -> dict[str, Array]:
        """A vector by kinds."""
        parts = {}
        for name, shape in self.shapes.items():
            size = math.prod(shape)
            parts[name], vector = vector[:size].reshape(shape), vector[size:]
        return parts

    def place(self, name: str) -> slice:
        """Where a kind stands in vectors."""
        sizes = [math.prod(shape) for shape in self.shapes.values()]
        first = sum(sizes[: self.kinds.index(name)])
        return slice(first, first + sizes[self.kinds.index(name)])

    def value(self, vector: Array, name: str) -> Array:
        """The numbers of a kind, (m,) of tendons; nominal where it is not sought."""
        if name in self.shapes:
            return self.fields(vector)[name]
        return np.full(self.mechanism.n_tendons if RIG_KINDS[name].of == "tendon" else 1, RIG_KINDS[name].nominal)

    def chain(self, vector: Array) -> AnyChain:
        """The mechanism of a vector; motors, sheaths and delays are no part of it."""
        chain, fields = self.mechanism, self.fields(vector)
        factors = self.value(vector, "stiffness")
        if isinstance(chain, RollingChain):
            errors = fields.get("surfaces", np.zeros((chain.n_links, 2, 3)))
            chain = varied_chain(chain, errors, factors)
        elif "stiffness" in fields:
            tendons = zip(chain.tendons, factors.tolist(), strict=True)
            chain = chain.replace(tendons=[replace(t, stiffness=t.stiffness * factor) for t, factor in tendons])
        if isinstance(chain, HingeChain) and "hinge_stiffness" in fields:
            factor = float(fields["hinge_stiffness"][0])
            chain = chain.replace(beads=[replace(bead, stiffness=bead.stiffness * factor) for bead in chain.beads])
        if isinstance(chain, HingeChain) and "hole_angles" in fields:
            chain = _with_turned_holes(chain, fields["hole_angles"])
        if "mu" in fields:
            rubbing = [CapstanFriction(max(mu, _LEAST_MU)) for mu in fields["mu"].tolist()]
            tendons = zip(chain.tendons, rubbing, strict=True)
            chain = chain.replace(tendons=[replace(t, friction=friction) for t, friction in tendons])
        return chain


def _with_turned_holes(chain: HingeChain, angles: Array) -> HingeChain:
    """The arm with the holes of every tendon turned about the axis, (m,) [rad]; unchanged where they would meet."""
    tendons = []
    for tendon, angle in zip(chain.tendons, angles.tolist(), strict=True):
        c, s = math.cos(angle), math.sin(angle)
        tendons.append(replace(tendon, holes=[(c * x - s * y, s * x + c * y) for x, y in tendon.holes]))
    try:
        return chain.replace(tendons=tendons)
    except MechanismError:
        return chain
