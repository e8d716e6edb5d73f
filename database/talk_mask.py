"""A photo's Talk Mask: the mesh of `database.portrait_mesh` laid over one face."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from database.portrait_mesh import (
    EYE_TRIANGLES,
    FRAME,
    INNER_CORNERS,
    LEFT_EYE,
    LEFT_LID_CREASE,
    LEFT_LOWER_LID,
    LEFT_UPPER_LID,
    LOWER_INNER,
    N_MASK,
    RIGHT_EYE,
    RIGHT_LID_CREASE,
    RIGHT_LOWER_LID,
    RIGHT_UPPER_LID,
    SKIN_TRIANGLES,
    UPPER_INNER,
)

F64 = npt.NDArray[np.float64]

CREASE_FOLLOWS = 0.3
"""How far the crease above a lid follows it down, in parts of the lid's way."""

LOWER_LID_RISES = 0.12
"""What the lower lid does of the way when an eye shuts."""

OVERLAP = 0.06
"""What the upper lid goes too far, so that no chink is left between two polygons."""

FLAT = 1e-4
"""Twice the area, in units, that a triangle may be turned over by and still count as flat."""


@dataclass(frozen=True)
class TalkMask:
    """Where the mask's vertices are in a photo.

    Parameters
    ----------
    vertices : (V, 2) float64
        Pixels of the photo.
    width, height : int
        Size of the photo.
    """

    vertices: F64
    width: int
    height: int

    @cached_property
    def unit(self) -> float:
        """Pixels between the outer eye corners: the mask's unit."""
        return float(np.hypot(*self._across))

    @cached_property
    def _across(self) -> F64:
        return np.asarray(self.vertices[RIGHT_EYE[0]] - self.vertices[LEFT_EYE[0]])

    @cached_property
    def axes(self) -> F64:
        """The mask's x and y axis in pixels, (2, 2): row vectors of one unit's length."""
        x, y = self._across
        return np.array([[x, y], [-y, x]])

    @cached_property
    def origin(self) -> F64:
        """Where the mask's origin lies in the photo, (2,)."""
        return np.asarray((self.vertices[RIGHT_EYE[0]] + self.vertices[LEFT_EYE[0]]) / 2)

    def to_pixels(self, displacements: npt.NDArray[np.floating]) -> F64:
        """Displacements (..., 2) in the mask's frame, to pixels."""
        return np.asarray(np.asarray(displacements, dtype=np.float64) @ self.axes)

    def from_pixels(self, displacements: npt.NDArray[np.floating]) -> F64:
        """Displacements (..., 2) in pixels, to the mask's frame: `to_pixels` turned round."""
        return np.asarray(np.asarray(displacements, dtype=np.float64) @ self.axes.T / self.unit**2)

    @cached_property
    def normalised(self) -> F64:
        """The vertices in the mask's frame, (V, 2)."""
        return self.from_pixels(self.vertices - self.origin)

    @cached_property
    def free(self) -> npt.NDArray[np.bool_]:
        """Which vertices may move, (V,): not the frame, nor what lies on the photo's edge."""
        x, y = self.vertices.T
        inside = (x > 0) & (y > 0) & (x < self.width - 1) & (y < self.height - 1)
        inside[FRAME] = False
        return np.asarray(inside)

    def shut_eyes(self) -> F64:
        """The displacements that shut both eyes, (V, 2): the upper lid on the lower one.

        A wink or a half shut eye is a part of it.
        """
        out = np.zeros((N_MASK, 2))
        at = self.normalised
        for eye, upper, lower, crease in (
            (LEFT_EYE, LEFT_UPPER_LID, LEFT_LOWER_LID, LEFT_LID_CREASE),
            (RIGHT_EYE, RIGHT_UPPER_LID, RIGHT_LOWER_LID, RIGHT_LID_CREASE),
        ):
            corners = at[eye[[0, 7]]]
            along = corners[1] - corners[0]
            below = np.stack([corners[0], *at[lower], corners[1]])
            above = np.stack([corners[0], *at[upper], corners[1]])

            def place(points: F64, start: F64 = corners[0], along: F64 = along) -> F64:
                return np.asarray((points - start) @ along / (along @ along))

            def gap(points: F64, above: F64 = above, below: F64 = below) -> F64:
                # From the upper lid to the lower one, at the points' places along the eye.
                t = place(points)
                ends = [
                    np.stack([np.interp(t, place(lid), lid[:, k]) for k in (0, 1)], axis=-1)
                    for lid in (above, below)
                ]
                return np.asarray(ends[1] - ends[0])

            out[upper] = (1 - LOWER_LID_RISES + OVERLAP) * gap(at[upper])
            out[lower] = -LOWER_LID_RISES * gap(at[lower])
            out[crease] = CREASE_FOLLOWS * gap(at[crease])
        return out

    def close_lips(self) -> F64:
        """The displacements that close the lips of a photo, (V, 2); none where they are closed."""
        out = np.zeros((N_MASK, 2))
        gap = (self.normalised[LOWER_INNER] - self.normalised[UPPER_INNER]) / 2
        out[UPPER_INNER], out[LOWER_INNER] = gap, -gap
        return out

    @property
    def opening(self) -> float:
        """Greatest distance of the inner lips in the photo, in units."""
        gap = self.normalised[LOWER_INNER] - self.normalised[UPPER_INNER]
        return float(np.linalg.norm(gap, axis=1).max())

    @property
    def mouth_width(self) -> float:
        """Distance of the inner corners of the mouth, in units."""
        corners = self.normalised[INNER_CORNERS]
        return float(np.linalg.norm(corners[1] - corners[0]))

    def folded(self) -> int:
        """How many triangles are turned over: some where the face is seen from the side."""
        triangles = np.concatenate([SKIN_TRIANGLES, EYE_TRIANGLES])
        a, b, c = (self.vertices[triangles[:, k]] for k in range(3))
        u, v = b - a, c - a
        area = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / self.unit**2
        return int((area < -FLAT).sum())
