"""The lip model's picture and its warp: what building and fitting it share.

* **Picture**: log levels, brightness and redness apart, so that light is an offset and a slope,
  which are fitted with the appearance and cost nothing.
* **Warp**: a thin plate spline that carries the template's points to the shape's. A pixel's
  place is a sum of the points' places, with weights that are worked out once.

Shapes are (20, 2) points (analysis/aam_points.py) or vectors of 40: the points' x, then their y.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.texture import LOG_OFFSET
from database.lip_model import N_POINTS

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]

CHANNELS: Final = 2
"""Brightness and redness."""

_LOGS: Final = np.log(np.arange(256, dtype=np.float32) + np.float32(LOG_OFFSET))
_MIX: Final = np.array([[0.299, 0.587, 0.114], [1.0, -1.0, 0.0]], np.float32)
"""Brightness and redness from the logarithms of red, green and blue."""


def channels_of(crop: npt.NDArray[np.uint8]) -> F32:
    """Brightness and redness of a crop, (h, w, 2) float32 log levels."""
    return np.asarray(cv2.transform(np.asarray(cv2.LUT(crop, _LOGS)), _MIX), dtype=np.float32)


def pyramid(crop: npt.NDArray[np.uint8], scale: float, levels: int, blur: float) -> list[F32]:
    """Channels of a crop at each level, finest first.

    Parameters
    ----------
    crop : (h, w, 3) uint8
    scale : float
        Of the finest level.
    levels : int
    blur : float
        Standard deviation of the smoothing of each level, pixels; sampling between pixels is
        linear, and should find nothing sharper.
    """
    image = channels_of(crop)
    if scale != 1.0:
        height, width = image.shape[:2]
        # An exact scale, whatever the rounding of the size: pixel edges go to pixel edges.
        size = (int(np.ceil(width * scale)), int(np.ceil(height * scale)))
        image = _smoothed(image, 0.45 / scale)
        offset = (scale - 1) / 2
        to_level = np.array([[scale, 0, offset], [0, scale, offset]])
        reduced = cv2.warpAffine(
            image, to_level, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        image = np.asarray(reduced, dtype=np.float32)
    out = []
    for level in range(levels):
        if level:
            height, width = image.shape[:2]
            even = np.pad(image, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
            size = (even.shape[1] // 2, even.shape[0] // 2)
            half = cv2.resize(even, size, interpolation=cv2.INTER_AREA)
            image = np.asarray(half, dtype=np.float32)
        out.append(np.ascontiguousarray(_smoothed(image, blur)))
    return out


def _smoothed(image: F32, deviation: float) -> F32:
    if deviation <= 0:
        return image
    return np.asarray(cv2.GaussianBlur(image, (0, 0), deviation), dtype=np.float32)


def to_vector(points: npt.NDArray[np.floating]) -> F64:
    """Points (..., 20, 2) as vectors (..., 40)."""
    both = np.asarray(points, dtype=np.float64)
    return np.concatenate([both[..., 0], both[..., 1]], axis=-1)


def to_points(vector: npt.NDArray[np.floating]) -> F64:
    """Vectors (..., 40) as points (..., 20, 2)."""
    both = np.asarray(vector, dtype=np.float64)
    return np.stack([both[..., :N_POINTS], both[..., N_POINTS:]], axis=-1)


def at_level(points: npt.NDArray[np.floating], level: int) -> F64:
    """Points of the finest level in the pixels of another."""
    return np.asarray((np.asarray(points, dtype=np.float64) + 0.5) / 2**level - 0.5)


def spline_weights(
    base: npt.NDArray[np.floating], places: npt.NDArray[np.floating]
) -> tuple[F64, F64]:
    """A thin plate spline as weights of its points' new places.

    Parameters
    ----------
    base : (20, 2) float
    places : (P, 2) float

    Returns
    -------
    phi : (20, P) float64
        A place goes to the sum of the points' new places with these weights.
    slopes : (2, P, 20) float64
        Derivatives of the weights by x and y.
    """
    points, at = np.asarray(base, dtype=np.float64), np.asarray(places, dtype=np.float64)
    n = len(points)
    # Centred and scaled, or the system is badly conditioned.
    centre, size = points.mean(axis=0), float(points.std())
    points, at = (points - centre) / size, (at - centre) / size
    system = np.zeros((n + 3, n + 3))
    system[:n, :n] = _kernel(points[:, None] - points)[0]
    system[:n, n:] = system[n:, :n].T
    system[:n, n] = system[n, :n] = 1
    system[:n, n + 1 :] = points
    system[n + 1 :, :n] = points.T
    solution = np.linalg.solve(system, np.eye(n + 3, n))
    value, slope = _kernel(at[:, None] - points)
    plane = np.column_stack([np.ones(len(at)), at])
    phi = (np.hstack([value, plane]) @ solution).T
    slopes = np.stack(
        [
            np.hstack([slope[..., d], np.tile(np.eye(3)[1 + d], (len(at), 1))]) @ solution / size
            for d in range(2)
        ]
    )
    return phi, slopes


def _kernel(away: F64) -> tuple[F64, F64]:
    """``r^2 log r^2`` and its derivatives, of differences (..., 2)."""
    squared = (away**2).sum(axis=-1)
    logs = np.log(np.maximum(squared, 1e-300))
    return squared * logs, 2 * away * np.where(squared > 0, logs + 1, 0.0)[..., None]


def light_of(x: npt.NDArray[np.floating], y: npt.NDArray[np.floating]) -> F64:
    """What light may do to a texture: a constant and slopes in each channel, (6, 2 P)."""
    base = np.stack([np.ones_like(x), x - x.mean(), y - y.mean()])
    return np.kron(np.eye(CHANNELS), base)
