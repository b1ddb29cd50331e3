"""Balls and dots in a picture: round spots that stand out, and their grey-weighted centres.

A spot stands out from the brightest (or darkest) surroundings within a few of its diameters, so that vignettes and
lamps do not matter. Spots that are not round are left out. Centres are means over a spot and its rim, weighted with
its contrast, of a hundredth of a pixel or so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from rollingjoint.checks import as_choice, as_floats, as_positive
from rollingjoint.errors import InvalidInput

Array = NDArray[np.float64]

KINDS = ("dark", "bright", "red", "green", "blue")
"""Balls that can be found, by their look beside what is around them."""

LARGEST_PICTURE = 100_000_000  # pixels
_BLUR = 1.0  # pixels: edges of spots are spread over some of them
_FAINT = 0.1  # contrast below which there is no spot at all
_SURROUNDINGS = 3.0  # diameters: within them the brightest place is what a spot is compared with
_SIZES = (0.5, 2.0)  # of a spot's area, as shares of the median or of what was said
_ROUND = 1.35  # largest ratio of a spot's axes
_FULL = 0.85  # smallest share of an ellipse with its moments that a spot fills
_RIM = 3  # pixels around a spot that count to its centre
_LEAST = 9  # pixels of a spot
_HALF = 0.5  # of the largest contrast: spots have more
_EDGE = (0.15, 0.65)  # of the way from a spot's surroundings to its middle: where pixels count more and more


def find_balls(picture: ArrayLike, kind: str = "dark", diameter: float | None = None) -> Array:
    """Centres of balls or dots, (N, 2) [pixels, to the right and down], from the top of the picture to its bottom.

    Args:
        picture: grey values or colours, (height, width) or (height, width, 3), of any scale.
        kind: of KINDS. diameter: of the balls in the picture [pixels]; None: as most spots have.
    Raises:
        InvalidInput: a picture of another shape, values that are not finite, an unknown kind.
    """
    as_choice("kind", kind, KINDS)
    values = as_floats("picture", picture, "grey values or colours")
    if values.ndim not in (2, 3) or (values.ndim == 3 and values.shape[2] != 3) or min(values.shape[:2]) < 8:
        raise InvalidInput(
            "shape of the picture", values.shape, "(height, width) or (height, width, 3), 8 or more each"
        )
    if values.shape[0] * values.shape[1] > LARGEST_PICTURE or not np.isfinite(values).all():
        raise InvalidInput("picture", values.shape, f"finite values, at most {LARGEST_PICTURE:,} pixels")
    if diameter is not None:
        as_positive("diameter", diameter, "a positive number of pixels")
    signal = _signal(values, kind)
    contrast = _contrast(signal, diameter) if kind in ("dark", "bright") else signal
    smooth = ndimage.gaussian_filter(contrast, _BLUR)
    if (most := float(smooth.max())) < _FAINT:
        return np.empty((0, 2))
    labels, count = ndimage.label(smooth > _HALF * most)
    spots = [(place, labels[place] == label) for label, place in enumerate(ndimage.find_objects(labels, count), 1)]
    spots = [
        (place, mask)
        for place, mask in spots
        if mask.sum() >= _LEAST and _is_whole(place, contrast.shape) and _is_round(mask)
    ]
    areas = np.array([float(mask.sum()) for _, mask in spots])
    if not len(areas):
        return np.empty((0, 2))
    usual = float(np.median(areas)) if diameter is None else 0.25 * np.pi * diameter**2
    fitting = (areas > _SIZES[0] * usual) & (areas < _SIZES[1] * usual)
    signal = ndimage.gaussian_filter(signal, _BLUR)
    centres = [_centre(signal, place, mask) for (place, mask), fits in zip(spots, fitting, strict=True) if fits]
    return np.array(centres).reshape(-1, 2)


def _signal(values: Array, kind: str) -> Array:
    """How much every pixel has of what is sought, 0 to 1, (height, width)."""
    if kind in ("red", "green", "blue"):
        if values.ndim == 2:
            raise InvalidInput("kind", kind, "'dark' or 'bright', in a picture without colours")
        channel = ("red", "green", "blue").index(kind)
        others = np.delete(values, channel, axis=2).max(axis=2)
        return np.clip((values[..., channel] - others) / max(float(values.max()), 1e-12), 0.0, None)
    grey = values if values.ndim == 2 else values.mean(axis=2)
    low, high = float(grey.min()), float(grey.max())
    if high <= low:
        return np.zeros(grey.shape)
    return np.asarray((high - grey if kind == "dark" else grey - low) / (high - low))


def _contrast(signal: Array, diameter: float | None) -> Array:
    """How much every pixel stands out from the lowest signal around it, as a share of the most that it could."""
    window = int(_SURROUNDINGS * (diameter or max(8.0, 0.02 * float(np.hypot(*signal.shape))))) | 1
    least = ndimage.uniform_filter(ndimage.minimum_filter(ndimage.gaussian_filter(signal, _BLUR), window), window)
    return np.clip((signal - least) / np.maximum(1.0 - least, 0.05), 0.0, None)


def _is_whole(place: tuple[slice, slice], shape: tuple[int, ...]) -> bool:
    """Whether a spot keeps away from the edges of the picture, which may cut it."""
    return all(one.start > _RIM and one.stop < size - _RIM for one, size in zip(place, shape, strict=True))


def _is_round(mask: NDArray[np.bool_]) -> bool:
    """Whether a spot is about an ellipse, and nearly a circle."""
    y, x = np.nonzero(mask)
    spread = np.cov(np.stack([x, y])) + np.eye(2) / 12.0  # of the pixels themselves
    small, large = np.sqrt(np.linalg.eigvalsh(spread))
    return bool(large < _ROUND * small and len(x) > _FULL * 4.0 * np.pi * small * large)


def _centre(signal: Array, place: tuple[slice, slice], spot_mask: NDArray[np.bool_]) -> tuple[float, float]:
    """Mean of a spot and its rim, weighted with the signal between that of the spot and of the ring around, (x, y).

    Within the spot weights are equal, so that light from one side does not move it.
    """
    rows, columns = place
    top, left = max(rows.start - 2 * _RIM, 0), max(columns.start - 2 * _RIM, 0)
    window = signal[top : rows.stop + 2 * _RIM, left : columns.stop + 2 * _RIM]
    mask = np.zeros(window.shape, bool)
    mask[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left] = spot_mask
    rim, surroundings = (ndimage.binary_dilation(mask, iterations=count) for count in (_RIM, 2 * _RIM))
    ring, spot = float(np.median(window[surroundings & ~rim])), float(np.median(window[mask]))
    share = (window - ring) / max(spot - ring, 1e-9)
    weights = np.where(rim, np.clip(share, *_EDGE) - _EDGE[0], 0.0)
    y, x = np.mgrid[top : top + window.shape[0], left : left + window.shape[1]]
    total = max(float(weights.sum()), 1e-9)
    return float((weights * x).sum() / total), float((weights * y).sum() / total)
