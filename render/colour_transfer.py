"""The unit's skin in the light of the frame that it is laid on.

Where the two pictures are blended they show the same skin, so what differs there is light. It is
taken as a ratio, and carried over the whole mouth as a field of gains in two parts: a plane
(constant and slopes a channel) that most of the band agrees on, and the rest of the difference,
which goes smoothly inwards from the band like a membrane that is held at its rim (the gradient
domain of Perez, Gangnet and Blake, 2003, its Laplace equation being solved on a small grid).
The mouth keeps its own gradients and meets the frame at its rim without a step.

Everything is fitted on pictures reduced to about `COLUMNS` columns, since light is smooth; there
the membrane is one small matrix, made once for a database.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from render.blend import ring_weights

FloatArray = npt.NDArray[np.float32]
UInt8Array = npt.NDArray[np.uint8]

DARK_LEVEL: Final = 4.0
"""Levels added before the logarithm, so that noise in the dark does not count as a ratio."""

LARGEST_GAIN: Final = 2.0
"""No pixel is made brighter or darker than by this factor."""

COLUMNS: Final = 11
"""Cells across a crop; 9 mm of the mask each on GRID."""

LEAST_WEIGHT: Final = 0.02
"""Cells that see less of the band than this have no say."""

STIFFNESS: Final = 0.05
"""What a difference between neighbouring cells costs, against a weight of 1 for what was seen."""

SLOPE_PENALTY: Final = 0.003
"""Weight against slopes, in parts of the band's total weight; small, as the band spans both."""

ROUNDS: Final = 3
"""Rounds in which cells that fit the plane badly (a shadow, an open jaw) lose weight."""

PLANE_SCALE: Final = 2.5
"""Robust standard deviations at which a cell's say in the plane begins to fall."""

MEMBRANE_SCALE: Final = 5.0
"""Robust standard deviations beyond which a cell pulls the membrane no further."""

SMALLEST_SCALE: Final = 0.01
"""Log gain: a standard deviation below this is taken to be this."""


class ColourTransfer:
    """Fits and applies the gains of a mouth's picture.

    Parameters
    ----------
    alpha : (h, w) float32
        Blend weight of each pixel of the crop (`render.blend.blend_alpha`).
    """

    def __init__(self, alpha: FloatArray) -> None:
        height, width = alpha.shape
        step = max(1, round(width / COLUMNS))
        columns, rows = max(1, round(width / step)), max(1, round(height / step))
        self._size = (columns, rows)
        seen = cv2.resize(ring_weights(alpha), self._size, interpolation=cv2.INTER_AREA)
        weights = np.where(seen < LEAST_WEIGHT, 0, seen).ravel().astype(np.float64)
        x = (np.arange(columns) + 0.5) / columns * 2 - 1
        y = (np.arange(rows) + 0.5) / rows * 2 - 1
        across, down = (axis.ravel() for axis in np.meshgrid(x, y))
        self._plane = np.stack([np.ones_like(across), across, down], axis=1)
        self._used = np.flatnonzero(weights)
        self._weights = weights[self._used]
        self._penalty = np.diag([0, SLOPE_PENALTY, SLOPE_PENALTY]) * weights.sum()
        self._penalty += 1e-9 * np.eye(3)
        self._membrane = _membrane(weights, rows, columns)[:, self._used]

    def field(self, frame_crop: UInt8Array, unit_crop: UInt8Array) -> FloatArray:
        """Log gains that make a unit's skin look like the frame's.

        Parameters
        ----------
        frame_crop : (h, w, 3) uint8
            The background frame's own crop at its pose.
        unit_crop : (h, w, 3) uint8
            The unit's crop.

        Returns
        -------
        (rows, columns, 3) float32
            A cell for each of some pixels of the crop; fields of neighbouring frames may be
            averaged. All zero where the crops are equal or the band is empty.
        """
        columns, rows = self._size
        if not len(self._used):
            return np.zeros((rows, columns, 3), np.float32)
        frame, unit = (
            cv2.resize(crop, self._size, interpolation=cv2.INTER_AREA)
            .reshape(-1, 3)[self._used]
            .astype(np.float64)
            for crop in (frame_crop, unit_crop)
        )
        wanted = np.log((frame + DARK_LEVEL) / (unit + DARK_LEVEL))
        plane, weights = self._plane[self._used], self._weights
        rest = wanted - np.median(wanted, axis=0)
        for _ in range(ROUNDS):
            error = np.sqrt((rest**2).sum(axis=1))
            scale = max(1.48 * float(np.median(error)), SMALLEST_SCALE)
            trust = np.minimum(1, 0.5 * PLANE_SCALE * scale / np.maximum(error, 1e-9)) ** 2
            weighted = plane * (weights * trust)[:, None]
            fit = np.linalg.solve(plane.T @ weighted + self._penalty, weighted.T @ wanted)
            rest = wanted - plane @ fit
        error = np.sqrt((rest**2).sum(axis=1))
        pull = rest * np.minimum(1, MEMBRANE_SCALE * scale / np.maximum(error, 1e-9))[:, None]
        field = self._plane @ fit + self._membrane @ pull
        return np.asarray(field.reshape(rows, columns, 3), dtype=np.float32)

    def apply(self, crop: UInt8Array, field: FloatArray) -> UInt8Array:
        """A crop with the gains of a field, (h, w, 3) uint8."""
        if not field.any():
            return crop
        limit = np.float32(np.log(LARGEST_GAIN))
        gain = cv2.resize(
            np.exp(np.clip(field, -limit, limit)),
            (crop.shape[1], crop.shape[0]),
            interpolation=cv2.INTER_LINEAR,
        )
        levels = np.add(crop, np.float32(DARK_LEVEL), dtype=np.float32)
        levels *= gain
        levels -= np.float32(DARK_LEVEL - 0.5)  # The half rounds.
        return np.asarray(np.clip(levels, 0, 255, out=levels), dtype=np.uint8)


def _membrane(weights: npt.NDArray[np.float64], rows: int, columns: int) -> npt.NDArray[np.float64]:
    """Matrix from what was seen in each cell to the membrane in each.

    It minimises the weighted squares of what is left plus `STIFFNESS` times the squared steps
    between neighbouring cells; where nothing was seen that is the Laplace equation.
    """
    number = np.arange(rows * columns).reshape(rows, columns)
    first = np.concatenate([number[:, :-1].ravel(), number[:-1].ravel()])
    second = np.concatenate([number[:, 1:].ravel(), number[1:].ravel()])
    steps = np.zeros((len(first), rows * columns))
    steps[np.arange(len(first)), first] = 1
    steps[np.arange(len(first)), second] = -1
    bending = STIFFNESS * steps.T @ steps + 1e-6 * np.eye(rows * columns)
    return np.asarray(np.linalg.solve(np.diag(weights) + bending, np.diag(weights)))
