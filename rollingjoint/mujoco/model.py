"""Any mechanism as a MuJoCo model; its joint positions, and the accuracy of a planar chain's poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.checks import as_integer
from rollingjoint.errors import InvalidInput
from rollingjoint.mujoco.arm import arm_mjcf
from rollingjoint.mujoco.chain import chain_mjcf, couplings
from rollingjoint.mujoco.coupling import Circles, Slides
from rollingjoint.mujoco.space import couplings as couplings_in_space
from rollingjoint.mujoco.space import space_mjcf
from rollingjoint.mujoco.walls import walls_text
from rollingjoint.surroundings import Surroundings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Accuracy:
    """Position errors of the links of a MuJoCo model, over random poses in the whole range of every joint.

    Args:
        largest: error of any link origin in any pose [mm]. tip: root mean square error of the last link [mm].
        exact: contacts that are exact, of all `contacts`.
    """

    largest: float
    tip: float
    exact: int
    contacts: int

    def __str__(self) -> str:
        exact = f"{self.exact} of {self.contacts} rolling contacts exact"
        return f"{exact}; links at most {self.largest:.2g} mm from their poses, tip {self.tip:.2g} mm (rms)"


def mjcf(mechanism: AnyChain, surroundings: Surroundings | None = None, base: ArrayLike = (0.0, 0.0, 0.0)) -> str:
    """The mechanism as MuJoCo's XML, weightless: an arm exactly, a planar chain with the error that accuracy() states.

    A chain in space is exact where circles roll; other surfaces are fitted as in the plane.

    Actuators are motors that pull the tendons with given tensions [N]. For given lengths set the second column of
    tendon_lengthspring to them [m]. docs/interchange.md shows both.

    Args:
        mechanism: a chain of any kind.
        surroundings: rigid walls without friction, no lumens and no tubes. base: pose of the base among them, x, y
            [mm], angle [rad]; in space x, y, z [mm], or these and a rotation vector [rad]. In the file the base is at
            the origin.
    Raises:
        InvalidInput: springs, friction, walls, or tendons of an arm that are not of the "exact" model, which the file
            would leave out.
    """
    springs, hint = getattr(mechanism, "springs", ()), "mechanism.replace makes one without."
    if springs:
        raise InvalidInput("springs", springs, "a mechanism without springs of its own", hint)
    if mechanism.has_friction:
        raise InvalidInput("friction", mechanism.friction, "a mechanism without friction", hint)
    walls, outlines = walls_text(surroundings, base, mechanism) if surroundings is not None else ("", {})
    if isinstance(mechanism, RollingChain):
        return chain_mjcf(mechanism, walls, outlines)
    if isinstance(mechanism, SpatialChain):
        return space_mjcf(mechanism, walls, outlines)
    if not isinstance(mechanism, HingeChain):
        raise InvalidInput("mechanism", mechanism, "a chain of rolling links or an arm of beads")
    if mechanism.model != "exact":
        raise InvalidInput("tendon model", mechanism.model, "'exact', of which MuJoCo's tendons are")
    return arm_mjcf(mechanism, walls=walls, outlines=outlines)


def positions(mechanism: AnyChain, joint_angles: ArrayLike) -> Array:
    """MuJoCo's qpos at joint angles (..., n - 1) [rad], (..., nq) [rad, m].

    Raises:
        InvalidInput: wrong number of joints, or numbers that are not finite.
    """
    phi = mechanism.per_joint("joint angles", joint_angles)
    if isinstance(mechanism, RollingChain):
        joints: Sequence[Circles | Slides | None] = couplings(mechanism)
    elif isinstance(mechanism, SpatialChain):
        joints = couplings_in_space(mechanism)
    else:
        return phi
    parts = []
    for i, joint in enumerate(joints):
        if joint is None:
            parts.append(phi[..., i : i + 1])
            continue
        scale = np.ones(2) if isinstance(joint, Circles) else np.array([1e-3, 1e-3, 1.0])
        parts.append(scale * joint.coordinates(phi[..., i]))
    return np.concatenate(parts, axis=-1)


def accuracy(chain: RollingChain, samples: int = 2000, seed: int = 0) -> Accuracy:
    """Position errors of the links of the MuJoCo model; no engine is needed.

    Args:
        samples: poses, in which every contact lies anywhere in its range, uniformly.
    """
    count = as_integer("samples", samples, 1)
    low, high = chain.joint_limits.T
    phi = chain.joint_angles(np.random.default_rng(seed).uniform(low, high, (count, chain.n_joints)))
    joints = couplings(chain)
    at, angle = np.zeros((count, 2)), np.zeros(count)
    wrong = [np.zeros(count)]
    exact = chain.poses(phi)
    for i, joint in enumerate(joints):
        pose = joint.poses(phi[:, i])
        cos, sin = np.cos(angle), np.sin(angle)
        at = at + np.stack([cos * pose[:, 0] - sin * pose[:, 1], sin * pose[:, 0] + cos * pose[:, 1]], axis=-1)
        angle = angle + pose[:, 2]
        wrong.append(np.linalg.norm(at - exact[:, i + 1, :2], axis=-1))
    circles = sum(isinstance(joint, Circles) for joint in joints)
    tip = float(np.sqrt(np.mean(wrong[-1] ** 2)))
    return Accuracy(float(np.max(wrong)), tip, circles, len(joints))
