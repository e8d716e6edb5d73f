"""Lips, teeth and tongue: what the mouth's picture shows, as numbers.

Geometry is measured on the face mesh's lip contours, carried into the mask's frame so that
head motion and distance do not count. Teeth and tongue are told from the picture, inside the
inner contour.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from analysis.smoothing import smoothed_runs
from database.mask import INNER_LIPS, OUTER_EYE_CORNERS, OUTER_LIPS, Camera, Mask, MouthPatch, Poses

FloatArray = npt.NDArray[np.float32]

CONTOUR_MARGIN = 0.7
"""mm of the inner contour's rim that count as lip."""

LIP_SMOOTHING = 5
"""Frames over which lip contours are smoothed by a parabola. On GRID the smoothed heights agree
with an estimate from pixels alone as well as raw ones do (0.96); over seven frames they agree
less (0.92): short closures begin to fill."""

SMALLEST_OPENING = 0.5
"""mm: lips closer than this show nothing between them."""

_LIPS = (*OUTER_LIPS, *INNER_LIPS)
_INNER_PAIRS = tuple(
    (len(OUTER_LIPS) + i, len(OUTER_LIPS) + len(INNER_LIPS) - i) for i in range(1, 10)
)
"""Places in `_LIPS` of inner points that face each other, upper and lower."""


@dataclass(frozen=True)
class LipGeometry:
    """Lips of n frames.

    Parameters
    ----------
    contours : (n, 40, 2) float32
        Outer then inner contour in the mask's frame, mm.
    width, height : (n,) float32
        Extent of the outer contour, mm.
    opening : (n,) float32
        Greatest distance between facing points of the inner contour, mm.
    """

    contours: FloatArray
    width: FloatArray
    height: FloatArray
    opening: FloatArray


def lip_geometry(
    landmarks: npt.NDArray[np.floating],
    poses: Poses,
    mask: Mask,
    camera: Camera,
    numbers: npt.ArrayLike,
    smoothing: int = LIP_SMOOTHING,
) -> LipGeometry:
    """Measure the lips in the mask's frame.

    The contours are smoothed over time; `mesh_mouth_height` is the measure that is not.

    Parameters
    ----------
    landmarks : (n, 468, 2) float
        Face mesh, pixels.
    poses : Poses of length n
    mask, camera
        What was filmed, and how. A landmark is taken to lie as deep as its mask vertex.
    numbers : (n,) int
        Frame numbers, rising; nothing is smoothed across a gap.
    smoothing : int
        Frames of the fit, odd; 1 for none.
    """
    ids = list(_LIPS)
    model = mask.vertices[ids].astype(np.float64)
    contours = np.empty((len(landmarks), len(ids), 2), np.float32)
    for i, points in enumerate(landmarks):
        pose = poses.matrix(i)
        z = model @ pose[2, :3] + pose[2, 3]
        xy = (points[ids, :2] - [camera.cx, camera.cy]) * (z / camera.focal)[:, None]
        contours[i] = ((np.column_stack([xy, z]) - pose[:, 3]) @ pose[:, :3])[:, :2]
    return measured(smoothed_runs(contours, numbers, smoothing))


def measured(contours: npt.NDArray[np.floating]) -> LipGeometry:
    """Measure contours.

    Parameters
    ----------
    contours : (n, 40, 2) float
        Outer then inner contour in the mask's frame, mm.
    """
    lips = np.asarray(contours, dtype=np.float32)
    outer = lips[:, : len(OUTER_LIPS)]
    extent = outer.max(axis=1) - outer.min(axis=1)
    upper, lower = (lips[:, [p[k] for p in _INNER_PAIRS], 1] for k in (0, 1))
    opening = np.maximum((lower - upper).max(axis=1), 0)
    return LipGeometry(lips, extent[:, 0], extent[:, 1], opening)


