"""Mechanisms as tensors: parameters with leading axes, and all that the classes of chains share."""

from __future__ import annotations

import dataclasses
import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rollingjoint.chain.chain import AnyChain
from rollingjoint.differentiable.friction import COEFFICIENTS, DifferentiableFriction, as_friction, without_rolling
from rollingjoint.differentiable.geometry import Geometry
from rollingjoint.differentiable.loads import AnyLoads
from rollingjoint.differentiable.looking import may_look, seen
from rollingjoint.differentiable.surface import MOST_UNSEEN_TURN, Surfaces, turning_bound, turning_coefficients
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import CapstanFriction
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.load import Load
from rollingjoint.profile import Profile, Surface

Array = NDArray[np.float64]
Axes = tuple[str | int, ...]

_MOST_TURN = 50.0  # rad; a piece that may turn by more is not a surface
_SAMPLES = 9  # of the relative curvature in every piece


class ChainTensors(ABC):
    """Mechanisms of one structure as tensors of double precision; each class of them is a frozen dataclass on top.

    Every parameter may have leading axes; together they broadcast to `batch`.

    Attributes of its class:
        parameters: axes of each after the leading ones; n links, J joints, m tendons, p pieces of k coefficients.
        structure: names of the fields, in addition to springs, that all mechanisms of a batch share.
        loads: the class of its load tables.
    """

    parameters: ClassVar[dict[str, Axes]]
    structure: ClassVar[tuple[str, ...]]
    loads: ClassVar[type[AnyLoads]]

    breaks: Tensor
    coefficients: Tensor
    starts: Tensor
    holes: Tensor
    stiffnesses: Tensor
    crossed: Tensor
    springs: tuple[Load, ...]
    friction: DifferentiableFriction | None

    def __post_init__(self) -> None:
        n, pieces = self.n_links, self.breaks.shape[-1] - 1
        sizes: dict[str | int, int] = {"n": n, "J": n - 1, "m": self.n_tendons, "p": pieces, "p + 1": pieces + 1}
        sizes["k"] = self.coefficients.shape[-1]
        for name, axes in self.parameters.items():
            tensor = getattr(self, name)
            expected = tuple(sizes.get(axis, axis) for axis in axes)
            if tensor.dtype != torch.float64 or tuple(tensor.shape[-len(axes) :]) != expected:
                raise InvalidInput(
                    name, (tensor.dtype, tuple(tensor.shape)), f"float64 of shape (..., {str(expected)[1:-1]})"
                )
        self.batch  # noqa: B018 - raises where leading axes disagree

    @classmethod
    def from_mechanism(
        cls, mechanism: Any, requires_grad: Iterable[str] = (), device: torch.device | str = "cpu"
    ) -> Self:
        """The mechanism as tensors; a list of them with a leading axis.

        Args:
            mechanism: one, or several of the same structure: equal numbers of links and tendons, tendons that end at
                the same links, and the same springs.
            requires_grad: names of the parameters to differentiate by.
            device: of the tensors.
        Raises:
            InvalidInput: mechanisms of different structure, or of another class; a name that is not a parameter.
        """
        several = isinstance(mechanism, Sequence)
        chains = [cls._checked(entry) for entry in (mechanism if several else [mechanism])]
        rows = cls._rows(chains)
        for row in rows[1:]:
            same = all(np.array_equal(row[name], rows[0][name]) for name in cls.structure)
            if row["starts"].shape != rows[0]["starts"].shape or not same:
                raise InvalidInput("mechanism", mechanism, "mechanisms with as many links and tendons and alike holes")
        springs = chains[0].springs
        if any(chain.springs != springs for chain in chains):
            raise InvalidInput("mechanism", mechanism, "mechanisms with the same springs")
        friction = _friction(chains, not several)
        stacked = {name: np.stack([row[name] for row in rows]) for name in cls.parameters}
        if not several:
            stacked = {name: array[0] for name, array in stacked.items()}
        structure = {name: rows[0][name] for name in cls.structure}
        tensors = {name: torch.as_tensor(array, device=device) for name, array in (stacked | structure).items()}
        for name in requires_grad:
            if name not in cls.parameters:
                raise InvalidInput("requires_grad", name, f"names out of {', '.join(cls.parameters)}")
            tensors[name].requires_grad_()
        friction = friction and friction.each(lambda tensor: tensor.to(device))
        return cls(**tensors, springs=tuple(springs), friction=friction)  # type: ignore[call-arg]  # a dataclass

    @classmethod
    @abstractmethod
    def _checked(cls, mechanism: object) -> Any:
        """The mechanism; InvalidInput for one of another class."""

    @classmethod
    @abstractmethod
    def _rows(cls, chains: Sequence[Any]) -> list[dict[str, Array]]:
        """Parameters and structure of every mechanism, tables of surfaces padded to the same numbers of pieces."""

    @functools.cached_property
    def batch(self) -> torch.Size:
        """The leading axes to which all parameters broadcast."""
        shapes = {name: tuple(getattr(self, name).shape[: -len(axes)]) for name, axes in self.parameters.items()}
        if self.friction is not None:
            shapes |= {name: tuple(getattr(self.friction, name).shape[:-1]) for name in COEFFICIENTS}
        try:
            return torch.Size(np.broadcast_shapes(*shapes.values()))  # torch's takes ten times as long
        except ValueError:
            raise InvalidInput("leading axes", shapes, "axes that broadcast") from None

    @property
    def n_links(self) -> int:
        """Number of links, the base included."""
        return int(self.holes.shape[-3])

    @property
    def n_tendons(self) -> int:
        """Number of tendons."""
        return int(self.crossed.shape[0])

    @property
    def device(self) -> torch.device:
        """The device of the tensors."""
        return self.starts.device

    def replace(self, **changes: Any) -> Self:
        """A copy with other parameters; numbers and tensors of other types become double precision.

        Args:
            changes: parameters by their names; `friction`: a DifferentiableFriction, a CapstanFriction or None.
        Raises:
            InvalidInput: a name that is not a parameter, shapes that disagree.
        """
        friction = changes.pop("friction", self.friction)
        for name in changes:
            if name not in self.parameters:
                raise InvalidInput("parameter", name, f"one of {', '.join(self.parameters)}, friction")
        tensors = {name: torch.as_tensor(v, dtype=torch.float64, device=self.device) for name, v in changes.items()}
        friction = None if friction is None else as_friction(friction, self.n_tendons, self.starts)
        return self._with(tensors, friction)

    def __getitem__(self, index: object) -> Self:
        """Some of the designs, or new axes among the leading ones: `design[:, None]` has room for load cases."""
        places = index if isinstance(index, tuple) else (index,)
        return self._each(lambda tensor, axes: tensor.expand(*self.batch, *tensor.shape[-axes:])[places])

    def over(self, n_axes: int) -> Self:
        """The designs with axes of size 1 in front, so that every parameter has n_axes leading axes."""
        return self._each(lambda tensor, axes: tensor[(None,) * (n_axes + axes - tensor.ndim)])

    def where(self, valid: Tensor) -> Self:
        """The designs where `valid`, (batch); elsewhere a plain mechanism, constant, that can always be solved."""
        if seen(valid.all(), False):
            return self
        plain = {name: torch.zeros_like(getattr(self, name)) for name in self.parameters}
        plain["breaks"][...] = torch.linspace(-1.0, 1.0, self.breaks.shape[-1], device=self.device).to(torch.float64)
        plain["stiffnesses"].fill_(1.0)
        self._fill_plain(plain)
        tensors = {}
        for name, axes in self.parameters.items():
            mask = valid[(..., *(None,) * len(axes))]
            tensors[name] = torch.where(mask, getattr(self, name), plain[name])
        return self._with(tensors, self.friction)

    @abstractmethod
    def _fill_plain(self, plain: dict[str, Tensor]) -> None:
        """Fill the parameters, zeros but for breaks and stiffnesses, as in a plain mechanism."""

    @abstractmethod
    def geometry(self) -> Geometry:
        """All that does not depend on the pose, with derivatives by the parameters."""

    @abstractmethod
    def valid(self) -> Tensor:
        """Whether links can roll on each other, (batch)."""

    @abstractmethod
    def load_table(self, loads: Sequence[Load]) -> Array:
        """The load table of external loads, (rows, columns); InvalidInput for loads that it cannot have."""

    def _finite(self) -> Tensor:
        """Whether all parameters are finite and in range, and the stiffnesses of the tendons positive, (batch)."""
        good = torch.ones(self.batch, dtype=torch.bool, device=self.device)
        for name, axes in self.parameters.items():
            good = good & (getattr(self, name).abs() <= LARGEST_INPUT).flatten(-len(axes)).all(-1)
        return good & (self.stiffnesses > 0).all(-1)

    def mechanisms(self) -> list[Any]:
        """The designs as mechanisms, in the order of the flattened batch.

        Raises:
            MechanismError: a design that cannot be built.
        """
        return [self.mechanism(place) for place in range(self.batch.numel())]

    @abstractmethod
    def mechanism(self, place: int = 0) -> Any:
        """One design as a mechanism, by its place in the flattened batch. The latest ones are cached.

        Raises:
            MechanismError: it cannot be built.
        """

    def _numbers(self, place: int) -> tuple[tuple[tuple[int, ...], ...], tuple[bytes, ...], tuple[Any, ...]]:
        """Shapes and bytes of the parameters of one design, and the friction of its tendons: keys of a cache."""
        design = self[np.unravel_index(int(place), self.batch)] if self.batch else self
        arrays = [getattr(design, name).detach().cpu().numpy() for name in self.parameters]
        return tuple(a.shape for a in arrays), tuple(a.tobytes() for a in arrays), design._frictions()

    def _frictions(self) -> tuple[CapstanFriction | None, ...]:
        """Friction of every tendon of one design."""
        if self.friction is None:
            return (None,) * self.n_tendons
        columns = [tensor.detach().expand(self.n_tendons).tolist() for tensor in self.friction.tensors]
        return tuple(CapstanFriction(**dict(zip(COEFFICIENTS, row, strict=True))) for row in zip(*columns, strict=True))

    def _each(self, change: Callable[[Tensor, int], Tensor]) -> Self:
        changed = {name: change(getattr(self, name), len(axes)) for name, axes in self.parameters.items()}
        return self._with(changed, self.friction and self.friction.each(lambda tensor: change(tensor, 1)))

    def _with(self, tensors: dict[str, Tensor], friction: DifferentiableFriction | None) -> Self:
        return dataclasses.replace(self, **tensors, friction=friction)  # type: ignore[type-var]  # a dataclass


