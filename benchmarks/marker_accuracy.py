"""Accuracy of poses from photographs: rendered pictures of a mechanism with balls on its links, and of a board.

    python benchmarks/marker_accuracy.py
    python benchmarks/marker_accuracy.py --pictures docs/images    # writes camera.png

The pictures are of a pinhole camera with a tilt, a shifted principal point, and radial and tangential distortion, of
which the calibration knows nothing but the picture of a board. Balls are spheres, seen in perspective; every pixel is
the mean of 5 x 5 rays near an edge. Then come blur, vignette, noise and rounding to 256 grey values.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

from rollingjoint import five_link
from rollingjoint.camera import LinkBalls, Photographs, view_of_board

BALLS = np.array([(-6.0, -1.0), (6.0, -3.0), (2.0, 4.0)])  # in the frame of every link [mm]
DIAMETER, PITCH = 3.0, 8.0  # mm
WHITE, BODY, DARK = 0.92, 0.72, 0.08
SAMPLES = (np.arange(5) - 2.0) / 5.0  # of a pixel


@dataclass(frozen=True)
class Pinhole:
    """A camera before the plane z = 0, which it sees from above, x to the right and y up.

    Args:
        size: of pictures [pixels]. focal: length [pixels]. distance: from the middle of the plane [mm].
        middle: of the plane [mm]. tilt: about x and y [rad]. radial, tangential: Brown's coefficients.
        shift: of the principal point [pixels].
    """

    size: tuple[int, int] = (1280, 1024)
    focal: float = 2000.0
    distance: float = 290.0
    middle: tuple[float, float] = (0.0, 40.0)
    tilt: tuple[float, float] = (0.05, -0.03)
    radial: tuple[float, float] = (-0.15, 0.05)
    tangential: tuple[float, float] = (5e-4, -3e-4)
    shift: tuple[float, float] = (9.0, -6.0)

    def turned(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) [mm] in the frame of the camera: x right, y down, z away from it."""
        a, b = self.tilt
        about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
        about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
        down = np.diag([1.0, -1.0, -1.0])
        centred = points - np.array([*self.middle, 0.0])
        return centred @ (about_x @ about_y @ down).T + np.array([0.0, 0.0, self.distance])

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Pixels of points (..., 3) [mm]."""
        seen = self.turned(points)
        return self.distorted(seen[..., :2] / seen[..., 2:])

    def distorted(self, ideal: np.ndarray) -> np.ndarray:
        """Pixels of rays (..., 2) as x/z, y/z."""
        x, y = ideal[..., 0], ideal[..., 1]
        (k1, k2), (p1, p2), r2 = self.radial, self.tangential, (ideal**2).sum(axis=-1)
        gain = 1.0 + k1 * r2 + k2 * r2**2
        moved = np.stack(
            [gain * x + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), gain * y + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y],
            axis=-1,
        )
        return self.focal * moved + 0.5 * (np.array(self.size) - 1.0) + self.shift

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """x/z and y/z of pixels (..., 2), by fixed-point iteration."""
        ideal = (pixels - 0.5 * (np.array(self.size) - 1.0) - self.shift) / self.focal
        for _ in range(7):
            ideal = ideal - (self.distorted(ideal) - pixels) / self.focal
        return ideal


class Picture:
    """Grey values (height, width) that shapes are painted on, one over the other."""

    def __init__(self, camera: Pinhole, background: float = WHITE) -> None:
        self.camera = camera
        self.grey = np.full(camera.size[::-1], background)

    def paint(self, outline: np.ndarray, covers, value) -> None:
        """Paint where `covers`, a function of rays (..., 2), says so.

        outline: around it, (K, 2) [pixels]. value: a number, or a function of rays.
        """
        low = np.maximum(np.floor(outline.min(axis=0)).astype(int) - 2, 0)
        high = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 3, np.array(self.camera.size))
        if (low >= high).any():
            return
        x, y = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
        pixels = np.stack([x, y], axis=-1).astype(float)
        inside = covers(self.camera.rays(pixels))
        mixed = np.zeros(inside.shape, bool)  # pixels with another neighbour: an edge may pass
        for axis in (0, 1):
            for way in (-1, 1):
                mixed |= np.roll(inside, way, axis) != inside
        mixed |= np.roll(mixed, 1, 0) | np.roll(mixed, -1, 0) | np.roll(mixed, 1, 1) | np.roll(mixed, -1, 1)
        share = inside.astype(float)
        offsets = np.stack(np.meshgrid(SAMPLES, SAMPLES), axis=-1).reshape(-1, 2)
        share[mixed] = covers(self.camera.rays(pixels[mixed][:, None] + offsets)).mean(axis=1)
        block = self.grey[low[1] : high[1], low[0] : high[0]]
        colour = value(self.camera.rays(pixels)) if callable(value) else value
        block += share * (colour - block)

    def sphere(self, centre: np.ndarray, radius: float, value: float) -> None:
        """A sphere with a soft light from above and left."""
        c = self.camera.turned(centre)

        def along(rays):
            d = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)
            return d / np.linalg.norm(d, axis=-1, keepdims=True)

        def covers(rays):
            d = along(rays)
            return (c @ c) - (d @ c) ** 2 <= radius**2

        def shade(rays):
            d = along(rays)
            depth = d @ c - np.sqrt(np.maximum(radius**2 - (c @ c - (d @ c) ** 2), 0.0))
            normal = (d * depth[..., None] - c) / radius
            return value + 0.08 * np.clip(normal @ np.array([-0.4, -0.4, -0.82]), 0.0, 1.0)

        ring = 1.3 * radius * np.stack([np.cos(np.arange(16) * 0.4), np.sin(np.arange(16) * 0.4), np.zeros(16)], axis=1)
        self.paint(self.camera.pixels(centre + ring), covers, shade)

    def flat(self, outline: np.ndarray, covers_places, value: float) -> None:
        """A flat shape in the plane z = 0; outline around it (K, 2), covers_places of places (..., 2) [mm]."""
        corners = np.array([[-500.0, -500.0, 0.0], [500.0, -500.0, 0.0], [-500.0, 500.0, 0.0]])
        origin, right, up = self.camera.turned(corners)
        normal = np.cross(right - origin, up - origin)

        def places(rays):
            d = np.concatenate([rays, np.ones((*rays.shape[:-1], 1))], axis=-1)
            hit = d * ((origin @ normal) / (d @ normal))[..., None] - origin
            return np.stack([hit @ (right - origin), hit @ (up - origin)], axis=-1) / 1000.0 - 500.0

        raised = np.concatenate([outline, np.zeros((len(outline), 1))], axis=1)
        self.paint(self.camera.pixels(raised), lambda rays: covers_places(places(rays)), value)

    def taken(self, rng: np.random.Generator, blur: float = 1.0, noise: float = 4.0) -> np.ndarray:
        """The photograph: blurred, darker towards its corners, noisy, rounded to 0 to 255."""
        y, x = np.mgrid[: self.grey.shape[0], : self.grey.shape[1]]
        w, h = self.camera.size
        r2 = ((x - w / 2) ** 2 + (y - h / 2) ** 2) / (w**2 + h**2) * 4.0
        lit = 255.0 * gaussian_filter(self.grey, blur) * (1.0 - 0.3 * r2)
        return np.clip(np.round(lit + noise * rng.standard_normal(lit.shape)), 0, 255)


def photograph_of_board(camera: Pinhole, rng: np.random.Generator, count: int = 30) -> np.ndarray:
    """A board of dots of 3 mm that fills the picture, a little turned."""
    picture = Picture(camera)
    c, s = np.cos(0.04), np.sin(0.04)
    for i in range(-count, count + 1):
        for j in range(-count, count + 1):
            place = PITCH * np.array([c * i - s * j, s * i + c * j]) + np.array(camera.middle)
            around = camera.pixels(np.array([*place, 0.0]))
            if not ((around > -20) & (around < np.array(camera.size) + 20)).all():
                continue
            ring = place + 2.0 * np.stack([np.cos(np.arange(16) * 0.4), np.sin(np.arange(16) * 0.4)], axis=1)
            picture.flat(ring, lambda places, at=place: ((places - at) ** 2).sum(axis=-1) <= 1.5**2, DARK)
    return picture.taken(rng)


def photograph_of(camera: Pinhole, poses: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Links at poses (n, 3) as light bodies, each with three dark balls whose centres are in the plane z = 0."""
    picture = Picture(camera)
    for x, y, angle in poses:
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        half = np.array([13.0, 9.0])
        outline = (half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])) @ turn.T + (x, y)

        def covers(places, turn=turn, at=(x, y), half=half):
            return (np.abs((places - at) @ turn) <= half).all(axis=-1)

        picture.flat(outline, covers, BODY)
    for x, y, angle in poses:
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        for ball in BALLS @ turn.T + (x, y):
            picture.sphere(np.array([*ball, 0.0]), 0.5 * DIAMETER, DARK)
    return picture.taken(rng)


