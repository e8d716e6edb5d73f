"""Teeth and tongue: how much of them a mouth's picture shows.

Colours are compared with the lips and the skin of the same picture, as differences of
logarithms: a brighter lamp, or one of another colour, multiplies each channel and so drops out.
A tooth is less red than the lips, by about as much as skin is or more, and not dark. The tongue
has the lips' colour in the mouth's shade; it is told from the lips by its place: between teeth
or the dark, or far inside the lips.
"""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.mask import OUTER_LIPS, MouthPatch

FloatArray = npt.NDArray[np.float32]

WORKING_SCALE: Final = 1.0
"""Pixels per mm of the picture that is looked at; a larger crop is made smaller. A tooth is
8 mm wide, so more would cost time and tell nothing."""

CONTOUR_ERROR: Final = 3.5
"""mm below the inner contour that are looked at too: a row of teeth above the lower lip often
lies outside the face mesh's contour. A lip there costs nothing, since it is red."""

CORNERS: Final = 0.2
"""Part of the inner contour's width that is not looked at, half of it at each end: where lips
are rounded the mesh's corners lie on skin, which is as pale as a tooth."""

CLOSED: Final = 0.3
OPEN: Final = 1.0
"""mm of opening up to which nothing shows, and from which all does."""

FULL: Final = 0.1
"""Area that counts as 1, in parts of the squared width of the resting mouth."""

LEAST_CONTRAST: Final = 0.12
"""Smallest difference that is taken between lips and skin, in log(red / green)."""

PALE: Final = (0.6, 1.3)
"""Paleness, from 0 (the lips) to 1 (skin), between which a pixel turns into a tooth."""

RED: Final = (0.3, 0.7)
"""Paleness between which a pixel ceases to be tongue."""

LIT: Final = (0.4, 0.8)
"""Brightness in parts of the lips' between which a pale pixel becomes a tooth."""

SHADE: Final = (0.45, 0.65)
"""Brightness in parts of the lips' between which the dark of the mouth ends."""

_BITS: Final = 4
"""Bits behind the point of coordinates given to OpenCV's drawing."""


def teeth_and_tongue(
    crop: npt.NDArray[np.uint8], contours: FloatArray, opening: float, patch: MouthPatch
) -> tuple[float, float]:
    """Visibility of teeth and tongue in one crop.

    Each is the area of pixels weighted by how surely they are tooth or tongue, in relation to a
    tenth of the resting mouth's width squared.

    Parameters
    ----------
    crop : (h, w, 3) uint8
        RGB.
    contours : (40, 2) float32
        Outer then inner contour, mm.
    opening : float
        Opening of the inner contour, mm.
    patch : MouthPatch
        What the crop shows.

    Returns
    -------
    teeth, tongue : float
        0..1; nothing shows where the lips cannot be told from the skin around them, as in a
        crop that holds no mouth.
    """
    if opening <= CLOSED:
        return 0.0, 0.0
    picture, points, scale = _mouth(crop, patch.to_crop(contours), patch.pixels_per_mm)
    shape = picture.shape[:2]
    outer, inner = points[: len(OUTER_LIPS)], points[len(OUTER_LIPS) :]
    error = CONTOUR_ERROR * scale
    mouth, hole = _filled(outer, shape), _filled(inner, shape)
    lips = (mouth > 0.5) & (hole < 0.5)
    skin = mouth == 0
    if lips.sum() < 8 or skin.sum() < 8:
        return 0.0, 0.0
    rgb = picture.astype(np.float32) + 4  # Noise in the dark is no colour.
    light = rgb.sum(axis=2)
    red = np.log(rgb[..., 0] / rgb[..., 1])
    # The upper quartile: what is marked as lips is skin in part.
    lip_red = _quantile(red[lips], 0.75)
    paleness = (lip_red - red) / max(lip_red - _quantile(red[skin], 0.5), LEAST_CONTRAST)
    brightness = light / _quantile(light[lips], 0.5)
    between = np.minimum(_filled(_lowered(inner, error), shape), mouth)
    lit = _step(brightness, *SHADE)
    pale = _step(paleness, *PALE) * between
    teeth = pale * _step(brightness, *LIT)
    behind = _enclosed(np.maximum(pale, (1 - lit) * between))
    inside = behind
    if opening > 2 * CONTOUR_ERROR:  # There is a place that far from both lips.
        inside = np.maximum(behind, _filled(inner, shape, error))
    tongue = lit * (1 - _step(paleness, *RED)) * inside * between
    # The rim of a dark gap is as red and as bright as a tongue, but a pixel wide.
    tongue = np.asarray(cv2.morphologyEx(tongue, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)))
    full = FULL * (patch.width_mm / 2 * scale) ** 2
    shown = np.clip((opening - CLOSED) / (OPEN - CLOSED), 0, 1) / full
    return min(1.0, float(teeth.sum() * shown)), min(1.0, float(tongue.sum() * shown))


def _mouth(
    crop: npt.NDArray[np.uint8], points: npt.NDArray[np.float64], scale: float
) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float64], float]:
    """The lips' surroundings at the working scale or less, the points there, and the scale."""
    around = 6 * scale
    width, height = crop.shape[1], crop.shape[0]
    low = np.clip(np.floor(points.min(axis=0) - around), 0, (width - 1, height - 1)).astype(int)
    high = np.clip(np.ceil(points.max(axis=0) + around) + 1, low + 1, (width, height)).astype(int)
    part, points = crop[low[1] : high[1], low[0] : high[0]], points - low
    if scale <= WORKING_SCALE:
        return part, points, scale
    size = np.maximum(np.round((high - low) * (WORKING_SCALE / scale)), 1).astype(int)
    ratio = size / (high - low)
    small = cv2.resize(part, (int(size[0]), int(size[1])), interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8), (points + 0.5) * ratio - 0.5, scale * float(ratio.mean())


def _lowered(inner: npt.NDArray[np.float64], by: float) -> npt.NDArray[np.float64]:
    """The inner contour without its corners and with the middle of its lower edge moved down."""
    half = len(inner) // 2
    left, right = inner[0], inner[half]
    across = right - left
    along = ((inner - left) @ across / max(float(across @ across), 1e-6)).clip(0, 1)
    out = inner - np.outer((along - 0.5) * CORNERS, across)
    out[half:, 1] += by * (1 - (2 * along[half:] - 1) ** 2)
    return out


def _filled(
    points: npt.NDArray[np.float64], shape: tuple[int, ...], rim: float = 0.0
) -> FloatArray:
    """Coverage, 0..1, of a polygon without a rim of some pixels."""
    canvas = np.zeros(shape, np.uint8)
    corners = [np.round(points * (1 << _BITS)).astype(np.int32)]
    cv2.fillPoly(canvas, corners, (255,), cv2.LINE_AA, _BITS)
    if rim > 0:
        cv2.polylines(canvas, corners, True, (0,), max(1, round(2 * rim)), cv2.LINE_AA, _BITS)
    return canvas * np.float32(1 / 255)


def _enclosed(kind: FloatArray) -> FloatArray:
    """How far each pixel has such pixels both above and below it."""
    above = np.maximum.accumulate(kind, axis=0)
    below = np.maximum.accumulate(kind[::-1], axis=0)[::-1]
    return np.minimum(above, below)


def _quantile(values: FloatArray, part: float) -> float:
    place = int(part * (len(values) - 1))
    return float(np.partition(values, place)[place])


def _step(x: FloatArray, low: float, high: float) -> FloatArray:
    t = np.clip((x - low) / (high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float32)
