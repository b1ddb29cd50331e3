"""A camera's view of a plane: a homography, then the radial distortion of the lens.

    n = proj(H (x, y, 1)),   n' = c + (n - c) (1 + k1 r² + k2 r⁴),   r = |n - c|,   pixel = middle + w n'

(x, y) is in the plane [mm], w half the diagonal of the picture [pixels]; pixels count to the right and down, and the
middle of the first one is (0, 0). Source: D. C. Brown, Close-range camera calibration, 1971, without its small terms.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.checked_yaml import dump_yaml, mapping, number_table, numbers, point, read_yaml
from rollingjoint.checks import as_integer
from rollingjoint.errors import ConfigError, InvalidInput

Array = NDArray[np.float64]

KEYS = ("size", "homography", "distortion", "centre")
_ITERATIONS = 30  # of the inverse of the distortion
_NEAR = 1e-12  # of radii, at which it ends
_BEHIND = 1e-9  # of the third homogeneous coordinate: points there are not in front of the camera


@dataclass(frozen=True, eq=False)
class PlaneView:
    """Where the points of a plane are in the pictures of a camera that stands still.

    Args:
        size: of pictures, width and height [pixels]. homography: H, (3, 3).
        distortion: k1, k2. centre: c of the distortion, in half diagonals from the middle of the picture.
    """

    size: tuple[int, int]
    homography: Array
    distortion: tuple[float, float] = (0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        H = np.array(self.homography, float)
        if H.shape != (3, 3) or not np.isfinite(H).all() or abs(np.linalg.det(H)) < 1e-15:
            raise InvalidInput("homography", self.homography, "a matrix of 3 x 3 finite numbers that can be inverted")
        object.__setattr__(self, "homography", H)

    @property
    def half_diagonal(self) -> float:
        """w [pixels]."""
        return 0.5 * float(np.hypot(*self.size))

    @property
    def middle(self) -> Array:
        """Of the picture, (2,) [pixels]."""
        return 0.5 * (np.array(self.size, float) - 1.0)

    def pixels(self, places: ArrayLike) -> Array:
        """Pixels of places in the plane, (..., 2) both; NaN for those behind the camera."""
        x = np.asarray(places, float)
        homogeneous = np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1) @ self.homography.T
        depth = np.where(homogeneous[..., 2:] > _BEHIND, homogeneous[..., 2:], np.nan)
        away = homogeneous[..., :2] / depth - self.centre
        k1, k2 = self.distortion
        r2 = (away**2).sum(axis=-1, keepdims=True)
        return np.asarray(self.middle + self.half_diagonal * (self.centre + away * (1.0 + k1 * r2 + k2 * r2**2)))

    def places(self, pixels: ArrayLike) -> Array:
        """Places in the plane of pixels, (..., 2) both [mm]; NaN where the distortion has no inverse."""
        distorted = (np.asarray(pixels, float) - self.middle) / self.half_diagonal - self.centre
        k1, k2 = self.distortion
        outer = np.linalg.norm(distorted, axis=-1, keepdims=True)
        r = outer.copy()
        with np.errstate(all="ignore"):
            for _ in range(_ITERATIONS):
                change = (r * (1.0 + k1 * r**2 + k2 * r**4) - outer) / (1.0 + 3.0 * k1 * r**2 + 5.0 * k2 * r**4)
                r = r - change
                if not (np.abs(change) > _NEAR).any():
                    break
            inverted = (np.abs(change) <= 1e-9) & (r >= 0.0) & (1.0 + 3.0 * k1 * r**2 + 5.0 * k2 * r**4 > 0.0)
            ideal = self.centre + distorted * np.where(outer > 0.0, r / np.where(outer > 0.0, outer, 1.0), 1.0)
        rows = np.concatenate([ideal, np.ones((*ideal.shape[:-1], 1))], axis=-1) @ np.linalg.inv(self.homography).T
        return np.asarray(np.where(inverted, rows[..., :2] / rows[..., 2:], np.nan))

    def pixels_per_mm(self) -> float:
        """In the middle of the picture."""
        corners = self.places(self.middle + np.array([[-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5]]))
        across = np.linalg.det(np.stack([corners[1] - corners[0], corners[2] - corners[0]]))
        return float(1.0 / np.sqrt(abs(across)))


def save_view(view: PlaneView, path: str | Path) -> None:
    """Write a view as YAML."""
    content = {
        "size": list(view.size),
        "homography": view.homography.tolist(),
        "distortion": list(view.distortion),
        "centre": list(view.centre),
    }
    Path(path).write_text(dump_yaml(content), encoding="utf-8")


def load_view(path: str | Path) -> PlaneView:
    """The view in a file of `save_view`; raises ConfigError for another one."""
    where = str(path)
    content = mapping(where, read_yaml(Path(path)), KEYS, KEYS)
    width, height = (
        as_integer(f"{where}: size", value, 1, 100_000, error=ConfigError)
        for value in point(f"{where}: size", content["size"])
    )
    rows = [numbers(f"{where}: homography", row) for row in number_table(f"{where}: homography", content["homography"])]
    others = (point(f"{where}: {name}", content[name]) for name in ("distortion", "centre"))
    try:
        return PlaneView((width, height), np.array(rows, float), *others)
    except (InvalidInput, ValueError):
        allowed = "3 x 3 finite numbers that can be inverted"
        raise ConfigError(f"{where}: homography", content["homography"], allowed) from None
