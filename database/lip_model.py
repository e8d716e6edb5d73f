"""The lip model that a database may hold: an active appearance model of the mouth's 20 points.

Arrays only; analysis/aam_fit.py fits it to crops, analysis/aam_training.py builds it. Points are
numbered as in analysis/aam_points.py: 12 on the outer contour, 8 on the inner one, each
clockwise in the picture from the left corner.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np
import numpy.typing as npt

F32 = npt.NDArray[np.float32]

N_POINTS: Final = 20
LEVELS: Final = 2
"""Resolutions at which the mouth is looked at."""


@dataclass(frozen=True)
class LipLevel:
    """Appearance at one resolution, on the template.

    Parameters
    ----------
    origin : (2,) int32
        x and y of the box's first pixel, in the level's pixels.
    region : (h, w) uint8
        1 for the pixels of the box that belong to the template.
    mean : (2, h, w) float32
        Brightness and redness (log levels), light taken out.
    modes : (m, 2, h, w) float32
        Principal components; inside the region orthonormal when divided by the root of `noise`.
    variances : (m,) float32
        Along the modes.
    noise : (2, h, w) float32
        Variance that the modes leave in each pixel.
    """

    origin: npt.NDArray[np.int32]
    region: npt.NDArray[np.uint8]
    mean: F32
    modes: F32
    variances: F32
    noise: F32


@dataclass(frozen=True)
class LipModel:
    """An active appearance model of a mouth.

    Parameters
    ----------
    scale : float
        Pixels of the finest level in one of the crop.
    blur : float
        Standard deviation of the smoothing of each level's picture, pixels.
    energy : float
        Median squared error of the training frames, each fitted by a model of others.
    mean_shape : (20, 2) float32
        Pixels of the finest level.
    shape_modes : (k, 40) float32
        Principal components of the shape, unit length: x of the 20 points, then y.
    shape_variances : (k,) float32
        pixel^2.
    template : (20, 2) float32
        The mean shape with its lips apart, on which the appearance lies.
    start_bias : (20, 2) float32
        What is added to the face mesh's points to get the model's, pixels.
    start_covariance : (40, 40) float32
        Of what is left, pixel^2.
    levels : tuple of LipLevel
        `LEVELS` of them, finest first, each half the resolution of the one before.
    """

    scale: float
    blur: float
    energy: float
    mean_shape: F32
    shape_modes: F32
    shape_variances: F32
    template: F32
    start_bias: F32
    start_covariance: F32
    levels: tuple[LipLevel, ...]

    def as_arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The model as arrays by name, for a file; `from_arrays` reads them back.

        The three numbers are one array, ``numbers`` (3,) float64; arrays of level i are called
        ``level<i>/<name>``.
        """
        out: dict[str, npt.NDArray[Any]] = {
            "numbers": np.array([self.scale, self.blur, self.energy])
        }
        for name in _ARRAYS:
            out[name] = getattr(self, name)
        for i, level in enumerate(self.levels):
            for field in fields(LipLevel):
                out[f"level{i}/{field.name}"] = getattr(level, field.name)
        return out

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> LipModel:
        """The model that `as_arrays` took apart.

        Raises
        ------
        KeyError
            If an array is missing.
        """
        scale, blur, energy = (float(v) for v in arrays["numbers"])
        levels = [
            LipLevel(**{f.name: arrays[f"level{i}/{f.name}"] for f in fields(LipLevel)})
            for i in range(LEVELS)
        ]
        rest = {name: arrays[name] for name in _ARRAYS}
        return cls(scale=scale, blur=blur, energy=energy, levels=tuple(levels), **rest)


_ARRAYS: Final = (
    *("mean_shape", "shape_modes", "shape_variances"),
    *("template", "start_bias", "start_covariance"),
)
