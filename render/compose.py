"""Laying the mouth over the background, and matching its colour to it.

The mouth is blended in the encoder's own yuv420p planes: a sample whose alpha is zero keeps the
background's value exactly; a chroma sample has the mean alpha of its 2 x 2 block.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.planes import Colour, Planes, block_means, to_levels
from render.scene import MouthLayer

FloatArray = npt.NDArray[np.float32]
UInt8Array = npt.NDArray[np.uint8]

DARK_LEVEL: Final = 4.0
"""Levels added before the logarithm, so that noise in the dark does not count as a ratio."""

LARGEST_GAIN: Final = 2.0
"""No pixel is made brighter or darker than by this factor."""

FIT_WIDTH: Final = 72
"""Pixels: gains are fitted on crops reduced to about this width."""

SLOPE_PENALTY: Final = 0.003
"""Weight against slopes, in parts of the ring's total weight; small, as the ring spans both."""

OUTLIER_SCALE: Final = 3.0
"""Residuals beyond so many robust standard deviations have no say (Tukey's biweight)."""

SMALLEST_SCALE: Final = 0.01
"""Log gain: residuals below about this are never outliers."""


def composite(planes: Planes, layer: MouthLayer, colour: Colour) -> Planes:
    """The background's planes with the mouth laid over them.

    Parameters
    ----------
    planes : Planes
        The background frame; left as it is.
    layer : MouthLayer
        At even coordinates, of even size, inside the picture.
    colour : Colour
        Meaning of the planes.

    Returns
    -------
    Planes
        New arrays; samples under zero alpha are the background's bit for bit.
    """
    y, u, v = planes.y.copy(), planes.u.copy(), planes.v.copy()
    height, width = layer.alpha.shape
    if height and width:
        alpha = layer.alpha
        # Linear in premultiplied colour, the offset being weighted by alpha as well.
        yuv = layer.premultiplied @ colour.from_rgb.T + alpha[..., None] * colour.offset
        rows, columns = slice(layer.y0, layer.y0 + height), slice(layer.x0, layer.x0 + width)
        _blend(y[rows, columns], yuv[..., 0], alpha)
        means = block_means(np.dstack([yuv[..., 1:], alpha]))
        rows = slice(layer.y0 // 2, (layer.y0 + height) // 2)
        columns = slice(layer.x0 // 2, (layer.x0 + width) // 2)
        _blend(u[rows, columns], means[..., 0], means[..., 2])
        _blend(v[rows, columns], means[..., 1], means[..., 2])
    return Planes(y, u, v)


def _blend(target: UInt8Array, premultiplied: FloatArray, alpha: FloatArray) -> None:
    """Blend into part of a plane, in place."""
    blended = to_levels(target * (1 - alpha) + premultiplied)
    np.copyto(target, blended, where=alpha > 0)


def fit_gain(
    frame_crop: UInt8Array, unit_crop: UInt8Array, ring: FloatArray
) -> npt.NDArray[np.float64]:
    """Log gain that makes a unit's skin look like the frame's: constant and slopes a channel.

    Fitted to the ratio of the two crops by weighted least squares; pixels that fit badly (a
    shadow, a moustache's edge, an open jaw) lose their weight in a few rounds, all three
    channels together. Coefficients of neighbouring frames may be averaged.

    Parameters
    ----------
    frame_crop : (h, w, 3) uint8
        The background frame's own crop at its pose.
    unit_crop : (h, w, 3) uint8
        The unit's crop.
    ring : (h, w) float32
        Weight of each pixel, not negative: the skin where the two meet.

    Returns
    -------
    (3, 3) float64
        A row a channel: log gain in the middle of the crop, and its change from the middle to
        the right and to the lower edge. All zero where the crops are equal or the ring empty.
    """
    height, width = ring.shape
    step = max(1, round(width / FIT_WIDTH))
    size = (max(1, width // step), max(1, height // step))
    frame, unit, weight = (
        cv2.resize(np.asarray(image, dtype=np.float32), size, interpolation=cv2.INTER_AREA)
        for image in (frame_crop, unit_crop, ring)
    )
    target = np.log((frame + DARK_LEVEL) / (unit + DARK_LEVEL)).astype(np.float64)
    x, y = _axes(size[0], size[1])
    used = weight > 1e-3
    if not used.any():
        return np.zeros((3, 3))
    grid = np.stack(np.broadcast_arrays(1.0, x, y), axis=-1)[used]
    values, weights = target[used], weight[used].astype(np.float64)
    penalty = np.diag([0.0, SLOPE_PENALTY, SLOPE_PENALTY]) * weights.sum()
    coefficients = np.zeros((3, 3))
    coefficients[0] = _weighted_median(values, weights)
    for _ in range(8):
        error = np.linalg.norm(values - grid @ coefficients, axis=1)
        scale = max(1.48 * float(_weighted_median(error[:, None], weights)[0]), SMALLEST_SCALE)
        trust = np.clip(1 - (error / (OUTLIER_SCALE * scale)) ** 2, 0, None) ** 2
        weighted = grid * (weights * trust)[:, None]
        coefficients = np.linalg.solve(
            grid.T @ weighted + penalty + 1e-9 * np.eye(3), weighted.T @ values
        )
    return np.ascontiguousarray(coefficients.T)


def apply_gain(crop: UInt8Array, coefficients: npt.NDArray[np.float64]) -> UInt8Array:
    """A crop with the gain of `fit_gain` applied, (h, w, 3) uint8."""
    if not coefficients.any():
        return crop
    height, width = crop.shape[:2]
    x, y = _axes(width, height)
    limit = np.log(LARGEST_GAIN)
    c = coefficients.astype(np.float32)
    field = c[:, 0] + x[..., None] * c[:, 1] + y[..., None] * c[:, 2]
    gain = np.exp(np.clip(field, -limit, limit))
    return to_levels((crop + np.float32(DARK_LEVEL)) * gain - np.float32(DARK_LEVEL))


def _axes(width: int, height: int) -> tuple[FloatArray, FloatArray]:
    """Places of pixel centres, -1 to 1 from edge to edge: (1, width) and (height, 1)."""
    x = (np.arange(width, dtype=np.float32) + 0.5) / width * 2 - 1
    y = (np.arange(height, dtype=np.float32) + 0.5) / height * 2 - 1
    return x[None, :].astype(np.float32), y[:, None].astype(np.float32)


def _weighted_median(
    values: npt.NDArray[np.float64], weights: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Median of each column, (n, k) to (k,)."""
    order = np.argsort(values, axis=0, kind="stable")
    heaped = np.cumsum(weights[order], axis=0)
    middle = np.argmax(heaped >= heaped[-1] / 2, axis=0)
    columns = np.arange(values.shape[1])
    return np.asarray(values[order[middle, columns], columns])
