"""Chains in space: pictures of an equilibrium with its contact lines, of their margins, and an animation.

Run: python examples/spatial_chains.py [--out DIR]
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot
from matplotlib.colors import LightSource
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

import rollingjoint as rj
from rollingjoint.cad import Fabrication, spatial_bodies, spatial_solid
from rollingjoint.plotting import plot_arm, save_figure
from rollingjoint.tables import text_table

SHARES = (1.0, 0.75, 0.5, 0.25)  # half width of the contact lines over the radius of the holes
LOADS = {"no load": (0.0, 0.0), "0.3 N at the tip": (0.3, 0.0), "0.1 N and 3 N·mm": (0.1, 3.0)}
POSES = 200
FRICTION = 0.2
FRAMES = 48
PULL = [rj.WorldForce(-1, (0.0, 0.15, 0.0))]


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    out = parser.parse_args(argv).out
    out.mkdir(parents=True, exist_ok=True)
    counts = {share: {name: failures(with_half_width(share * 3.0), *load) for name, load in LOADS.items()}
              for share in SHARES}  # fmt: skip
    print("\n".join(table(counts)))
    tube = rj.solve_tensions(rj.pitch_yaw(5), [2.0, 2.5, 3.0, 2.0])
    arm = rj.solve_tensions(rj.small_arm(4), [4.0, 3.0, 1.0, 1.0])
    pictures = {
        "spatial": draw_chains(),
        "spatial_widths": draw_widths(),
        "cad_space": draw_bodies(tube, Fabrication(), 0.6),
        "cad_beads": draw_bodies(arm, Fabrication(channel_diameter=1.5, bore=4.0, thickness=10.0), 1.0),
    }
    for name, figure in pictures.items():
        print(f"wrote {save_figure(figure, out / f'{name}.png', dpi=80)}")
        pyplot.close(figure)
    print(f"wrote {animate(out / 'spatial.gif')}")


def with_half_width(half_width: float, joints: int = 12) -> rj.SpatialChain:
    """The preset pitch_yaw with contact lines of that half width [mm]."""
    chain = rj.pitch_yaw(joints)
    return chain.replace(joints=[replace(joint, half_width=half_width) for joint in chain.joints])


def failures(chain: rj.SpatialChain, force: float, torque: float) -> tuple[float, float]:
    """Shares of random poses in which a contact line lifts at an end, or needs more friction than FRICTION."""
    rng = np.random.default_rng(0)
    tilts, slips = [], []
    for pulls in np.exp(rng.uniform(np.log(2.0), np.log(8.0), (POSES, chain.n_tendons))):
        ways = rng.normal(size=(2, 3))
        push, twist = (ways.T / np.linalg.norm(ways, axis=1)).T * rng.uniform(0.0, 1.0, (2, 1)) * [[force], [torque]]
        at = rj.solve_tensions(chain, pulls, [rj.WorldForce(-1, tuple(push), tuple(twist))])
        if at.ok:
            tilts.append(np.any(at.tilting_margins < 0.0))
            slips.append(np.any(at.friction_required > FRICTION))
    return float(np.mean(tilts)), float(np.mean(slips))


def table(counts: dict[float, dict[str, tuple[float, float]]]) -> list[str]:
    head = ["tensions 2 to 8 N", *(f"{share:g}" for share in SHARES)]
    rows = [
        [name, *(f"{100 * counts[share][name][0]:.0f} / {100 * counts[share][name][1]:.0f} %" for share in SHARES)]
        for name in LOADS
    ]
    return [
        f"Poses in which an end lifts / that need friction above {FRICTION:g}, by half width",
        text_table(head, rows),
    ]


def draw_chains() -> pyplot.Figure:
    """The two presets, bent by their tendons and loaded at the tip."""
    one, two = rj.pitch_yaw(), rj.pitch_yaw_two_segment()
    bent = [
        rj.solve_tensions(one, [5.0, 3.0, 2.0, 3.5], PULL),
        rj.solve_tensions(two, [2.0, 2.0, 5.0, 2.0, 6.0, 2.5, 2.0, 4.0], PULL),
    ]
    figure = pyplot.figure(figsize=(10, 5.6), layout="constrained")
    for place, at in enumerate(bent, start=1):
        ax = plot_arm(at, figure.add_subplot(1, 2, place, projection="3d"))
        ax.set_title(at.mechanism.name)
        ax.view_init(18, -60)
    share_legend(figure)
    return figure


def draw_widths() -> pyplot.Figure:
    """One equilibrium of three chains that differ in the width of their contact lines."""
    figure = pyplot.figure(figsize=(11, 5.0), layout="constrained")
    for place, share in enumerate((1.0, 0.5, 0.25), start=1):
        at = rj.solve_tensions(with_half_width(share * 3.0, 5), [1.7, 2.4, 1.1, 0.7], PULL)
        ax = plot_arm(at, figure.add_subplot(1, 3, place, projection="3d"), tendons=False)
        ax.set_title(
            f"half width {share:g} × radius of the holes\nleast tilting margin {at.tilting_margins.min():.1f} N"
        )
        ax.view_init(18, -60)
    share_legend(figure)
    return figure


def draw_bodies(bent: Any, making: Fabrication, size: float) -> pyplot.Figure:
    """One link as its STL file has it, and all links bent by their tendons, drawn in triangles of this size [mm]."""
    solids = [spatial_solid(body, link) for link, body in enumerate(spatial_bodies(bent.mechanism, making))]
    placed = [solid.copy().apply_transform(pose) for solid, pose in zip(solids, bent.poses, strict=True)]
    figure = pyplot.figure(figsize=(10, 4.6), layout="constrained")
    for place, (title, drawn) in enumerate({"link 1": solids[1:2], "bent by its tendons": placed}.items(), start=1):
        ax = figure.add_subplot(1, 2, place, projection="3d")
        ax.view_init(24, -60)
        triangles = np.concatenate([front_of(solid, size) for solid in drawn])
        light = LightSource(azdeg=200, altdeg=50)
        ax.add_collection3d(Poly3DCollection(triangles, facecolors="#a9b8cf", shade=True, lightsource=light,
                                             antialiaseds=False))  # fmt: skip
        ax.auto_scale_xyz(*triangles.reshape(-1, 3).T)
        ax.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", title=title)
        ax.locator_params(nbins=4)
        ax.set_box_aspect([np.ptp(limits) for limits in (ax.get_xlim(), ax.get_ylim(), ax.get_zlim())], zoom=0.85)
    return figure


def front_of(solid: Any, size: float) -> np.ndarray:
    """The triangles that face the camera, in small pieces that matplotlib can sort, (k, 3, 3)."""
    pieces = solid.subdivide_to_size(size)
    elevation, azimuth = np.radians([24.0, -60.0])
    camera = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    return np.asarray(pieces.triangles[pieces.face_normals @ camera > 0.0])


def share_legend(figure: pyplot.Figure) -> None:
    """One legend below all axes, without the tendons."""
    handles = {}
    for ax in figure.axes:
        lines, texts = ax.get_legend_handles_labels()
        shown = zip(lines, (text.split(":")[0] for text in texts), strict=True)
        handles |= {text: line for line, text in shown if not text.startswith("tendon")}
        ax.get_legend().remove()
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3, fontsize="small")


def animate(path: Path) -> Path:
    """The two-segment preset on a closed way of its tendon lengths, under a load at the tip."""
    chain = rj.pitch_yaw_two_segment()
    phases = 2.0 * np.pi * np.arange(FRAMES)[:, None] / FRAMES
    ring = 0.5 * np.pi * np.arange(4)
    swing = np.hstack([1.8 * np.cos(phases - ring), 4.0 * np.cos(2.0 * phases - ring - 0.25 * np.pi)])
    equilibria = rj.trace(chain, chain.neutral_lengths - 0.3 + swing, PULL)
    frames = []
    for row in range(FRAMES):
        figure = pyplot.figure(figsize=(5.2, 5.2))
        ax = plot_arm(equilibria.row(row), figure.add_axes((0.0, 0.05, 0.92, 0.97), projection="3d"))
        ax.get_legend().remove()
        ax.set(xlim=(-50, 50), ylim=(-50, 50), zlim=(0, 120))
        ax.set_box_aspect((100, 100, 120), zoom=1.1)
        ax.view_init(18, -60)
        frames.append(picture(figure))
        pyplot.close(figure)
    return save_frames(frames, path)


def picture(figure: pyplot.Figure) -> Image.Image:
    figure.set_dpi(80)
    figure.canvas.draw()
    return Image.fromarray(np.asarray(figure.canvas.buffer_rgba())[..., :3])


def save_frames(frames: Sequence[Image.Image], path: Path) -> Path:
    palette = frames[0].quantize(64)
    first, *others = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    first.save(path, save_all=True, append_images=others, duration=80, loop=0)
    return path


if __name__ == "__main__":
    main()
