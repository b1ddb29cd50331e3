"""The command `rj identify`: parameters from measurements."""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path

from rollingjoint.cli.case_options import note
from rollingjoint.errors import InvalidInput

_DEFAULT = "mu"
_RECORDINGS = (".jsonl", ".csv")


def add_identify(parser: argparse.ArgumentParser) -> None:
    """Adds the options."""
    parser.add_argument("measurements", metavar="FILE", help="YAML file of measurements, or a recording of a rig")
    text = f"what to find, separated by commas; NAME:run gives every run its own value (default {_DEFAULT})"
    parser.add_argument("--parameters", metavar="NAMES", help=text)
    parser.add_argument("--mechanism", metavar="NAME", help="of a recording: preset or file (default: as it says)")
    text = "what the motors were given (default: as the file says)"
    parser.add_argument("--given", choices=("tensions", "lengths"), help=text)
    text = "how given lengths are understood (default: as the file says)"
    parser.add_argument("--method", choices=("elastic", "least_squares"), help=text)
    parser.add_argument("--confidence", type=float, default=0.95, metavar="P", help="of the intervals (default 0.95)")
    text = "intervals from profile likelihoods, or faster and rougher (default profile)"
    parser.add_argument("--intervals", choices=("profile", "linear"), default="profile", help=text)
    text = "folder for pictures, identification.json and ranges.yaml"
    parser.add_argument("--output", metavar="FOLDER", help=text)
    parser.add_argument("--json", action="store_true", help="print JSON")


def run_identify(args: argparse.Namespace) -> None:
    """Identify parameters, print the result, and write it into the folder."""
    from rollingjoint.identify import identify, load_measurements  # SciPy's optimisers are slow to import

    folder = _folder(args.output)
    if Path(args.measurements).suffix.lower() in _RECORDINGS:
        _run_recording(args, folder)
        return
    if args.mechanism:
        raise InvalidInput("--mechanism", args.mechanism, "an option of recordings", "Measurement files name theirs.")
    measurements = load_measurements(args.measurements)
    if args.given or args.method:
        measurements = measurements.input_given(args.given or measurements.given, args.method)
    parameters = _names(args.parameters or _DEFAULT)
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)  # before the fit, which may take minutes
    identification = identify(measurements, parameters, args.confidence, args.intervals)
    content = json.dumps(identification.as_dict(), indent=2)
    if folder is not None:
        from rollingjoint.identify.pictures import save_pictures
        from rollingjoint.identify.report import ranges_text

        (folder / "identification.json").write_text(content + "\n", encoding="utf-8")
        (folder / "ranges.yaml").write_text(ranges_text(identification.ranges), encoding="utf-8")
        save_pictures(identification, folder)
    print(content if args.json else identification.report())


def _run_recording(args: argparse.Namespace, folder: Path | None) -> None:
    """Identify a rig from its recording, print the result, and write it into the folder."""
    from rollingjoint.identify.recording import read_recording
    from rollingjoint.identify.rig import as_report, identify_rig
    from rollingjoint.identify.rig_files import rig_report, save_rig
    from rollingjoint.io.mechanism_file import load_mechanism

    for option in ("given", "method"):
        if getattr(args, option):
            raise InvalidInput(f"--{option}", getattr(args, option), "an option of measurement files", "Leave it out.")
    recording = read_recording(args.measurements, partial(note, args))
    mechanism = load_mechanism(args.mechanism) if args.mechanism else None
    found = identify_rig(recording, mechanism, _names(args.parameters) if args.parameters else None)
    if folder is not None:
        save_rig(found, folder)
    print(json.dumps(as_report(found), indent=2) if args.json else rig_report(found))


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _folder(name: str | None) -> Path | None:
    """The folder, which may be missing."""
    if name is None:
        return None
    path = Path(name)
    if path.exists() and not path.is_dir():
        raise InvalidInput("--output", name, "a folder, not a file")
    return path
