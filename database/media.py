"""Video in: frames in order, at a constant rate, with what their samples mean.

Pictures are RGB uint8, or yuv420p planes (database/planes.py), upright as the file asks for
(database/orientation.py) and progressive (database/interlace.py). Time zero is the first frame
of the video, or the start of a piece (database/piece.py). Files are read once from front to
back, pieces from a place before them, and never held whole.

Interpretations made here: matrices other than BT.601 and BT.709, and RGB, are converted to the
one that the size suggests. Pictures of odd size lose their last column or row, as yuv420p
cannot hold it.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Final

import av
import numpy as np
import numpy.typing as npt
from av.video.reformatter import ColorRange, Colorspace, Interpolation, VideoReformatter

from database.container import frames_from, video_stream
from database.errors import MediaError
from database.interlace import deinterlaced
from database.media_index import LARGEST_GAP, MediaIndex, index_of, snap_rate
from database.orientation import UPRIGHT, Orientation
from database.piece import Piece, Source, piece_of
from database.planes import Colour, Matrix, Planes, planes_to_rgb
from database.sound import Sound, probe_sound_duration, read_sound
from database.track import frame_count

__all__ = [
    "MediaInfo",
    "Piece",
    "Sound",
    "VideoFrame",
    "probe",
    "probe_sound_duration",
    "read_sound",
    "read_video",
    "snap_rate",
]

BEYOND: Final = 0.1
"""Seconds that a piece may reach beyond its file: sound and picture seldom end together."""

_FOREIGN: Final = {7: Colorspace.SMPTE240M, 9: Colorspace.BT2020, 10: Colorspace.BT2020}
"""Matrices that are converted away."""
_COLORSPACE: Final[dict[Matrix, Colorspace]] = {
    "bt601": Colorspace.ITU601,
    "bt709": Colorspace.ITU709,
}

_TO_PLANES: Final = Interpolation.BICUBIC | Interpolation.ACCURATE_RND


@dataclass(frozen=True)
class MediaInfo:
    """What a video file is.

    Parameters
    ----------
    path : Path
    width, height : int
        Size of the frames that `read_video` gives: even.
    fps : float
        Nominal frame rate.
    duration : float
        Seconds from the first frame to the end of the last.
    frames : int
        Coded frames of the file (`read_video` may give others, see there).
    has_sound : bool
    sound_rate : int or None
        Samples a second.
    colour : Colour
        Meaning of the planes that `read_video` gives.
    orientation : Orientation
        How the coded pictures are turned by `read_video`.
    interlaced : bool
        Whether they are deinterlaced by it.
    """

    path: Path
    width: int
    height: int
    fps: float
    duration: float
    frames: int
    has_sound: bool
    sound_rate: int | None
    colour: Colour
    orientation: Orientation = UPRIGHT
    interlaced: bool = False


@dataclass
class _Converter:
    """From decoded frames to planes; holds swscale's state, so one for each file."""

    info: MediaIndex
    scaler: VideoReformatter = field(default_factory=VideoReformatter)

    def to_planes(self, frame: av.VideoFrame) -> Planes:
        info = self.info
        frame = self._of_first_size(frame)
        if frame.format.name not in ("yuv420p", "yuvj420p") or frame.colorspace in _FOREIGN:
            full = ColorRange.JPEG if info.colour.full_range else ColorRange.MPEG
            own = _COLORSPACE[info.colour.matrix]
            frame = self.scaler.reformat(
                frame,
                format="yuv420p",
                src_colorspace=int(_FOREIGN.get(frame.colorspace, own)),
                dst_colorspace=own,
                src_color_range=ColorRange.JPEG if frame.format.is_rgb else full,
                dst_color_range=full,
                interpolation=_TO_PLANES,
            )
        y, u, v = (
            np.frombuffer(memoryview(plane), np.uint8)
            .reshape(-1, plane.line_size)[: info.height // step, : info.width // step]
            .copy()
            for plane, step in zip(frame.planes, (1, 2, 2), strict=True)
        )
        return info.orientation.turned(Planes(y, u, v))

    def _of_first_size(self, frame: av.VideoFrame) -> av.VideoFrame:
        """Scale a frame back to the first size where a stream changes it on its way."""
        width, height = self.info.width, self.info.height
        if frame.width // 2 * 2 == width and frame.height // 2 * 2 == height:
            return frame
        return self.scaler.reformat(frame, width, height, interpolation=_TO_PLANES)


class _Picture:
    """One decoded picture, converted when somebody looks."""

    def __init__(self, frame: av.VideoFrame, converter: _Converter) -> None:
        self._frame = frame
        self._converter = converter

    @cached_property
    def rgb(self) -> npt.NDArray[np.uint8]:
        return planes_to_rgb(self.planes, self._converter.info.colour)

    @cached_property
    def planes(self) -> Planes:
        return self._converter.to_planes(self._frame)


@dataclass(frozen=True)
class VideoFrame:
    """A frame of a video at a constant rate.

    Both views are made on first use and kept; frames that show the same picture share them,
    so they are not to be written to.

    Parameters
    ----------
    index : int
        Number of the frame, from 0.
    time : float
        Seconds: its start, ``index / fps``.
    """

    index: int
    time: float
    _picture: _Picture = field(repr=False, compare=False)

    @property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """(height, width, 3) uint8."""
        return self._picture.rgb

    @property
    def planes(self) -> Planes:
        """The picture as yuv420p; of the file itself, bit for bit, where it is 8 bit yuv420p."""
        return self._picture.planes


def probe(source: Source) -> MediaInfo:
    """Find out what a video file, or a piece of one, is.

    Its packets are counted and its first pictures looked at, once while the file stays as it is.

    Raises
    ------
    MediaError
        If the file cannot be read, holds no video, or ends before the piece does.
    """
    piece = piece_of(source)
    index = index_of(piece.path)
    if piece.start >= index.duration:
        raise MediaError(
            f"{piece.path}: ends at {index.duration:.2f} s, before the piece that starts at "
            f"{piece.start:.2f} s"
        )
    if piece.end is not None and piece.end > index.duration + BEYOND:
        raise MediaError(
            f"{piece.path}: ends at {index.duration:.2f} s, before the end of the piece at "
            f"{piece.end:.2f} s"
        )
    end = min(index.duration, index.duration if piece.end is None else piece.end)
    frames = index.frames
    if not piece.whole and len(index.stamps):
        inside = index.stamps - index.stamps[0] + 1e-6
        frames = int(np.count_nonzero((inside >= piece.start) & (inside < end)))
    return MediaInfo(
        piece.path,
        *index.orientation.size(index.width, index.height),
        float(index.fps),
        end - piece.start,
        frames,
        index.sound_rate is not None,
        index.sound_rate,
        index.colour,
        index.orientation,
        index.fields != "none",
    )


def read_video(
    source: Source, fps: float | Fraction | None = None
) -> Generator[VideoFrame, None, None]:
    """Read a video's frames in order, at a constant rate, upright and progressive.

    Frame i is the picture whose time stamp, counted from the start of the piece (of a whole
    file: from the first picture's), is nearest to ``i / fps``. Videos of variable rate are
    thereby conformed, other rates converted, and where damage has lost a picture its neighbour
    is repeated, so that later frames keep their time.

    Parameters
    ----------
    source : path or Piece
    fps : float, optional
        Frames a second; by default the nominal rate (`MediaInfo.fps`).

    Yields
    ------
    VideoFrame

    Raises
    ------
    MediaError
        On the first step: if the file cannot be read, holds no video, or no picture of it can
        be decoded.
    """
    piece = piece_of(source)
    info = probe(piece)
    stored = index_of(piece.path)
    rate = snap_rate(info.fps if fps is None else fps)
    limit = math.inf if piece.end is None else frame_count(info.duration, float(rate))
    converter = _Converter(stored)
    index = 0
    shown: _Picture | None = None
    since = 0.0
    for time, frame in _timed_frames(piece, stored):
        if shown is not None:
            # A hair of tolerance, so that rounded time stamps do not decide ties.
            halfway = (since + time) / 2 * float(rate) + 1e-6
            while index <= halfway and index < limit:
                yield VideoFrame(index, float(index / rate), shown)
                index += 1
        if index >= limit:
            return
        shown, since = _Picture(frame, converter), time
    if shown is None:
        raise MediaError(f"{piece}: not one frame of its video can be decoded")
    length = min(limit, frame_count(since + 1 / info.fps, float(rate)))
    while index < length:
        yield VideoFrame(index, float(index / rate), shown)
        index += 1


def _timed_frames(piece: Piece, index: MediaIndex) -> Iterator[tuple[float, av.VideoFrame]]:
    """Decoded frames with strictly rising times, seconds from the piece's start."""
    step = 1 / float(index.fps)
    if piece.start > 0 and index.steady and index.first is not None:
        # Two frames earlier: the picture before the start may be the nearest one, and a
        # deinterlacer looks back.
        wanted = index.first + piece.start - 2.5 * step
        last = -math.inf
        for frame in deinterlaced(_decoded(piece.path, wanted), index.fields):
            time = frame.time
            if time is None or time < wanted or time <= last:
                continue
            last = time
            yield time - index.first - piece.start, frame
        return
    shift: float | None = None
    previous = -step
    for frame in deinterlaced(_decoded(piece.path, None), index.fields):
        stamp = frame.time
        if shift is None:
            shift = -stamp if stamp is not None else 0.0
        time = previous + step if stamp is None else stamp + shift
        if not previous < time <= previous + LARGEST_GAP:
            shift += previous + step - time
            time = previous + step
        yield time - piece.start, frame
        previous = time


def _decoded(path: Path, time: float | None) -> Iterator[av.VideoFrame]:
    for frame in frames_from(path, video_stream, time):
        if isinstance(frame, av.VideoFrame):
            yield frame
