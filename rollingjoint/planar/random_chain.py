"""Random valid mechanisms, loads and inputs: for tests, convergence studies and randomised training."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rollingjoint.errors import MechanismError
from rollingjoint.load import BodyWrench, Gravity, Load, Spring, WorldForce
from rollingjoint.planar.chain import Link, RollingChain
from rollingjoint.profile import Profile, Surface
from rollingjoint.tendon import OnSurface, Tendon

Generator = np.random.Generator


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


def _links(rng: Generator, n: int, half_width: float) -> list[Link]:
    """Links whose neighbours roll on each other: every child surface is curved below the parent surface above it."""
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
