"""Mechanisms as tensors, by which equilibria can be differentiated."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from rollingjoint.chain.rolling import Link, RollingChain, planar
from rollingjoint.chain.tendon import Hole, OnSurface, Tendon
from rollingjoint.differentiable.friction import COEFFICIENTS, DifferentiableFriction, as_friction, without_rolling
from rollingjoint.differentiable.looking import may_look, seen
from rollingjoint.differentiable.surface import MOST_UNSEEN_TURN, Surfaces, turning_bound, turning_coefficients
from rollingjoint.errors import InvalidInput
from rollingjoint.friction import CapstanFriction
from rollingjoint.kernels.arrays import LARGEST_INPUT
from rollingjoint.load import Load
from rollingjoint.profile import Profile, Surface

PARAMETERS = {  # axes after those of the batch; n links, m tendons, 2 for (parent, child), p pieces of k coefficients
    "breaks": ("n", 2, "p + 1"),
    "coefficients": ("n", 2, "p", "k"),
    "starts": ("n", 2, 2),
    "angles": ("n", 2),
    "holes": ("m", "n", 2, 2),
    "hole_arcs": ("m", "n", 2),
    "stiffnesses": ("m",),
}
_OF_SURFACES = ("breaks", "coefficients", "starts", "angles")
_MOST_TURN = 50.0  # rad; a piece that may turn by more is not a surface
_SAMPLES = 9  # of the relative curvature in every piece


@dataclass(frozen=True, eq=False)
class DifferentiableChain:
    """Mechanisms with as many links, tendons and crossed joints as one another, as tensors of double precision.

    Every field may have leading axes; together they broadcast to `batch`. Links count from the base, surfaces are
    (parent, child). Padding (pieces of zero length at the end, numbers of a hole of the other kind) has no
    effect.

    Args:
        breaks: borders of the pieces of every curvature, (..., n, 2, p + 1) [mm].
        coefficients: ascending powers of the arc length from the beginning of the piece, (..., n, 2, p, k) [1/mm, ...].
        starts: point of every surface at s = 0, (..., n, 2, 2) [mm].
        angles: tangent angle of every surface at s = 0, (..., n, 2) [rad].
        holes: parent and child hole of every tendon in every link, (..., m, n, 2, 2) [mm].
        hole_arcs: arc length of the holes that lie on a surface, (..., m, n, 2) [mm].
        stiffnesses: of the tendons, (..., m) [N/mm].
        on_surface: which holes lie on a surface, (m, n, 2).
        crossed: how many joints each tendon crosses, (m,).
        springs: loads that belong to every mechanism, constant.
        friction: of the tendons.
    Raises:
        InvalidInput: shapes that disagree.
    """

    breaks: Tensor
    coefficients: Tensor
    starts: Tensor
    angles: Tensor
    holes: Tensor
    hole_arcs: Tensor
    stiffnesses: Tensor
    on_surface: Tensor
    crossed: Tensor
    springs: tuple[Load, ...] = ()
    friction: DifferentiableFriction | None = None

    def __post_init__(self) -> None:
        m, n = self.on_surface.shape[:2]
        sizes: dict[str | int, int] = {"n": n, "m": m, "p": self.breaks.shape[-1] - 1, "p + 1": self.breaks.shape[-1]}
        sizes["k"] = self.coefficients.shape[-1]
        for name, axes in PARAMETERS.items():
            tensor = getattr(self, name)
            expected = tuple(sizes.get(axis, axis) for axis in axes)
            if tensor.dtype != torch.float64 or tuple(tensor.shape[-len(axes) :]) != expected:
                raise InvalidInput(
                    name, (tensor.dtype, tuple(tensor.shape)), f"float64 of shape (..., {str(expected)[1:-1]})"
                )
        self.batch  # noqa: B018 - raises where leading axes disagree

    @classmethod
    def from_mechanism(
        cls,
        mechanism: RollingChain | Sequence[RollingChain],
        requires_grad: Iterable[str] = (),
        device: torch.device | str = "cpu",
    ) -> DifferentiableChain:
        """The mechanism as tensors; a list of them with a leading axis.

        Args:
            mechanism: one, or several with as many links and tendons, whose tendons end alike and pass as many holes
                on surfaces.
            requires_grad: names of the parameters to differentiate by.
            device: where the tensors are.
        Raises:
            InvalidInput: mechanisms of different structure, or not planar chains; a name that is not a parameter.
        """
        chains = [planar(each) for each in (mechanism if isinstance(mechanism, Sequence) else [mechanism])]
        profiles = [s.profile for chain in chains for link in chain.links for s in (link.parent, link.child)]
        pieces, degrees = np.max([profile.coefficients.shape for profile in profiles], axis=0)
        rows = [_numbers(chain, int(pieces), int(degrees)) for chain in chains]
        for row in rows[1:]:
            same = all(np.array_equal(row[name], rows[0][name]) for name in ("on_surface", "crossed"))
            if row["starts"].shape != rows[0]["starts"].shape or not same:
                raise InvalidInput("mechanism", mechanism, "mechanisms with as many links and tendons and alike holes")
        springs = chains[0].springs
        if any(chain.springs != springs for chain in chains):
            raise InvalidInput("mechanism", mechanism, "mechanisms with the same springs")
        friction = _friction(chains, isinstance(mechanism, RollingChain))
        stacked = {name: np.stack([row[name] for row in rows]) for name in PARAMETERS}
        if isinstance(mechanism, RollingChain):
            stacked = {name: array[0] for name, array in stacked.items()}
        structure = {name: rows[0][name] for name in ("on_surface", "crossed")}
        tensors = {name: torch.as_tensor(array, device=device) for name, array in (stacked | structure).items()}
        for name in requires_grad:
            if name not in PARAMETERS:
                raise InvalidInput("requires_grad", name, f"names out of {', '.join(PARAMETERS)}")
            tensors[name].requires_grad_()
        friction = friction and friction.each(lambda tensor: tensor.to(device))
        return cls(**tensors, springs=tuple(springs), friction=friction)

    @functools.cached_property
    def batch(self) -> torch.Size:
        """The leading axes that the parameters broadcast to."""
        shapes = {name: tuple(getattr(self, name).shape[: -len(axes)]) for name, axes in PARAMETERS.items()}
        if self.friction is not None:
            shapes |= {name: tuple(getattr(self.friction, name).shape[:-1]) for name in COEFFICIENTS}
        try:
            return torch.Size(np.broadcast_shapes(*shapes.values()))  # torch's takes ten times as long
        except ValueError:
            raise InvalidInput("leading axes", shapes, "axes that broadcast") from None

    @property
    def n_links(self) -> int:
        """Number of links, the base included."""
        return int(self.on_surface.shape[1])

    @property
    def n_tendons(self) -> int:
        """Number of tendons."""
        return int(self.on_surface.shape[0])

    @property
    def device(self) -> torch.device:
        """Where the tensors are."""
        return self.starts.device

    def replace(self, **changes: Any) -> DifferentiableChain:
        """A copy with other parameters; numbers and tensors of other types become double precision.

        Args:
            changes: parameters by their names; `friction`: a DifferentiableFriction, a CapstanFriction or None.
        Raises:
            InvalidInput: a name that is not a parameter, shapes that disagree.
        """
        friction = changes.pop("friction", self.friction)
        for name in changes:
            if name not in PARAMETERS:
                raise InvalidInput("parameter", name, f"one of {', '.join(PARAMETERS)}, friction")
        tensors = {name: torch.as_tensor(v, dtype=torch.float64, device=self.device) for name, v in changes.items()}
        friction = None if friction is None else as_friction(friction, self.n_tendons, self.starts)
        return dataclasses.replace(self, **tensors, friction=friction)

    def __getitem__(self, index: object) -> DifferentiableChain:
        """Some of the designs, or new axes among the leading ones: `design[:, None]` has room for load cases."""
        places = index if isinstance(index, tuple) else (index,)
        return self._each(lambda tensor, axes: tensor.expand(*self.batch, *tensor.shape[-axes:])[places])

    def over(self, n_axes: int) -> DifferentiableChain:
        """The designs with leading axes of size 1 in front, so that there are n_axes of them in every parameter."""
        return self._each(lambda tensor, axes: tensor[(None,) * (n_axes + axes - tensor.ndim)])

    def where(self, valid: Tensor) -> DifferentiableChain:
        """The designs where `valid`, (batch); elsewhere a plain mechanism, constant, that can always be solved."""
        if seen(valid.all(), False):
            return self
        plain = {name: torch.zeros_like(getattr(self, name)) for name in PARAMETERS}
        plain["breaks"][...] = torch.linspace(-1.0, 1.0, self.breaks.shape[-1], device=self.device).to(torch.float64)
        plain["coefficients"][..., 1, :, 0].fill_(-0.05)
        plain["starts"][..., 0, 1].fill_(-10.0)
        plain["starts"][..., 1, 1].fill_(10.0)
        plain["stiffnesses"].fill_(1.0)
        chosen = {}
        for name, axes in PARAMETERS.items():
            mask = valid[(..., *(None,) * len(axes))]
            chosen[name] = torch.where(mask, getattr(self, name), plain[name])
        return dataclasses.replace(self, **chosen)

    def surfaces(self) -> Surfaces:
        """Every surface, (..., n, 2); where one link was expanded to n, they are computed once."""
        tables = [(getattr(self, name), len(axes)) for name, axes in PARAMETERS.items() if name in _OF_SURFACES]
        if any(tensor.stride(tensor.ndim - axes) for tensor, axes in tables):
            return Surfaces.of(*(tensor for tensor, _ in tables))
        return Surfaces.of(*(tensor.narrow(tensor.ndim - axes, 0, 1) for tensor, axes in tables)).repeated(self.n_links)

    def valid(self) -> Tensor:
        """Whether links can roll on each other, (batch): a relative curvature below 0 at 9 places of every piece.

        False also for numbers that are not finite, beyond 1e12, out of order, or no surface.
        """
        with torch.no_grad():
            good = self.finite()
            return good & _rolling(self.where(good))

    def finite(self) -> Tensor:
        """Whether the numbers can be those of a mechanism at all, (batch)."""
        good = torch.ones(self.batch, dtype=torch.bool, device=self.device)
        for name, axes in PARAMETERS.items():
            good = good & (getattr(self, name).abs() <= LARGEST_INPUT).flatten(-len(axes)).all(-1)
        lengths = self.breaks.diff(dim=-1)
        calm = turning_bound(turning_coefficients(self.coefficients), lengths) <= _most_turn()
        ordered = (lengths >= 0).all(-1) & (lengths[..., 0] > 0)
        around = (self.breaks[..., 0] <= 0) & (self.breaks[..., -1] >= 0)
        stiff = (self.stiffnesses > 0).all(-1)
        first, last = self.breaks[..., None, :, :, 0], self.breaks[..., None, :, :, -1]
        drilled = ~self.on_surface | (self.hole_arcs >= first) & (self.hole_arcs <= last)
        good = good & calm.flatten(-3).all(-1) & (ordered & around).flatten(-2).all(-1)
        return good & drilled.flatten(-3).all(-1) & stiff

    def mechanisms(self) -> list[RollingChain]:
        """The designs as mechanisms, in the order of the flattened batch.

        Raises:
            MechanismError: a design that cannot be built.
        """
        return [self.mechanism(place) for place in range(self.batch.numel())]

    def mechanism(self, place: int = 0) -> RollingChain:
        """One design as a mechanism, by its place in the flattened batch. The latest ones are cached.

        Raises:
            MechanismError: it cannot be built.
        """
        one = self[np.unravel_index(int(place), self.batch)] if self.batch else self
        numbers = [getattr(one, name).detach().cpu().numpy() for name in PARAMETERS]
        structure = self.on_surface.cpu().numpy().tobytes(), tuple(self.crossed.tolist()), one._frictions()
        return _mechanism(self.springs, *structure, tuple(a.shape for a in numbers), *(a.tobytes() for a in numbers))

    def _frictions(self) -> tuple[CapstanFriction | None, ...]:
        """Of every tendon of one design."""
        if self.friction is None:
            return (None,) * self.n_tendons
        columns = [tensor.detach().expand(self.n_tendons).tolist() for tensor in self.friction.tensors]
        return tuple(CapstanFriction(**dict(zip(COEFFICIENTS, row, strict=True))) for row in zip(*columns, strict=True))

    def _each(self, change: Callable[[Tensor, int], Tensor]) -> DifferentiableChain:
        changed = {name: change(getattr(self, name), len(axes)) for name, axes in PARAMETERS.items()}
        friction = self.friction and self.friction.each(lambda tensor: change(tensor, 1))
        return dataclasses.replace(self, **changed, friction=friction)


def _most_turn() -> float:
    """By how much a piece may turn [rad]: less where the host does not look how many nodes its quadrature needs."""
    return _MOST_TURN if may_look() else MOST_UNSEEN_TURN


def _rolling(design: DifferentiableChain) -> Tensor:
    """Whether the relative curvature of every joint is below 0 where it is sampled."""
    inside = torch.linspace(0.0, 1.0 - 1e-9, _SAMPLES, device=design.device).to(torch.float64)
    below, above = design.breaks[..., :-1, 1, :], design.breaks[..., 1:, 0, :]
    if seen((below == above).all(), False):
        return _rolling_alike(design, below.diff(dim=-1), inside)
    joints = design.surfaces().joints()
    low, high = joints.common_range()
    begins = joints.pieces[..., 0]
    ends = joints.limits[..., 1:].expand(*begins.shape[:-1], 1)
    lengths = torch.cat([begins[..., 1:], ends], -1) - begins
    s = (begins[..., None] + lengths[..., None] * inside).flatten(-3).movedim(-1, -2)  # (..., samples, J)
    s = torch.minimum(torch.maximum(s, low[..., None, :]), high[..., None, :])
    curvature = joints.several().at(s[..., None].expand(*s.shape, 2)).curvature()
    return (curvature[..., 0] < curvature[..., 1]).flatten(-2).all(-1) & (low < high).all(-1)


def _rolling_alike(design: DifferentiableChain, lengths: Tensor, inside: Tensor) -> Tensor:
    """`_rolling` for joints whose two surfaces have the same pieces, of these lengths (..., J, p)."""
    degrees = torch.arange(design.coefficients.shape[-1], device=design.device).to(inside)
    relative = design.coefficients[..., :-1, 1, :, :] - design.coefficients[..., 1:, 0, :, :]
    samples = (relative * lengths[..., None] ** degrees) @ (inside ** degrees[:, None])
    return ((samples < 0) | (lengths[..., None] == 0)).flatten(-3).all(-1)


def _friction(chains: Sequence[RollingChain], single: bool) -> DifferentiableFriction | None:
    """That of the tendons of one mechanism, or of several with a leading axis."""
    if not any(chain.has_friction for chain in chains):
        return None
    for chain in chains:
        without_rolling(chain.rolling_coefficients[0])
    rows = torch.tensor(np.stack([chain.friction_coefficients for chain in chains]))
    return DifferentiableFriction(*(rows[0] if single else rows).unbind(-1))


def _numbers(chain: RollingChain, pieces: int, degrees: int) -> dict[str, np.ndarray]:
    """The parameters and the structure of one mechanism."""
    n, m = chain.n_links, chain.n_tendons
    breaks, coefficients = np.empty((n, 2, pieces + 1)), np.zeros((n, 2, pieces, degrees))
    holes, hole_arcs = np.zeros((m, n, 2, 2)), np.zeros((m, n, 2))
    on_surface = np.zeros((m, n, 2), bool)
    surfaces = [(link.parent, link.child) for link in chain.links]
    for i, pair in enumerate(surfaces):
        for side, surface in enumerate(pair):
            own = surface.profile.coefficients
            breaks[i, side] = np.pad(surface.profile.breaks, (0, pieces - len(own)), "edge")
            coefficients[i, side, : len(own), : own.shape[1]] = own
    for j, tendon in enumerate(chain.tendons):
        for i, ends in enumerate(tendon.link_holes(n)):
            for side, hole in enumerate(ends):
                if isinstance(hole, OnSurface):
                    on_surface[j, i, side], hole_arcs[j, i, side] = True, hole.s
                else:
                    holes[j, i, side] = hole
    return {
        "breaks": breaks,
        "coefficients": coefficients,
        "starts": np.array([[surface.start for surface in pair] for pair in surfaces]),
        "angles": np.array([[surface.angle for surface in pair] for pair in surfaces]),
        "holes": holes,
        "hole_arcs": hole_arcs,
        "stiffnesses": chain.stiffnesses.copy(),
        "on_surface": on_surface,
        "crossed": np.array(chain.last_links),
    }


@functools.lru_cache(maxsize=256)
def _mechanism(
    springs: tuple[Load, ...],
    on_surface: bytes,
    crossed: tuple[int, ...],
    frictions: tuple[CapstanFriction | None, ...],
    shapes: tuple[tuple[int, ...], ...],
    *raw: bytes,
) -> RollingChain:
    """The mechanism with these numbers."""
    arrays = (np.frombuffer(row).reshape(shape) for row, shape in zip(raw, shapes, strict=True))
    breaks, coefficients, starts, angles, holes, hole_arcs, stiffnesses = arrays
    on = np.frombuffer(on_surface, bool).reshape(hole_arcs.shape)

    def surface(i: int, side: int) -> Surface:
        real = np.concatenate([[True], np.diff(breaks[i, side]) > 0])
        profile = Profile(breaks[i, side][real], coefficients[i, side][real[1:]])
        return Surface(profile, starts[i, side], angles[i, side])

    def hole(j: int, i: int, side: int) -> Hole:
        if on[j, i, side]:
            return OnSurface(float(hole_arcs[j, i, side]))
        x, y = holes[j, i, side]
        return float(x), float(y)

    links = [Link(surface(i, 0), surface(i, 1)) for i in range(len(starts))]
    tendons = [
        Tendon([(hole(j, i, 0), hole(j, i, 1)) for i in range(end + 1)], end, stiffnesses[j], frictions[j])
        for j, end in enumerate(crossed)
    ]
    return RollingChain(links, tendons, "design", springs)
