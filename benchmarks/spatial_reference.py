"""The worst difference of chains in space from reference equilibria in a file.

    python benchmarks/spatial_reference.py tests/second_opinions/spatial_reference.json

Every case is solved from its neutral pose. Lengths in mm, forces in N, angles in rad, the turns of tendons at their
holes among them where the file has them; the exit code is 1 where an equilibrium is not usable or a place, a length or
an angle differs by more than 1e-8.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))  # where tests.second_opinions lies

from tests.second_opinions import spatial_reference as reference

LARGEST = 1e-8
PLACES = ("arc_lengths", "positions", "contact_points", "lengths")  # mm
ANGLES = ("joint_angles", "rotations", "turns")  # rad, and entries of rotation matrices


def main() -> int:
    """Print the differences of every case; 1 where one is too large, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "file", metavar="FILE", help="cases in the form of tests/second_opinions/spatial_reference.json"
    )
    worst: dict[str, float] = {}
    usable = True
    for case in reference.cases(parser.parse_args().file):
        equilibrium = reference.solved(case)
        differences = reference.differences(case, equilibrium)
        usable = usable and bool(equilibrium.ok)
        place, angle = largest_of(PLACES, differences), largest_of(ANGLES, differences)
        steps = f"{equilibrium.status.name}, {equilibrium.iterations} steps"
        print(f"{place:.1e} mm  {angle:.1e} rad  {steps}: {case['name']}")
        for name, difference in differences.items():
            worst[name] = max(worst.get(name, 0.0), difference)
    print(*(f"{name} {difference:.1e}" for name, difference in worst.items()), sep=", ")
    place, angle = largest_of(PLACES, worst), largest_of(ANGLES, worst)
    print(f"worst difference: {place:.1e} mm and {angle:.1e} rad, at most {LARGEST:g} each")
    return int(not usable or max(place, angle) > LARGEST)


def largest_of(names: Sequence[str], differences: Mapping[str, float]) -> float:
    """The largest difference of these quantities; a file may lack turns."""
    return max(differences[name] for name in names if name in differences)


if __name__ == "__main__":
    sys.exit(main())
