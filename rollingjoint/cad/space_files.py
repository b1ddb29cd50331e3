"""The files of a chain in space or an arm: solids of every link and of the assembly, a table of identical links."""

from __future__ import annotations

import csv
import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.kits import Exact, write_step
from rollingjoint.cad.space_body import SpatialBody, spatial_bodies
from rollingjoint.cad.space_solid import carved_in_space, placed, spatial_solid, write_mesh
from rollingjoint.chain.equilibrium import EquilibriumInSpace
from rollingjoint.chain.hinge import HingeChain
from rollingjoint.chain.spatial import SpatialChain
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]

_PART = ("part", "same as", "diameter [mm]", "height [mm]", "channels", "volume [mm3]")


@dataclass(frozen=True, eq=False)
class SpatialAssembly:
    """Bodies in poses in space.

    Attributes:
        poses: of the links, (n, 4, 4) [mm].
        making: channels, walls and tolerance of the bodies.
        bodies: one per link.
    """

    poses: Array
    making: Fabrication
    bodies: list[SpatialBody]

    @cached_property
    def first_alike(self) -> list[int]:
        """For every link, the first link that is an identical part."""
        return [next(k for k, candidate in enumerate(self.bodies) if body.alike(candidate)) for body in self.bodies]

    @cached_property
    def meshes(self) -> list[Any]:
        """The solid of every link in its frame, trimesh.Trimesh; identical parts share one."""
        parts = {k: spatial_solid(self.bodies[k], k, self.making.tolerance) for k in sorted(set(self.first_alike))}
        return [parts[k] for k in self.first_alike]


def assemble_in_space(
    mechanism: SpatialChain | HingeChain | EquilibriumInSpace, making: Fabrication
) -> SpatialAssembly:
    """The mechanism's bodies, at rest or in the pose of an equilibrium.

    Raises:
        MechanismError: a body or a channel that cannot be made.
        InvalidInput: a batch of equilibria. SolverError: an unusable equilibrium.
    """
    if isinstance(mechanism, SpatialChain | HingeChain):
        return SpatialAssembly(mechanism.poses(mechanism.neutral_angles), making, spatial_bodies(mechanism, making))
    if mechanism.poses.ndim != 3 or isinstance(mechanism.mechanism, tuple):
        allowed = "one equilibrium, poses (n, 4, 4)"
        raise InvalidInput("equilibrium", mechanism.poses.shape, allowed, "Solve a single row.")
    mechanism.require()
    return SpatialAssembly(mechanism.poses, making, spatial_bodies(mechanism.mechanism, making))


def writers_in_space(assembly: SpatialAssembly, formats: Sequence[str]) -> Iterator[tuple[str, Callable[[Path], None]]]:
    """File names with the writer of each, of the formats stl and step."""
    if "stl" in formats:
        for i, mesh in enumerate(assembly.meshes):
            yield f"link_{i}.stl", functools.partial(write_mesh, mesh=mesh)
        yield "assembly.stl", functools.partial(write_mesh, mesh=placed(assembly.meshes, assembly.poses))
    if "step" in formats:
        kit, tolerance = Exact(), assembly.making.tolerance
        parts = {k: carved_in_space(assembly.bodies[k], k, kit, tolerance) for k in sorted(set(assembly.first_alike))}
        yield from step_files([parts[k] for k in assembly.first_alike], [pose[:3] for pose in assembly.poses], kit)
    yield "parts.csv", functools.partial(_write_parts, assembly=assembly)


def step_files(
    solids: Sequence[Any], frames: Sequence[Array], kit: Exact
) -> Iterator[tuple[str, Callable[[Path], None]]]:
    """Names and writers of the STEP files of all links in their frames, and of the assembly, poses (3, 4) [mm]."""
    for i, solid in enumerate(solids):
        yield f"link_{i}.step", functools.partial(write_step, solids=[(f"link_{i}", solid)])
    together = [(f"link_{i}", kit.placed(*pair)) for i, pair in enumerate(zip(solids, frames, strict=True))]
    yield "assembly.step", functools.partial(write_step, solids=together)


def _write_parts(path: Path, assembly: SpatialAssembly) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(_PART)
        rows = zip(assembly.bodies, assembly.meshes, assembly.first_alike, strict=True)
        for i, (body, mesh, first) in enumerate(rows):
            same = "" if first == i else f"link_{first}"
            sizes = [f"{extent:.3f}" for extent in (2.0 * body.radius, np.ptp(mesh.bounds[:, 2]))]
            table.writerow([f"link_{i}", same, *sizes, len(body.channels), f"{mesh.volume:.3f}"])