def most_turn() -> float:
    """Largest turn of a piece [rad]: smaller where the host does not look at the nodes that its quadrature needs."""
    return _MOST_TURN if may_look() else MOST_UNSEEN_TURN


def drawable(breaks: Tensor, coefficients: Tensor) -> Tensor:
    """Whether tables of curvature (..., p + 1) and (..., p, k) are surfaces around s = 0, pieces in order, (...)."""
    lengths = breaks.diff(dim=-1)
    calm = (turning_bound(turning_coefficients(coefficients), lengths) <= most_turn()).all(-1)
    ordered = (lengths >= 0).all(-1) & (lengths[..., 0] > 0)
    return calm & ordered & (breaks[..., 0] <= 0) & (breaks[..., -1] >= 0)


def rolling(below: tuple[Tensor, Tensor], above: tuple[Tensor, Tensor], surfaces: Callable[[], Surfaces]) -> Tensor:
    """Whether the relative curvature of every joint is below 0 where it is sampled, (...).

    Args:
        below, above: breaks (..., J, p + 1) and coefficients (..., J, p, k) of the surfaces of all joints.
        surfaces: the surfaces of all joints, (..., J, 2); called where the breaks below and above differ.
    """
    (breaks, coefficients), (breaks_above, coefficients_above) = below, above
    fractions = torch.linspace(0.0, 1.0 - 1e-9, _SAMPLES, device=breaks.device).to(torch.float64)
    if seen((breaks == breaks_above).all(), False):
        return _rolling_alike(coefficients - coefficients_above, breaks.diff(dim=-1), fractions)
    joints = surfaces()
    low, high = joints.common_range()
    begins = joints.pieces[..., 0]
    ends = joints.limits[..., 1:].expand(*begins.shape[:-1], 1)
    lengths = torch.cat([begins[..., 1:], ends], -1) - begins
    s = (begins[..., None] + lengths[..., None] * fractions).flatten(-3).movedim(-1, -2)  # (..., samples, J)
    s = torch.minimum(torch.maximum(s, low[..., None, :]), high[..., None, :])
    curvature = joints.several().at(s[..., None].expand(*s.shape, 2)).curvature()
    return (curvature[..., 0] < curvature[..., 1]).flatten(-2).all(-1) & (low < high).all(-1)


