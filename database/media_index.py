"""What reading a video needs to know of its file: found once a file, then kept.

Packets are counted and a few pictures decoded; pieces of one long recording share the result.
A stream that does not name its matrix is taken to have BT.709 from 577 lines up, BT.601 below.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Final

import av
import numpy as np
import numpy.typing as npt
from av.container import InputContainer
from av.video.reformatter import ColorRange
from av.video.stream import VideoStream

from database.container import frames_from, open_media, sound_stream, video_stream
from database.errors import MediaError
from database.interlace import Fields, find_fields, may_be_interlaced
from database.orientation import UPRIGHT, Orientation, orientation_of
from database.planes import Colour, Matrix

STANDARD_RATES: Final = (
    *(Fraction(24000, 1001), Fraction(24), Fraction(25), Fraction(30000, 1001), Fraction(30)),
    *(Fraction(48), Fraction(50), Fraction(60000, 1001), Fraction(60), Fraction(100)),
    *(Fraction(120000, 1001), Fraction(120)),
)
"""Frame rates that are meant when a number is close to one of them."""

LARGEST_RATE: Final = 1000.0
"""Frames a second; containers that claim more give the ticks of a clock."""

SD_LINES: Final = 576
"""Pictures with more lines than this are taken to be BT.709 where nothing is said."""

_MATRICES: Final[dict[int, Matrix]] = {1: "bt709", 4: "bt601", 5: "bt601", 6: "bt601"}
"""Matrices by FFmpeg's number."""
LARGEST_GAP: Final = 10.0
"""Seconds: a larger step between two frames, or one back, is a broken clock, not a pause."""

LOOKED_AT: Final = 12
"""Frames of each stretch that is searched for interlacing."""

STRETCHES: Final = (0.0, 0.35, 0.7)
"""Where those stretches begin, in parts of the duration."""


@dataclass(frozen=True)
class MediaIndex:
    """A video file, as stored.

    Parameters
    ----------
    width, height : int
        Of the coded pictures, before turning.
    fps : Fraction
        Nominal frame rate.
    duration : float
        Seconds from the first frame to the end of the last.
    stamps : (n,) float64
        Time stamps of the coded frames in seconds, sorted, none twice.
    frames : int
        Coded frames, with or without a time stamp.
    first : float or None
        Time stamp of the first picture that can be decoded; None where it has none.
    steady : bool
        Whether the time stamps can be trusted, so that one may read on from any place.
    sound_rate : int or None
    colour : Colour
    orientation : Orientation
    fields : str
        See `database.interlace.Fields`.
    """

    width: int
    height: int
    fps: Fraction
    duration: float
    stamps: npt.NDArray[np.float64]
    frames: int
    first: float | None
    steady: bool
    sound_rate: int | None
    colour: Colour
    orientation: Orientation
    fields: Fields


def snap_rate(fps: float | Fraction) -> Fraction:
    """The exact frame rate that a number means: 29.97 is 30000/1001.

    Raises
    ------
    MediaError
        If it is not a positive finite number of at most 1000.
    """
    if not math.isfinite(fps) or not 0 < fps <= LARGEST_RATE:
        raise MediaError(f"frame rate {float(fps):g}: must be above 0 and at most 1000")
    nearest = min(STANDARD_RATES, key=lambda rate: abs(float(rate) - fps))
    if abs(float(nearest) / float(fps) - 1) < 2e-4:
        return nearest
    return Fraction(fps).limit_denominator(1001)


def index_of(path: Path) -> MediaIndex:
    """Find out what a video file is, or remember it while the file stays as it is.

    Raises
    ------
    MediaError
        If the file cannot be read, or holds no video.
    """
    try:
        stat = path.stat()
    except OSError:
        return _read_index(path, 0, 0)  # Says what is wrong.
    return _read_index(path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=64)
