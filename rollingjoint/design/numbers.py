"""The numbers of designs, shared by surfaces and links."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from rollingjoint.design.curve import Curve


@dataclass(frozen=True, eq=False)
class Structure:
    """Places of the distinct surfaces of a design.

    Attributes:
        joints: (child, parent) surface of every distinct joint, (J, 2).
        links: (parent, child) surface of every distinct link, (1 or n, 2).
        symmetric: whether the surfaces are even in s.
    """

    joints: Tensor
    links: Tensor
    symmetric: bool


@dataclass(frozen=True, eq=False)
class Numbers:
    """Physical numbers of designs with one leading axis.

    Attributes:
        structure: places of the surfaces.
        curve: the curve through the knot values.
        convexity: of every distinct surface, (B, S, f) [1/mm].
        angle: of a child surface at s = 0; a parent surface has the negative, (B, S) [rad].
        height: of every distinct link, (B, 1 or n) [mm].
        half_width: (B,) [mm].
        hole: distance of the left and the right holes from s = 0 along the surface, (B, 2) [mm].
    """

    structure: Structure
    curve: Curve
    convexity: Tensor
    angle: Tensor
    height: Tensor
    half_width: Tensor
    hole: Tensor

    def rows(self, begin: int, end: int) -> Numbers:
        """The designs from row `begin` up to `end`."""
        names = ("convexity", "angle", "height", "half_width", "hole")
        return replace(self, **{name: getattr(self, name)[begin:end] for name in names})


@functools.lru_cache
def structure(n_links: int, alike: bool, symmetric: bool) -> Structure:
    """The structure of a chain. A surface without a partner mirrors the other surface of its link."""
    if alike:
        return Structure(torch.tensor([[0, 1]]), torch.tensor([[1, 0]]), symmetric)
    joints = torch.arange(2 * (n_links - 1)).reshape(-1, 2)
    below, above = joints[0, :1], joints[-1, 1:]
    links = torch.stack([torch.cat([below, joints[:, 1]]), torch.cat([joints[:, 0], above])], -1)
    return Structure(joints, links, symmetric)
