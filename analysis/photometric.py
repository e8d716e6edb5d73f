"""The mask's rigid surface, and its texture as footage shows it.

The surface is what speech leaves in place: forehead and brows, the cheeks' upper part, the nose
down to the nostrils; never the lids, the lips or the jaw. It is sampled on a grid along the
mask's frontal plane and cut into regions, each with a light of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.mask import Mask

OUTLINE: Final = (
    *(139, 156, 143, 111, 117, 118, 101, 36, 129, 98, 97, 2, 326, 327, 358, 266, 330, 347, 346),
    *(340, 372, 383, 368, 301, 298, 333, 299, 337, 151, 108, 69, 104, 68, 71),
)
"""Mesh points around the rigid surface, inside the hair."""

EYES: Final = (
    (33, 7, 163, 144, 145, 153, 154, 155, 133, 173, 157, 158, 159, 160, 161, 246),
    (263, 249, 390, 373, 374, 380, 381, 382, 362, 398, 384, 385, 386, 387, 388, 466),
)
"""Mesh points around each eye's opening."""

NOSE: Final = (
    *(193, 168, 417, 351, 399, 437, 420, 279, 358, 327, 326, 2, 97, 98, 129, 49, 198, 217),
    *(174, 122),
)
"""Mesh points around the nose."""

LID_MARGIN: Final = 3.0
"""mm around an eye's opening that lids and lashes move."""

REGIONS: Final = ("forehead", "left cheek", "right cheek", "nose")
"""Parts of the surface that turn away from a light together; left and right in the picture."""

REGION_SIZE: Final = 30.0
"""mm: half the extent of a region, roughly."""

TYPICAL_SLOPE: Final = 0.5
"""Of a normal's components across and down, what counts as one."""


@dataclass(frozen=True)
class Surface:
    """Points of the mask's rigid surface.

    Parameters
    ----------
    points : (n, 3) float32
        Mask frame, mm.
    normals : (n, 3) float32
        Unit vectors, out of the face.
    region : (n,) int64
        Place in `REGIONS`.
    place : (n, 4) float32
        Where in its region a point lies and how it is turned, both across and down and from the
        region's mean, in `REGION_SIZE` and `TYPICAL_SLOPE`: what its light depends on.
    spacing : float
        mm between points, along x and y.
    """

    points: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]
    region: npt.NDArray[np.int64]
    place: npt.NDArray[np.float32]
    spacing: float

    def __len__(self) -> int:
        return len(self.points)

    def part(self, chosen: npt.NDArray[np.bool_]) -> Surface:
        """Some of the points."""
        return Surface(
            self.points[chosen],
            self.normals[chosen],
            self.region[chosen],
            self.place[chosen],
            self.spacing,
        )

    def squares(self, side: float) -> npt.NDArray[np.bool_]:
        """A chessboard of squares `side` mm wide: True on the white ones, (n,) bool."""
        cell = np.floor(self.points[:, :2] / side).astype(np.int64)
        return np.asarray(cell.sum(axis=1) % 2 == 0)


def rigid_surface(mask: Mask, spacing: float) -> Surface:
    """Sample the rigid surface of a mask.

    Parameters
    ----------
    mask : Mask
    spacing : float
        mm between points.
    """
    vertices = mask.vertices.astype(np.float64)
    outline = vertices[list(OUTLINE), :2]
    low, high = outline.min(axis=0) - spacing, outline.max(axis=0) + spacing
    columns, rows = np.ceil((high - low) / spacing).astype(int) + 1
    x = low[0] + spacing * np.arange(columns)
    y = low[1] + spacing * np.arange(rows)
    plane = np.stack(np.meshgrid(x, y), axis=-1)

    def filled(polygon: npt.NDArray[np.float64], grow: float = 0.0) -> npt.NDArray[np.bool_]:
        # Drawn in sixteenths of a grid step.
        corners = np.round((polygon - low) / spacing * 16).astype(np.int32)
        canvas = np.zeros((rows, columns), np.uint8)
        cv2.fillPoly(canvas, [corners], (1,), shift=4)
        reach = round(grow / spacing)
        if reach:
            disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
            canvas = np.asarray(cv2.dilate(canvas, disc), dtype=np.uint8)
        return canvas > 0

    kept = filled(outline)
    for eye in EYES:
        kept &= ~filled(vertices[list(eye), :2], LID_MARGIN)
    z = surface_depth(vertices, plane)
    down, across = np.gradient(z, spacing)
    normals = np.stack([across, down, -np.ones_like(z)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    region = np.where(plane[..., 0] < vertices[list(NOSE), 0].mean(), 1, 2)
    eye_line = vertices[[i for eye in EYES for i in eye], 1].mean()
    region[plane[..., 1] < eye_line] = 0
    region[filled(vertices[list(NOSE), :2])] = 3
    points = np.concatenate([plane, z[..., None]], axis=-1)
    place = np.concatenate([plane / REGION_SIZE, normals[..., :2] / TYPICAL_SLOPE], axis=-1)
    for r in range(len(REGIONS)):
        mine = kept & (region == r)
        if mine.any():
            place[mine] -= place[mine].mean(axis=0)
    return Surface(
        points[kept].astype(np.float32),
        normals[kept].astype(np.float32),
        region[kept].astype(np.int64),
        place[kept].astype(np.float32),
        spacing,
    )


def surface_depth(
    vertices: npt.NDArray[np.float64], plane: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Depth of the mesh at points of its frontal plane, a little smoothed.

    Parameters
    ----------
    vertices : (468, 3) float64
        Mask frame, mm.
    plane : (rows, columns, 2) float64
        A regular grid, mm; beyond the mesh the nearest vertex's depth is taken.
    """
    from scipy.interpolate import CloughTocher2DInterpolator, NearestNDInterpolator
    from scipy.ndimage import gaussian_filter

    flat, depth = vertices[:, :2], vertices[:, 2]
    z = CloughTocher2DInterpolator(flat, depth)(plane)
    outside = np.isnan(z)
    if outside.any():
        z[outside] = NearestNDInterpolator(flat, depth)(plane[outside])
    step = float(plane[0, 1, 0] - plane[0, 0, 0])
    return np.asarray(gaussian_filter(z, 1.5 / step))
