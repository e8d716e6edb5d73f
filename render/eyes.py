"""The eyes of another clip, laid onto the frames of a background.

Blinks and gaze then do not depend on the background: the region around each eye is cut out of
another clip of the person at its poses, head motion taken out, and drawn where the background's
head is, in the background's light, exactly as mouths are (render/colour_transfer.py,
render/scene.py, render/compose.py).
"""

from __future__ import annotations

from fractions import Fraction
from types import TracebackType
from typing import Final, Self

import numpy as np
import numpy.typing as npt

from database.mask import LEFT_EYE, RIGHT_EYE, Camera, Mask, MouthPatch
from database.mask_surface import eyes_patch
from database.planes import Colour, Planes, planes_to_rgb
from render.background import Background
from render.blend import BORDER
from render.colour_transfer import ColourTransfer
from render.compose import composite, cut_from_planes
from render.playback import Playback
from render.scene import Scene
from render.sharpening import sharpen, sharpening_amount

FloatArray = npt.NDArray[np.float32]

SIDE: Final = 10.0
"""Millimetres from an eye's corners outwards to where its region ends."""

ABOVE: Final = 10.0
"""Millimetres from the upper lid up to there: below most of the brow, which moves with the lid."""

BELOW: Final = 12.0
"""Millimetres from the lower lid down to there: the lid's bag is the eye's."""

FEATHER: Final = 7.0
"""Width of the fade, mm."""

POWER: Final = 2.5
"""Form of the regions: 2 is an ellipse, more is squarer."""

GAIN_MEMORY: Final = 0.3
"""How much of the last frame's colour gain a frame keeps."""


def eyes_alpha(mask: Mask, patch: MouthPatch) -> FloatArray:
    """Blend weight of each pixel of the eyes' crop.

    Parameters
    ----------
    mask : Mask
    patch : MouthPatch
        Of `database.mask_surface.eyes_patch`.

    Returns
    -------
    (crop_height, crop_width) float32
        1 on both eyes, falling to 0 around each; exactly 0 at the crop's border.
    """
    inset = (BORDER + 0.5) / patch.pixels_per_mm
    left, top = (float(v) for v in patch.grid[0, 0, :2])
    right, bottom = (float(v) for v in patch.grid[-1, -1, :2])
    x = left + (np.arange(patch.crop_width) + 0.5) / patch.crop_width * (right - left)
    y = top + (np.arange(patch.crop_height) + 0.5) / patch.crop_height * (bottom - top)
    x, y = x[None, :], y[:, None]
    alpha = np.zeros((patch.crop_height, patch.crop_width))
    for eye in (LEFT_EYE, RIGHT_EYE):
        points = mask.vertices[list(eye), :2].astype(np.float64)
        low = np.maximum(points.min(axis=0) - [SIDE, ABOVE], [left + inset, top + inset])
        high = np.minimum(points.max(axis=0) + [SIDE, BELOW], [right - inset, bottom - inset])
        middle, half = (low + high) / 2, (high - low) / 2
        form = (np.abs(x - middle[0]) / half[0]) ** POWER
        form = (form + (np.abs(y - middle[1]) / half[1]) ** POWER) ** (1 / POWER)
        t = np.clip((1 - form) * half.min() / FEATHER, 0, 1)
        alpha = np.maximum(alpha, t * t * (3 - 2 * t))
    return np.asarray(alpha, dtype=np.float32)


class Eyes:
    """A clip's eyes, frame after frame; a context manager.

    Parameters
    ----------
    source : Background
        The clip, with the head's pose in each frame.
    mask : Mask
        Of the person.
    camera : Camera
        Of the database.
    rate : Fraction
        Frames a second of the output.
    width, height : int
        Size of the pictures that are laid on.
    length : int, optional
        Frames that will be asked for, where that is known.

    Raises
    ------
    RenderError
        Here and from `lay`: if OpenGL cannot be started, or the clip has fewer frames than were
        tracked.
    MediaError
        If the clip cannot be read.
    """

    def __init__(
        self,
        source: Background,
        mask: Mask,
        camera: Camera,
        rate: Fraction,
        width: int,
        height: int,
        *,
        length: int | None = None,
    ) -> None:
        self.patch = eyes_patch(mask)
        self.alpha = eyes_alpha(mask, self.patch)
        self._camera = camera.scaled_to(width, height)
        self._transfer = ColourTransfer(self.alpha)
        self._gain: FloatArray | None = None
        self._amount: float | None = None
        self._scene = Scene(width, height, self.patch, self._camera, self.alpha)
        try:
            # What the mouth's patch covers is not compared when the clip goes on: the eyes are.
            self._played = Playback(source, rate, mask.patch, camera, length=length)
        except BaseException:
            self._scene.release()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close what is read, and give back what OpenGL holds."""
        self._played.close()
        self._scene.release()

    def lay(self, planes: Planes, pose: npt.NDArray[np.float64], colour: Colour) -> Planes:
        """Lay the clip's next eyes onto a picture.

        Parameters
        ----------
        planes : Planes
            Left as it is.
        pose : (3, 4) float64
            The head's in this picture.
        colour : Colour
            Meaning of the planes.

        Returns
        -------
        Planes
            New arrays; outside the eyes' regions the same samples.
        """
        shown = next(self._played)
        crop = cut_from_planes(
            shown.planes, shown.colour, self.patch, shown.pose, self._played.camera
        )
        under = cut_from_planes(planes, colour, self.patch, pose, self._camera)
        fitted = self._transfer.field(under, crop)
        if self._gain is not None:
            fitted = GAIN_MEMORY * self._gain + (1 - GAIN_MEMORY) * fitted
        self._gain = fitted
        if self._amount is None:
            frame = planes_to_rgb(planes, colour)
            self._amount = sharpening_amount(self._scene, frame, pose, colour)
        drawn = self._transfer.apply(sharpen(crop, self._amount), fitted)
        return composite(planes, self._scene.draw(drawn, pose), colour)
