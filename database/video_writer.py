"""Video out: H.264 and AAC in mp4, every frame at its exact time.

Frame i starts at ``i / fps`` exactly: the time base is that of the frame rate, and the rates
that are meant by 29.97 and the like are taken as fractions. Sound starts with the picture and
ends with it. The file is written beside its place and moved there when complete.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import av
import numpy as np
import numpy.typing as npt
from av.audio.frame import AudioFrame
from av.audio.stream import AudioStream
from av.container import OutputContainer
from av.video.stream import VideoStream

from database.container import reason
from database.errors import MediaError
from database.media import snap_rate
from database.planes import Colour, Planes, rgb_to_planes
from database.sound import Sound, iter_sound, sound_format

SUFFIXES: Final = {".mp4": "mp4", ".m4v": "mp4"}
"""File suffixes that can be written, and FFmpeg's name of the container."""

AAC_RATES: Final = (
    *(8000, 11025, 12000, 16000, 22050, 24000, 32000, 44100, 48000, 64000, 88200, 96000),
)
"""Sample rates that AAC has."""

AAC_BITS_PER_CHANNEL: Final = 96_000

AAC_LAYOUTS: Final = frozenset({"mono", "stereo"})
"""Channel layouts that are kept; others are mixed to stereo."""

_MATRIX_NUMBERS: Final = {"bt709": 1, "bt601": 6}
_RANGE_NUMBERS: Final = {False: 1, True: 2}


class VideoWriter:
    """Writes one video; a context manager.

    Leaving the block completes the file and moves it to its place; leaving it through an
    exception removes what was written.

    Parameters
    ----------
    path : path
        Ends in .mp4 or .m4v; its folder exists.
    width, height : int
        Even numbers.
    fps : int, float or Fraction
        29.97 means 30000/1001, and so on.
    sound : path, Sound or None
        Media file (its sound counts from its video's first frame) or samples. Rate and
        channels are kept where AAC has them. It is cut, or lengthened by silence, to the
        length of the video.
    colour : Colour
        Meaning of the planes; the stream is marked with it.
    crf : int
        Quality, x264's constant rate factor: 18 is hard to tell from the input.
    codec : str
        FFmpeg's name of the video encoder.

    Raises
    ------
    MediaError
        Here and in every method: if the path, sizes, rate or sound cannot be used, or
        encoding or writing fails.

    Examples
    --------
    >>> with VideoWriter("out.mp4", 360, 288, 25, "voice.wav") as video:  # doctest: +SKIP
    ...     for planes in pictures:
    ...         video.write_planes(planes)
    """

    def __init__(
        self,
        path: str | Path,
        width: int,
        height: int,
        fps: int | float | Fraction,
        sound: str | Path | Sound | None = None,
        *,
        colour: Colour | None = None,
        crf: int = 18,
        codec: str = "libx264",
    ) -> None:
        self.path = Path(path)
        self.width = width
        self.height = height
        self.fps = snap_rate(fps)
        self.colour = Colour() if colour is None else colour
        self.frames = 0
        """Frames written so far."""
        self._crf = crf
        self._codec = codec
        _check_output(self.path)
        if width < 2 or height < 2 or width % 2 or height % 2:
            raise MediaError(
                f"{self.path}: a picture of {width} x {height} cannot be written as yuv420p; "
                "width and height must be even"
            )
        self._sound = None if sound is None else _SoundSource.of(sound)
        self._partial = self.path.with_name(
            f".{self.path.stem}.{os.getpid()}.part{self.path.suffix}"
        )
        self._container: OutputContainer | None = None

    def __enter__(self) -> Self:
        try:
            self._open()
        except (av.FFmpegError, OSError, ValueError) as error:
            self._discard()
            raise MediaError(f"{self.path}: cannot be written ({reason(error)})") from error
        except BaseException:
            self._discard()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None:
            self._discard()
            return
        try:
            self._complete()
        except (av.FFmpegError, OSError, ValueError) as error:
            self._discard()
            raise MediaError(f"{self.path}: cannot be written ({reason(error)})") from error
        except BaseException:
            self._discard()
            raise

    def write_planes(self, planes: Planes) -> None:
        """Write the next frame from its yuv420p planes, which reach the encoder unaltered."""
        if (planes.width, planes.height) != (self.width, self.height):
            raise MediaError(
                f"{self.path}: frame {self.frames} is {planes.width} x {planes.height}, "
                f"not {self.width} x {self.height}"
            )
        if self._container is None:
            raise MediaError(f"{self.path}: is not open; use the writer in a with statement")
        try:
            frame = av.VideoFrame.from_ndarray(planes.packed(), format="yuv420p")
            frame.pts = self.frames
            frame.time_base = 1 / self.fps
            frame.colorspace = _MATRIX_NUMBERS[self.colour.matrix]
            frame.color_range = _RANGE_NUMBERS[self.colour.full_range]
            self._container.mux(self._video.encode(frame))
            self.frames += 1
            self._write_sound(final=False)
        except (av.FFmpegError, OSError) as error:
            raise MediaError(f"{self.path}: cannot be written ({reason(error)})") from error

    def write_rgb(self, rgb: npt.NDArray[np.uint8]) -> None:
        """Write the next frame from (height, width, 3) uint8 RGB."""
        self.write_planes(rgb_to_planes(rgb, self.colour))

    def _open(self) -> None:
        container = av.open(
            str(self._partial),
            "w",
            format=SUFFIXES[self.path.suffix.lower()],
            options={"movflags": "+faststart"},
        )
        self._container = container
        video = container.add_stream(self._codec, rate=self.fps)
        if not isinstance(video, VideoStream):
            raise ValueError(f"{self._codec} is not a video encoder")
        video.width, video.height, video.pix_fmt = self.width, self.height, "yuv420p"
        video.codec_context.time_base = 1 / self.fps
        video.codec_context.options = {"crf": str(self._crf)}
        video.colorspace = _MATRIX_NUMBERS[self.colour.matrix]
        video.color_range = _RANGE_NUMBERS[self.colour.full_range]
        video.color_primaries = self.colour.primaries
        video.color_trc = self.colour.transfer
        self._video = video
        if self._sound is not None:
            audio = container.add_stream("aac", rate=self._sound.rate)
            if not isinstance(audio, AudioStream):
                raise ValueError("aac is not a sound encoder")
            audio.codec_context.layout = self._sound.layout
            audio.codec_context.format = "fltp"
            audio.codec_context.bit_rate = AAC_BITS_PER_CHANNEL * self._sound.channels
            audio.codec_context.time_base = Fraction(1, self._sound.rate)
            self._audio = audio
        container.start_encoding()

    def _write_sound(self, *, final: bool) -> None:
        """Encode sound up to the end of the last frame written."""
        source = self._sound
        if source is None or self._container is None:
            return
        target = round(self.frames / self.fps * source.rate)
        size = self._audio.codec_context.frame_size or 1024
        while source.place < target:
            n = min(size, target - source.place)
            if n < size and not final:
                return
            frame = AudioFrame.from_ndarray(source.take(n), format="fltp", layout=source.layout)
            frame.pts = source.place - n
            frame.sample_rate = source.rate
            frame.time_base = Fraction(1, source.rate)
            self._container.mux(self._audio.encode(frame))

    def _complete(self) -> None:
        if self.frames == 0:
            raise MediaError(f"{self.path}: no frame was written")
        if self._container is None:
            raise MediaError(f"{self.path}: is not open")
        self._write_sound(final=True)
        self._container.mux(self._video.encode(None))
        if self._sound is not None:
            self._container.mux(self._audio.encode(None))
        self._container.close()
        self._container = None
        self._partial.replace(self.path)

    def _discard(self) -> None:
        if self._container is not None:
            # It is removed anyway, and the first error is the one to tell.
            with suppress(av.FFmpegError, OSError, ValueError):
                self._container.close()
            self._container = None
        self._partial.unlink(missing_ok=True)


