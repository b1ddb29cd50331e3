"""Random valid mechanisms, loads and inputs: for tests, convergence studies and randomised training."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.presets import two_segment
from rollingjoint.chain.rolling import Link, RollingChain
from rollingjoint.chain.tendon import OnSurface, Tendon
from rollingjoint.errors import MechanismError
from rollingjoint.load import BodyWrench, Gravity, Load, Spring, TorsionSpring, WorldForce
from rollingjoint.profile import Profile, Surface

Generator = np.random.Generator

HARD_KINDS = ("flat end", "flat inside", "long", "spanning springs", "slack tip", "stiff", "lopsided", "sharp")
"""Reasons why a chain of `hard_chain` is hard to solve."""


def random_chain(rng: Generator, max_links: int = 10) -> RollingChain:
    """A chain of 2 to max_links links with surfaces of every kind, jumps and nearly flat contacts, 2 to 4 tendons.

    Some tendons end before the tip; some holes lie on the surfaces and some inside the links.
    """
    while True:
        n = int(rng.integers(2, max_links + 1))
        half_width = rng.uniform(8.0, 16.0)
        try:
            return RollingChain(_links(rng, n, half_width), _tendons(rng, n, half_width), "random")
        except MechanismError:  # holes that cross: draw again
            continue


def hard_chain(rng: Generator, kind: str) -> RollingChain:
    """A chain of one of HARD_KINDS.

    flat end, flat inside: relative curvatures that fall to 1e-7 to 1e-4 /mm at the end of a surface or inside it.
    long: 16 to 40 joints. spanning springs: torsion springs over many joints. slack tip: two segments, of which
    `hard_inputs` leaves the distal one slack. stiff: tendons of 1 to 1e4 N/mm. lopsided: limits far from symmetric.
    sharp: one to three joints that can turn several times.
    """
    while True:
        try:
            return _hard_chain(rng, kind)
        except MechanismError:  # holes that cross: draw again
            continue


def hard_inputs(rng: Generator, chain: RollingChain, kind: str, given: str, rows: int) -> NDArray[np.float64]:
    """Tensions [N] or lengths [mm] of many rows, (rows, m), for a chain of `hard_chain`."""
    if given == "tensions":
        tensions = 10.0 ** rng.uniform(-1.0, 1.3, (rows, chain.n_tendons))
        taut = rng.random(tensions.shape) >= 0.1
        if kind == "slack tip":
            slack = 10.0 ** rng.uniform(-4.0, -1.0, tensions.shape) * (rng.random((rows, 1)) < 0.5)
            tensions = np.where(np.array(chain.last_links) == chain.n_links - 1, slack, tensions)
        return np.array(tensions * taut)
    spread = chain.length * (1e-3 if kind == "stiff" and rng.random() < 0.5 else 1.0)
    lengths = chain.neutral_lengths + spread * rng.uniform(-0.15, 0.05, (rows, chain.n_tendons))
    if kind == "slack tip":
        lengths[:, np.array(chain.last_links) == chain.n_links - 1] += 0.2 * chain.length
    return np.array(lengths)


def hard_loads(rng: Generator, chain: RollingChain, kind: str, largest: float, follower: bool) -> list[Load]:
    """Loads for a chain of `hard_chain`; with `follower` one of them turns with its link.

    With slack tendons every second set of loads is a moment alone, which does not stiffen the chain.
    """
    loads = random_loads(rng, chain.n_links, largest, follower)
    if kind == "slack tip" and not follower and rng.random() < 0.5:
        loads = [_load(rng, "moment", chain.n_links, largest)]
    if follower and not any(isinstance(load, BodyWrench) for load in loads):
        loads.append(_load(rng, "follower", chain.n_links, largest))
    return loads


def random_loads(rng: Generator, n_links: int, largest: float = 1.5, follower: bool = False) -> list[Load]:
    """One to three loads of every kind, forces up to `largest` [N]; follower forces only on request."""
    kinds = ["force", "moment", "gravity", "spring", *(["follower"] if follower else [])]
    return [_load(rng, kind, n_links, largest) for kind in rng.choice(kinds, rng.integers(1, 4), replace=False)]


def random_tensions(rng: Generator, n_tendons: int, slack: float = 0.1) -> NDArray[np.float64]:
    """Tensions log-uniform in [0.1, 20] N, each slack (0 N) with probability `slack`."""
    return 10.0 ** rng.uniform(-1.0, 1.3, n_tendons) * (rng.random(n_tendons) >= slack)


def random_lengths(rng: Generator, mechanism: RollingChain) -> NDArray[np.float64]:
    """Unstretched lengths around the neutral ones: up to 15 % of the length shorter, 5 % longer."""
    return mechanism.neutral_lengths + mechanism.length * rng.uniform(-0.15, 0.05, mechanism.n_tendons)


def _hard_chain(rng: Generator, kind: str) -> RollingChain:
    half_width = rng.uniform(8.0, 16.0)
    n = int(rng.integers(17, 42) if kind == "long" else rng.integers(3, 11))
    match kind:
        case "flat end" | "flat inside":
            link = _flat_link(rng, half_width, kind == "flat inside")
            return RollingChain([link] * n, _tendons(rng, n, half_width), kind)
        case "lopsided":
            shift = rng.choice([-0.9, 0.9]) * half_width
            links = [_moved(link, shift) for link in _links(rng, n, half_width)]
            reach = (1.0 - abs(shift) / half_width) * half_width
            return RollingChain(links, _tendons(rng, n, reach), kind)
        case "slack tip":
            counts, radius = rng.integers(1, 6, 2).tolist(), rng.uniform(15.0, 30.0)
            spring = TorsionSpring(-1, 10.0 ** rng.uniform(0.5, 2.5), rng.uniform(-1.5, 1.5))
            return two_segment(*counts, radius=radius, half_width=half_width).replace(name=kind, springs=[spring])
        case "sharp":
            n = int(rng.integers(2, 5))
            links = [_sharp_link(rng, half_width) for _ in range(n)]
            return RollingChain(links, _tendons(rng, n, half_width), kind)
    links, tendons, springs = _links(rng, n, half_width), _tendons(rng, n, half_width), []
    if kind == "stiff":
        tendons = [Tendon(tendon.holes, tendon.end, 10.0 ** rng.uniform(0.0, 4.0)) for tendon in tendons]
    if kind == "spanning springs" or (kind == "long" and rng.random() < 0.5):
        springs = [_spanning_spring(rng, n) for _ in range(rng.integers(1, 3))]
    return RollingChain(links, tendons, kind, springs)


def _spanning_spring(rng: Generator, n_links: int) -> TorsionSpring:
    """A torsion spring over at least half of the joints."""
    first = int(rng.integers(0, n_links // 2))
    last = int(rng.integers(first + (n_links - first) // 2, n_links))
    return TorsionSpring(last, 10.0 ** rng.uniform(0.0, 2.5), rng.normal(0.0, 0.5), first)


def _flat_link(rng: Generator, half_width: float, interior: bool) -> Link:
    """A link on which the relative curvature nearly vanishes at one place."""
    smallest, slope = 10.0 ** rng.uniform(-7.0, -4.0), 10.0 ** rng.uniform(-3.0, -1.7)
    if interior:
        place = rng.uniform(-0.5, 0.5) * half_width
        s = np.array([-half_width, place, half_width])
    else:
        s = np.array([-half_width, half_width])
        place = rng.choice(s)
    parent = Profile.samples(s, smallest + slope * np.abs(s - place))
    return Link(
        Surface(parent, (0.0, -10.0), rng.normal(0.0, 0.1)),
        Surface(Profile.constant(0.0, (-half_width, half_width)), (0.0, 10.0), rng.normal(0.0, 0.1)),
    )


def _moved(link: Link, shift: float) -> Link:
    """The link with its surfaces shifted along their arc lengths, so that s = 0 lies near one end."""
    parent, child = (
        Surface(Profile(side.profile.breaks + shift, side.profile.coefficients), side.start, side.angle)
        for side in (link.parent, link.child)
    )
    return Link(parent, child)


def _sharp_link(rng: Generator, half_width: float) -> Link:
    """A link with surfaces that turn several times."""
    curvature = 10.0 ** rng.uniform(-0.5, 0.8)
    limits = (-half_width, half_width)
    parent, child = Profile.constant(rng.uniform(-0.02, 0.02), limits), Profile.constant(-curvature, limits)
    return Link(Surface(parent, (0.0, -10.0)), Surface(child, (0.0, 10.0)))


def _links(rng: Generator, n: int, half_width: float) -> list[Link]:
    """Links that roll on each other: the curvature of every child surface is below the parent surface's above it."""
    height = rng.uniform(10.0, 25.0)
    parents = [_profile(rng, half_width, 0.01, 0.04) for _ in range(n)]
    children = [_below(rng, _profile(rng, half_width, -0.02, 0.03), parent) for parent in parents[1:]]
    children.append(_profile(rng, half_width, -0.02, 0.02))
    return [
        Link(
            Surface(parent, (rng.normal(0.0, 0.5), -0.5 * height), rng.normal(0.0, 0.1)),
            Surface(child, (rng.normal(0.0, 0.5), 0.5 * height), rng.normal(0.0, 0.1)),
        )
        for parent, child in zip(parents, children, strict=True)
    ]


