"""The worst difference of chains among walls from reference equilibria in a file.

    python benchmarks/contact_reference.py tests/rollingjoint/walls/contact_reference.json

Every case is a walk of commands and base poses from a pose at equal tensions, without memory. Lengths in mm, forces in
N, moments in N·mm; the exit code is 1 where a status or the pressed candidates differ, or a number by more than 1e-8.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rollingjoint as rj

Array = NDArray[np.float64]

LARGEST = 1e-8


def main() -> int:
    """Print the differences of every case; 1 where one is too large, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "file", metavar="FILE", help="cases in the form of tests/rollingjoint/walls/contact_reference.json"
    )
    agreed, largest = True, 0.0
    for case in json.loads(Path(parser.parse_args().file).read_text())["cases"]:
        worst: dict[str, float] = {}
        for stored, equilibrium in walk(case):
            same, differences = compare(stored, equilibrium, case["spec"]["mu"] > 0.0)
            agreed = agreed and same
            worst = {name: max(worst.get(name, 0.0), number) for name, number in differences.items()}
        largest = max(largest, *worst.values())
        print(f"{case['spec']['name']:24}", *(f"{name} {number:.1e}" for name, number in worst.items()), sep="  ")
    print(
        f"worst difference: {largest:.1e}, at most {LARGEST:g}",
        "" if agreed else "; statuses or contacts differ",
        sep="",
    )
    return int(not agreed or largest > LARGEST)


def chain_of(spec: Mapping[str, Any]) -> rj.RollingChain:
    """The mechanism of a case."""
    chain: rj.RollingChain = getattr(rj, spec["mech"])(**spec["args"])
    return chain


def surroundings_of(case: Mapping[str, Any]) -> rj.Surroundings:
    """The walls of a case, in the order of its table."""
    spec, walls = case["spec"], case["spec"]["sur"]
    toe = 0.0 if spec["rigid"] else walls.get("toe", 0.0)
    every: list[Any] = [rj.HalfPlane((nx, ny), d, stiffness=k, toe=toe) for nx, ny, d, k in walls.get("planes", ())]
    if "pieces" in walls:
        lengths, curvatures, before, after = np.transpose(walls["pieces"])
        radii = [before[0], *after]
        start = tuple(walls["start"])
        every.append(rj.Lumen(lengths, curvatures, radii, start, stiffness=walls["lumen_k"], toe=toe))
    every += [rj.Disc((x, y), radius, stiffness=k, toe=toe) for x, y, radius, k in walls.get("discs", ())]
    every += [
        rj.Capsule((ax, ay), (bx, by), radius, stiffness=k, toe=toe)
        for ax, ay, bx, by, radius, k in walls.get("segs", ())
    ]
    kind, size = spec["outline"]
    outline = {"sleeve": rj.Sleeve, "bare": rj.Bare}[kind](size)
    friction = rj.WallFriction(spec["mu"], case["presliding_mm"]) if spec["mu"] else None
    return rj.Surroundings(every, outline, friction, spec["rigid"])


def walk(case: Mapping[str, Any]) -> Iterator[tuple[dict[str, Any], Any]]:
    """The stored steps of a case, and the equilibria."""
    chain = chain_of(case["spec"])
    settings = {"surroundings": surroundings_of(case), "tension_limits": tuple(case["tension_limits"])}
    rest = chain.neutral_lengths - case["start_tension_N"] / chain.stiffnesses
    loads = case["spec"].get("loads", ())
    history = rj.solve_lengths(chain, rest, loads_at(loads, 0.0), **settings)
    for stored in case["steps"]:
        base = stored["base"]
        command, seen = rest + stored["command"], loads_at(loads, base[2])
        history = rj.solve_lengths(chain, command, seen, history=history, base=base, **settings)
        yield stored, history


def loads_at(loads: list[list[float]], angle: float) -> list[rj.WorldForce]:
    """Forces of the world on body points, as seen from a base that is turned."""
    cos, sin = np.cos(angle), np.sin(angle)
    return [
        rj.WorldForce(int(link), (cos * fx + sin * fy, cos * fy - sin * fx), point=(x, y))
        for link, x, y, fx, fy in loads
    ]


def compare(stored: Mapping[str, Any], equilibrium: Any, rubs: bool) -> tuple[bool, dict[str, float]]:
    """Whether status and pressed candidates are those stored, and the largest differences of numbers.

    rubs: whether walls have friction; without it the stored contacts are said to stick.
    """
    x, y, angle = stored["base"]
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    poses, forces = equilibrium.poses @ turn.T + [x, y, angle], equilibrium.wall_forces @ turn.T
    if not np.allclose(stored["poses"][0], [x, y, angle]):  # poses and forces in the frame of the base
        poses, forces = equilibrium.poses, equilibrium.wall_forces
    contacts = {contact.candidate: contact for contact in equilibrium.wall_contacts}
    touching = {contact["candidate"]: contact for contact in stored["contacts"]}
    same = equilibrium.status.name == stored["status"] and contacts.keys() == touching.keys()
    pairs = [(contacts[number], touching[number]) for number in contacts.keys() & touching.keys()]
    same = same and all(mine.sticks == (rubs and theirs["sticks"]) for mine, theirs in pairs)
    return same, {
        "poses": float(np.abs(poses - stored["poses"]).max()),
        "tensions": float(np.abs(equilibrium.tensions - stored["tensions"]).max()),
        "wall forces": float(np.abs(forces - stored["wall_forces"]).max()),
        "gaps": max((abs(mine.gap - theirs["gap_mm"]) for mine, theirs in pairs), default=0.0),
        "normals": max((abs(mine.force - theirs["normal_N"]) for mine, theirs in pairs), default=0.0),
        "states": max((abs(mine.state - theirs["state"]) for mine, theirs in pairs), default=0.0),
    }


if __name__ == "__main__":
    raise SystemExit(main())