def _rolling_alike(relative: Tensor, lengths: Tensor, fractions: Tensor) -> Tensor:
    """`rolling` for relative curvatures (..., J, p, k) of surfaces with the same pieces, of lengths (..., J, p)."""
    degrees = torch.arange(relative.shape[-1], device=relative.device).to(fractions)
    samples = (relative * lengths[..., None] ** degrees) @ (fractions ** degrees[:, None])
    return ((samples < 0) | (lengths[..., None] == 0)).flatten(-3).all(-1)


def _friction(chains: Sequence[AnyChain], single: bool) -> DifferentiableFriction | None:
    """Friction of the tendons of one mechanism, or of several with a leading axis; None without friction."""
    if not any(chain.has_friction for chain in chains):
        return None
    for chain in chains:
        without_rolling(chain.rolling_coefficients[0])
    rows = torch.tensor(np.stack([chain.friction_coefficients for chain in chains]))
    return DifferentiableFriction(*(rows[0] if single else rows).unbind(-1))


def tables_of(surfaces: Sequence[tuple[Surface, Surface]], pieces: int, degrees: int) -> dict[str, Array]:
    """Breaks, coefficients, starts and angles of pairs of surfaces, padded to numbers of pieces and coefficients."""
    breaks = np.empty((len(surfaces), 2, pieces + 1))
    coefficients = np.zeros((len(surfaces), 2, pieces, degrees))
    for i, pair in enumerate(surfaces):
        for side, surface in enumerate(pair):
            table = surface.profile.coefficients
            breaks[i, side] = np.pad(surface.profile.breaks, (0, pieces - len(table)), "edge")
            coefficients[i, side, : len(table), : table.shape[1]] = table
    return {
        "breaks": breaks,
        "coefficients": coefficients,
        "starts": np.array([[surface.start for surface in pair] for pair in surfaces]),
        "angles": np.array([[surface.angle for surface in pair] for pair in surfaces]),
    }


def largest_table(surfaces: Sequence[tuple[Surface, Surface]]) -> tuple[int, int]:
    """Numbers of pieces and coefficients of the largest curvature of the surfaces."""
    shapes = [surface.profile.coefficients.shape for pair in surfaces for surface in pair]
    pieces, degrees = np.max(shapes, axis=0)
    return int(pieces), int(degrees)


def surface_of(breaks: Array, coefficients: Array, start: Array, angle: Array) -> Surface:
    """The surface with these numbers, without its padding."""
    real = np.concatenate([[True], np.diff(breaks) > 0])
    x, y = start.tolist()
    return Surface(Profile(breaks[real], coefficients[real[1:]]), (x, y), float(angle))
