"""Whether eyes are shut, from pixels: an iris is darker than a lid.

The face mesh does not help, as it draws open lids over shut ones in small pictures.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from database.mask import LEFT_EYE, RIGHT_EYE, Camera, Mask, project

INNER: Final = 0.6
"""Share of an eye's width, in its middle, in which its iris is looked for."""

IRIS: Final = 30
"""Percentile of the brightness there: an iris is larger than so much of it, lashes are smaller."""

MARGIN: Final = 8.0
"""Millimetres around both eyes within which the skin's brightness is measured."""

BLACK: Final = 16
"""Luma of black."""

SHUT: Final = 1.2
"""Eyes count as shut, or nearly, from so many times their usual brightness on. On GRID's speaker
open ones stay below 1.15, drooping lids are at 1.2 and shut ones at 1.3 to 1.6."""


def eye_brightness(
    luma: npt.NDArray[np.uint8], mask: Mask, pose: npt.NDArray[np.float64], camera: Camera
) -> float:
    """How bright the darker third of both eyes is, in parts of the brightness around them.

    Parameters
    ----------
    luma : (h, w) uint8
        Brightness of the picture.
    mask : Mask
    pose : (3, 4) float64
    camera : Camera
        Of this picture.

    Returns
    -------
    float
        NaN where the eyes are not in the picture.
    """
    found, around = [], []
    for eye in (LEFT_EYE, RIGHT_EYE):
        contour = project(mask.vertices[list(eye)], pose, camera)
        low, high = contour.min(axis=0), contour.max(axis=0)
        trim = (1 - INNER) / 2 * (high[0] - low[0])
        scale = camera.focal / pose[2, 3]
        found.append(_part(luma, low + [trim, -scale], high + [-trim, scale]))
        around.append(_part(luma, low - MARGIN * scale, high + MARGIN * scale))
    if min(part.size for part in found) == 0:
        return float("nan")
    skin = float(np.median(np.concatenate(around)))
    darkest = [float(np.percentile(part, IRIS)) for part in found]
    return float(np.mean(darkest)) / max(skin, 1.0)


def shut_share(brightness: npt.NDArray[np.floating], usual: float) -> float:
    """Share of frames with eyes shut or nearly so.

    Parameters
    ----------
    brightness : (n,) float
        `eye_brightness` of the frames; those that are NaN do not count.
    usual : float
        Its median over many frames of the person.
    """
    known = brightness[np.isfinite(brightness)]
    return float((known > SHUT * usual).mean()) if len(known) else 0.0


def _part(
    luma: npt.NDArray[np.uint8], low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]
) -> npt.NDArray[np.uint8]:
    (x0, y0), (x1, y1) = np.maximum(np.rint(low), 0).astype(int), np.rint(high).astype(int) + 1
    part = luma[y0 : max(y1, 0), x0 : max(x1, 0)].ravel()
    return np.maximum(part, BLACK) - np.uint8(BLACK)
