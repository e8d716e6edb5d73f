"""The region of the mouth's crop that is laid over the background, and how it fades.

Two closed curves in the crop's plane, one inside the other, both made of four quarters of
superellipses around the middle of the resting mouth's corners: inside the inner one the
unit covers the background, outside the outer one nothing is drawn, and between them alpha
falls smoothly along each ray from the middle. Distances are millimetres of the mask, so the
region stays on the skin whatever the size of the face in the picture.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from database.mask import Mask

FloatArray = npt.NDArray[np.float32]

LEFT_CORNER: Final = 61
RIGHT_CORNER: Final = 291
NOSE_BASE: Final = 2
"""Mesh point where the nose's septum meets the upper lip."""
CHIN: Final = 152
"""Lowest mesh point of the chin."""

SOLID: Final = 0.999
"""Alpha from which on a pixel is the mouth's alone."""

BORDER: Final = 1.5
"""Crop pixels at the crop's edge that are never drawn."""


@dataclass(frozen=True)
class BlendShape:
    """Size and form of the blend region; millimetres.

    Parameters
    ----------
    side : float
        From the resting mouth's corners outwards to the outer curve.
    side_feather : float
        Width of the fade there.
    nose_gap : float
        From the base of the nose down to the outer curve, so that the nostrils stay the
        background's.
    upper_feather : float
        Width of the fade there.
    chin_gap : float
        From the chin's lowest point up to the outer curve; negative goes below the chin, so
        that an open jaw is the unit's to its end and the background's chin is covered.
    lower_feather : float
        Width of the fade there.
    upper_power, lower_power : float
        Form of the quarters above and below the mouth: 2 is an ellipse, less is more pointed
        (narrow under the nose), more is squarer.
    """

    side: float = 22.0
    side_feather: float = 13.0
    nose_gap: float = 2.0
    upper_feather: float = 7.0
    chin_gap: float = -14.0
    lower_feather: float = 10.0
    upper_power: float = 1.8
    lower_power: float = 2.4


def blend_alpha(mask: Mask, shape: BlendShape | None = None) -> FloatArray:
    """Blend weight of each pixel of the mouth's crop.

    Parameters
    ----------
    mask : Mask
    shape : BlendShape, optional

    Returns
    -------
    (crop_height, crop_width) float32
        1 around the mouth, falling to 0; exactly 0 at the crop's border, where the region is
        made smaller if it would not fit.

    Raises
    ------
    RenderError
        If the sizes leave no region.
    """
    shape = BlendShape() if shape is None else shape
    patch = mask.patch
    corners = mask.vertices[[LEFT_CORNER, RIGHT_CORNER], :2].astype(np.float64)
    middle = corners.mean(axis=0)
    half_mouth = abs(corners[1, 0] - corners[0, 0]) / 2
    # Points of the crop in mm from the middle; x right, y down.
    inset = (BORDER + 0.5) / patch.pixels_per_mm
    left, top = patch.grid[0, 0, :2] - middle
    right, bottom = patch.grid[-1, -1, :2] - middle
    x = left + (np.arange(patch.crop_width) + 0.5) / patch.crop_width * (right - left)
    y = top + (np.arange(patch.crop_height) + 0.5) / patch.crop_height * (bottom - top)
    x, y = x[None, :], y[:, None]
    # Outer and inner half-axes: left, right, up, down.
    outer = np.array(
        [
            min(half_mouth + shape.side, -left - inset),
            min(half_mouth + shape.side, right - inset),
            min(middle[1] - mask.vertices[NOSE_BASE, 1] - shape.nose_gap, -top - inset),
            min(mask.vertices[CHIN, 1] - middle[1] - shape.chin_gap, bottom - inset),
        ]
    )
    feathers = np.array(
        [shape.side_feather, shape.side_feather, shape.upper_feather, shape.lower_feather]
    )
    inner = outer - feathers
    if not (inner > 0).all() or not (feathers > 0).all():
        side = ("left", "right", "top", "bottom")[int(np.argmin(np.minimum(inner, feathers)))]
        raise RenderError(
            f"the blend region has no room at its {side} "
            f"({outer.min():.1f} mm from the mouth's middle); use smaller feathers or gaps"
        )
    radius = np.hypot(x, y)
    to_outer = radius / np.maximum(_level(x, y, outer, shape), 1e-9)
    to_inner = radius / np.maximum(_level(x, y, inner, shape), 1e-9)
    t = np.clip((to_outer - radius) / np.maximum(to_outer - to_inner, 1e-9), 0, 1)
    alpha = np.where(radius < inner.min() / 2, 1.0, t * t * (3 - 2 * t))
    return np.asarray(alpha, dtype=np.float32)


def _level(
    x: npt.NDArray[np.float64],
    y: npt.NDArray[np.float64],
    axes: npt.NDArray[np.float64],
    shape: BlendShape,
) -> npt.NDArray[np.float64]:
    """1 on the curve, and in proportion along each ray from the middle."""
    across = np.abs(x) / np.where(x < 0, axes[0], axes[1])
    along = np.abs(y) / np.where(y < 0, axes[2], axes[3])
    power = np.where(y < 0, shape.upper_power, shape.lower_power)
    out: npt.NDArray[np.float64] = (across**power + along**power) ** (1 / power)
    return out


def ring_weights(alpha: FloatArray) -> FloatArray:
    """Weight of each crop pixel for colour matching: the band in which both are seen.

    Returns
    -------
    (h, w) float32
        1 where alpha is a half, 0 where it is 0 or 1.
    """
    return np.asarray(4 * alpha * (1 - alpha), dtype=np.float32)