def _read_index(path: Path, size: int, changed: int) -> MediaIndex:
    with open_media(path) as container:
        stream = video_stream(container)
        if stream is None:
            raise MediaError(f"{path}: holds no video")
        context = stream.codec_context
        width, height = context.width // 2 * 2, context.height // 2 * 2
        if width == 0 or height == 0:
            raise MediaError(f"{path}: its video cannot be decoded; is the file complete?")
        meaning = _colour_of(stream)
        sound = sound_stream(container)
        sound_rate = None if sound is None else int(sound.rate)
        count, stamps, ordered = _packet_times(container, stream)
        fps = _nominal_rate(stream, stamps)
    span = float(stamps[-1] - stamps[0]) if len(stamps) else 0.0
    duration = span + 1 / float(fps) if span > 0 else max(count, 1) / float(fps)
    frame = next(_video_frames(path, None), None)
    first = None if frame is None else frame.time
    gap = float(np.diff(stamps).max()) if len(stamps) > 1 else math.inf
    steady = ordered and first is not None and len(stamps) == count and gap <= LARGEST_GAP
    fields: Fields = "none"
    if frame is not None and may_be_interlaced(height, float(fps), frame.interlaced_frame):
        places = STRETCHES if steady and count > 4 * LOOKED_AT else (0.0,)
        fields = find_fields(
            islice(_video_frames(path, (first or 0.0) + place * duration), LOOKED_AT)
            for place in places
        )
    return MediaIndex(
        width,
        height,
        fps,
        duration,
        stamps,
        count,
        first,
        steady,
        sound_rate,
        meaning,
        UPRIGHT if frame is None else orientation_of(frame),
        fields,
    )


def _packet_times(
    container: InputContainer, stream: VideoStream
) -> tuple[int, npt.NDArray[np.float64], bool]:
    """Number of coded frames, their sorted time stamps, and whether decoding goes forwards."""
    count, stamps, ordered = 0, [], True
    before = -math.inf
    try:
        for packet in container.demux(stream):
            if packet.size == 0:
                continue
            count += 1
            if packet.pts is not None and packet.time_base is not None:
                stamps.append(float(packet.pts * packet.time_base))
            if packet.dts is not None:
                ordered &= packet.dts >= before
                before = packet.dts
    except av.FFmpegError:
        ordered = False  # Damaged further on: what was found stands.
    return count, np.unique(np.array(stamps, dtype=np.float64)), ordered


def _nominal_rate(stream: VideoStream, stamps: npt.NDArray[np.float64]) -> Fraction:
    """The stated rate that fits the time stamps best.

    Containers disagree with themselves (MPEG-1 often states 50 as the mean of 25), and the
    stamps of some are rounded to milliseconds, so that neither is enough alone.
    """
    stated = [stream.guessed_rate, stream.base_rate, stream.average_rate]
    usable = [Fraction(rate) for rate in stated if rate and 1 <= rate <= 240]
    if len(stamps) > 1:
        step = float(np.median(np.diff(stamps)))
        if step > 0 and 1 / step <= LARGEST_RATE:
            if not usable:
                return snap_rate(1 / step)
            return snap_rate(min(usable, key=lambda rate: abs(math.log(float(rate) * step))))
    return snap_rate(usable[0]) if usable else Fraction(25)


def _colour_of(stream: VideoStream) -> Colour:
    context = stream.codec_context
    by_size: Matrix = "bt709" if context.height > SD_LINES else "bt601"
    pix_fmt = context.format
    rgb = pix_fmt is not None and pix_fmt.is_rgb
    full = not rgb and (
        context.color_range == ColorRange.JPEG or (context.pix_fmt or "").startswith("yuvj")
    )
    return Colour(
        _MATRICES.get(context.colorspace, by_size),
        full,
        context.color_primaries,
        context.color_trc,
    )


def _video_frames(path: Path, time: float | None) -> Iterator[av.VideoFrame]:
    for frame in frames_from(path, video_stream, time):
        if isinstance(frame, av.VideoFrame):
            yield frame
