"""Selected mouths drawn onto the frames of a background."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from database.mask import cut_crop
from database.media import snap_rate
from database.planes import Planes
from database.reader import UnitDatabase
from database.track import frame_count
from render.background import Background
from render.blend import BlendShape, blend_alpha, ring_weights
from render.compose import apply_gain, composite, fit_gain
from render.playback import Playback
from render.scene import Scene
from unitsel.select import Selection

Progress = Callable[[str, int, int], None]

GAIN_MEMORY: Final = 0.7
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
    def _ring(self) -> npt.NDArray[np.float32]:
        return ring_weights(self._alpha)

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
        rate = float(snap_rate(background.fps if fps is None else fps))
        n = frame_count(selection.duration, rate)
        units = selection.at_rate(rate, n)
        patch = db.mask.patch
        gain: npt.NDArray[np.float64] | None = None
        with (
            Playback(background, rate, patch, db.camera, length=n) as played,
            Scene(played.width, played.height, patch, played.camera, self._alpha) as scene,
        ):
            for i, frame in zip(range(n), played, strict=False):
                pose, camera = frame.pose, played.camera
                unit = int(units[i])
                crop = db.picture(unit)
                fitted = fit_gain(cut_crop(frame.rgb, patch, pose, camera), crop, self._ring)
                same_clip = i > 0 and db.units.sequence[unit] == db.units.sequence[units[i - 1]]
                if gain is None or not same_clip:
                    gain = fitted
                else:
                    gain = GAIN_MEMORY * gain + (1 - GAIN_MEMORY) * fitted
                layer = scene.draw(apply_gain(crop, gain), pose)
                yield composite(frame.planes, layer, played.colour)
                if progress is not None:
                    progress("rendering", i + 1, n)
