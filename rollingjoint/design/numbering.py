"""Which dimensions of a mechanism change together, and what the changes are called."""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.design.refined import Profiles
from rollingjoint.differentiable import DifferentiableSpatialChain
from rollingjoint.differentiable.parameters import ChainTensors

Array = NDArray[np.float64]

CHANGES = ("convexity", "height", "hole_radius", "hole_depth", "azimuth", "half_width", "joint_stiffness")
"""Names of the ranges of a `MechanismSpace`."""

_IN_SPACE = CHANGES[4:]


@dataclass(frozen=True, eq=False)
class Numbering:
    """The changes of a mechanism.

    Args:
        base: the mechanism. tensors: the same. profiles: of its surfaces, as the tables have them.
        alike: what is equal changes together. symmetric: so do holes on both sides.
    """

    base: AnyChain
    tensors: ChainTensors
    profiles: Profiles
    alike: bool
    symmetric: bool

    @cached_property
    def _rolling(self) -> NDArray[np.bool_]:
        """Whether a surface of the tables rolls on another one, (rows, 2)."""
        rolls = np.array([[profile is not None for profile in pair] for pair in self.profiles])
        if isinstance(self.base, RollingChain):
            rolls[0, 0] = rolls[-1, 1] = False
        return rolls

    @cached_property
    def distinct_joints(self) -> list[int]:
        """Rolling joints whose surfaces are not those of an earlier one."""
        index = self.indices["convexity"]
        plane = isinstance(self.base, RollingChain)
        pairs = [(index[i, 1], index[i + 1, 0]) for i in range(len(index) - 1)] if plane else [*map(tuple, index)]
        first: dict[Hashable, int] = {}
        for joint, pair in enumerate(pairs):
            if pair[0] >= 0:
                first.setdefault(tuple(int(place) for place in pair), joint)
        return list(first.values())

    @cached_property
    def distinct_links(self) -> list[int]:
        """In the plane, links that are not equal to an earlier one."""
        if not isinstance(self.base, RollingChain):
            return []
        first: dict[Hashable, int] = {}
        changes = self._numbered["convexity"][1].tolist(), self._numbered["height"][1].tolist()
        for i, link in enumerate(self.base.links):
            surfaces = ((surface.profile, surface.start, surface.angle) for surface in (link.parent, link.child))
            first.setdefault((*surfaces, *changes[0][i], changes[1][i]), i)
        return list(first.values())

    @cached_property
    def _half_heights(self) -> Array:
        """Farthest surface or pivot of every link from its origin along the axis, (n,) [mm]."""
        reach = np.zeros((2, self.tensors.n_links))
        if isinstance(self.base, RollingChain):
            ends = np.abs(self.tensors.starts[..., 1].numpy())
            ends[0, 0] = ends[-1, 1] = 0.0  # they roll on nothing
            return np.asarray(ends.max(1))
        base = self.tensors
        assert isinstance(base, DifferentiableSpatialChain)
        ends = torch.where(base.hinges[:, None], base.hinge_points[..., 2], base.starts[..., 1]).abs().numpy()
        reach[0, 1:], reach[1, :-1] = ends[:, 0], ends[:, 1]
        return np.asarray(reach.max(0))

    @property
    def least_height(self) -> float:
        """Least half height of a link [mm]; infinite where none has one."""
        heights = self._half_heights[self._half_heights > 0.0]
        return float(heights.min()) if heights.size else math.inf

    @cached_property
    def _numbered(self) -> dict[str, tuple[tuple[str, ...], NDArray[np.intp]]]:
        """Labels of the changes, and for every entry of the tables the place of its change; -1 for none."""
        base, n = self.tensors, self.tensors.n_links
        plane = isinstance(self.base, RollingChain)
        rows = "link" if plane else "joint"
        sides = "parent", "child"
        keys: dict[str, tuple[list[Any], list[str], tuple[int, ...]]] = {}
        places = [(i, side) for i in range(len(self.profiles)) for side in (0, 1)]
        surfaces = [
            ((side, self.profiles[i][side], float(base.angles[i, side])) if self._rolling[i, side] else None)  # type: ignore[attr-defined]
            for i, side in places
        ]
        if plane and self.alike:  # a surface that rolls on nothing goes with its equals
            used = set(surfaces) - {None}
            free = [(0, 0), (n - 1, 1)]
            for i, side in free:
                key = side, self.profiles[i][side], float(base.angles[i, side])  # type: ignore[attr-defined]
                surfaces[2 * i + side] = key if key in used else None
        keys["convexity"] = surfaces, [f"{rows} {i} {sides[side]}" for i, side in places], (len(self.profiles), 2)
        heights: list[Any] = _rounded(self._half_heights)
        keys["height"] = heights, [f"link {i} height" for i in range(n)], (n,)
        keys |= self._numbered_holes()
        joints = [f"joint {i}" for i in range(n - 1)]
        if isinstance(base, DifferentiableSpatialChain):
            contacts = (~base.hinges).tolist()
            widths = [key if rolls else None for key, rolls in zip(_rounded(base.half_widths), contacts, strict=True)]
            keys["azimuth"] = list(range(n - 1)), [f"{joint} azimuth" for joint in joints], (n - 1,)
            keys["half_width"] = widths, [f"{joint} half width" for joint in joints], (n - 1,)
            stiffnesses: list[Any] = _rounded(base.joint_stiffnesses)
            keys["joint_stiffness"] = stiffnesses, [f"{joint} stiffness" for joint in joints], (n - 1,)
        else:
            keys |= {name: ([], [], (0,)) for name in _IN_SPACE}
        alone = () if self.alike else CHANGES
        return {name: _numbering(*keys[name], name in alone) for name in CHANGES}

    def _numbered_holes(self) -> dict[str, tuple[list[Any], list[str], tuple[int, ...]]]:
        """Keys, labels and shape of the changes of holes (m, n, 2); holes that bound no gap go with the other end."""
        base, n = self.tensors, self.tensors.n_links
        m, crossed = base.n_tendons, base.crossed.tolist()
        radii, sides, on = self._hole_radii, self._hole_sides, self._on_surface
        depths = np.abs(base.holes[..., -1].numpy())
        found: dict[str, tuple[list[Any], list[str], tuple[int, ...]]] = {}
        for name in ("hole_radius", "hole_depth"):
            keys: list[Any] = []
            labels = []
            for j in range(m):
                for i in range(n):
                    for side in (0, 1):
                        passes = i <= crossed[j] and not (name == "hole_depth" and on[j, i, side])
                        moved = passes and (name == "hole_depth" or radii[j, i, side] > 0.0)
                        bound = side if (i, side) not in ((0, 0), (crossed[j], 1)) else 1 - side
                        mirrored = 0.0 if self.symmetric or not sides.size else float(sides[j, i, bound])
                        equal = *_rounded((radii[j, i, bound], depths[j, i, bound])), mirrored
                        own = j, i, bound
                        keys.append((equal if self.alike else own) if moved else None)
                        end = f"link {i} {('parent', 'child')[bound]}"
                        labels.append(f"tendon {j} {end} {name.replace('_', ' ')}")
            found[name] = keys, labels, (m, n, 2)
        return found

    @cached_property
    def _on_surface(self) -> NDArray[np.bool_]:
        shape = self.tensors.holes.shape[:-1]
        return getattr(self.tensors, "on_surface", torch.zeros(shape, dtype=torch.bool)).numpy()

    @cached_property
    def _hole_radii(self) -> Array:
        """Distance of every hole from the axis of its link, or from s = 0 along its surface, (m, n, 2) [mm]."""
        across = np.linalg.norm(self.tensors.holes[..., :-1].numpy(), axis=-1)
        arcs = getattr(self.tensors, "hole_arcs", None)
        return np.asarray(across if arcs is None else np.where(self._on_surface, np.abs(arcs.numpy()), across))

    @cached_property
    def _hole_sides(self) -> Array:
        """In the plane the sign of x, or of s, of every hole, (m, n, 2); in space empty."""
        arcs = getattr(self.tensors, "hole_arcs", None)
        if arcs is None:
            return np.empty(0)
        return np.sign(np.where(self._on_surface, arcs.numpy(), self.tensors.holes[..., 0].numpy()))

    @property
    def least_sizes(self) -> dict[str, float]:
        """Least half width of a contact line [mm] and least stiffness of a joint [N·mm/rad], of chains in space."""
        base = self.tensors
        if not isinstance(base, DifferentiableSpatialChain):
            return {}
        widths = base.half_widths[~base.hinges].tolist()
        return {"half_width": min(widths, default=math.inf), "joint_stiffness": float(base.joint_stiffnesses.min())}

    @property
    def labels(self) -> dict[str, tuple[str, ...]]:
        """Labels of the changes, without the knots of curvatures."""
        return {name: labels for name, (labels, _) in self._numbered.items()}

    @property
    def indices(self) -> dict[str, NDArray[np.intp]]:
        """For every entry of a table the place of its change, -1 for none; empty for tables without changes."""
        return {name: index if (index >= 0).any() else index[:0] for name, (_, index) in self._numbered.items()}


def _numbering(
    keys: list[Any], labels: list[str], shape: tuple[int, ...], alone: bool
) -> tuple[tuple[str, ...], NDArray[np.intp]]:
    """Labels of the distinct keys, and the place of every entry's key; -1 for None. `alone`: by place of the label."""
    first: dict[Any, int] = {}
    names: list[str] = []
    index = []
    for key, label in zip(keys, labels, strict=True):
        if key is None:
            index.append(-1)
            continue
        shared = label if alone else key
        if shared not in first:
            first[shared] = len(names)
            names.append(label)
        index.append(first[shared])
    return tuple(names), np.array(index, np.intp).reshape(shape)


def _rounded(values: Iterable[Any]) -> list[float]:
    """Numbers to compare, as floats without their last digits."""
    return [round(float(value), 9) for value in values]