def mesh_mouth_height(landmarks: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """Mouth height straight from the raw face mesh: the ruler that analysis does not move.

    Parameters
    ----------
    landmarks : (n, 468, 2) float

    Returns
    -------
    (n,) float64
        Extent of the outer contour across the eye line, in parts of the distance between the
        outer eye corners.
    """
    points = np.asarray(landmarks, dtype=np.float64)
    left, right = OUTER_EYE_CORNERS
    eyes = points[:, right] - points[:, left]
    length = np.linalg.norm(eyes, axis=1)
    down = np.stack([-eyes[:, 1], eyes[:, 0]], axis=1) / length[:, None]
    along = np.einsum("npk,nk->np", points[:, list(OUTER_LIPS)], down)
    height: npt.NDArray[np.float64] = (along.max(axis=1) - along.min(axis=1)) / length
    return height


def teeth_and_tongue(
    crop: npt.NDArray[np.uint8], contours: FloatArray, opening: float, patch: MouthPatch
) -> tuple[float, float]:
    """Visibility of teeth and tongue in one crop.

    Inside the inner lip contour a pixel is tooth as far as it is bright and little red, tongue
    as far as it is red and neither dark nor bright, both in relation to the lips of the same
    picture (so that lighting does not count). The visibility is the area of such pixels in
    relation to a fixed one, a tenth of the resting mouth's width squared, at most 1.

    Parameters
    ----------
    crop : (h, w, 3) uint8
    contours : (40, 2) float32
        Outer then inner contour, mm.
    opening : float
        Opening of the inner contour, mm.
    patch : MouthPatch
        What the crop shows.

    Returns
    -------
    teeth, tongue : float
        0..1.
    """
    if opening < SMALLEST_OPENING:
        return 0.0, 0.0
    points = patch.to_crop(contours)
    outer, inner = points[: len(OUTER_LIPS)], points[len(OUTER_LIPS) :]
    shape = crop.shape[:2]
    lips = _filled(outer, shape) * (1 - _filled(inner, shape))
    # The contour is a guess to within a millimetre: stay off the lips themselves.
    inside = _filled(inner, shape, CONTOUR_MARGIN * patch.pixels_per_mm)
    if inside.sum() < 1 or (lips > 0.5).sum() < 4:
        return 0.0, 0.0
    rgb = crop.astype(np.float32) + 1
    light = rgb.mean(axis=2)
    red = rgb[..., 0] / rgb[..., 1]
    # How red, from grey (0) to the lips (1); how bright, in parts of the lips.
    redness = (red - 1) / max(float(np.median(red[lips > 0.5])) - 1, 0.05)
    bright = light / float(np.median(light[lips > 0.5]))
    is_tooth = _step(bright, 0.60, 0.85) * (1 - _step(redness, 0.55, 0.85))
    is_tongue = _step(bright, 0.40, 0.55) * _step(redness, 0.60, 0.90)
    full = 0.1 * (patch.crop_width / 2) ** 2
    teeth, tongue = (float((kind * inside).sum()) / full for kind in (is_tooth, is_tongue))
    return min(1.0, teeth), min(1.0, tongue)


def _filled(
    points: npt.NDArray[np.float64], shape: tuple[int, ...], margin: float = 0.0
) -> FloatArray:
    """Coverage of a polygon, less a margin in pixels: drawn at four times the size and shrunk."""
    big = np.zeros((shape[0] * 4, shape[1] * 4), np.uint8)
    cv2.fillPoly(big, [np.round((points + 0.5) * 4 - 0.5).astype(np.int32)], (255,))
    if margin > 0:
        side = 2 * round(margin * 4) + 1
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        big = np.asarray(cv2.erode(big, disc), dtype=np.uint8)
    small = cv2.resize(big, (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return np.asarray(small / np.float32(255), dtype=np.float32)


def _step(x: FloatArray, low: float, high: float) -> FloatArray:
    t = np.clip((x - low) / (high - low), 0, 1)
    return np.asarray(t * t * (3 - 2 * t), dtype=np.float32)