class _SoundSource:
    """Samples on demand, then silence without end."""

    def __init__(self, rate: int, layout: str, pieces: Iterator[npt.NDArray[np.float32]]) -> None:
        self.rate = rate
        self.layout = layout
        self.channels = 1 if layout == "mono" else 2
        self.place = 0
        """Samples given out."""
        self._pieces = pieces
        self._held = np.zeros((self.channels, 0), dtype=np.float32)

    @classmethod
    def of(cls, sound: str | Path | Sound) -> _SoundSource:
        if isinstance(sound, Sound):
            rate, layout = sound.rate, "mono"
            if rate not in AAC_RATES:
                raise MediaError(f"sound: {rate} samples a second; AAC has {AAC_RATES}")
            samples = np.clip(np.nan_to_num(sound.samples), -1, 1).astype(np.float32)
            return cls(rate, layout, iter([samples[None]]))
        rate, layout = sound_format(sound)
        if layout not in AAC_LAYOUTS:
            layout = "stereo"
        rate = _aac_rate(rate)
        return cls(rate, layout, iter_sound(sound, rate, layout))

    def take(self, n: int) -> npt.NDArray[np.float32]:
        """Give out the next n samples, (channels, n) float32."""
        pieces = [self._held]
        missing = n - self._held.shape[1]
        while missing > 0:
            piece = next(self._pieces, None)
            if piece is None:
                piece = np.zeros((self.channels, missing), dtype=np.float32)
            pieces.append(piece)
            missing -= piece.shape[1]
        joined = np.concatenate(pieces, axis=1)
        self._held = joined[:, n:]
        self.place += n
        return np.ascontiguousarray(joined[:, :n])


def _aac_rate(rate: int) -> int:
    """Lowest rate of AAC that loses nothing of `rate`."""
    return next((known for known in AAC_RATES if known >= rate), AAC_RATES[-1])


def _check_output(path: Path) -> None:
    if path.suffix.lower() not in SUFFIXES:
        raise MediaError(
            f"{path}: videos are written as {' or '.join(SUFFIXES)}, not {path.suffix or 'so'!r}"
        )
    if not path.parent.is_dir():
        raise MediaError(f"{path}: the folder {path.parent} does not exist; create it first")
    if path.is_dir():
        raise MediaError(f"{path}: is a folder")
    if not os.access(path.parent, os.W_OK):
        raise MediaError(f"{path}: the folder {path.parent} cannot be written to")
