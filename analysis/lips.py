"""Lips as numbers: the face mesh's contours, carried into the mask's frame.

There head motion and distance do not count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from analysis.smoothing import smoothed_runs
from database.mask import INNER_LIPS, OUTER_EYE_CORNERS, OUTER_LIPS, Camera, Mask, Poses

FloatArray = npt.NDArray[np.float32]

LIP_SMOOTHING = 5
"""Frames over which lip contours are smoothed by a parabola. On GRID the smoothed heights agree
with an estimate from pixels alone as well as raw ones do (0.96); over seven frames they agree
less (0.92): short closures begin to fill."""

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