def _profile(rng: Generator, half_width: float, mean: float, spread: float) -> Profile:
    limits = (-half_width, half_width)
    match rng.integers(5):
        case 0:
            return Profile.constant(rng.normal(mean, spread), limits)
        case 1:
            scale = spread / half_width ** np.arange(4)
            return Profile.polynomial(mean * (np.arange(4) == 0) + rng.normal(0.0, 0.5, 4) * scale, limits)
        case 2:
            breaks = np.concatenate([[-half_width], np.sort(rng.uniform(-half_width, half_width, 2)), [half_width]])
            return Profile.piecewise_constant(breaks, rng.normal(mean, 0.5 * spread, 3))
        case 3:
            return Profile.spline(np.linspace(*limits, 5), rng.normal(mean, 0.5 * spread, 5))
    return Profile.samples(np.linspace(*limits, 9), rng.normal(mean, 0.5 * spread, 9))


def _below(rng: Generator, child: Profile, parent: Profile) -> Profile:
    """The child profile, lowered until its curvature is below the parent's by a margin that may be tiny."""
    s = np.unique(np.concatenate([np.linspace(*child.limits, 1001), child.breaks, parent.breaks]))
    sides = np.concatenate([s, np.nextafter(s[1:], s[0])])
    margin = 10.0 ** rng.uniform(-4.0, -1.3)
    shift = np.max(child.curvature(sides) - parent.curvature(sides)) + margin
    coefficients = child.coefficients.copy()
    coefficients[:, 0] -= shift
    return Profile(child.breaks, coefficients)


