"""The files of an export, written all together or not at all."""

from __future__ import annotations

import csv
import functools
import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.cad.assembly import Assembly, assemble
from rollingjoint.cad.drawing import write_drawing
from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.flat import Shape, shapes, write_dxf, write_svg
from rollingjoint.cad.kits import Exact
from rollingjoint.cad.solid import carved, write_stl
from rollingjoint.cad.space_files import assemble_in_space, step_files, writers_in_space
from rollingjoint.cad.tables import different_parts
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.solution import Solution
from rollingjoint.errors import InvalidInput, naming

Array = NDArray[np.float64]

FORMATS = ("dxf", "svg", "stl", "step", "pdf", "png")
"""Formats of `export`: plane files, solids in two forms, and drawings in two forms. In space there are solids alone."""

DEFAULT_FORMATS = ("dxf", "svg", "stl")

_PART = ("part", "same as", "width [mm]", "height [mm]", "thickness [mm]", "channels", "outline area [mm2]")


def export(
    mechanism: AnyChain | Solution,
    folder: str | Path,
    formats: Iterable[str] = DEFAULT_FORMATS,
    *,
    thickness: float = Fabrication.thickness,
    channel_diameter: float = Fabrication.channel_diameter,
    tolerance: float = Fabrication.tolerance,
    wall: float = Fabrication.wall,
    bore: float = Fabrication.bore,
    depths: Sequence[float] = (),
    overwrite: bool = False,
) -> list[Path]:
    """The files written: link_0.dxf and so on, assembly.dxf, and parts.csv, a table of identical links.

    DXF, SVG, STL and STEP hold one link per file, in its frame, in mm; all but the STL of planar chains also the
    assembly. PDF and PNG have the assembly, and a sheet of every link that is not identical to an earlier one.

    Args:
        mechanism: a mechanism, assembled at s = 0, or an equilibrium, assembled in its pose.
        folder: created if missing; its parent must exist.
        formats: some of FORMATS; unless given, all in DEFAULT_FORMATS that the mechanism has.
        thickness, channel_diameter, tolerance, wall, bore, depths: see Fabrication [mm].
        overwrite: replace existing files.
    Raises:
        MechanismError: a link with an outline that is no valid body, or a channel that cannot be drilled.
        InvalidInput: unknown formats, plane files of a chain in space, a bore of a planar chain, numbers beyond their
            range, existing files, a missing package.
        SolverError: an equilibrium that is not usable.
        OSError: a folder that cannot be written.
    """
    target, making = Path(folder), Fabrication(thickness, channel_diameter, tolerance, wall, bore, tuple(depths))
    writers = dict(_writers_of(mechanism, making, formats))
    _check_free(target, writers, overwrite)
    with tempfile.TemporaryDirectory(prefix=".export-", dir=target if target.is_dir() else target.parent) as place:
        for name, write in writers.items():
            with naming(target / name):
                write(Path(place, name))
        target.mkdir(exist_ok=True)
        return [Path(place, name).replace(target / name) for name in writers]


def _writers_of(
    mechanism: Any, making: Fabrication, formats: Iterable[str]
) -> Iterator[tuple[str, Callable[[Path], None]]]:
    """File names with the writer of each."""
    names = _checked_formats(formats)
    if isinstance(mechanism, RollingChain | Equilibrium):
        if making.bore:
            raise InvalidInput("bore", making.bore, "0 for a planar chain, whose links are plates")
        return _writers(assemble(mechanism, making), names)
    if making.depths:
        raise InvalidInput("depths", making.depths, "none for chains in space, whose channels run from hole to hole")
    if formats == DEFAULT_FORMATS:
        names = ["stl"]
    if not set(names) <= {"stl", "step"}:
        raise InvalidInput("formats", names, "stl or step, the formats of chains in space and arms")
    return writers_in_space(assemble_in_space(mechanism, making), names)


def _checked_formats(formats: Iterable[str]) -> list[str]:
    names = [formats] if isinstance(formats, str) else list(formats)
    if not names or not set(names) <= set(FORMATS):
        raise InvalidInput("formats", names, f"one or more of {', '.join(FORMATS)}")
    return [name for name in FORMATS if name in names]


def _check_free(folder: Path, names: Iterable[str], overwrite: bool) -> None:
    if not folder.is_dir() and (folder.exists() or not folder.parent.is_dir()):
        hint = "It is a file." if folder.exists() else f"Create {folder.parent} first."
        raise InvalidInput("folder", str(folder), "a folder, or a new one in an existing folder", hint)
    taken = [name for name in names if (folder / name).exists()]
    if taken and not overwrite:
        hint = "Choose another folder, or overwrite."
        raise InvalidInput("file", str(folder / taken[0]), "a name that is free", hint)


def _writers(assembly: Assembly, formats: list[str]) -> Iterator[tuple[str, Callable[[Path], None]]]:
    """File names with the writer of each."""
    name = assembly.chain.name or "mechanism"
    for i, body in enumerate(assembly.bodies):
        yield from _plane_files(f"link_{i}", shapes(body), f"{name}, link {i}", formats)
        if "stl" in formats:
            yield f"link_{i}.stl", functools.partial(write_stl, body=body, tolerance=assembly.making.tolerance)
    if "step" in formats:
        kit = Exact()
        exact = {k: carved(assembly.bodies[k], kit) for k in sorted(set(assembly.first_alike))}
        frames = [planar_frame(pose) for pose in assembly.poses]
        yield from step_files([exact[k] for k in assembly.first_alike], frames, kit)
    together = [
        shape for body, pose in zip(assembly.bodies, assembly.poses, strict=True) for shape in shapes(body, pose)
    ]
    yield from _plane_files("assembly", together, f"{name}, {assembly.state}", formats)
    for suffix in ("pdf", "png"):
        if suffix in formats:
            yield f"assembly.{suffix}", functools.partial(write_drawing, assembly=assembly)
            for first, _ in different_parts(assembly):
                yield f"link_{first}.{suffix}", functools.partial(write_drawing, assembly=assembly, link=first)
    yield "parts.csv", functools.partial(_write_parts, assembly=assembly)


def planar_frame(pose: Array) -> Array:
    """The frame (3, 4) in space of a pose (x, y, angle)."""
    x, y, angle = pose.tolist()
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, -sin, 0.0, x], [sin, cos, 0.0, y], [0.0, 0.0, 1.0, 0.0]])


def _plane_files(
    stem: str, drawn: list[Shape], title: str, formats: list[str]
) -> Iterator[tuple[str, Callable[[Path], None]]]:
    if "dxf" in formats:
        yield f"{stem}.dxf", functools.partial(write_dxf, drawn=drawn)
    if "svg" in formats:
        yield f"{stem}.svg", functools.partial(write_svg, drawn=drawn, title=title)


def _write_parts(path: Path, assembly: Assembly) -> None:
    """Writes a table of the links: identical parts and sizes."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(_PART)
        for i, (body, first) in enumerate(zip(assembly.bodies, assembly.first_alike, strict=True)):
            size = [f"{extent:.3f}" for extent in body.bounds[1] - body.bounds[0]]
            same = "" if first == i else f"link_{first}"
            table.writerow([f"link_{i}", same, *size, f"{body.thickness:g}", len(body.channels), f"{body.area:.3f}"])
