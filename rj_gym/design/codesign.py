"""The task of designing a mechanism and then bringing its tip to targets by its tendons. It needs torch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import LARGEST, checked_keys
from rj_gym.core.columns import ERROR, STATUS, STEP
from rj_gym.core.generators import Random, blocks_of
from rj_gym.core.info import STATUS_NAMES
from rj_gym.core.task import POSITION_BOUND, Entry, Task
from rj_gym.design.config import CoDesignConfig
from rj_gym.design.options import option_numbers
from rj_gym.design.sampling import directed_forces, valid_pairs
from rj_gym.design.task import check_space, origins, rounded
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.status import Status
from rollingjoint.design.objectives import tip_loads
from rollingjoint.differentiable import Equilibria, solve_lengths, solve_tensions
from rollingjoint.errors import InvalidInput, naming_extras

with naming_extras():
    import torch

Array = NDArray[np.float64]

TERMS = ("tracking", "effort", "violation", "failure")
OPTIONS = ("design", "targets", "force")

_ERROR_UNIT, _TENSION_UNIT = 10.0, 10.0  # mm, N
_MOST_TARGETS = 100
_ANGLE_DECIMALS = 9


class CoDesignDraws(NamedTuple):
    """Random draws of B episodes: the first design, (B, d), targets (B, n, 2 or 3) [mm], force (B, 2 or 3) [N]."""

    design: Array
    targets: Array
    force: Array


class CoDesignOptions(NamedTuple):
    """Values that a reset fixes, the same in every lane; None is drawn. Shapes as in CoDesignDraws, no B."""

    design: Array | None = None
    targets: Array | None = None
    force: Array | None = None


class DesignPose(NamedTuple):
    """Mechanisms in equilibrium: joint angles (B, J) [rad], tips (B, 2 or 3), unstretched lengths (B, m) [mm].

    Further fields: tensions (B, m) [N], statuses (B,).
    """

    angles: Array
    tip: Array
    lengths: Array
    tensions: Array
    status: NDArray[np.int64]

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Where there is an equilibrium, (B,)."""
        return self.status <= Status.AT_LIMIT

    def rows(self, mask: NDArray[np.bool_]) -> DesignPose:
        """Some of them."""
        return DesignPose(self.angles[mask], self.tip[mask], self.lengths[mask], self.tensions[mask], self.status[mask])


