"""Video in: frames in order, at a constant rate, with what their samples mean.

Pictures are RGB uint8, or yuv420p planes (database/planes.py). Time zero is the first frame of
the video. Files are read once from front to back and never held whole.

Interpretations made here: a stream that does not name its matrix has BT.709 from 577 lines up
and BT.601 below; matrices other than these two, and RGB, are converted to the one that the
size suggests. Pictures of odd size lose their last column or row, as yuv420p cannot hold it.
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
from av.container import InputContainer
from av.video.reformatter import ColorRange, Colorspace, Interpolation, VideoReformatter
from av.video.stream import VideoStream

from database.container import decoded, open_media, sound_stream, video_stream
from database.errors import MediaError
from database.planes import Colour, Matrix, Planes, planes_to_rgb
from database.sound import Sound, probe_sound_duration, read_sound
from database.track import frame_count

__all__ = [
    "MediaInfo",
    "Sound",
    "VideoFrame",
    "probe",
    "probe_sound_duration",
    "read_sound",
    "read_video",
    "snap_rate",
]

STANDARD_RATES: Final = (
    *(Fraction(24000, 1001), Fraction(24), Fraction(25), Fraction(30000, 1001), Fraction(30)),
    *(Fraction(48), Fraction(50), Fraction(60000, 1001), Fraction(60), Fraction(100)),
    *(Fraction(120000, 1001), Fraction(120)),
)
"""Frame rates that are meant when a number is close to one of them."""

LARGEST_RATE: Final = 1000.0
"""Frames a second; containers that claim more give the ticks of a clock."""

LARGEST_GAP: Final = 10.0
"""Seconds: a larger step between two frames, or one back, is a broken clock, not a pause."""

SD_LINES: Final = 576
"""Pictures with more lines than this are taken to be BT.709 where nothing is said."""

_MATRICES: Final[dict[int, Matrix]] = {1: "bt709", 4: "bt601", 5: "bt601", 6: "bt601"}
"""Matrices by FFmpeg's number."""
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


@dataclass
class _Converter:
    """From decoded frames to planes; holds swscale's state, so one for each file."""

    info: MediaInfo
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
        return Planes(y, u, v)

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


def probe(path: str | Path) -> MediaInfo:
    """Find out what a video file is; its packets are counted, nothing is decoded.

    Raises
    ------
    MediaError
        If the file cannot be read, or holds no video.
    """
    path = Path(path)
    with open_media(path) as container:
        stream = video_stream(container)
        if stream is None:
            raise MediaError(f"{path}: holds no video")
        width, height = stream.codec_context.width // 2 * 2, stream.codec_context.height // 2 * 2
        if width == 0 or height == 0:
            raise MediaError(f"{path}: its video cannot be decoded; is the file complete?")
        colour = _colour_of(stream)
        sound = sound_stream(container)
        rate = None if sound is None else int(sound.rate)
        count, stamps = _packet_times(container, stream)
        fps = float(_nominal_rate(stream, stamps))
        span = float(stamps[-1] - stamps[0]) if len(stamps) else 0.0
        duration = span + 1 / fps if span > 0 else max(count, 1) / fps
    return MediaInfo(path, width, height, fps, duration, count, rate is not None, rate, colour)


def _packet_times(
    container: InputContainer, stream: VideoStream
) -> tuple[int, npt.NDArray[np.float64]]:
    """Number of coded frames, and their sorted time stamps in seconds."""
    count, stamps = 0, []
    try:
        for packet in container.demux(stream):
            if packet.size == 0:
                continue
            count += 1
            if packet.pts is not None and packet.time_base is not None:
                stamps.append(float(packet.pts * packet.time_base))
    except av.FFmpegError:
        pass  # Damaged further on: what was found stands.
    return count, np.unique(np.array(stamps, dtype=np.float64))


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


def read_video(
    path: str | Path, fps: float | Fraction | None = None
) -> Generator[VideoFrame, None, None]:
    """Read a video's frames in order, at a constant rate.

    Frame i is the picture whose time stamp, counted from the first picture's, is nearest to
    ``i / fps``. Videos of variable rate are thereby conformed, other rates converted, and where
    damage has lost a picture its neighbour is repeated, so that later frames keep their time.

    Parameters
    ----------
    path : path
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
    info = probe(path)
    rate = snap_rate(info.fps if fps is None else fps)
    converter = _Converter(info)
    index = 0
    shown: _Picture | None = None
    since = 0.0
    for time, frame in _timed_frames(info):
        if shown is not None:
            # A hair of tolerance, so that rounded time stamps do not decide ties.
            halfway = (since + time) / 2 * float(rate) + 1e-6
            while index <= halfway:
                yield VideoFrame(index, float(index / rate), shown)
                index += 1
        shown, since = _Picture(frame, converter), time
    if shown is None:
        raise MediaError(f"{info.path}: not one frame of its video can be decoded")
    length = frame_count(since + 1 / info.fps, float(rate))
    while index < length:
        yield VideoFrame(index, float(index / rate), shown)
        index += 1


def _timed_frames(info: MediaInfo) -> Iterator[tuple[float, av.VideoFrame]]:
    """Decoded frames with strictly rising times, seconds from the first."""
    step = 1 / info.fps
    shift: float | None = None
    previous = -step
    with open_media(info.path) as container:
        stream = video_stream(container)
        if stream is None:
            raise MediaError(f"{info.path}: holds no video")
        for _, frame in decoded(container, stream):
            if not isinstance(frame, av.VideoFrame):
                continue
            stamp = frame.time
            if shift is None:
                shift = -stamp if stamp is not None else 0.0
            time = previous + step if stamp is None else stamp + shift
            if not previous < time <= previous + LARGEST_GAP:
                shift += previous + step - time
                time = previous + step
            yield time, frame
            previous = time
