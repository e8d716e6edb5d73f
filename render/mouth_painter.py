"""A mouth from its decoded picture to the drawn layer, frame after frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.pictures import Picture
from database.planes import Planes, planes_to_rgb
from render.colour_transfer import ColourTransfer
from render.playback import PlayedFrame
from render.scene import MouthLayer, Scene
from render.sharpening import sharpen, sharpening_amount

GAIN_MEMORY: Final = 0.3
"""How much of the last frame's colour gain a frame keeps inside a segment: fits flicker."""


@dataclass(frozen=True)
class DecodedFrame:
    """What a frame is drawn from.

    Parameters
    ----------
    frame : PlayedFrame
        The background's, as it is played.
    planes : Planes
        The same in the size of the output.
    unit : int
        The unit that is shown.
    crop : (crop_height, crop_width, 3) uint8
        Its picture.
    fitted : (rows, columns, 3) float32
        Its gains for this frame (`ColourTransfer.field`).
    """

    frame: PlayedFrame
    planes: Planes
    unit: int
    crop: Picture
    fitted: npt.NDArray[np.float32]


class MouthPainter:
    """Draws the mouths of one video, in the background's light.

    Parameters
    ----------
    scene : Scene
    transfer : ColourTransfer
    sequence : (N,) int
        Sequence of each unit: gains are evened out inside one.
    """

    def __init__(
        self, scene: Scene, transfer: ColourTransfer, sequence: npt.NDArray[np.integer]
    ) -> None:
        self._scene = scene
        self._transfer = transfer
        self._sequence = sequence
        self._gain: npt.NDArray[np.float32] | None = None
        self._unit = -1
        self._amount: float | None = None

    def paint(self, decoded: DecodedFrame) -> MouthLayer:
        """Draw the next frame's mouth."""
        same = self._unit >= 0 and self._sequence[decoded.unit] == self._sequence[self._unit]
        if self._gain is None or not same:
            self._gain = decoded.fitted
        else:
            self._gain = GAIN_MEMORY * self._gain + (1 - GAIN_MEMORY) * decoded.fitted
        self._unit = decoded.unit
        pose, colour = decoded.frame.pose, decoded.frame.colour
        if self._amount is None:
            seen = planes_to_rgb(decoded.planes, colour)
            self._amount = sharpening_amount(self._scene, seen, pose, colour)
        crop = self._transfer.apply(sharpen(decoded.crop, self._amount), self._gain)
        return self._scene.draw(crop, pose)