def _tendons(rng: Generator, n: int, half_width: float) -> list[Tendon]:
    offset = rng.uniform(0.3, 0.8) * half_width
    stiffness = 10.0 ** rng.uniform(0.0, 1.5)
    tendons = [Tendon.on_surfaces(s, stiffness=stiffness) for s in (-offset, offset)]
    for side in (-1.0, 1.0)[: rng.integers(0, 3)]:
        hole = OnSurface(side * 0.8 * offset) if rng.random() < 0.5 else (side * 0.6 * offset, 0.0)
        tendons.append(Tendon([(hole, hole)], int(rng.integers(1, n)), stiffness))
    return tendons


def _load(rng: Generator, kind: str, n_links: int, largest: float) -> Load:
    link = int(rng.integers(1, n_links))
    angle, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, largest)
    force = (size * np.cos(angle), size * np.sin(angle))
    point = (rng.normal(0.0, 3.0), rng.normal(0.0, 3.0))
    match kind:
        case "force":
            return WorldForce(link, force, point=point)
        case "moment":
            return WorldForce(link, (0.0, 0.0), moment=rng.normal(0.0, 10.0 * largest))
        case "gravity":
            return Gravity([0.1 * largest * rng.random()] * n_links, force if size > 0.0 else (0.0, -1.0))
        case "spring":
            return Spring(link, 0.1 * size, (rng.uniform(-50.0, 50.0), rng.uniform(0.0, 100.0)), point)
    return BodyWrench(link, force, point=point)
