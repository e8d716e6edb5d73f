"""The sharpness that resampling takes, given back.

A mouth is resampled twice, when its crop is cut and when it is drawn, and each time loses some of
its finest detail. How much depends on the sizes of crop and picture, so it is measured where it
happens: a background frame's own mouth is cut out and drawn again, and the amount of sharpening
is the one with which the drawn mouth is as sharp as the frame (in the variance of the Laplacian,
which is a quadratic in the amount).
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.mask import cut_crop
from database.planes import Colour
from render.blend import SOLID
from render.scene import MouthLayer, Scene

UInt8Array = npt.NDArray[np.uint8]

LARGEST_AMOUNT: Final = 0.5
"""No more than this: a mouth recorded smaller than it is drawn cannot be made as sharp."""

BETWEEN: Final = 0.15
"""Pixels, right and down, by which the mouth is drawn off the place that it was cut from: units
come from other places between pixels, which loses more than none. With this much, units of
GRID's built clips are as sharp on other backgrounds as in their own recordings."""

BINOMIAL: Final = np.outer([1.0, 2.0, 1.0], [1.0, 2.0, 1.0]) / 16


def sharpen(crop: UInt8Array, amount: float) -> UInt8Array:
    """Add a part of what a 3 x 3 binomial filter takes away.

    Parameters
    ----------
    crop : (h, w, 3) uint8
    amount : float
        0 leaves the crop as it is.

    Returns
    -------
    (h, w, 3) uint8
    """
    if amount == 0:
        return crop
    kernel = -amount * BINOMIAL
    kernel[1, 1] += 1 + amount
    return np.asarray(cv2.filter2D(crop, -1, kernel), dtype=np.uint8)


def sharpening_amount(
    scene: Scene, frame: UInt8Array, pose: npt.NDArray[np.float64], colour: Colour
) -> float:
    """How much to sharpen crops, so that a drawn mouth is as sharp as the picture under it.

    Parameters
    ----------
    scene : Scene
        What draws the mouths.
    frame : (height, width, 3) uint8
        A frame of the background.
    pose : (3, 4) float64
        The head's in that frame.
    colour : Colour
        Meaning of the planes, which says what luma is.

    Returns
    -------
    float
        0 to `LARGEST_AMOUNT`; 0 where the mouth is drawn much smaller than its crops are, which
        loses nothing, or lies outside the picture.
    """
    if scene.minifies(pose):
        return 0.0
    weights = colour.from_rgb[0]
    luma = np.ascontiguousarray(frame @ weights)
    crop = cut_crop(frame, scene.patch, pose, scene.camera)
    moved = pose.copy()
    moved[:2, 3] += BETWEEN * pose[2, 3] / scene.camera.focal

    def laplacian(layer: MouthLayer) -> npt.NDArray[np.float64]:
        """Of the layer laid over the frame, where nothing but the layer is seen."""
        height, width = layer.alpha.shape
        under = luma[layer.y0 : layer.y0 + height, layer.x0 : layer.x0 + width]
        laid = under * (1 - layer.alpha) + layer.premultiplied @ weights
        found = cv2.Laplacian(laid, cv2.CV_32F)[layer.alpha >= SOLID]
        return np.asarray(found, dtype=np.float64)

    plain = scene.draw(crop, moved)
    solid = plain.alpha >= SOLID
    if not solid.any():
        return 0.0
    height, width = solid.shape
    whole = cv2.Laplacian(luma, cv2.CV_32F)
    there = whole[plain.y0 : plain.y0 + height, plain.x0 : plain.x0 + width]
    wanted = float(there[solid].var(dtype=np.float64))
    low = laplacian(plain)
    more = laplacian(scene.draw(sharpen(crop, 1.0), moved)) - low
    # var(low + a more) = wanted, the smaller amount that is not negative.
    square, cross, rest = more.var(), np.mean((low - low.mean()) * more), low.var() - wanted
    if rest >= 0 or square <= 0:
        return 0.0
    amount = (np.sqrt(cross**2 - square * rest) - cross) / square
    return float(np.clip(amount, 0, LARGEST_AMOUNT))
