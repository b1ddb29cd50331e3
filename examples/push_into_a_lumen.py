"""An instrument that is pushed into a lumen with two bends, and pulled back: contact, friction, and the force it takes.

Run: python examples/push_into_a_lumen.py [--out DIR]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes

import rollingjoint as rj
from rollingjoint.plotting import plot_family, plot_mechanism, plot_wall_contacts, save_figure, save_wall_film
from rollingjoint.tables import text_table

LUMEN = rj.Lumen.through([(0, 0), (55, 0), (90, 30), (150, 30)], radii=8.0, bend_radius=35.0, stiffness=2.0)
FRICTIONS = (0.0, 0.1, 0.2)
TURN = np.concatenate([np.linspace(0, 0.4, 21)[1:], np.linspace(1, 20, 20)])  # small steps, where contacts stick
FEEDS = np.concatenate([np.linspace(-40, 40, 81), 40 - TURN, 20 + TURN])  # mm
END, BACK = 80, 80 + 30  # steps: as far in as it goes, and 10 mm back


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    out.mkdir(parents=True, exist_ok=True)
    chain = rj.two_segment(4, 4, height=10, radius=7, half_width=5)
    paths = [pushed(chain, mu) for mu in FRICTIONS]
    print("\n".join(table(paths)), end="\n\n")
    shown, pushing = paths[-1], (20, 50, END)
    labels = [f"base at {FEEDS[i]:g} mm" for i in pushing]
    figures = {
        "surroundings_push": plot_family([shown[i] for i in pushing], labels, lying_axes()).figure,
        "surroundings_end": plot_mechanism(shown[END], lying_axes(), contacts=False).figure,
        "surroundings_stick_slip": plot_wall_contacts(shown, FEEDS),
    }
    for name, figure in figures.items():
        print(f"wrote {save_figure(figure, out / f'{name}.png', dpi=110)}")
        pyplot.close(figure)
    film = save_wall_film(shown[: BACK + 1], FEEDS[: BACK + 1], out / "surroundings_push.gif")
    print(f"wrote {film}")


def lying_axes() -> Axes:
    """Axes for a lumen that lies."""
    return pyplot.subplots(figsize=(9.0, 3.7), layout="constrained")[1]


def pushed(chain: rj.RollingChain, mu: float) -> list[rj.Equilibrium]:
    """The equilibria on the way in, a part of the way back, and in again, at constant tendon lengths."""
    around = rj.Surroundings([LUMEN], rj.Sleeve(5.0), rj.WallFriction(mu))
    lengths = chain.neutral_lengths - 2.0 / chain.stiffnesses  # 2 N in every tendon where the chain is straight
    settings = {"surroundings": around, "tension_limits": (0.5, 15.0)}
    path = [rj.solve_lengths(chain, lengths, base=(FEEDS[0], 0.0, -np.pi / 2), **settings)]
    for feed in FEEDS[1:]:
        path.append(rj.solve_lengths(chain, lengths, base=(feed, 0.0, -np.pi / 2), history=path[-1], **settings))
    assert all(equilibrium.ok for equilibrium in path)
    return path


def table(paths: list[list[rj.Equilibrium]]) -> list[str]:
    """Forces and work of every coefficient of friction."""
    head = ["friction", "largest normal force [N]", "insertion force [N]", "after 10 mm back [N]", "lost [N mm]"]
    rows = []
    for mu, path in zip(FRICTIONS, paths, strict=True):
        largest = max(touch.force for equilibrium in path for touch in equilibrium.wall_contacts)
        lost = sum(equilibrium.dissipated_work for equilibrium in path)
        numbers = (largest, path[END].insertion_force, path[BACK].insertion_force, lost)
        rows.append([f"{mu}", *(f"{number + 0.0:.2f}" for number in numbers)])
    return text_table(head, rows).splitlines()


if __name__ == "__main__":
    main()
