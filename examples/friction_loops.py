"""Hysteresis by friction of the tendons: loops of the five-link mechanism, tensions along a tendon, holes that stick.

Run: python examples/friction_loops.py [--out DIR]
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot

import rollingjoint as rj
from rollingjoint.plotting import (
    plot_friction_states,
    plot_loops,
    plot_mechanism,
    plot_tensions,
    save_animation,
    save_figure,
)
from rollingjoint.tables import text_table

FRICTIONS = (0.05, 0.1, 0.2)
PUSH = [rj.WorldForce(-1, (0.5, 0.0))]
LOOPS = {  # arguments of trace_loop
    "both lengths ±5 mm": {"swing": (-5, 5)},
    "both lengths ±5 mm, 0.5 N on the tip": {"swing": (-5, 5), "loads": PUSH},
    "both lengths ±1 mm": {"swing": (-1, 1)},
    "one length ±5 mm, 0.5 N on the tip": {"swing": (-5, 0), "loads": PUSH, "tension_limits": (0.5, 15)},
    "tensions from 1:3 to 3:1 N": {"swing": (1, -1), "middle": (2, 2), "given": "tensions"},
}
SHOWN = 0.1  # friction of the pictures of one loop


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    out.mkdir(parents=True, exist_ok=True)
    loops = {name: [loop_of(mu, **arguments) for mu in FRICTIONS] for name, arguments in LOOPS.items()}
    print("\n".join(width_table(loops)), end="\n\n")
    wide = loops["both lengths ±5 mm"]
    print("\n".join(work_table(wide)), end="\n\n")
    shown = wide[FRICTIONS.index(SHOWN)]
    figures = {
        "friction_loops": plot_loops(wide, [f"μ = {mu}" for mu in FRICTIONS]),
        "friction_tensions": draw_tensions(shown),
        "friction_states": plot_friction_states(shown.path).figure,
    }
    for name, figure in figures.items():
        print(f"wrote {save_figure(figure, out / f'{name}.png', dpi=80)}")
        pyplot.close(figure)
    print(f"wrote {save_animation(shown, out / 'friction_loop.gif')}")


def loop_of(mu: float, **arguments: object) -> rj.Loop:
    """The loop of the five-link mechanism with that coefficient of friction."""
    loop = rj.trace_loop(rj.five_link().replace(friction=rj.CapstanFriction(mu)), **arguments)
    assert loop.ok
    return loop


def width_table(loops: dict[str, list[rj.Loop]]) -> list[str]:
    head = ["", *(f"μ = {mu}" for mu in FRICTIONS)]
    rows = [
        [name, *(f"{loop.width:.2f} ({loop.width_in_the_middle:.2f})" for loop in found)]
        for name, found in loops.items()
    ]
    return ["Width of the loop, in brackets at the middle [mm]", text_table(head, rows)]


def work_table(loops: list[rj.Loop]) -> list[str]:
    head = ["both lengths ±5 mm", *(f"μ = {mu}" for mu in FRICTIONS)]
    rows = [
        ["travel of the tip [mm]", *(f"{loop.travel:.1f}" for loop in loops)],
        ["work of friction in a cycle [N·mm]", *(f"{loop.dissipated_work:.2f}" for loop in loops)],
        ["work of the motors in a cycle [N·mm]", *(f"{loop.motor_work:.2f}" for loop in loops)],
        ["holes that stick, mean [%]", *(f"{100 * loop.sticking:.0f}" for loop in loops)],
    ]
    return [text_table(head, rows)]


def draw_tensions(loop: rj.Loop) -> pyplot.Figure:
    """Left: the mechanism soon after it has turned back; right: the tension along tendon 0 there and elsewhere."""
    turn, steps = len(loop.shares) - 1 - loop.steps, loop.steps
    moments = {"at the end, let out": turn, "soon after": turn + steps // 20, "pulled in, in the middle": -steps // 2}
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10, 4.8), layout="constrained", width_ratios=(2, 3))
    plot_mechanism(loop.path.row(moments["soon after"]), left, contacts=False)
    left.get_legend().remove()
    left.set_title("soon after turning back", fontsize=10)
    plot_tensions([loop.path.row(step) for step in moments.values()], list(moments), 0, right)
    return figure


if __name__ == "__main__":
    main()
