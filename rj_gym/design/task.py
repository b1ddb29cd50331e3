"""The design task of one configuration: what designs are worth, and random episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from rj_gym.design.config import DesignConfig
from rollingjoint.design.objectives import tip_loads
from rollingjoint.differentiable import DifferentiableChain, Equilibria, solve_tensions
from rollingjoint.errors import InvalidInput
from rollingjoint.planar.chain import RollingChain
from rollingjoint.solution import Status

Array = NDArray[np.float64]

_DECIMALS = 6  # of positions [mm] and margins; differences between batches are about 1e-13
_LANES = 2048  # designs × cases that are solved together
_CANDIDATES = 6  # designs drawn at a time for a lane
_MOST_ROUNDS = 20_000
_MOST_TARGETS = 100


class Episodes(NamedTuple):
    """What was drawn for B episodes: arrays with the lane first.

    Fields: the hidden design and the one to begin with, (B, d); tensions (B, K, 2) [N]; force on the tip in every case,
    (B, K, 2) [N]; origins of the hidden design's moving links, (B, K, n - 1, 2) [mm].
    """

    target_design: Array
    start_design: Array
    tensions: Array
    forces: Array
    targets: Array


class Judged(NamedTuple):
    """What B designs are worth in their cases: arrays with the lane first.

    Fields: margins (B, q); origins of the moving links, (B, K, n - 1, 2) [mm], and a Status, (B, K), for every case;
    root mean square distance from the targets in every case, (B, K), and in all, (B,) [mm].
    A design that is not valid has the status INVALID_INPUT; without an equilibrium origins are those of the targets.
    """

    margins: Array
    positions: Array
    status: NDArray[np.int64]
    case_errors: Array
    error: Array

    @property
    def violation(self) -> Array:
        """Sum of the margins' shortfalls below 0, (B,)."""
        return np.maximum(-self.margins, 0.0).sum(-1)


class Fixed(NamedTuple):
    """What the caller of reset holds fixed, the same in every lane; None is drawn. Shapes as in Episodes, without B."""

    start_design: Array | None = None
    target_design: Array | None = None
    tensions: Array | None = None
    forces: Array | None = None


