"""The design task: change the curvatures of a chain until it bends as wanted. It needs torch."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.columns import ERROR, STATUS
from rj_gym.core.generators import Random, blocks_of
from rj_gym.core.info import STATUS_NAMES
from rj_gym.core.task import Entry, Task
from rj_gym.design.config import DesignConfig, DesignRewardConfig
from rj_gym.design.observation import design_observation_entries
from rj_gym.design.options import DesignOptions, checked_options
from rj_gym.design.sampling import DesignDraws, blank_draws, tip_forces, valid_pairs
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.status import Status
from rollingjoint.design import DesignBox
from rollingjoint.design.objectives import tip_loads
from rollingjoint.differentiable import Equilibria, SpatialEquilibria, solve_tensions
from rollingjoint.errors import InvalidInput, naming_extras

with naming_extras():
    import torch

Array = NDArray[np.float64]

TERMS = ("improvement", "violation", "failure")

_DECIMALS = 6  # of positions [mm] and margins; differences between batches are about 1e-13
_LANES = 2048  # designs × cases that are solved together
_MOST_TARGETS = 100


class Judged(NamedTuple):
    """Values of B designs in their cases: arrays with the lane first.

    Fields: margins (B, q); origins of the moving links, (B, K, n - 1, 2) [mm], and a Status, (B, K), for every case;
    root mean square distance from the targets in every case, (B, K), and in all, (B,) [mm].
    A design that is not valid has the status INVALID_INPUT; without an equilibrium origins are the targets'.
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


