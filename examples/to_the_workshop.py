"""A mechanism for the workshop: outlines, bodies, a parts list, and the drawing of it bent by its tendons.

Run: python examples/to_the_workshop.py [--out DIR]
"""

import argparse
from pathlib import Path

import rollingjoint as rj
from rollingjoint.cad import Fabrication, assembly_drawing, bodies, export

PLASTIC = 1.24e-3  # g/mm³, PLA


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    out.mkdir(parents=True, exist_ok=True)
    mechanism = rj.five_link()
    making = {"thickness": 8.0, "channel_diameter": 1.0}
    for i, body in enumerate(bodies(mechanism, Fabrication(**making))):
        mass = body.area * body.thickness * PLASTIC
        print(f"link {i}: {len(body.outline)} corners, {len(body.channels)} channels, about {mass:.1f} g")
    files = export(mechanism, out / "five_link", **making, overwrite=True)
    print(f"wrote {len(files)} files into {out / 'five_link'}")
    bent = rj.solve_tensions(mechanism, (6.0, 3.0), [rj.WorldForce(-1, (0.5, 0.0))])
    print(f"wrote {assembly_drawing(bent, out / 'bent.pdf', **making)}")


if __name__ == "__main__":
    main()
