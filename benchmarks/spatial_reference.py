"""The worst difference of chains in space from reference equilibria in a file.

    python benchmarks/spatial_reference.py tests/second_opinions/spatial_reference.json

Every case is solved from its neutral pose. Lengths in mm, forces in N, angles in rad; the exit code is 1 where an
equilibrium is not usable or a place, a length or an angle differs by more than 1e-8.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))  # where tests.second_opinions lies

from tests.second_opinions import spatial_reference as reference

LARGEST = 1e-8
PLACES = ("joint_angles", "arc_lengths", "positions", "rotations", "contact_points", "lengths")


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
        place = max(differences[name] for name in PLACES)
        print(f"{place:.1e} mm  {equilibrium.status.name}, {equilibrium.iterations} steps: {case['name']}")
        for name, difference in differences.items():
            worst[name] = max(worst.get(name, 0.0), difference)
    print(*(f"{name} {difference:.1e}" for name, difference in worst.items()), sep=", ")
    largest = max(worst[name] for name in PLACES)
    print(f"worst difference: {largest:.1e} mm, at most {LARGEST:g}")
    return int(not usable or largest > LARGEST)


if __name__ == "__main__":
    sys.exit(main())
