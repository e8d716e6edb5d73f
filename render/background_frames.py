"""Frames of backgrounds in any order, with a bounded number of them in memory.

Random places of compressed video are slow to reach, so what was decoded is kept, the least
recently shown leaving first; clips of some seconds fit as a whole and are decoded once.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Generator
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from database.media import VideoFrame, read_video
from database.photo import FrameFormat, frame_format, read_photo
from database.piece import Piece
from database.planes import Planes, planes_to_rgb, rgb_to_planes
from render.background import Background

MEMORY_LIMIT: Final = 400_000_000
"""Bytes of decoded frames that are kept."""

READ_ON: Final = 60
"""Frames: a place that is nearer ahead is read on to, not sought."""

SAME_SHAPE: Final = 0.01
"""Backgrounds whose width over height differ by a greater share cannot be joined."""


class BackgroundFrames:
    """The frames of backgrounds that are played together, in the size and colours of the first.

    Parameters
    ----------
    parts : sequence of Background
    memory : int
        Bytes of decoded frames to keep; one frame is kept at least.

    Raises
    ------
    MediaError
        If a file cannot be read.
    RenderError
        If the pictures of one are of another shape than those of the first.
    """

    def __init__(self, parts: tuple[Background, ...], memory: int = MEMORY_LIMIT) -> None:
        self._parts = parts
        self._formats = [frame_format(part.path) for part in parts]
        self.format: FrameFormat = self._formats[0]
        self._kept: OrderedDict[tuple[int, int], Planes] = OrderedDict()
        frame_bytes = self.format.width * self.format.height * 3 // 2
        self._room = max(1, memory // frame_bytes)
        self._reader: Generator[VideoFrame, None, None] | None = None
        self._reads = 0
        self._next = 0
        for part, own in zip(parts, self._formats, strict=True):
            shape = own.width / own.height, self.format.width / self.format.height
            if abs(shape[0] / shape[1] - 1) > SAME_SHAPE:
                raise RenderError(
                    f"{part.path}: its pictures of {own.width} x {own.height} cannot be joined to "
                    f"those of {parts[0].path}, {self.format.width} x {self.format.height}; cut "
                    "them to the same shape, or use one of the two"
                )

    def planes(self, part: int, place: int) -> Planes:
        """One frame.

        Parameters
        ----------
        part : int
            Which of the backgrounds.
        place : int
            Frame of it, from 0, as its poses are counted.

        Raises
        ------
        RenderError
            If the file has fewer frames than were tracked.
        MediaError
            If it cannot be read.
        """
        if self._parts[part].still:
            place = 0
        key = (part, place)
        if key not in self._kept:
            self._read(part, place)
        self._kept.move_to_end(key)
        return self._kept[key]

    def close(self) -> None:
        """Close the file that is being read, and forget all frames."""
        if self._reader is not None:
            self._reader.close()
            self._reader = None
        self._kept.clear()

    def _read(self, part: int, place: int) -> None:
        """Decode up to a frame, keeping what comes by."""
        background = self._parts[part]
        if background.still:
            self._keep(part, 0, rgb_to_planes(read_photo(background.path), self.format.colour))
            return
        ahead = self._reads == part and 0 <= place - self._next <= READ_ON
        if self._reader is None or not ahead:
            self._open(part, place)
        while self._next <= place:
            frame = None if self._reader is None else next(self._reader, None)
            if frame is None:
                self._reader = None
                raise RenderError(
                    f"{background.path}: ends before frame {background.first + place}, which was "
                    "tracked; has the file changed?"
                )
            if frame.index >= self._skip:
                if self._next <= place and (part, self._next) not in self._kept:
                    self._keep(part, self._next, frame.planes)
                self._next += 1

    def _open(self, part: int, place: int) -> None:
        """Start reading at a frame: at the piece's first one where that is near."""
        if self._reader is not None:
            self._reader.close()
        background = self._parts[part]
        self._reads = part
        if place <= READ_ON:
            self._skip, self._next = background.first, 0
            self._reader = read_video(background.source, background.fps)
            return
        # A piece's frames count from its start: frame 0 of this one is the frame wanted.
        start = background.start + (background.first + place) / background.fps
        self._skip, self._next = 0, place
        self._reader = read_video(Piece(background.path, start), background.fps)

    def _keep(self, part: int, place: int, planes: Planes) -> None:
        self._kept[part, place] = self._conformed(part, planes)
        while len(self._kept) > self._room:
            self._kept.popitem(last=False)

    def _conformed(self, part: int, planes: Planes) -> Planes:
        """A frame in the size and colours of the first background."""
        own, wanted = self._formats[part], self.format
        if own.colour != wanted.colour and not self._parts[part].still:
            planes = rgb_to_planes(planes_to_rgb(planes, own.colour), wanted.colour)
        if (planes.width, planes.height) == (wanted.width, wanted.height):
            return planes
        size = (wanted.width, wanted.height)
        half = (wanted.width // 2, wanted.height // 2)
        return Planes(_resized(planes.y, size), _resized(planes.u, half), _resized(planes.v, half))


def _resized(plane: npt.NDArray[np.uint8], size: tuple[int, int]) -> npt.NDArray[np.uint8]:
    smaller = size[0] < plane.shape[1]
    how = cv2.INTER_AREA if smaller else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(plane, size, interpolation=how), dtype=np.uint8)