class CoDesignTask(Task):
    """The task of one configuration; no method changes anything.

    Attributes:
        space: the designs. columns: where the parts of readings are; the first four are common to all tasks.
    Raises:
        InvalidInput: a space in which hardly any design is valid.
    """

    last_status: ClassVar[int] = int(max(Status))  # a bad design or command does not end an episode
    config: CoDesignConfig

    def __init__(self, config: CoDesignConfig) -> None:
        self.config, self.space, self.length = config, config.space, config.space.length
        plain, d, self._size = config.space.plain, config.space.dimensions, config.space.dimension
        self._tendons = m = plain.n_tendons
        self.action_size = d + m
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("step", "status", "error", "reward"), (1,))
        shapes |= {"terms": (len(TERMS),), "design": (d,), "built": (d,), "margins": (len(config.space.margin_names),)}
        shapes |= {"tip": (self._size,), "target": (self._size,), "tensions": (m,), "command": (m,), "rest": (m,)}
        self.columns = blocks_of(shapes | {"angles": (plain.n_links - 1,)})
        check_space(config.space)

    def part(self, readings: Array, name: str) -> Array:
        """A part of the readings (B, columns), (B, ...), not copied."""
        start, stop, shape = self.columns[name]
        return readings[:, start:stop].reshape(-1, *shape)

    def entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the observation vector."""
        config, axes, tendons = self.config, "xyz"[: self._size], range(self._tendons)
        worst = config.largest_error_mm / _ERROR_UNIT
        position = -POSITION_BOUND, POSITION_BOUND
        return [
            Entry("control phase", "1", 0.0, 1.0),
            Entry("steps left", "episode", 0.0, 1.0),
            *(Entry(name, "half range", -1.0, 1.0) for name in config.space.names),
            *(Entry(f"{name} margin", "1", -1.0, 1.0) for name in config.space.margin_names),
            *(Entry(f"target {k} {axis}", "L", *position) for k in range(config.targets) for axis in axes),
            *(Entry(f"tip {axis}", "L", *position) for axis in axes),
            *(Entry(f"error {axis}", f"{_ERROR_UNIT:g} mm", -worst, worst) for axis in axes),
            *(Entry(f"force {axis}", f"{config.force[1] or 1.0:g} N", -1.0, 1.0) for axis in axes),
            *(Entry(f"tendon {j} tension", f"{_TENSION_UNIT:g} N", 0.0, 10.0) for j in tendons),
            *(Entry(f"tendon {j} command", f"{config.command_range_mm:g} mm", -1.0, 1.0) for j in tendons),
        ]

    def observation(self, readings: Array, draws: CoDesignDraws) -> Array:
        """The values of the entries in B lanes, (B, entries)."""
        config, step = self.config, readings[:, STEP]
        tip, target = self.part(readings, "tip"), self.part(readings, "target")
        parts = (
            step >= config.design_steps,
            1.0 - step / config.episode_steps,
            self.part(readings, "design"),
            self.part(readings, "margins"),
            draws.targets / self.length,
            tip / self.length,
            (target - tip) / _ERROR_UNIT,
            draws.force / (config.force[1] or 1.0),
            self.part(readings, "tensions") / _TENSION_UNIT,
            self.part(readings, "command") / config.command_range_mm,
        )
        return np.concatenate([np.asarray(part, float).reshape(len(readings), -1) for part in parts], axis=1)

    def checked_options(self, options: Mapping[str, Any] | None) -> CoDesignOptions:
        """The values that the options of a reset fix; raises InvalidInput for unusable ones.

        Args:
            options: any of "design" (d,), a valid one to begin with; "targets" (n, 2 or 3) [mm]; "force" (2 or 3) [N].
        """
        given, size = checked_keys(options, OPTIONS), self._size
        fixed = CoDesignOptions(
            option_numbers(given, "design", (self.space.dimensions,), -1.0, 1.0),
            option_numbers(given, "targets", (self.config.targets, size), -LARGEST, LARGEST),
            option_numbers(given, "force", (size,), -LARGEST, LARGEST),
        )
        if fixed.design is not None:
            self._check_design(fixed.design)
        return fixed

    def _check_design(self, design: Array) -> None:
        """Raise InvalidInput for a design (d,) that is not valid, or has no equilibrium at rest."""
        margins = self.margins(design)
        worst = int(margins.argmin())
        if margins[worst] < 0:
            what = f"margin {self.space.margin_names[worst]!r} of options['design']"
            raise InvalidInput(what, float(margins[worst]), "0 or more", "Take a valid design.")
        if not self.at_rest(design[None]).ok[0]:
            allowed = f"a design with an equilibrium under the pretension, {self.config.pretension:g} N"
            raise InvalidInput("options['design']", design, allowed)

    def state_info(self, readings: Array) -> dict[str, Any]:
        """The info of every step, arrays (B, ...): parts of the readings, and copies."""
        names = "margins", "design", "tip", "target", "tensions", "command"
        control = readings[:, STEP] >= self.config.design_steps
        return {
            "error_mm": readings[:, ERROR],
            "phase": np.where(control, "control", "design").astype(object),
            "valid": (self.part(readings, "margins") >= 0).all(-1),
            "status": STATUS_NAMES[readings[:, STATUS].astype(np.intp)],
            "built_design": self.part(readings, "built"),
            **{name: self.part(readings, name) for name in names},
        }

    def reward_info(self, readings: Array) -> dict[str, Array]:
        """The terms of the reward, (B,) each: parts of the readings."""
        return dict(zip(TERMS, self.part(readings, "terms").T, strict=True))

    def margins(self, designs: Array) -> Array:
        """Validity margins of designs (..., d), (..., q), rounded to 1e-6."""
        with torch.no_grad():
            return rounded(self.space.margins(torch.as_tensor(designs)))

    def target(self, step: Array, draws: CoDesignDraws) -> Array:
        """The target after this number of steps, (B,), (B, 2 or 3) [mm]."""
        config = self.config
        share = np.maximum(step - config.design_steps, 0) * config.targets // config.control_steps
        place = np.minimum(share.astype(np.intp), config.targets - 1)
        return draws.targets[np.arange(len(place)), place]

    def at_rest(self, designs: Array, tensions: Array | None = None) -> DesignPose:
        """Designs (B, d) without load, under the pretension or under tensions (B, m) [N]."""
        pulls = np.full((len(designs), self._tendons), self.config.pretension) if tensions is None else tensions
        with torch.no_grad():
            chain = self.space.chain(torch.as_tensor(designs))
            return _pose(solve_tensions(chain, torch.as_tensor(pulls)), chain)

    def moved(self, designs: Array, lengths: Array, force: Array, angles: Array) -> DesignPose:
        """Designs (B, d) with motors at unstretched lengths (B, m) [mm] under forces, searched from joint angles."""
        with torch.no_grad():
            chain = self.space.chain(torch.as_tensor(designs))
            loads = tip_loads(torch.as_tensor(force), chain)
            return _pose(solve_lengths(chain, torch.as_tensor(lengths), loads, torch.as_tensor(angles)), chain)

    def mechanism(self, design: Array) -> AnyChain:
        """A valid design (d,) as a mechanism: for pictures."""
        mechanism: AnyChain = self.space.chain(torch.as_tensor(design)).mechanism()
        return mechanism

    def sample(self, rngs: Random, fixed: CoDesignOptions | None = None) -> CoDesignDraws:
        """One episode per generator. An episode depends on its own generator alone, whatever the batch around it.

        Raises:
            InvalidInput: no equilibrium however often designs and targets are drawn; the generators are then as they
                were.
        """
        generators: list[Any] = [rngs[lane] for lane in range(len(rngs))]
        before = [rng.bit_generator.state for rng in generators]
        try:
            return self._sample(generators, fixed or CoDesignOptions())
        except InvalidInput:
            for rng, state in zip(generators, before, strict=True):
                rng.bit_generator.state = state
            raise

    def _sample(self, generators: list[Any], fixed: CoDesignOptions) -> CoDesignDraws:
        config, count = self.config, len(generators)
        draws = blank_draws(config, count)
        reference = np.tile(self.space.reference(), (count * config.targets, 1))
        unsolved = np.arange(count)
        for _ in range(_MOST_TARGETS):
            active = [generators[lane] for lane in unsolved]
            draws.force[unsolved] = directed_forces(config.force, 1, self._size, active)[:, 0]
            designs = valid_pairs(self.margins, self.space.dimensions, active)[:, 0]
            designs = np.broadcast_to(self.space.reference(), designs.shape) if config.start == "reference" else designs
            draws.design[unsolved] = designs if fixed.design is None else fixed.design
            pulls = np.stack([rng.uniform(*config.target_tensions, (config.targets, self._tendons)) for rng in active])
            wanted = self.at_rest(reference[: pulls.shape[0] * config.targets], pulls.reshape(-1, self._tendons))
            draws.targets[unsolved] = wanted.tip.reshape(len(unsolved), config.targets, self._size)
            ok = wanted.ok.reshape(len(unsolved), -1).all(-1) & self.at_rest(draws.design[unsolved]).ok
            unsolved = unsolved[~ok]
            if not len(unsolved):
                for name, value in fixed._asdict().items():
                    if value is not None:
                        getattr(draws, name)[:] = value
                return draws
        hint = "Take other target_tensions or pretension."
        raise InvalidInput("targets", f"none in {_MOST_TARGETS} draws", "a reference with equilibria", hint)


def blank_draws(config: CoDesignConfig, count: int) -> CoDesignDraws:
    """Zeros in the shapes of `count` episodes."""
    size = config.space.dimension
    shapes = (config.space.dimensions,), (config.targets, size), (size,)
    return CoDesignDraws(*(np.zeros((count, *shape)) for shape in shapes))


def _pose(found: Equilibria, chain: Any) -> DesignPose:
    """Equilibria without the last digits, which depend on the batch."""
    lengths = found.lengths - found.tensions / chain.stiffnesses
    angles = np.round(found.joint_angles.numpy(), _ANGLE_DECIMALS)
    tip = origins(found)[..., -1, :]
    return DesignPose(angles + 0.0, rounded(tip), rounded(lengths), rounded(found.tensions), found.status.numpy())
