"""Selected mouths drawn onto the frames of a background."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from database.mask import cut_crop
from database.media import probe, snap_rate
from database.planes import Planes
from database.reader import UnitDatabase
from database.track import frame_count
from render.background import Background, playback_indices, stream_frames
from render.blend import BlendShape, blend_alpha
from render.colour_transfer import ColourTransfer
from render.compose import composite
from render.scene import Scene
from render.sharpening import sharpen, sharpening_amount
from unitsel.select import Selection

Progress = Callable[[str, int, int], None]

GAIN_MEMORY: Final = 0.3
"""How much of the last frame's colour gain a frame keeps inside a segment: fits flicker."""


class UnitPictures:
    """Draws the mouths of a database.

    Parameters
    ----------
    database : UnitDatabase
    blend : BlendShape, optional
        Where the mouth's picture ends and the background begins.
    """

    def __init__(self, database: UnitDatabase, blend: BlendShape | None = None) -> None:
        self._database = database
        self._blend = blend

    @cached_property
    def _alpha(self) -> npt.NDArray[np.float32]:
        return blend_alpha(self._database.mask, self._blend)

    @cached_property
    def _transfer(self) -> ColourTransfer:
        return ColourTransfer(self._alpha)

    def draw(
        self,
        selection: Selection,
        background: Background,
        *,
        fps: float | Fraction | None = None,
        progress: Progress | None = None,
    ) -> Iterator[Planes]:
        """Draw a selection; see `Synthesizer.render`."""
        db = self._database
        info = probe(background.path)
        camera = db.camera.scaled_to(info.width, info.height)
        rate = float(snap_rate(background.fps if fps is None else fps))
        n = frame_count(selection.duration, rate)
        units = selection.at_rate(rate, n)
        places = playback_indices(len(background), n, background.fps, rate)
        patch = db.mask.patch
        gain: npt.NDArray[np.float32] | None = None
        amount: float | None = None
        with Scene(info.width, info.height, patch, camera, self._alpha) as scene:
            for i, frame in enumerate(stream_frames(background, places)):
                pose = background.poses.matrix(int(places[i]))
                unit = int(units[i])
                crop = db.picture(unit)
                if amount is None:
                    amount = sharpening_amount(scene, frame.rgb, pose, info.colour)
                fitted = self._transfer.field(cut_crop(frame.rgb, patch, pose, camera), crop)
                same_clip = i > 0 and db.units.sequence[unit] == db.units.sequence[units[i - 1]]
                if gain is None or not same_clip:
                    gain = fitted
                else:
                    gain = GAIN_MEMORY * gain + (1 - GAIN_MEMORY) * fitted
                crop = self._transfer.apply(sharpen(crop, amount), gain)
                layer = scene.draw(crop, pose)
                yield composite(frame.planes, layer, info.colour)
                if progress is not None:
                    progress("rendering", i + 1, n)
