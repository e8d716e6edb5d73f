"""The face mask, the camera, and how one is seen by the other.

Conventions, for the whole project:

* **Pictures**: pixel centres at integers, x right, y down, RGB uint8.
* **Space**: millimetres; x right, y down, z away from the camera (OpenCV's camera frame). The
  mask's own frame has its origin at the centre of the face's rigid points and its axes along
  the camera's when the face looks straight into it. A pose maps a mask point X to
  ``R X + t`` in the camera's frame.
* **Texture**: the mouth's crop is the part of the mask inside a rectangle, seen along the
  mask's z axis at one millimetre scale a database. `MouthPatch.grid` gives the mask's surface
  there, as a regular grid of points: the same grid cuts crops out of footage
  (`crop_map`) and carries them into a picture (render/scene.py). The eyes have such a patch of
  their own (database/mask_surface.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float32]

N_VERTICES = 468
"""Vertices of the face mesh (Google's face_landmark model)."""

OUTER_EYE_CORNERS = (33, 263)
"""Mesh points of the outer eye corners, left and right in the picture."""

LEFT_EYE = (33, 246, 161, 160, 159, 158, 157, 173, 133, 155, 154, 153, 145, 144, 163, 7)
RIGHT_EYE = (263, 466, 388, 387, 386, 385, 384, 398, 362, 382, 381, 380, 374, 373, 390, 249)
"""Mesh points of the lids' contours, left and right in the picture, from the outer corners over
the upper lids."""

OUTER_LIPS = (
    *(61, 185, 40, 39, 37, 0, 267, 269, 270, 409),
    *(291, 375, 321, 405, 314, 17, 84, 181, 91, 146),
)
"""Mesh points of the outer lip contour, clockwise in the picture from the left corner."""

INNER_LIPS = (
    *(78, 191, 80, 81, 82, 13, 312, 311, 310, 415),
    *(308, 324, 318, 402, 317, 14, 87, 178, 88, 95),
)
"""Mesh points of the inner lip contour, clockwise in the picture from the left corner."""


@dataclass(frozen=True)
class Camera:
    """A pinhole camera without distortion.

    Parameters
    ----------
    focal : float
        Focal length in pixels.
    cx, cy : float
        Principal point in pixels.
    width, height : int
        Size of the pictures in pixels.
    """

    focal: float
    cx: float
    cy: float
    width: int
    height: int

    @classmethod
    def assumed(cls, width: int, height: int, focal: float | None = None) -> Camera:
        """A camera looking along the picture's middle; the focal length a guess if not given.

        The guess is twice the longer side: the mild telephoto with which heads are filmed.
        """
        f = 2.0 * max(width, height) if focal is None else focal
        return cls(float(f), (width - 1) / 2, (height - 1) / 2, width, height)

    @property
    def matrix(self) -> npt.NDArray[np.float64]:
        """Intrinsics, (3, 3) float64."""
        return np.array([[self.focal, 0, self.cx], [0, self.focal, self.cy], [0, 0, 1]])

    def scaled_to(self, width: int, height: int) -> Camera:
        """The same camera for pictures of another size.

        Scaled by the width; pictures of another shape are taken to be cut evenly at the top and
        the bottom.
        """
        if (width, height) == (self.width, self.height):
            return self
        s = width / self.width
        cy = (self.cy - (self.height - 1) / 2) * s + (height - 1) / 2
        return Camera(self.focal * s, (self.cx + 0.5) * s - 0.5, cy, width, height)


@dataclass(frozen=True)
class Poses:
    """Where the head is, frame by frame.

    Parameters
    ----------
    rotations : (n, 3) float
        Rotation vectors (axis times angle, radians).
    translations : (n, 3) float
        Millimetres.
    """

    rotations: FloatArray
    translations: FloatArray

    def __len__(self) -> int:
        return len(self.rotations)

    def matrix(self, i: int) -> npt.NDArray[np.float64]:
        """Pose i as (3, 4) float64 ``[R | t]``."""
        r, _ = cv2.Rodrigues(np.asarray(self.rotations[i], dtype=np.float64))
        return np.hstack([r, np.asarray(self.translations[i], dtype=np.float64)[:, None]])


@dataclass(frozen=True)
class MouthPatch:
    """The mask's surface around the mouth, and the crop that shows it.

    Parameters
    ----------
    grid : (rows, columns, 3) float32
        Points of the surface in the mask's frame, mm. Corner points lie on the outer edges of
        the crop's corner pixels; rows go down, columns right, evenly in x and y.
    crop_width, crop_height : int
        Size of a crop in pixels.
    """

    grid: FloatArray
    crop_width: int
    crop_height: int

    @property
    def width_mm(self) -> float:
        """Width of the crop in millimetres."""
        return float(self.grid[0, -1, 0] - self.grid[0, 0, 0])

    @property
    def height_mm(self) -> float:
        """Height of the crop in millimetres."""
        return float(self.grid[-1, 0, 1] - self.grid[0, 0, 1])

    @property
    def pixels_per_mm(self) -> float:
        """Scale of the crop."""
        return self.crop_width / self.width_mm

    def to_crop(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Mask points (..., 3) or (..., 2) mm, to crop pixels (..., 2)."""
        origin = self.grid[0, 0, :2].astype(np.float64)
        xy = np.asarray(points, dtype=np.float64)[..., :2]
        sizes = np.array([self.crop_width / self.width_mm, self.crop_height / self.height_mm])
        out: npt.NDArray[np.float64] = (xy - origin) * sizes - 0.5
        return out

    def from_crop(self, points: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
        """Crop pixels (..., 2) to the mask's frame (..., 2), mm: `to_crop` turned round."""
        origin = self.grid[0, 0, :2].astype(np.float64)
        sizes = np.array([self.crop_width / self.width_mm, self.crop_height / self.height_mm])
        out: npt.NDArray[np.float64] = (np.asarray(points, dtype=np.float64) + 0.5) / sizes + origin
        return out


@dataclass(frozen=True)
class Mask:
    """A person's face: mesh vertices and the mouth's patch.

    Parameters
    ----------
    vertices : (468, 3) float32
        Face mesh in the mask's frame, mm.
    patch : MouthPatch
    """

    vertices: FloatArray
    patch: MouthPatch


def project(
    points: npt.NDArray[np.floating],
    pose: npt.NDArray[np.float64],
    camera: Camera,
) -> npt.NDArray[np.float64]:
    """Project mask points into a picture.

    Parameters
    ----------
    points : (..., 3) float
        Mask frame, mm.
    pose : (3, 4) float64
        ``[R | t]``.
    camera : Camera

    Returns
    -------
    (..., 2) float64
        Pixels.
    """
    p = np.asarray(points, dtype=np.float64) @ pose[:, :3].T + pose[:, 3]
    seen = p[..., :2] * (camera.focal / p[..., 2:3])
    return np.asarray(seen + np.array([camera.cx, camera.cy]), dtype=np.float64)


def crop_map(
    patch: MouthPatch, pose: npt.NDArray[np.float64], camera: Camera
) -> npt.NDArray[np.float32]:
    """Where in a picture each pixel of the crop is, for `cv2.remap`.

    The grid is projected exactly and interpolated between its points.

    Returns
    -------
    (crop_height, crop_width, 2) float32
        Picture x and y of every crop pixel.
    """
    corners = project(patch.grid, pose, camera).astype(np.float32)
    rows, columns = corners.shape[:2]
    # Crop pixel centres in units of grid steps.
    gx = (np.arange(patch.crop_width, dtype=np.float32) + 0.5) / patch.crop_width * (columns - 1)
    gy = (np.arange(patch.crop_height, dtype=np.float32) + 0.5) / patch.crop_height * (rows - 1)
    x0 = np.minimum(gx.astype(int), columns - 2)
    y0 = np.minimum(gy.astype(int), rows - 2)
    fx = (gx - x0)[None, :, None].astype(np.float32)
    fy = (gy - y0)[:, None, None].astype(np.float32)
    across = corners[:, x0] * (1 - fx) + corners[:, x0 + 1] * fx
    out: npt.NDArray[np.float32] = across[y0] * (1 - fy) + across[y0 + 1] * fy
    return out


def cut_crop(
    picture: npt.NDArray[np.uint8],
    patch: MouthPatch,
    pose: npt.NDArray[np.float64],
    camera: Camera,
) -> npt.NDArray[np.uint8]:
    """The mouth of a picture, head motion taken out.

    Returns
    -------
    (crop_height, crop_width, 3) uint8
    """
    where = crop_map(patch, pose, camera)
    x, y = np.ascontiguousarray(where[..., 0]), np.ascontiguousarray(where[..., 1])
    cut = cv2.remap(picture, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(cut, dtype=np.uint8)
