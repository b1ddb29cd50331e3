"""Measurement files: YAML -> Measurements, documented in docs/fidelity.md."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rollingjoint.camera.photographs import Photographs, photographs_from_dict, read_picture
from rollingjoint.chain.chain import AnyChain
from rollingjoint.checked_yaml import entries, located, mapping, number, numbered, numbers, point, read_yaml, text
from rollingjoint.checks import as_boolean, as_choice, as_integer
from rollingjoint.errors import ConfigError
from rollingjoint.identify.measurements import GIVEN, METHODS, QUANTITIES, Input, Measurements, Run, Step
from rollingjoint.io.mechanism_file import load_mechanism, mechanism_from_dict
from rollingjoint.load import WorldForce

KEYS = (
    "about", "source", "mechanism", "given", "method", "tension_limits", "deviations", "absolute", "camera", "runs"
)  # fmt: skip
SHAPES = ("poses", "positions", "tip", "photograph")
STEP_KEYS = ("tensions", "lengths", "approach", *SHAPES, "forces", "weight")


def load_measurements(path: str | Path) -> Measurements:
    """The measurements in a YAML file.

    Raises:
        ConfigError: a file that cannot be read, a wrong key, type or number, with the place in the file.
    """
    source = str(path)
    return measurements_from_dict(read_yaml(Path(path)), source, Path(path).parent)


def measurements_from_dict(content: object, source: str = "measurements", folder: Path = Path()) -> Measurements:
    """The measurements that the content of a measurement file describes.

    Args:
        content: from yaml.safe_load.
        source: name for messages, usually the file name.
        folder: where the file of a mechanism is looked for, after the presets.
    Raises:
        ConfigError: a wrong key, type or number, with the place.
    """
    top = mapping(source, content, KEYS, required=("mechanism", "runs"))
    mechanism = _mechanism(f"{source}: mechanism", top["mechanism"], folder)
    runs = mapping(f"{source}: runs", top["runs"], [str(name) for name in top["runs"] or ()])
    if not runs:
        raise ConfigError(f"{source}: runs", runs, "at least one run", "Write its name, and below it its steps.")
    options: dict[str, Any] = {}
    for name, choices in (("given", GIVEN), ("method", METHODS)):
        if name in top:
            options[name] = as_choice(f"{source}: {name}", top[name], choices, ConfigError)
    if "tension_limits" in top:
        options["tension_limits"] = point(f"{source}: tension_limits", top["tension_limits"])
    if "absolute" in top:
        options["absolute"] = as_boolean(f"{source}: absolute", top["absolute"], ConfigError)
    if "deviations" in top:
        deviations = mapping(f"{source}: deviations", top["deviations"], tuple(QUANTITIES))
        options["deviations"] = {key: number(f"{source}: deviations.{key}", value) for key, value in deviations.items()}
    options |= {key: text(f"{source}: {key}", top[key]) for key in ("about", "source") if key in top}
    if "camera" in top:
        camera = photographs_from_dict(f"{source}: camera", top["camera"], mechanism, folder)
        runs = {name: _with_photographs(f"{source}: runs.{name}", run, camera, folder) for name, run in runs.items()}
    with located(source):
        return Measurements(
            mechanism, [_run(source, str(name), steps, mechanism) for name, steps in runs.items()], **options
        )


def _with_photographs(where: str, steps: object, camera: Photographs, folder: Path) -> list[Any]:
    """Steps with the poses of their photographs in place of these."""
    result: list[Any] = []
    for place, step in numbered(where, steps):
        if not isinstance(step, Mapping) or "photograph" not in step:
            result.append(step)
            continue
        if others := [key for key in SHAPES if key in step and key != "photograph"]:
            raise ConfigError(place, ["photograph", *others], "one of poses, positions, tip and photograph")
        poses = camera.poses(read_picture(folder / text(f"{place}.photograph", step["photograph"])))
        if not np.isfinite(poses[1:]).any():
            hint = "Are there three balls on every link, as camera.balls has them, and nothing else that is round?"
            raise ConfigError(f"{place}.photograph", step["photograph"], "a picture in which links are seen", hint)
        rows = [row.tolist() if np.isfinite(row).all() else None for row in poses]
        result.append({key: value for key, value in step.items() if key != "photograph"} | {"poses": rows})
    return result


def _mechanism(where: str, value: object, folder: Path) -> AnyChain:
    if isinstance(value, Mapping):
        return mechanism_from_dict(value, where)
    name = text(where, value)
    candidate = folder / name
    return load_mechanism(candidate if candidate.is_file() else name)


def _run(source: str, name: str, steps: object, mechanism: AnyChain) -> Run:
    return Run(name, [_step(place, step, mechanism) for place, step in numbered(f"{source}: runs.{name}", steps)])


def _step(where: str, content: object, mechanism: AnyChain) -> Step:
    step = mapping(where, content, STEP_KEYS)
    fields: dict[str, Any] = {key: numbers(f"{where}.{key}", step[key]) for key in GIVEN if key in step}
    if "approach" in step:
        fields["approach"] = [_input(place, item) for place, item in numbered(f"{where}.approach", step["approach"])]
    if "forces" in step:
        fields["forces"] = [
            _force(place, item, mechanism) for place, item in numbered(f"{where}.forces", step["forces"])
        ]
    if "weight" in step:
        fields["weight"] = number(f"{where}.weight", step["weight"])
    with located(where):
        return Step(**fields, **_shape(where, step, mechanism))


def _shape(where: str, step: Mapping[str, Any], mechanism: AnyChain) -> dict[str, Any]:
    """Positions and angles of a step, from its poses, positions or tip."""
    present = [key for key in SHAPES if key in step]
    if len(present) > 1:
        raise ConfigError(where, present, "one of poses, positions, tip and photograph")
    if not present:
        return {}
    if present == ["photograph"]:
        allowed = "photographs in a file with the key 'camera'"
        raise ConfigError(f"{where}.photograph", step["photograph"], allowed, "docs/rig.md#photographs has one.")
    dimension, n = mechanism.dimension, mechanism.n_links
    if present == ["tip"]:
        return {
            "positions": np.vstack([np.full((n - 1, dimension), np.nan), _row(f"{where}.tip", step["tip"], dimension)])
        }
    key = present[0]
    if key == "poses" and dimension == 3:
        raise ConfigError(f"{where}.poses", step[key], "positions or tip, for an arm")
    width = dimension + (key == "poses")
    rows = np.array([_row(place, row, width) for place, row in numbered(f"{where}.{key}", step[key])])
    if len(rows) != n:
        raise ConfigError(f"{where}.{key}", len(rows), f"{n} rows, one per link, base first; null: not measured")
    return {"positions": rows[:, :dimension], **({"angles": rows[:, 2]} if key == "poses" else {})}


def _row(where: str, row: object, width: int) -> list[float]:
    if row is None:
        return [np.nan] * width
    values = numbers(where, row)
    if len(values) != width:
        raise ConfigError(where, row, f"{width} numbers, or null for what was not measured")
    return values


def _input(where: str, content: object) -> Input:
    entry = mapping(where, content, GIVEN)
    if len(entry) != 1:
        raise ConfigError(where, content, "either tensions or lengths, such as {tensions: [3, 3]}")
    name, values = next(iter(entry.items()))
    with located(where):
        return Input(name, tuple(numbers(f"{where}.{name}", values)))


def _force(where: str, content: object, mechanism: AnyChain) -> WorldForce:
    dimension, n = mechanism.dimension, mechanism.n_links
    values = entries(where, content)
    if len(values) != dimension + 1:
        raise ConfigError(where, content, f"a link and {dimension} numbers [N], such as [-1{', 0.5' * dimension}]")
    link = as_integer(f"{where}[0]", values[0], -n, n - 1, error=ConfigError)
    force: Any = tuple(numbers(where, values[1:]))
    return WorldForce(link, force)
