"""The colour fit that `render/colour_transfer.py` replaced: one plane of log gain a channel.

Least squares over all pixels of the band at crop size, in eight rounds of Tukey's biweight. Kept as
the opponent of `picture.py`.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

UInt8Array = npt.NDArray[np.uint8]

DARK_LEVEL = 4.0
SLOPE_PENALTY = 0.003
OUTLIER_SCALE = 3.0
SMALLEST_SCALE = 0.01
LARGEST_GAIN = 2.0


def fit_gain(
    frame_crop: UInt8Array, unit_crop: UInt8Array, ring: npt.NDArray[np.float32]
) -> npt.NDArray[np.float64]:
    """Log gain and its slopes, a row a channel, (3, 3) float64."""
    height, width = ring.shape
    frame, unit = frame_crop.astype(np.float32), unit_crop.astype(np.float32)
    target = np.log((frame + DARK_LEVEL) / (unit + DARK_LEVEL)).astype(np.float64)
    x, y = _axes(width, height)
    used = ring > 1e-3
    grid = np.stack(np.broadcast_arrays(1.0, x, y), axis=-1)[used]
    values, weights = target[used], ring[used].astype(np.float64)
    penalty = np.diag([0.0, SLOPE_PENALTY, SLOPE_PENALTY]) * weights.sum()
    coefficients = np.zeros((3, 3))
    coefficients[0] = np.median(values, axis=0)
    for _ in range(8):
        error = np.linalg.norm(values - grid @ coefficients, axis=1)
        scale = max(1.48 * float(np.median(error)), SMALLEST_SCALE)
        trust = np.clip(1 - (error / (OUTLIER_SCALE * scale)) ** 2, 0, None) ** 2
        weighted = grid * (weights * trust)[:, None]
        coefficients = np.linalg.solve(
            grid.T @ weighted + penalty + 1e-9 * np.eye(3), weighted.T @ values
        )
    return np.ascontiguousarray(coefficients.T)


def apply_gain(crop: UInt8Array, coefficients: npt.NDArray[np.float64]) -> UInt8Array:
    """A crop with that gain, (h, w, 3) uint8."""
    x, y = _axes(crop.shape[1], crop.shape[0])
    limit = np.log(LARGEST_GAIN)
    c = coefficients.astype(np.float32)
    field = c[:, 0] + x[..., None] * c[:, 1] + y[..., None] * c[:, 2]
    made = (crop + DARK_LEVEL) * np.exp(np.clip(field, -limit, limit)) - DARK_LEVEL
    return np.asarray(np.clip(np.rint(made), 0, 255), dtype=np.uint8)


def _axes(width: int, height: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    x = (np.arange(width, dtype=np.float32) + 0.5) / width * 2 - 1
    y = (np.arange(height, dtype=np.float32) + 0.5) / height * 2 - 1
    return x[None, :], y[:, None]
