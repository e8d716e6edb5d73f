"""A background without an end: frame after frame with its pose, for as long as is asked.

Long output goes on through frames that are alike (`render.walk`), each such change blended over a
few frames (`render.morph`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from types import TracebackType
from typing import Self

import numpy as np
import numpy.typing as npt

from database.mask import Camera, MouthPatch
from database.media import snap_rate
from database.planes import Colour, Planes, planes_to_rgb
from render.background import Background
from render.background_frames import MEMORY_LIMIT, BackgroundFrames


@dataclass(frozen=True)
class PlayedFrame:
    """A frame of the background as it is shown.

    Parameters
    ----------
    number : int
        Frame of the output, from 0.
    planes : Planes
        Not to be written to.
    pose : (3, 4) float64
        ``[R | t]`` of the head, mm.
    colour : Colour
        Meaning of the planes.
    part, place : int
        Background and frame of it that is shown, or that has the greater share of a blend.
    blended : bool
        Whether it is a blend of two frames.
    """

    number: int
    planes: Planes
    pose: npt.NDArray[np.float64]
    colour: Colour
    part: int
    place: int
    blended: bool = False

    @cached_property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """(height, width, 3) uint8, made on first use."""
        return planes_to_rgb(self.planes, self.colour)


class Playback:
    """An endless iterator over a background's frames at a rate; a context manager.

    Parameters
    ----------
    background : Background
        With the others joined to it.
    fps : float or Fraction
        Frames a second of the output.
    patch : MouthPatch
        Of the person's mask: what the mouth will cover is not compared.
    camera : Camera
        Of the database.
    seed : int
        Of the choice between ways to go on.
    length : int, optional
        Frames that will be taken, where that is known: a background that is long enough is played
        straight on.
    memory : int
        Bytes of decoded frames to keep.

    Attributes
    ----------
    width, height : int
        Of the frames.
    colour : Colour
    camera : Camera
        For the frames.
    notes : tuple of str
        What a user should know of how the background is played on.

    Raises
    ------
    RenderError
        Here, and while it runs if a file has fewer frames than were tracked.
    MediaError
        If a file cannot be read.
    """

    def __init__(
        self,
        background: Background,
        fps: float | Fraction,
        patch: MouthPatch,
        camera: Camera,
        *,
        seed: int = 0,
        length: int | None = None,
        memory: int = MEMORY_LIMIT,
    ) -> None:
        self._parts = background.parts
        self._ratio = background.fps / float(snap_rate(fps))
        self._frames = BackgroundFrames(self._parts, memory)
        form = self._frames.format
        self.width, self.height, self.colour = form.width, form.height, form.colour
        self.camera = camera.scaled_to(form.width, form.height)
        self.notes: tuple[str, ...] = ()
        self._number = 0
        self._patch, self._seed, self._length = patch, seed, length

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[PlayedFrame]:
        return self

    def __next__(self) -> PlayedFrame:
        number = self._number
        self._number += 1
        n = len(self._parts[0])
        # Halves go to the earlier frame, as in database.media.read_video.
        step = int(np.ceil(number * self._ratio - 0.5 - 1e-6))
        period = max(2 * (n - 1), 1)
        place = min(step % period, period - step % period) if n > 1 else 0
        return PlayedFrame(
            number,
            self._frames.planes(0, place),
            self._parts[0].poses.matrix(place),
            self.colour,
            0,
            place,
        )

    def close(self) -> None:
        """Close what is read and forget all frames."""
        self._frames.close()