def random_poses(rng: np.random.Generator) -> np.ndarray:
    """Poses of the five-link mechanism with contacts anywhere in the middle of their travel, (5, 3)."""
    chain = five_link()
    return np.asarray(chain.poses(chain.joint_angles(rng.uniform(-6.0, 6.0, chain.n_joints))))


CAMERAS = {
    "7 px/mm, square, no distortion": Pinhole(tilt=(0.0, 0.0), radial=(0.0, 0.0), tangential=(0.0, 0.0)),
    "7 px/mm, tilted 3°, radial -0.15": Pinhole(),
    "7 px/mm, tilted 6°, radial -0.3": Pinhole(tilt=(0.1, -0.05), radial=(-0.3, 0.1), tangential=(1e-3, -1e-3)),
    "3.5 px/mm, tilted 3°, radial -0.15": Pinhole(size=(640, 512), focal=1000.0, shift=(4.5, -3.0)),
}


def measured(camera: Pinhole, count: int, seed: int) -> dict[str, float]:
    """Errors of poses in `count` photographs: positions [mm] and angles [mrad], and links that were not seen."""
    rng = np.random.default_rng(seed)
    board = view_of_board(photograph_of_board(camera, rng), PITCH)
    photographs = Photographs(board.view, LinkBalls(five_link(), BALLS), DIAMETER)
    errors, seconds = [], 0.0
    for _ in range(count):
        poses = random_poses(rng)
        taken = photograph_of(camera, poses, rng)
        begun = time.process_time()
        errors.append((photographs.poses(taken) - poses)[1:])
        seconds += time.process_time() - begun
    off = np.array(errors).reshape(-1, 3)
    seen = off[np.isfinite(off).all(axis=1)]
    away = np.linalg.norm(seen[:, :2], axis=1)
    return {
        "board": board.rms,
        "dots": len(board.pixels),
        "rms": float(np.sqrt(np.mean(away**2))),
        "p99": float(np.quantile(away, 0.99)),
        "angle": 1e3 * float(np.sqrt(np.mean(seen[:, 2] ** 2))),
        "missing": len(off) - len(seen),
        "ms": 1e3 * seconds / count,
    }


