"""What the flexible-joint paper found, tried on the model: which input forgives a wrong model, and constant curvature.

Run: python examples/flexible_arm_findings.py [--out DIR]
Source: W. Feng and others, "Computing forward statics from tendon-length in flexible-joint hyper-redundant
manipulators", sec. IV. The paper compares with measurements of its arm; here flexible_arm() stands for the arm.
"""

import argparse
import dataclasses
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot

import rollingjoint as rj
from rollingjoint.plotting import PALETTE, save_figure
from rollingjoint.spatial.constant_curvature import bends_of_lengths, constant_curvature_poses, tip_errors

HANG = (0.0, 0.0, 1.0)
SHARES = (-50, -40, -30, -20, -10, 0, 10, 20, 30, 40, 50)  # % of the true number
TILTS = (-20, -15, -10, -5, 0, 5, 10, 15, 20)  # degrees
SHOWN = (-50, -20, 20, 50)  # of these in the table
POSES = 40
PULL = np.array([8.0, 0, 0, 0, 3, 3, 0, 0])  # N
SCALES = np.linspace(0.03, 0.9, 30)  # of PULL; beyond, the weightless arm makes more than half a turn
INPUTS = ("tensions", "lengths")
WORLDS = {  # direction of gravity, None for none; payload at the tip [N]
    "weightless": (None, 0.0),
    "hanging": (HANG, 0.0),
    "hanging, 0.3 N at the tip": (HANG, 0.3),
    "30° from hanging": ((0.5, 0.0, 0.75**0.5), 0.0),
}


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    out.mkdir(parents=True, exist_ok=True)
    errors = errors_of_wrong_models()
    print("\n".join([*input_table(errors), *reading_table()]), end="\n\n")
    curvature = {name: curvature_errors(*world) for name, world in WORLDS.items()}
    print("\n".join(curvature_table(curvature)), end="\n\n")
    for figure, name in (
        (draw_inputs(errors), "flexible_arm_inputs"),
        (draw_curvature(curvature), "flexible_arm_arcs"),
    ):
        print(f"wrote {save_figure(figure, out / f'{name}.png', dpi=90)}")


def with_hinges(arm: rj.HingeChain, **factors: float) -> rj.HingeChain:
    """The arm with numbers of its beads multiplied."""
    return arm.replace(
        beads=[
            dataclasses.replace(bead, **{name: factor * getattr(bead, name) for name, factor in factors.items()})
            for bead in arm.beads
        ]
    )


def tilted(degrees: float) -> tuple[float, float, float]:
    """The direction of gravity for an arm mounted so far from hanging."""
    return np.sin(np.radians(degrees)), 0.0, np.cos(np.radians(degrees))


def wrong_models() -> dict[str, list[tuple[float, rj.HingeChain, tuple[float, float, float]]]]:
    """For every kind of error: how large, the wrong arm, its direction of gravity."""
    arm = rj.flexible_arm()
    return {
        "hinge stiffness": [(share, with_hinges(arm, stiffness=1 + share / 100), HANG) for share in SHARES],
        "weight": [(share, with_hinges(arm, weight=1 + share / 100), HANG) for share in SHARES],
        "tendon compliance": [(share, rj.flexible_arm(compliance=0.1 * (1 + share / 100)), HANG) for share in SHARES],
        "direction of gravity": [(degrees, arm, tilted(degrees)) for degrees in TILTS],
    }


def true_poses() -> tuple[rj.HingeEquilibrium, np.ndarray]:
    """Random poses of the hanging arm, and the lengths that its motors leave in them, (POSES, 8) [mm]."""
    rng = np.random.default_rng(0)
    arm = rj.flexible_arm()
    tensions = rng.uniform(1.0, 9.0, (POSES, 8)) * (rng.random((POSES, 8)) < 0.4)
    truth = rj.solve_tensions_batch(arm, tensions, [arm.gravity(HANG)]).require()
    return truth, truth.lengths - truth.tensions / arm.stiffnesses


def errors_of_wrong_models() -> dict[str, list[tuple[float, dict[str, np.ndarray]]]]:
    """For every kind of error: how large, and for each input the tip error in every pose, (POSES,) [mm]."""
    truth, commands = true_poses()

    def errors(wrong: rj.HingeChain, gravity: tuple[float, float, float]) -> dict[str, np.ndarray]:
        loads = [wrong.gravity(gravity)]
        by_tensions = rj.solve_tensions_batch(wrong, truth.tensions, loads)
        by_lengths = rj.solve_lengths_batch(wrong, commands, loads)
        return {"tensions": distances(by_tensions, truth), "lengths": distances(by_lengths, truth)}

    return {
        kind: [(size, errors(wrong, gravity)) for size, wrong, gravity in models]
        for kind, models in wrong_models().items()
    }


def distances(found: rj.HingeEquilibrium, truth: rj.HingeEquilibrium) -> np.ndarray:
    """How far the tips are from the true ones, (POSES,) [mm]."""
    return np.linalg.norm(found.require().tip - truth.tip, axis=1)