class DesignTask:
    """The design task of one configuration; no method changes anything.

    Raises:
        InvalidInput: a space in which hardly any design is valid.
    """

    def __init__(self, config: DesignConfig) -> None:
        self.config, self.space = config, config.space
        self.moving = config.space.n_links - 1
        self.length = config.space.n_links * 0.5 * sum(config.space.height)
        config.space.sample(1, np.random.default_rng(0))

    def judge(self, designs: Array, episodes: Episodes) -> Judged:
        """What designs (B, d) are worth in the cases of their episodes; rows do not depend on each other."""
        count, cap = len(designs), self.config.largest_error_mm
        margins = self.margins(designs)
        valid = (margins >= 0).all(-1)
        positions = episodes.targets.copy()
        status = np.full((count, self.config.cases), int(Status.INVALID_INPUT))
        shapes = self.shapes(designs[valid], episodes.tensions[valid], episodes.forces[valid])
        status[valid] = shapes[1]
        ok = status <= Status.AT_LIMIT
        positions[valid] = np.where(ok[valid][..., None, None], shapes[0], positions[valid])
        square = np.square(positions - episodes.targets).sum(-1).sum(-1) / self.moving
        errors = np.where(ok, np.minimum(np.sqrt(square), cap), cap)
        whole = np.minimum(np.sqrt(square.sum(-1) / self.config.cases), cap)
        return Judged(margins, positions, status, errors, np.where(ok.all(-1), whole, cap))

    def margins(self, designs: Array) -> Array:
        """Validity margins of designs (..., d), (..., q), rounded to 1e-6."""
        with torch.no_grad():
            return _rounded(self.space.margins(torch.as_tensor(designs)))

    def shapes(self, designs: Array, tensions: Array, forces: Array) -> tuple[Array, NDArray[np.int64]]:
        """Origins of the moving links (B, K, n - 1, 2) [mm], rounded to 1e-6, and statuses (B, K).

        Args:
            designs: (B, d).
            tensions, forces: (B, K, 2) [N].
        """
        count, cases = tensions.shape[:2]
        positions, status = np.zeros((count, cases, self.moving, 2)), np.zeros((count, cases), np.int64)
        step = max(1, _LANES // cases)
        for first in range(0, count, step):
            rows = slice(first, first + step)
            found = _solved(self.space.chain(torch.as_tensor(designs[rows])), tensions[rows], forces[rows])
            positions[rows], status[rows] = _rounded(found.poses[..., 1:, :2]), found.status.numpy()
        return positions, status

    def drawn(self, design: Array, tensions: Array, forces: Array) -> tuple[RollingChain, Array]:
        """A valid design (d,) as a mechanism, and its poses (K, n, 3) [mm, rad] in cases (K, 2): for pictures."""
        chain = self.space.chain(torch.as_tensor(design)[None])
        return chain.mechanism(), _solved(chain, tensions[None], forces[None]).poses[0].numpy()

    def sample(self, rngs: Sequence[np.random.Generator], fixed: Fixed = Fixed()) -> Episodes:  # noqa: B008 - immutable
        """One episode per generator. An episode depends on its own generator alone, whatever the batch around it.

        Raises:
            InvalidInput: no equilibrium of the hidden design under the forces, however often they are drawn.
        """
        config, count = self.config, len(rngs)
        blank = np.zeros((count, self.space.dimensions))
        forces = np.zeros((count, config.cases, 2))
        tensions = np.array(config.tensions) if fixed.tensions is None else fixed.tensions
        targets = np.zeros((count, config.cases, self.moving, 2))
        drawn = Episodes(blank, blank.copy(), np.tile(tensions, (count, 1, 1)), forces, targets)
        left = list(range(count))
        for _ in range(_MOST_TARGETS):
            drawn.forces[left] = self._forces([rngs[lane] for lane in left]) if fixed.forces is None else fixed.forces
            pairs = self._valid_pairs([rngs[lane] for lane in left])
            drawn.target_design[left] = pairs[:, 0] if fixed.target_design is None else fixed.target_design
            drawn.start_design[left] = self._starts(pairs[:, 1], fixed)
            drawn.targets[left], status = self.shapes(
                drawn.target_design[left], drawn.tensions[left], drawn.forces[left]
            )
            left = [lane for lane, ends in zip(left, status, strict=True) if (ends > Status.AT_LIMIT).any()]
            if not left:
                return drawn
        hint = "Take smaller forces or larger tensions."
        raise InvalidInput("targets", f"none in {_MOST_TARGETS} draws", "a design with equilibria in all cases", hint)

    def _starts(self, drawn: Array, fixed: Fixed) -> Array:
        if fixed.start_design is not None:
            return fixed.start_design
        return self.space.reference() if self.config.start == "reference" else drawn

    def _forces(self, rngs: Sequence[np.random.Generator]) -> Array:
        """Forces of all cases, (len(rngs), K, 2) [N]."""
        low, high = self.config.force
        uniform = np.array([rng.random((self.config.cases, 2)) for rng in rngs])
        size, angle = low + (high - low) * uniform[..., 0], 2.0 * np.pi * uniform[..., 1]
        return size[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1)

    def _valid_pairs(self, rngs: Sequence[np.random.Generator]) -> Array:
        """Two valid designs from every generator, uniform in the box by rejection, (len(rngs), 2, d)."""
        found: list[list[Array]] = [[] for _ in rngs]
        for _ in range(_MOST_ROUNDS):
            left = [lane for lane, own in enumerate(found) if len(own) < 2]
            if not left:
                return np.array([own[:2] for own in found])
            shape = _CANDIDATES, self.space.dimensions
            drawn = np.array([rngs[lane].uniform(-1.0, 1.0, shape) for lane in left])
            good = np.all(self.margins(drawn) >= 0, axis=-1)
            for place, lane in enumerate(left):
                found[lane] += list(drawn[place][good[place]])
        raise InvalidInput("designs", "hardly any valid", "a space with valid designs", "Narrow its ranges.")


def design_task(config: DesignConfig | Mapping[str, Any] | None, overrides: Mapping[str, Any]) -> DesignTask:
    """The task of settings with overrides on top; raises ConfigError for settings that it does not have."""
    if not isinstance(config, DesignConfig):
        config = DesignConfig.from_dict(config or {})
    return DesignTask(config.updated(overrides))


def _solved(chain: DifferentiableChain, tensions: Array, forces: Array) -> Equilibria:
    """Equilibria of designs (B,) under tensions and forces on the tip, (B, K, 2) each [N]."""
    with torch.no_grad():
        each = chain[:, None]
        return solve_tensions(each, torch.as_tensor(tensions), tip_loads(torch.as_tensor(forces), each))


def _rounded(values: torch.Tensor) -> Array:
    """Numbers without the last digits, in which one batch differs from another."""
    return np.round(values.numpy(), _DECIMALS) + 0.0
