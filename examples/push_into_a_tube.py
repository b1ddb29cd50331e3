"""An arm of beads that is pushed into a tube that winds in space: contact, friction, and the force it takes.

Run: python examples/push_into_a_tube.py [--out DIR]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot

import rollingjoint as rj
from rollingjoint.plotting import plot_arm, save_figure, save_wall_film
from rollingjoint.tables import text_table

TUBE = rj.Tube.through(
    [(0, 0, 0), (0, 0, 30), (14, 0, 62), (14, 16, 92), (14, 16, 115)], radii=9.0, bend_radius=30.0, stiffness=1.0
)
FRICTIONS = (0.0, 0.1, 0.2)
FEEDS = np.concatenate([np.linspace(-60, 30, 46), 30 - np.arange(1.0, 6.0)])  # mm
END = 45  # step: as far in as it goes


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    out.mkdir(parents=True, exist_ok=True)
    paths = [pushed(instrument(), mu) for mu in FRICTIONS]
    print("\n".join(table(paths)), end="\n\n")
    axes = pyplot.figure(figsize=(7.0, 7.0), layout="constrained").add_subplot(projection="3d")
    axes.view_init(elev=14.0, azim=-62.0)
    figure = plot_arm(paths[-1].row(END), axes).figure
    print(f"wrote {save_figure(figure, out / 'surroundings_tube.png', dpi=110)}")
    pyplot.close(figure)
    steps = [paths[-1].row(step) for step in range(len(FEEDS))]
    print(f"wrote {save_wall_film(steps, FEEDS, out / 'surroundings_tube.gif')}")


def instrument() -> rj.HingeChain:
    """Eight beads with four tendons."""
    beads = [rj.Bead(10.0, "y" if i % 2 else "x", 120.0, gap=3.0) for i in range(8)]
    holes = (6.0, 0.0), (0.0, 6.0), (-6.0, 0.0), (0.0, -6.0)
    return rj.HingeChain(beads, [rj.BeadTendon([hole]) for hole in holes], name="instrument")


def pushed(arm: rj.HingeChain, mu: float) -> rj.HingeEquilibrium:
    """The equilibria on the way in, and 5 mm back, at constant tendon lengths."""
    around = rj.Surroundings([TUBE], rj.Sleeve(7.0), rj.WallFriction(mu))
    lengths = np.tile(arm.neutral_lengths - 1.0 / arm.stiffnesses, (len(FEEDS), 1))  # 1 N in every tendon at rest
    bases = np.stack([0.0 * FEEDS, 0.0 * FEEDS, FEEDS], axis=1)
    return rj.trace(arm, lengths, tension_limits=(0.5, 15.0), surroundings=around, base=bases).require()


def table(paths: list[rj.HingeEquilibrium]) -> list[str]:
    """Forces and work of every coefficient of friction."""
    head = ["friction", "largest normal force [N]", "insertion force [N]", "after 5 mm back [N]", "lost [N mm]"]
    rows = []
    for mu, path in zip(FRICTIONS, paths, strict=True):
        largest, lost = path.walls.normals.max(), path.dissipated_work.sum()
        numbers = (largest, path.insertion_force[END], path.insertion_force[-1], lost)
        rows.append([f"{mu}", *(f"{number + 0.0:.2f}" for number in numbers)])
    return text_table(head, rows).splitlines()


if __name__ == "__main__":
    main()
