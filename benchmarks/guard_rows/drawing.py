"""The drawn inputs, as plain values that name no code: the same for every checkout.

A mechanism is the content of a mechanism file, a load the name of its public class with its arguments, and a commanded
length a share of the mechanism's length beyond the neutral one.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Generator = np.random.Generator
Load = tuple[str, dict[str, Any]]

SEED = 2026
ROWS, LONG, LONG_ROWS = 24, 41, 6  # rows of a batch, and from how many links on there are fewer
ALONE = 8  # rows of a case that are solved one by one, and rows of a step of a batch with friction
LIMITS = ((0.0, float("inf")), (0.5, 15.0))  # of tensions [N]
LOADS = ("force", "moment", "follower", "spring", "torsion spring", "gravity")
KINDS = ("plain", *LOADS, "all loads", "own springs", "unusable numbers", "friction")
ARM_KINDS = ("plain", "hanging", "loads", "linear", "friction")
UNUSABLE = (float("nan"), float("inf"), -1.0, 1e13, 0.0)


class Sizes(NamedTuple):
    """How much is compared."""

    links: tuple[int, ...] = (*range(2, 41), 200)
    arms: int = 16  # of every kind
    episodes: int = 200
    steps: int = 10**6  # of an episode at most
    lanes: int = 64
    runs: bool = True  # make run folders, which loads the learners
    judged: bool = True  # whether timings have limits
    pairs: int = 15  # of timings
    rounds: int = 3  # of fresh processes that the pairs are shared out to
    starts: int = 5  # pairs of first solves
    warmups: int = 3  # pairs of warm-ups
    work: float = 0.1  # s of a timing


FULL = Sizes()
QUICK = Sizes((2, 5, 17), 2, 2, 8, 3, runs=False, judged=False, pairs=2, rounds=1, starts=1, warmups=0, work=2e-3)


@dataclass(frozen=True)
class Case:
    """One mechanism and what it is asked: rows of tensions [N], or of shares of its length, (B, m)."""

    name: str
    mechanism: dict[str, Any]
    given: str
    inputs: Array
    loads: tuple[Load, ...]
    limits: tuple[float, float]

    @property
    def size(self) -> int:
        """Number of links or beads."""
        return len(self.mechanism.get("links") or self.mechanism["beads"])


def planar_cases(kind: str, links: tuple[int, ...]) -> Iterator[Case]:
    """A chain of every number of links."""
    for n in links:
        rng = np.random.default_rng([SEED, KINDS.index(kind), n])
        mechanism = _chain(rng, n)
        if kind == "friction":
            mechanism["friction"] = _friction(rng, rolls=True)
        if kind == "own springs":
            mechanism["springs"] = [_spring_of_a_file(rng, n) for _ in range(2)]
        names = {"all loads": LOADS, "unusable numbers": ("force",)}.get(kind, (kind,) if kind in LOADS else ())
        loads = tuple(_load(rng, name, n) for name in names)
        yield _case(rng, f"{kind}, {n} links", mechanism, loads, kind)


def arm_cases(kind: str, count: int) -> Iterator[Case]:
    """Arms of 1 to 12 beads; the first one has 32."""
    for number in range(count):
        rng = np.random.default_rng([SEED, 1000 + ARM_KINDS.index(kind), number])
        n = int(rng.integers(1, 13)) if number else 32
        mechanism = _arm(rng, n)
        if kind == "friction":
            mechanism["friction"] = _friction(rng, rolls=False)
        if kind == "linear":
            mechanism["model"] = "linear"
        hanging: Load = ("Gravity", {"weights": [0.1] * (n + 1), "direction": (0.0, 0.0, 1.0)})
        loads = () if kind == "plain" else (hanging, *(_arm_loads(rng, n) if kind == "loads" else ()))
        yield _case(rng, f"{kind}, arm {number} of {n} beads", mechanism, loads, kind)


def inputs_of(case: str, row: int, sizes: Sizes) -> str:
    """JSON of what a row of a case was asked; empty for a case that is not drawn here."""
    name, kind, number = re.fullmatch(r"(.*?)(?:, (step|row) (\d+))?", case).groups()
    row += int(number or 0) * (ALONE if kind == "step" else 1)
    drawn = (
        *(one for kind in KINDS for one in planar_cases(kind, sizes.links)),
        *(one for kind in ARM_KINDS for one in arm_cases(kind, sizes.arms)),
    )
    for one in drawn:
        if one.name == name:
            asked = {one.given: one.inputs[row].tolist(), "limits": one.limits, "loads": one.loads}
            return json.dumps(asked | {"mechanism": one.mechanism})
    return ""


def variations(mechanism: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """The mechanism with other tendon stiffnesses, for rows that have mechanisms of their own."""
    rng = np.random.default_rng([SEED, 2000])
    tendons = mechanism["tendons"]
    return [
        {**mechanism, "tendons": [{**one, "stiffness": float(k)} for one, k in zip(tendons, row, strict=True)]}
        for row in rng.uniform(2.0, 9.0, (count, len(tendons)))
    ]


def actions(count: int, size: int, seed: int) -> NDArray[np.float32]:
    """Actions of an episode, some beyond their bounds, (count, size)."""
    rng = np.random.default_rng([SEED, 3000, seed])
    return rng.uniform(-1.2, 1.2, (count, size)).astype(np.float32)


def _case(rng: Generator, name: str, mechanism: dict[str, Any], loads: tuple[Load, ...], kind: str) -> Case:
    given = ("tensions", "lengths")[int(rng.integers(2))]
    long = len(mechanism.get("links", ())) >= LONG and kind != "friction"
    shape = LONG_ROWS if long else ROWS, len(mechanism["tendons"])
    tense = 10.0 ** rng.uniform(-0.5, 1.1, shape) * (rng.random(shape) >= 0.03)
    inputs = tense if given == "tensions" else rng.uniform(-0.06, 0.01, shape)
    if kind == "friction":  # a path
        inputs = inputs[0] * rng.uniform(0.7, 1.3, shape)
    if kind == "unusable numbers":
        for row in range(0, len(inputs), 3):
            inputs[row, rng.integers(shape[1])] = UNUSABLE[int(rng.integers(len(UNUSABLE)))]
    limits = LIMITS[int(rng.integers(2))] if given == "lengths" else LIMITS[0]
    return Case(name, mechanism, given, inputs, loads, limits)


def _chain(rng: Generator, n: int) -> dict[str, Any]:
    """A chain of links of at most four shapes: every child surface is curved below every parent surface."""
    level, half, height = float(rng.normal(0.0, 0.005)), float(rng.uniform(8.0, 14.0)), float(rng.uniform(12.0, 24.0))
    shapes = [
        {
            "parent": _surface(rng, half, -0.5 * height, level, 1.0),
            "child": _surface(rng, half, 0.5 * height, level, -1.0),
        }
        for _ in range(min(n, 4))
    ]
    offset, stiffness = float(rng.uniform(0.4, 0.75)) * half, float(10.0 ** rng.uniform(0.3, 1.0))
    tendons: list[dict[str, Any]] = [{"on_surface": side * offset, "stiffness": stiffness} for side in (-1.0, 1.0)]
    if rng.random() < 0.4:
        hole = {"on_surface": 0.8 * offset} if rng.random() < 0.5 else [0.6 * offset, 0.0]
        tendons.append({"holes": [{"parent": hole, "child": hole}], "end": int(rng.integers(1, n)), "stiffness": 4.0})
    return {"name": f"drawn {n}", "links": [shapes[k % len(shapes)] for k in range(n)], "tendons": tendons}


def _surface(rng: Generator, half: float, height: float, level: float, side: float) -> dict[str, Any]:
    """A surface whose curvature stays on one side of the level."""
    start = [float(rng.normal(0.0, 0.3)), height]
    curvature = _curvature(rng, half, level, side)
    limits = {"limits": [-half, half]} if {"constant", "polynomial"} & set(curvature) else {}
    return {"start": start, "angle": float(rng.normal(0.0, 0.05)), "curvature": curvature, **limits}


def _curvature(rng: Generator, half: float, level: float, side: float) -> dict[str, Any]:
    def beyond(count: int, spread: float = 0.02) -> Any:
        return (level + side * (0.012 + spread * rng.random(count))).tolist()

    match rng.integers(5):
        case 0:
            return {"constant": beyond(1)[0]}
        case 1:
            return {"polynomial": [beyond(1)[0], 0.0, side * float(rng.uniform(0.0, 1e-4))]}
        case 2:
            return {"piecewise_constant": {"breaks": [-half, -0.3 * half, 0.4 * half, half], "values": beyond(3)}}
        case 3:
            return {"spline": {"s": np.linspace(-half, half, 5).tolist(), "u": beyond(5, 0.01)}}
    return {"samples": {"s": np.linspace(-half, half, 7).tolist(), "u": beyond(7)}}


def _friction(rng: Generator, rolls: bool) -> dict[str, float]:
    friction = {"mu": float(rng.uniform(0.02, 0.25)), "presliding": float(10.0 ** rng.uniform(-1.7, -0.5))}
    for name, most in (("constant", 0.3), ("compliance", 0.05), ("extra_turn", 0.3), ("rolling", 0.5)):
        if rng.random() < 0.3 and (rolls or name != "rolling"):
            friction[name] = float(rng.uniform(0.0, most))
    return friction


def _spring_of_a_file(rng: Generator, n: int) -> dict[str, Any]:
    link = int(rng.integers(1, n))
    if rng.random() < 0.5:
        return {"link": link, "stiffness": 0.02, "anchor": rng.uniform(-50.0, 50.0, 2).tolist()}
    return {"link": link, "stiffness": float(rng.uniform(0.0, 30.0)), "rest_angle": float(rng.normal(0.0, 0.2))}


def _load(rng: Generator, name: str, n: int) -> Load:
    """One load; on long chains a smaller one."""
    link, size = int(rng.integers(1, n)), min(1.0, 8.0 / n)
    force, point = (size * rng.normal(0.0, 0.5, 2)).tolist(), rng.normal(0.0, 3.0, 2).tolist()
    match name:
        case "force":
            return "WorldForce", {"link": link, "force": force, "point": point}
        case "moment":
            return "WorldForce", {"link": link, "force": (0.0, 0.0), "moment": float(size * rng.normal(0.0, 8.0))}
        case "follower":
            return "BodyWrench", {"link": link, "force": [3.0 * one for one in force], "point": point}
        case "spring":
            anchor = rng.uniform(-50.0, 100.0, 2).tolist()
            return "Spring", {"link": link, "stiffness": float(rng.uniform(0.0, 0.05)), "anchor": anchor}
        case "torsion spring":
            rest = float(rng.normal(0.0, 0.3))
            return "TorsionSpring", {"link": link, "stiffness": float(rng.uniform(0.0, 20.0)), "rest_angle": rest}
    weights = (0.1 * size * rng.random(n)).tolist()
    return "Gravity", {"weights": weights, "direction": tuple(rng.normal(size=2).tolist())}


def _arm(rng: Generator, n: int) -> dict[str, Any]:
    softest = 500.0 if n < 16 else 680.0
    beads = [
        {
            "spacing": float(rng.uniform(18.0, 24.0)),
            "axis": "xyxy"[k % 4] if rng.random() < 0.8 else rng.normal(size=3).tolist(),
            "stiffness": float(softest * rng.uniform(1.0, 1.5)),
            "gap": float(rng.uniform(6.0, 10.0)),
        }
        for k in range(n)
    ]
    radius, ends = float(rng.uniform(10.0, 18.0)), (n, max(1, n // 2))
    holes = [[radius * float(np.cos(turn)), radius * float(np.sin(turn))] for turn in np.pi / 2 * np.arange(4)]
    rings = ends if n > 16 else ends[: 1 + int(rng.integers(2))]
    tendons = [{"holes": [hole], "end": end, "stiffness": 8.0} for end in rings for hole in holes]
    return {"name": f"drawn arm {n}", "beads": beads, "tendons": tendons}


def _arm_loads(rng: Generator, n: int) -> tuple[Load, ...]:
    link, size = int(rng.integers(1, n + 1)), min(1.0, 4.0 / n)
    force = tuple((size * rng.normal(0.0, 0.2, 3)).tolist())
    return (
        ("WorldForce", {"link": link, "force": force, "point": (0.0, 1.0, 2.0)}),
        ("BodyWrench", {"link": n, "force": tuple((0.5 * size * rng.normal(0.0, 0.2, 3)).tolist())}),
        ("Spring", {"link": link, "stiffness": 0.005 * size, "anchor": (50.0, -20.0, 100.0)}),
    )