class DesignTask(Task):
    """The design task of one configuration; no method changes anything.

    Attributes:
        space: the designs. moving: number of moving links.
        columns: where the parts of readings are; the first four are common to all tasks.
    Raises:
        InvalidInput: a space in which hardly any design is valid.
    """

    last_status: ClassVar[int] = int(max(Status))  # a bad design does not end an episode
    config: DesignConfig

    def __init__(self, config: DesignConfig) -> None:
        self.config, self.space = config, config.space
        self.moving = config.space.plain.n_links - 1
        self.length = config.space.length
        self.action_size = config.space.dimensions
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("step", "status", "error", "reward"), (1,))
        shapes |= {"terms": (len(TERMS),), "case_errors": (config.cases,), "margins": (len(config.space.margin_names),)}
        positions = config.cases, self.moving, config.space.dimension
        shapes |= {"design": (self.action_size,), "positions": positions, "cases": (config.cases,)}
        self.columns = blocks_of(shapes)
        check_space(config.space)

    def part(self, readings: Array, name: str) -> Array:
        """A part of the readings (B, columns), (B, ...), not copied."""
        start, stop, shape = self.columns[name]
        return readings[:, start:stop].reshape(-1, *shape)

    def entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the observation vector."""
        return design_observation_entries(self.config)

    def checked_options(self, options: Mapping[str, Any] | None) -> DesignOptions:
        """The values that the options of a reset fix; raises InvalidInput for unusable ones."""
        fixed = checked_options(options, self.config)
        if fixed.target_design is not None:
            margins = self.margins(fixed.target_design)
            worst = int(margins.argmin())
            if margins[worst] < 0:
                what = f"margin {self.space.margin_names[worst]!r} of options['target_design']"
                hint = "Take a valid design, see margins() of the space."
                raise InvalidInput(what, float(margins[worst]), "0 or more", hint)
        return fixed

    def state_info(self, readings: Array) -> dict[str, Any]:
        """The info of every step, arrays (B, ...): parts of the readings, and copies."""
        margins = self.part(readings, "margins")
        return {
            "error_mm": readings[:, ERROR],
            "case_errors_mm": self.part(readings, "case_errors"),
            "valid": (margins >= 0).all(-1),
            "status": STATUS_NAMES[readings[:, STATUS].astype(np.intp)],
            "margins": margins,
            "design": self.part(readings, "design"),
            "positions": self.part(readings, "positions"),
        }

    def reward_info(self, readings: Array) -> dict[str, Array]:
        """The terms of the reward, (B,) each: parts of the readings."""
        return dict(zip(TERMS, self.part(readings, "terms").T, strict=True))

    def judge(self, designs: Array, draws: DesignDraws) -> Judged:
        """Values of designs (B, d) in the cases of their episodes; rows do not depend on each other."""
        count, cap = len(designs), self.config.largest_error_mm
        margins = self.margins(designs)
        valid = (margins >= 0).all(-1)
        positions = draws.targets.copy()
        status = np.full((count, self.config.cases), int(Status.INVALID_INPUT))
        shapes = self.shapes(designs[valid], draws.tensions[valid], draws.forces[valid])
        status[valid] = shapes[1]
        ok = status <= Status.AT_LIMIT
        positions[valid] = np.where(ok[valid][..., None, None], shapes[0], positions[valid])
        square = np.square(positions - draws.targets).sum(-1).sum(-1) / self.moving
        errors = np.where(ok, np.minimum(np.sqrt(square), cap), cap)
        total = np.minimum(np.sqrt(square.sum(-1) / self.config.cases), cap)
        return Judged(margins, positions, status, errors, np.where(ok.all(-1), total, cap))

    def margins(self, designs: Array) -> Array:
        """Validity margins of designs (..., d), (..., q), rounded to 1e-6."""
        with torch.no_grad():
            return rounded(self.space.margins(torch.as_tensor(designs)))

    def shapes(self, designs: Array, tensions: Array, forces: Array) -> tuple[Array, NDArray[np.int64]]:
        """Origins of the moving links (B, K, n - 1, 2 or 3) [mm], rounded to 1e-6, and statuses (B, K).

        Args:
            designs: (B, d).
            tensions: (B, K, m) [N]. forces: (B, K, 2), in space (B, K, 3) [N].
        """
        count, cases = tensions.shape[:2]
        places = count, cases, self.moving, self.space.dimension
        positions, status = np.zeros(places), np.zeros((count, cases), np.int64)
        step = max(1, _LANES // cases)
        for first in range(0, count, step):
            rows = slice(first, first + step)
            equilibria = _solved(self.space.chain(torch.as_tensor(designs[rows])), tensions[rows], forces[rows])
            positions[rows], status[rows] = rounded(origins(equilibria)[..., 1:, :]), equilibria.status.numpy()
        return positions, status

    def drawn(self, design: Array, tensions: Array, forces: Array) -> tuple[AnyChain, Array]:
        """A valid design (d,) as a mechanism, and the poses of its links, (K, n, ...), in all cases: for pictures."""
        chain = self.space.chain(torch.as_tensor(design)[None])
        return chain.mechanism(), _solved(chain, tensions[None], forces[None]).poses[0].numpy()

    def sample(self, rngs: Random, fixed: DesignOptions | None = None) -> DesignDraws:
        """One episode per generator. An episode depends on its own generator alone, whatever the batch around it.

        Raises:
            InvalidInput: no equilibrium of the hidden design under the forces, however often they are drawn; the
                generators are then as they were.
        """
        generators: list[Any] = [rngs[lane] for lane in range(len(rngs))]
        before = [rng.bit_generator.state for rng in generators]
        try:
            return self._sample(generators, fixed)
        except InvalidInput:
            for rng, state in zip(generators, before, strict=True):
                rng.bit_generator.state = state
            raise

    def _sample(self, generators: list[Any], fixed: DesignOptions | None) -> DesignDraws:
        fixed, drawn = fixed or DesignOptions(), blank_draws(self.config, len(generators))
        if fixed.tensions is not None:
            drawn.tensions[:] = fixed.tensions
        unsolved = list(range(len(generators)))
        for _ in range(_MOST_TARGETS):
            active = [generators[lane] for lane in unsolved]
            drawn.forces[unsolved] = tip_forces(self.config, active) if fixed.forces is None else fixed.forces
            pairs = valid_pairs(self.margins, self.space.dimensions, active)
            drawn.target_design[unsolved] = pairs[:, 0] if fixed.target_design is None else fixed.target_design
            drawn.start_design[unsolved] = self._starts(pairs[:, 1], fixed)
            drawn.targets[unsolved], status = self.shapes(
                drawn.target_design[unsolved], drawn.tensions[unsolved], drawn.forces[unsolved]
            )
            unsolved = [lane for lane, ends in zip(unsolved, status, strict=True) if (ends > Status.AT_LIMIT).any()]
            if not unsolved:
                return drawn
        hint = "Take smaller forces or larger tensions."
        raise InvalidInput("targets", f"none in {_MOST_TARGETS} draws", "a design with equilibria in all cases", hint)

    def _starts(self, drawn: Array, fixed: DesignOptions) -> Array:
        if fixed.start_design is not None:
            return fixed.start_design
        return self.space.reference() if self.config.start == "reference" else drawn


@lru_cache
def check_space(space: DesignBox) -> None:
    """Raises InvalidInput for a space in which hardly any design is valid."""
    space.sample(1, np.random.default_rng(0))


def reward_terms(reward: DesignRewardConfig, before: Array, judged: Judged) -> Array:
    """TERMS of designs that had these errors (B,) [mm] a step before, (B, 3)."""
    if reward.improvement == "log":
        improvement = np.log((before + reward.offset_mm) / (judged.error + reward.offset_mm))
    else:
        improvement = (before - judged.error) / reward.error_scale_mm
    violation = judged.violation
    failed = (violation == 0) & (judged.status > int(Status.AT_LIMIT)).any(-1)
    return np.stack([improvement, -reward.violation * violation, -reward.failure * failed], -1) + 0.0


def origins(equilibria: Equilibria) -> torch.Tensor:
    """Origins of all links, (..., n, 2), in space (..., n, 3) [mm]."""
    poses = equilibria.poses
    return poses[..., :3, 3] if isinstance(equilibria, SpatialEquilibria) else poses[..., :2]


def _solved(chain: Any, tensions: Array, forces: Array) -> Equilibria:
    """Equilibria of designs (B,) under tensions (B, K, m) and forces on the tip, (B, K, 2 or 3) [N]."""
    with torch.no_grad():
        chains = chain[:, None]
        return solve_tensions(chains, torch.as_tensor(tensions), tip_loads(torch.as_tensor(forces), chains))


def rounded(values: torch.Tensor) -> Array:
    """Numbers without the last digits, which depend on the batch."""
    return np.round(values.numpy(), _DECIMALS) + 0.0
