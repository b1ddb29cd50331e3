"""The files of an export, written all together or not at all."""

from __future__ import annotations

import csv
import functools
import tempfile
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from rollingjoint.cad.assembly import Assembly, assemble
from rollingjoint.cad.drawing import write_drawing
from rollingjoint.cad.fabrication import Fabrication
from rollingjoint.cad.flat import Shape, shapes, write_dxf, write_svg
from rollingjoint.cad.solid import write_stl
from rollingjoint.cad.space_files import assemble_in_space, writers_in_space
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.equilibrium import Equilibrium
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.chain.solution import Solution
from rollingjoint.errors import InvalidInput, naming

FORMATS = ("dxf", "svg", "stl", "pdf", "png")
"""Formats of `export`: plane files, solids, and the assembly drawing in two forms. In space there is STL alone."""

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
    overwrite: bool = False,
) -> list[Path]:
    """The files written: link_0.dxf and so on, assembly.dxf, and parts.csv, a table of identical links.

    DXF, SVG and STL hold one link per file, in its frame, in mm; DXF, SVG, PDF and PNG also the assembly, of chains in
    space STL.

    Args:
        mechanism: a mechanism, assembled at s = 0, or an equilibrium, assembled in its pose.
        folder: created if missing; its parent must exist.
        formats: some of FORMATS; unless given, all in DEFAULT_FORMATS that the mechanism has.
        thickness, channel_diameter, tolerance, wall, bore: see Fabrication [mm].
        overwrite: replace existing files.
    Raises:
        MechanismError: a link with an outline that is no valid body, or a channel that cannot be drilled.
        InvalidInput: unknown formats, plane files of a chain in space, a bore of a planar chain, numbers beyond their
            range, existing files, a missing package.
        SolverError: an equilibrium that is not usable.
        OSError: a folder that cannot be written.
    """
    target, making = Path(folder), Fabrication(thickness, channel_diameter, tolerance, wall, bore)
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
    if formats != DEFAULT_FORMATS and names != ["stl"]:
        raise InvalidInput("formats", names, "stl, the one format of chains in space and arms")
    return writers_in_space(assemble_in_space(mechanism, making))


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
    together = [
        shape for body, pose in zip(assembly.bodies, assembly.poses, strict=True) for shape in shapes(body, pose)
    ]
    yield from _plane_files("assembly", together, f"{name}, {assembly.state}", formats)
    for suffix in ("pdf", "png"):
        if suffix in formats:
            yield f"assembly.{suffix}", functools.partial(write_drawing, assembly=assembly)
    yield "parts.csv", functools.partial(_write_parts, assembly=assembly)


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