def input_table(errors: dict[str, list[tuple[float, dict[str, np.ndarray]]]]) -> list[str]:
    lines = [
        f"Mean (largest) tip error of a wrong model in {POSES} poses of the hanging arm [mm]",
        f"{'wrong by':32}{'tensions given':>18}{'lengths given':>18}",
    ]
    for kind, sizes in errors.items():
        unit = "°" if kind == "direction of gravity" else " %"
        for size, found in sizes:
            if size in SHOWN:
                cells = "".join(f"{in_cell(found[name]):>18}" for name in INPUTS)
                lines.append(f"{f'{kind}, {size:+.0f}{unit}':32}{cells}")
    return lines


def in_cell(errors: np.ndarray) -> str:
    return f"{errors.mean():.1f} ({errors.max():.1f})"


def reading_table() -> list[str]:
    """The right model with inputs that are read wrong: normal errors of every tendon."""
    truth, commands = true_poses()
    arm, rng = truth.mechanism, np.random.default_rng(1)
    loads = [arm.gravity(HANG)]
    noisy = truth.tensions * np.maximum(1 + 0.05 * rng.normal(size=commands.shape), 0.0)
    by_tensions = distances(rj.solve_tensions_batch(arm, noisy, loads), truth)
    by_lengths = distances(rj.solve_lengths_batch(arm, commands + rng.normal(size=commands.shape), loads), truth)
    return [
        f"{'nothing, tensions read 5 % off':32}{in_cell(by_tensions):>18}",
        f"{'nothing, lengths read 1 mm off':32}{'':18}{in_cell(by_lengths):>18}",
    ]


def curvature_errors(gravity: tuple[float, float, float] | None, payload: float) -> np.ndarray:
    """Constant curvature from the true tendon lengths, (scales, 5): bend of the tip, e_theta, eps_theta, e_p, eps_p."""
    arm = rj.flexible_arm()
    loads = [] if gravity is None else [arm.gravity(gravity), rj.WorldForce(-1, payload * np.array(gravity))]
    straight, rows = arm.poses(np.zeros(arm.n_joints))[-1], []
    for scale in SCALES:
        truth = rj.solve_tensions(arm, scale * PULL, loads).require()
        arcs = constant_curvature_poses(arm, bends_of_lengths(arm, truth.lengths))
        error = tip_errors(arcs[-1], truth.poses[-1], straight)
        bend = np.arccos(truth.rotations[-1][2, 2])
        rows.append([bend, error.angle, error.relative_angle, error.position, error.relative_position])
    return np.array(rows)


def curvature_table(errors: dict[str, np.ndarray]) -> list[str]:
    lines = [
        "Constant curvature against the equilibrium, fitted to its tendon lengths",
        f"{'':27}{'pull [N]':>14}{'bend':>8}{'e_θ':>8}{'ε_θ':>8}{'e_p':>11}{'ε_p':>8}",
    ]
    for name, rows in errors.items():
        for i in (9, 29):
            pull = "+".join(f"{tension:.1f}" for tension in SCALES[i] * PULL if tension)
            bend, angle, relative_angle, position, relative = rows[i]
            lines.append(
                f"{name:27}{pull:>14}{np.degrees(bend):7.0f}°{np.degrees(angle):7.1f}°{relative_angle:8.0%}"
                f"{position:8.1f} mm{relative:8.0%}"
            )
    return lines


def draw_inputs(errors: dict[str, list[tuple[float, dict[str, np.ndarray]]]]) -> pyplot.Figure:
    figure, axes = pyplot.subplots(1, len(errors), figsize=(13, 3.8), layout="constrained", sharey=True)
    for ax, (kind, sizes) in zip(axes, errors.items(), strict=True):
        at = [size for size, _ in sizes]
        for name, color in zip(INPUTS, (PALETTE[5], PALETTE[0]), strict=True):
            every = np.array([found[name] for _, found in sizes])
            ax.plot(at, every.mean(axis=1), "o-", markersize=3, color=color, label=f"{name} given, mean")
            spread = np.percentile(every, (10, 90), axis=1)
            ax.fill_between(at, *spread, color=color, alpha=0.2, linewidth=0, label="10 to 90 % of the poses")
        ax.set(title=f"wrong {kind}", xlabel="[°]" if kind == "direction of gravity" else "wrong by [%]")
        ax.grid(color="#E5E8EC", linewidth=0.6)
    axes[0].set(ylabel="tip error [mm]", ylim=(0, None))
    axes[0].legend(fontsize="small")
    return figure


def draw_curvature(errors: dict[str, np.ndarray]) -> pyplot.Figure:
    figure, axes = pyplot.subplots(1, 4, figsize=(13, 3.8), layout="constrained")
    panels = (("$e_θ$ [°]", 180 / np.pi), ("$ε_θ$ [%]", 100), ("$e_p$ [mm]", 1), ("$ε_p$ [%]", 100))
    for column, (ax, (label, unit)) in enumerate(zip(axes, panels, strict=True), start=1):
        for color, (name, rows) in zip(PALETTE, errors.items(), strict=False):
            ax.plot(SCALES * PULL.sum(), unit * rows[:, column], color=color, label=name)
        ax.set(title=label, xlabel="sum of the tensions [N]", ylim=(0, None))
        ax.grid(color="#E5E8EC", linewidth=0.6)
    axes[0].legend(fontsize="small")
    return figure


if __name__ == "__main__":
    main()
