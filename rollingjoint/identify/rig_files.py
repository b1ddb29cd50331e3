"""Files of an identified rig: its numbers, its mechanism, an environment centred on it, samples; and a report."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rollingjoint.chain.chain import AnyChain
from rollingjoint.checked_yaml import dump_yaml, entries, located, mapping, number, read_yaml, text
from rollingjoint.identify.beliefs import RIG_KINDS, RigSpace
from rollingjoint.identify.rig import IdentifiedRig, as_report
from rollingjoint.io.mechanism_file import dump_mechanism
from rollingjoint.tables import text_table

Array = NDArray[np.float64]

IDENTIFIED, MECHANISM, ENVIRONMENT, SAMPLES = "identified.yaml", "mechanism.yaml", "environment.yaml", "samples.csv"
SAMPLES_KEPT, SEED = 500, 1
_SURE = 2.0  # standard deviations to either side of ranges
_WIDEST_SPREAD = 0.9  # of stiffness, that environments take
_HEADER = """\
# Settings of a tracking environment around an identified rig: its mechanism, and ranges of what is still uncertain.
# Positions of motors have `offsets` of identified.yaml added to them; friction in the holes is drawn for episodes.
"""


def save_rig(found: IdentifiedRig, folder: Path) -> None:
    """Write identified.yaml, mechanism.yaml, environment.yaml and samples.csv into a folder, which is made."""
    folder.mkdir(parents=True, exist_ok=True)
    content = {"parameters_of": list(found.space.kinds)} | as_report(found)
    content |= {"offsets": [float(f"{value:.6g}") for value in found.offsets]}
    (folder / IDENTIFIED).write_text(dump_yaml(content), encoding="utf-8")
    (folder / MECHANISM).write_text(dump_mechanism(without_friction(found.mechanism)), encoding="utf-8")
    settings = {"mechanism": MECHANISM} | environment_settings(found)
    (folder / ENVIRONMENT).write_text(_HEADER + dump_yaml(settings), encoding="utf-8")
    with (folder / SAMPLES).open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(found.space.labels)
        samples = found.drawn(np.random.default_rng(SEED), SAMPLES_KEPT)
        writer.writerows([[f"{value:.8g}" for value in row] for row in samples])


def load_identified(folder: Path, mechanism: AnyChain) -> tuple[RigSpace, Array]:
    """The rigs and the most likely one, (P,), of a folder of `save_rig`; mechanism: as designed.

    Raises:
        ConfigError: no such folder, or values of another mechanism.
    """
    path = folder / IDENTIFIED
    content = read_yaml(path)
    where = str(path)
    keys = list(content) if isinstance(content, Mapping) else []
    top = mapping(where, content, keys, ("parameters_of", "parameters"))
    with located(where):
        names = entries(f"{where}: parameters_of", top["parameters_of"])
        space = RigSpace(mechanism, [text(f"{where}: parameters_of", name) for name in names])
    parameters = mapping(f"{where}: parameters", top["parameters"], space.labels, space.labels)
    values = []
    for label in space.labels:
        place = f"{where}: parameters.{label}"
        values.append(
            number(place, mapping(place, parameters[label], ("value", "sd", "interval"), ("value",))["value"])
        )
    return space, np.array(values)


def without_friction(mechanism: AnyChain) -> AnyChain:
    """The mechanism whose tendons have no friction of their own."""
    return mechanism.replace(tendons=[replace(tendon, friction=None) for tendon in mechanism.tendons])


def environment_settings(found: IdentifiedRig) -> dict[str, Any]:
    """Settings of a tracking environment, without its mechanism, that hold what is left uncertain."""
    actuation: dict[str, Any] = {}
    randomization: dict[str, Any] = {}
    values, sd = found.fields, found.sd
    for name, setting in (("play", "play_mm"), ("sheath", "sheath_friction")):
        if name in values:
            actuation[setting] = _range(found, name)
    if "stiffness" in values:
        spread = float((_SURE * sd["stiffness"] / values["stiffness"]).max())
        randomization["stiffness_spread"] = _rounded(min(spread, _WIDEST_SPREAD))
    if "hinge_stiffness" in values:
        spread = float((_SURE * sd["hinge_stiffness"] / values["hinge_stiffness"]).max())
        randomization["hinge_stiffness_spread"] = _rounded(min(spread, _WIDEST_SPREAD))
    if "surfaces" in values:
        randomization["link_tolerance_mm"] = _rounded(_SURE * float(sd["surfaces"][..., :2].max()))
        randomization["link_tolerance_rad"] = _rounded(_SURE * float(sd["surfaces"][..., 2].max()))
    if "offsets" in values:
        randomization["actuator_offset_mm"] = _rounded(_SURE * float(sd["offsets"].max()))
    settings: dict[str, Any] = {"actuation": actuation, "randomization": randomization}
    if "mu" in values:
        settings["friction"] = {"mu": _range(found, "mu"), "shared": False}
    return {name: section for name, section in settings.items() if section}


def _range(found: IdentifiedRig, name: str) -> list[float]:
    """The range of a number of all tendons, within the bounds of beliefs."""
    margin, values = _SURE * found.sd[name], found.fields[name]
    belief = RIG_KINDS[name].belief
    ends = float((values - margin).min()), float((values + margin).max())
    low, high = (float(np.clip(end, np.min(belief.low), np.max(belief.high))) for end in ends)
    return [_rounded(low), _rounded(high)]


def rig_report(found: IdentifiedRig) -> str:
    """Numbers with 95 % intervals, pretension and errors as text."""
    rows = []
    for label, value, (low, high) in zip(found.space.labels, found.values, found.intervals, strict=True):
        kind = RIG_KINDS[label.partition("[")[0]]
        if kind.of != "surface":
            rows.append([label, kind.unit or "1", f"{value:.4g}", f"{low:.4g} to {high:.4g}"])
    parts = [
        f"{found.count} readings; {found.before:.2f} -> {found.residual:.2f} standard deviations left",
        text_table(["parameter", "unit", "estimate", "95 % interval"], rows, left=2),
    ]
    if "surfaces" in found.fields:
        errors = found.fields["surfaces"]
        largest = f"{np.abs(errors[..., :2]).max():.3f} mm and {1000 * np.abs(errors[..., 2]).max():.1f} mrad"
        parts.append(f"contact surfaces are displaced by up to {largest}; all numbers are in {IDENTIFIED}")
    pretension = ", ".join(f"{value:.2f}" for value in found.pretension)
    errors_left = ", ".join(f"{name} {value:.3g}" for name, value in found.deviations.items())
    parts.append(f"pretension where the recording begins: {pretension} N\nerrors of readings [N, mm]: {errors_left}")
    return "\n\n".join(parts)


def _rounded(number: float) -> float:
    return float(f"{number:.4g}") + 0.0
