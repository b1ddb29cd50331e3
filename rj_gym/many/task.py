"""The task of tracking with many mechanisms: of all of them together, and of those with the same number of links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rj_gym.core.arguments import checked_keys
from rj_gym.core.generators import Random, Uniforms, blocks_of
from rj_gym.core.task import Entry
from rj_gym.many.designs import DrawnDesign, description_entries
from rj_gym.tracking.arm import ArmTask
from rj_gym.tracking.arrays import Rules
from rj_gym.tracking.draws import TrackingDraws
from rj_gym.tracking.options import ARM_OPTIONS, NOTHING_FIXED, OPTIONS, TrackingOptions
from rj_gym.tracking.planar import PlanarTask
from rj_gym.tracking.task import TrackingTask
from rollingjoint.checks import as_integer
from rollingjoint.errors import InvalidInput
from rollingjoint.io.mechanism_file import load_mechanism

Array = NDArray[np.float64]
Places = NDArray[np.intp]

_OF_LINKS = ("surface_offsets", "hinge_stiffnesses", "weights")
"""Entries of info["sampled"] that have a number for every link."""
_ONE_NUMBER = blocks_of({"design": (1,)})


class Chosen(NamedTuple):
    """What holds of episodes with the same number of links: their mechanisms, and what else a reset fixes."""

    mechanisms: tuple[Any, ...]
    designs: NDArray[np.int64]  # which of them each episode has, (B,)
    options: TrackingOptions

    @classmethod
    def of(cls, designs: Sequence[DrawnDesign], options: TrackingOptions) -> Chosen:
        """Episodes with these designs."""
        places: dict[Any, int] = {}
        rows = [places.setdefault(design.mechanism, len(places)) for design in designs]
        return cls(tuple(places), np.array(rows, np.int64), options)


class OwnUnits(NamedTuple):
    """How the numbers of an episode come into the units of its mechanism: (number - shift) * factor.

    Args:
        entries: constants, shifts and factors of the observation with all numbers of links, (3, entries): constants
            are the entries that tell of the design, 0 elsewhere.
        truths: the same of the privileged state, (3, K).
    """

    entries: NDArray[np.float32]
    truths: Array


@dataclass(frozen=True)
class ManyOptions:
    """Values that a reset fixes: the design, None is drawn; the others, by number of links."""

    design: DrawnDesign | None
    by_links: Mapping[int, TrackingOptions]


class OneSizeTask(TrackingTask):
    """Tracking with chains of one number of links, of which every lane has its own: what the plane and space share.

    Observations and privileged states come in units of the plain chain with this number of links and are not clipped:
    `own_units` brings them into those of each mechanism.
    """

    def sample(self, rngs: Random, fixed: Any = None) -> TrackingDraws:
        """One episode per generator, `fixed` a Chosen."""
        draws, (mechanisms, designs, _) = super().sample(rngs, fixed.options), fixed
        return replace(draws, mechanisms=mechanisms, designs=designs, **self.of_designs(mechanisms, designs))

    def rules(self, goal: bool = False) -> Rules:
        """The parameters that all lanes share, without bounds of observations."""
        rules = super().rules(goal)
        truths = np.full_like(rules.hardware.privileged_low, np.inf)
        hardware = rules.hardware._replace(privileged_low=-truths, privileged_high=truths)
        free = np.full_like(rules.low, np.inf)
        return rules._replace(low=-free, high=free, hardware=hardware)

    def own_sampled(self, draws: Any, targets: Array) -> dict[str, Any]:
        """Entries of info["sampled"] without those of single links, which are those of the design."""
        sampled = super().own_sampled(draws, targets)
        return {name: values for name, values in sampled.items() if name not in _OF_LINKS}

    def own_units(self, entries: Sequence[Entry], mechanism: Any) -> tuple[Array, Array]:
        """Shifts and factors, (entries,) each: a number of an entry is (number - shift) * factor in own units."""
        factors = np.where([entry.unit == "L" for entry in entries], self.length / mechanism.length, 1.0)
        shifts = np.zeros(len(entries))
        for place, entry in enumerate(entries):
            words = entry.name.split()
            if words[0] == "tendon" and words[2:] == ["command"]:
                change = mechanism.neutral_lengths - self.neutral_lengths
                shifts[place] = change[int(words[1])] / self.config.command_scale_mm
        return shifts, factors


class PlanarOneSizeTask(OneSizeTask, PlanarTask):
    """Chains in the plane with one number of links."""


class SpatialOneSizeTask(OneSizeTask, ArmTask):
    """Chains in space with one number of links."""


class ManyMechanismsTask(TrackingTask):
    """Tracking with a mechanism that every episode draws; `mechanism` is the plain chain with the most links.

    The entries of an observation are those of the task with the most links, 0 for links that are not there, and the
    description of the design. Numbers are in units of the episode's own mechanism: its length, its neutral lengths.

    Attributes:
        drawn: the designs. sizes: the task of every number of links.
        one: the class of the task with one mechanism. one_size: of those in `sizes`.
    """

    one: ClassVar[type[TrackingTask]]
    one_size: ClassVar[type[OneSizeTask]]
    config: Any

    def __init__(self, config: Any) -> None:
        self.drawn, (fewest, most) = config.mechanisms.drawn, config.mechanisms.links
        super().__init__(replace(config, mechanism=self.drawn.reference(most)))
        self.sizes = {n: self.one_size(config.of_one(self.drawn.reference(n))) for n in range(fewest, most + 1)}
        self._designs: dict[int, DrawnDesign] = {}
        self._own_units: dict[Any, OwnUnits] = {}
        self._own_tasks: dict[Any, TrackingTask] = {}

    def own_entries(self, goal: bool = False) -> list[Entry]:
        """The entries of the task with the most links, and those of the description."""
        return super().own_entries(goal) + description_entries(self.mechanism)

    @property
    def plain_columns(self) -> int:
        """Number of columns of readings before the privileged state."""
        return self._plain

    @property
    def tells_truth(self) -> bool:
        """Whether readings have the privileged state."""
        return self.config.privileged != "off"

    @cached_property
    def places(self) -> dict[int, Places]:
        """For every number of links, where the entries of its task are among the observation's."""
        return {n: _places(task.entries(), self.entries()) for n, task in self.sizes.items()}

    @cached_property
    def truth_places(self) -> dict[int, Places]:
        """The same of the privileged state."""
        own = self.privileged_entries()
        return {n: _places(task.privileged_entries(), own) for n, task in self.sizes.items()}

    @cached_property
    def pictured_places(self) -> dict[int, Places]:
        """The same of `pictured`."""
        own = self.pictured
        return {n: np.array(list(map(own.index, task.pictured)), np.intp) for n, task in self.sizes.items()}

    def own_units(self, design: DrawnDesign) -> OwnUnits:
        """The units of the mechanism of a design."""
        if design.mechanism not in self._own_units:
            self._own_units[design.mechanism] = self._units_of(design)
        return self._own_units[design.mechanism]

    def _units_of(self, design: DrawnDesign) -> OwnUnits:
        task, entries, truths = self.sizes[design.n_links], self.entries(), self.privileged_entries()
        units, truth_units = (np.repeat([[0.0], [0.0], [1.0]], len(each), axis=1) for each in (entries, truths))
        units[0] = [min(max(design.described.get(entry.name, 0.0), entry.low), entry.high) for entry in entries]
        units[1:, self.places[design.n_links]] = task.own_units(task.entries(), design.mechanism)
        own = task.own_units(task.privileged_entries(), design.mechanism)
        truth_units[1:, self.truth_places[design.n_links]] = own
        truth_units[0] = [min(max(0.0, entry.low), entry.high) for entry in truths]
        return OwnUnits(units.astype(np.float32), truth_units)

    def choose(self, rngs: Random, fixed: ManyOptions | None = None) -> list[DrawnDesign]:
        """The designs of episodes, one per generator, each of which gives one number."""
        uniforms = Uniforms(_ONE_NUMBER, rngs)["design"][:, 0]
        if fixed is not None and fixed.design is not None:
            return [fixed.design] * len(uniforms)
        first, stop = self.config.mechanisms.designs
        numbers = first + (uniforms * (stop - first)).astype(np.int64)
        return [self.design(number) for number in numbers.tolist()]

    def design(self, number: int) -> DrawnDesign:
        """The design with this number."""
        if number not in self._designs:
            self._designs[number] = self.drawn[number]
        return self._designs[number]

    def options_for(self, n_links: int, fixed: ManyOptions | None) -> TrackingOptions:
        """What a reset fixes in episodes with this number of links."""
        return NOTHING_FIXED if fixed is None else fixed.by_links[n_links]

    def checked_options(self, options: Mapping[str, Any] | None) -> Any:
        """Values that the options of a reset fix.

        Args:
            options: as of the environment with one mechanism; "design": the number of a design; "mechanism": one with
                the tendons, and as many links, as designs have. A link of a load must be one of every mechanism that
                may be drawn.
        Raises:
            InvalidInput: options that cannot be used.
        """
        if not options:
            return None
        checked_keys(options, ("design", *(OPTIONS if self.dimension == 2 else ARM_OPTIONS)))
        others, design = dict(options), None
        number, mechanism = others.pop("design", None), others.pop("mechanism", None)
        if number is not None and mechanism is not None:
            raise InvalidInput("options", ["design", "mechanism"], "one of both")
        if number is not None:
            design = self.design(as_integer("options['design']", number, 0))
        sizes = self.sizes
        if mechanism is not None:
            design = DrawnDesign(-1, self._checked_mechanism(mechanism))
        if design is not None:
            sizes = {design.n_links: sizes[design.n_links]}
        return ManyOptions(design, {n: task.checked_options(others) for n, task in sizes.items()})

    def _checked_mechanism(self, value: Any) -> Any:
        """The mechanism of an option; InvalidInput unless designs can have its numbers of links and tendons."""
        mechanism = load_mechanism(value, self.config.MECHANISM) if isinstance(value, str) else value
        n = getattr(mechanism, "n_links", 0)
        if n not in self.sizes:
            few, most = self.config.mechanisms.links
            allowed = f"{self.mechanism.title} of {few} to {most} links"
            raise InvalidInput("options['mechanism'] links", n or value, allowed)
        return self.sizes[n].checked_options({"mechanism": mechanism}).mechanism

    def own_task(self, design: DrawnDesign) -> TrackingTask:
        """The task with the mechanism of a design alone, for controllers with a model; all else as here."""
        return self._task_of(design.mechanism)

    def plain_task(self, n_links: int) -> TrackingTask:
        """The task with the plain chain of the space with this number of links, for controllers told no more."""
        return self._task_of(self.drawn.reference(n_links))

    def _task_of(self, mechanism: Any) -> TrackingTask:
        if mechanism not in self._own_tasks:
            self._own_tasks[mechanism] = self.one(self.config.of_one(mechanism))
        return self._own_tasks[mechanism]

    def own_observations(self, observations: Any, n_links: int) -> Any:
        """The observations (B, entries) of mechanisms with this number of links, as the task with one gives them."""
        if isinstance(observations, Mapping):
            truths = observations["privileged"][:, self.truth_places[n_links]]
            return {"observation": self.own_observations(observations["observation"], n_links), "privileged": truths}
        return observations[:, self.places[n_links]]

    def episodes_by_links(self, rngs: Sequence[Any]) -> list[tuple[NDArray[np.int64], OneSizeTask, TrackingDraws]]:
        """The episodes of these generators by number of links: their places, their task, their random numbers."""
        designs = self.choose(rngs)
        parts = []
        for n, rows in by_links(designs).items():
            chosen = Chosen.of([designs[row] for row in rows], NOTHING_FIXED)
            parts.append((rows, self.sizes[n], self.sizes[n].sample([rngs[row] for row in rows], chosen)))
        return parts


class ManyPlanarTask(ManyMechanismsTask, PlanarTask):
    """Tracking with a chain in the plane that every episode draws."""

    one: ClassVar[type[TrackingTask]] = PlanarTask
    one_size: ClassVar[type[OneSizeTask]] = PlanarOneSizeTask


class ManySpatialTask(ManyMechanismsTask, ArmTask):
    """Tracking with a chain in space that every episode draws."""

    one: ClassVar[type[TrackingTask]] = ArmTask
    one_size: ClassVar[type[OneSizeTask]] = SpatialOneSizeTask


def by_links(designs: Sequence[DrawnDesign]) -> dict[int, NDArray[np.int64]]:
    """The places of designs with the same number of links, by that number."""
    sizes = np.array([design.n_links for design in designs])
    return {int(n): np.flatnonzero(sizes == n) for n in np.unique(sizes)}


def _places(entries: Sequence[Entry], among: Sequence[Entry]) -> Places:
    names = [entry.name for entry in among]
    return np.array([names.index(entry.name) for entry in entries], np.intp)
