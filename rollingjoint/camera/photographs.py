"""Photographs of a mechanism with balls on its links, in files: the poses of the links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rollingjoint.camera.balls import KINDS, LARGEST_PICTURE, find_balls
from rollingjoint.camera.links import LinkBalls
from rollingjoint.camera.view import PlaneView, load_view
from rollingjoint.chain.chain import AnyChain
from rollingjoint.chain.rolling import RollingChain
from rollingjoint.checked_yaml import located, mapping, number, numbered, point, text
from rollingjoint.checks import as_choice
from rollingjoint.errors import ConfigError, naming_extras

Array = NDArray[np.float64]

KEYS = ("view", "balls", "diameter", "kind")


@dataclass(frozen=True)
class Photographs:
    """A camera that stands still before a mechanism.

    Args:
        view: of the plane of the balls. links: with their balls.
        diameter: of the balls [mm]. kind: of KINDS.
    """

    view: PlaneView
    links: LinkBalls
    diameter: float
    kind: str = "dark"

    def poses(self, picture: ArrayLike) -> Array:
        """Poses (x, y, angle) of the links in the frame of the base, (n, 3) [mm, rad]; NaN: not seen.

        Raises:
            ConfigError: a picture of another size than the board's.
        """
        size = np.shape(picture)[1::-1]
        if tuple(size) != tuple(self.view.size):
            raise ConfigError("size of the picture", list(size), f"{list(self.view.size)}, as of the board's")
        pixels = find_balls(picture, self.kind, self.diameter * self.view.pixels_per_mm())
        return self.links.poses(self.view.places(pixels))


def photographs_from_dict(where: str, content: object, mechanism: AnyChain, folder: Path) -> Photographs:
    """The camera that a mapping with KEYS describes; files are looked for in the folder.

    Raises:
        ConfigError: a wrong key, type or number, with the place; a mechanism with other links than rolling ones.
    """
    values: Mapping[str, Any] = mapping(where, content, KEYS, KEYS[:3])
    if not isinstance(mechanism, RollingChain):
        raise ConfigError(where, mechanism.title, "a planar chain of rolling links")
    balls = [point(place, row) for place, row in numbered(f"{where}.balls", values["balls"])]
    kind = as_choice(f"{where}.kind", values.get("kind", "dark"), KINDS, ConfigError)
    diameter = number(f"{where}.diameter", values["diameter"])
    if not 0.0 < diameter < 1e3:
        raise ConfigError(f"{where}.diameter", diameter, "a positive number [mm]")
    with located(where):
        links = LinkBalls(mechanism, np.array(balls, float))
    return Photographs(load_view(folder / text(f"{where}.view", values["view"])), links, diameter, kind)


def read_picture(path: str | Path) -> Array:
    """Grey values or colours of a picture in a file, (height, width) or (height, width, 3), 0 to 255.

    Raises:
        ConfigError: no picture. MissingPackage: without the extra `camera`.
    """
    with naming_extras("camera"):
        from PIL import Image
    try:
        with Image.open(path) as image:
            if image.width * image.height > LARGEST_PICTURE:
                raise ConfigError("picture", str(path), f"at most {LARGEST_PICTURE:,} pixels")
            deep = image.mode.startswith(("I", "F"))  # 16 bits
            return np.asarray(image if deep or image.mode == "L" else image.convert("RGB"), float)
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError("picture", str(path), "a readable picture", str(error)) from None