def main() -> None:
    """Print a table of cameras."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--photographs", type=int, default=20, help="of every camera")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="write camera.png into it, and end")
    arguments = parser.parse_args()
    if arguments.pictures:
        draw(arguments.pictures)
        return
    print("| camera | dots | board left [mm] | position rms (p99) [mm] | angle rms [mrad] | not seen | ms a picture |")
    print("|---|---|---|---|---|---|---|")
    for name, camera in CAMERAS.items():
        row = measured(camera, arguments.photographs, arguments.seed)
        cells = [name, f"{row['dots']}", f"{row['board']:.4f}", f"{row['rms']:.4f} ({row['p99']:.4f})"]
        cells += [f"{row['angle']:.2f}", f"{row['missing']}", f"{row['ms']:.0f}"]
        print("| " + " | ".join(cells) + " |", flush=True)


def draw(folder: Path) -> None:
    """A board and a mechanism as the most distorting camera sees them, with what was found."""
    import matplotlib.pyplot as plt

    camera, rng = replace(CAMERAS["7 px/mm, tilted 6°, radial -0.3"], radial=(-0.45, 0.2)), np.random.default_rng(3)
    taken = photograph_of_board(camera, rng)
    board = view_of_board(taken, PITCH)
    poses = random_poses(rng)
    photograph = photograph_of(camera, poses, rng)
    found = Photographs(board.view, LinkBalls(five_link(), BALLS), DIAMETER).poses(photograph)
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    left.imshow(taken, cmap="gray", vmin=0, vmax=255)
    left.plot(*board.pixels.T, "+", color="tab:orange", ms=5, label="dots found")
    left.set_title(f"board: {len(board.pixels)} dots, {1e3 * board.rms:.0f} µm rms left")
    right.imshow(photograph, cmap="gray", vmin=0, vmax=255)
    base = poses[0]
    for k, (x, y, angle) in enumerate(found):
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        spots = camera.pixels(np.column_stack([BALLS @ turn.T + (x, y) + base[:2], np.zeros(3)]))
        right.plot(
            *np.vstack([spots, spots[:1]]).T, "-", color="tab:orange", lw=1.2, label="links found" if k == 0 else None
        )
    off = np.linalg.norm((found - poses)[1:, :2], axis=1)
    right.set_title(f"links: {1e3 * np.sqrt(np.mean(off**2)):.0f} µm rms off")
    for axes in (left, right):
        axes.set_axis_off()
        axes.legend(loc="lower right")
    figure.savefig(folder / "camera.png", dpi=90, bbox_inches="tight")


if __name__ == "__main__":
    main()
