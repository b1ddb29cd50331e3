"""A plan along an arc under a weight at the tip, where the mechanism has to change its shape, and one among walls.

Run: python examples/plan.py [--out DIR]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np

import rollingjoint as rj
from rollingjoint.plotting import plot_plan, save_figure


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    out.mkdir(parents=True, exist_ok=True)
    for name, plan in (("arc", arc()), ("walls", among_walls())):
        print(f"{name}: {plan}, {plan.wall_force.max():.3f} N at walls at the most")
        print(f"wrote {save_figure(plot_plan(plan), out / f'plan_{name}.png')}")


def arc() -> rj.Plan:
    angles = np.radians(np.linspace(-35, 35, 15))
    path = 84.0 * np.stack([np.sin(angles), np.cos(angles)], axis=-1)
    return rj.plan_path(rj.two_segment(), path, [rj.WorldForce(-1, (0.0, -0.6))], (0.2, 8.0))


def among_walls() -> rj.Plan:
    arm = rj.two_segment(4, 4, height=10, radius=7, half_width=5)
    around = rj.Surroundings([rj.HalfPlane((1, 0), -25, stiffness=2.0), rj.Disc((-21, 45), 6.0)], rj.Sleeve(5.0))
    path = [(10.0, 78.0), (-8.0, 78.0), (-18.0, 70.0)]
    return rj.plan_path(arm, path, (), (0.5, 15.0), surroundings=around, wall_force=0.3)


if __name__ == "__main__":
    main()
