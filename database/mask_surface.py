"""Parts of the mask's surface as regular grids: how deep the face is, and where its eyes are."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter

from database.mask import INNER_LIPS, LEFT_EYE, OUTER_LIPS, RIGHT_EYE, Mask, MouthPatch

FloatArray = npt.NDArray[np.float32]

EYES_MARGIN: Final = 18.0
"""Millimetres from the eyes' contours to the edge of their crop."""

GRID_STEP: Final = 5.0
"""Millimetres between the points of the eyes' grid, about."""


def surface_depth(
    vertices: FloatArray, plane: npt.NDArray[np.float64], reach: float
) -> npt.NDArray[np.float64]:
    """Depth of the face at points of its frontal plane: smooth, carried on beyond the face.

    Parameters
    ----------
    vertices : (468, 3) float32
        Face mesh in the mask's frame, mm.
    plane : (rows, columns, 2) float64
        Points in the mask's x and y, mm.
    reach : float
        Millimetres from their middle up to which the mesh is looked at.

    Returns
    -------
    (rows, columns) float64
    """
    from scipy.interpolate import RBFInterpolator  # Slow to load, and seldom needed.

    lips = set(OUTER_LIPS) | set(INNER_LIPS)
    middle = plane.reshape(-1, 2).mean(axis=0)
    near = [
        i
        for i in np.flatnonzero(np.linalg.norm(vertices[:, :2] - middle, axis=1) < reach)
        if i not in lips or i in OUTER_LIPS
    ]
    known = vertices[near].astype(np.float64)
    hull = cv2.convexHull(known[:, :2].astype(np.float32))[:, 0].astype(np.float64)
    inside = _pulled_inside(plane.reshape(-1, 2), hull)
    fit = RBFInterpolator(known[:, :2], known[:, 2], smoothing=20.0, kernel="thin_plate_spline")
    return np.asarray(gaussian_filter(fit(inside).reshape(plane.shape[:2]), 1.0))


def eyes_patch(mask: Mask) -> MouthPatch:
    """The mask's surface around both eyes, and the crop that shows it.

    Parameters
    ----------
    mask : Mask

    Returns
    -------
    MouthPatch
        At the scale of the mouth's; the same conventions hold.
    """
    eyes = mask.vertices[[*LEFT_EYE, *RIGHT_EYE], :2].astype(np.float64)
    low, high = eyes.min(axis=0) - EYES_MARGIN, eyes.max(axis=0) + EYES_MARGIN
    scale = mask.patch.pixels_per_mm
    width, height = (max(8, 4 * round(float(size) * scale / 4)) for size in high - low)
    high = low + np.array([width, height]) / scale
    columns, rows = (max(3, 1 + round(float(size) / GRID_STEP)) for size in high - low)
    plane = np.stack(
        np.meshgrid(np.linspace(low[0], high[0], columns), np.linspace(low[1], high[1], rows)),
        axis=-1,
    )
    z = surface_depth(mask.vertices, plane, reach=0.75 * float((high - low).max()))
    grid = np.concatenate([plane, z[..., None]], axis=-1).astype(np.float32)
    return MouthPatch(grid, width, height)


def _pulled_inside(
    points: npt.NDArray[np.float64], hull: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Points outside a convex polygon moved to the nearest point of its edge."""
    following = np.roll(hull, -1, axis=0)
    edge = following - hull
    t = np.einsum("pek,ek->pe", points[:, None] - hull, edge) / (edge**2).sum(axis=1)
    foot = hull + np.clip(t, 0, 1)[..., None] * edge
    nearest = np.linalg.norm(points[:, None] - foot, axis=2).argmin(axis=1)
    contour = hull.astype(np.float32)[:, None]
    outside = np.array([cv2.pointPolygonTest(contour, (x, y), False) < 0 for x, y in points])
    return np.where(outside[:, None], foot[np.arange(len(points)), nearest], points)
