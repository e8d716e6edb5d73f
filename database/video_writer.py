"""Video out: every frame at its exact time, with its sound.

Frame i starts at ``i / fps`` exactly: the time base is that of the frame rate, and the rates
that are meant by 29.97 and the like are taken as fractions. Sound starts with the picture and
ends with it. The file is written beside its place and moved there when complete.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import av
import numpy as np
import numpy.typing as npt
from av.container import OutputContainer
from av.video.reformatter import ColorRange, Colorspace, Interpolation, VideoReformatter
from av.video.stream import VideoStream

from database.container import reason
from database.errors import MediaError
from database.media import snap_rate
from database.planes import Colour, Planes, rgb_to_planes
from database.sound_out import CopiedSound, EncodedSound, SoundInput
from database.video_codecs import CONTAINERS, container_of, find_codec

__all__ = ["SUFFIXES", "VideoWriter"]

SUFFIXES: Final = tuple(CONTAINERS)
"""File suffixes that can be written."""

_MATRIX_NUMBERS: Final = {"bt709": 1, "bt601": 6}
_RANGE_NUMBERS: Final = {False: 1, True: 2}
_SPACES: Final = {"bt709": Colorspace.ITU709, "bt601": Colorspace.ITU601}
_EXACT: Final = Interpolation.BICUBIC | Interpolation.ACCURATE_RND | Interpolation.FULL_CHR_H_INT


class VideoWriter:
    """Writes one video; a context manager.

    Leaving the block completes the file and moves it to its place; leaving it through an
    exception removes what was written.

    Parameters
    ----------
    path : path
        Its suffix says the container (`database.video_codecs.CONTAINERS`); its folder exists.
    width, height : int
        Even numbers.
    fps : int, float or Fraction
        29.97 means 30000/1001, and so on.
    sound : path, Sound, SoundQueue or None
        Media file (its sound counts from its video's first frame), samples, or samples to come. A
        file's sound is taken over packet by packet where the container takes its codec, and
        then ends with the video, or earlier if it is shorter. Other sound is encoded, rate and
        channels kept where the encoder has them, and is cut, or lengthened by silence, to the
        video's length.
    colour : Colour
        Meaning of the planes; the stream is marked with it.
    crf : int, optional
        Quality, the encoder's constant rate factor; by default one that is hard to tell from the
        input.
    codec : str, optional
        One of `database.video_codecs.CODECS` that the container takes.
    alpha : bool
        Whether frames are transparent in part, and come as RGBA (`write_rgba`).
    metadata : mapping of str to str, optional
        Tags of the file.

    Raises
    ------
    MediaError
        Here and in every method: if the path, sizes, rate, codec or sound cannot be used, or
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
        sound: SoundInput | None = None,
        *,
        colour: Colour | None = None,
        crf: int | None = None,
        codec: str | None = None,
        alpha: bool = False,
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        self.path = Path(path)
        self.width = width
        self.height = height
        self.fps = snap_rate(fps)
        self.colour = Colour() if colour is None else colour
        self.frames = 0
        """Frames written so far."""
        self._kind = container_of(self.path)
        self._codec = find_codec(self.path, codec, crf=crf, alpha=alpha)
        self._options = self._codec.settings(crf)
        self._metadata = dict(metadata or {})
        check_place(self.path)
        if width < 2 or height < 2 or width % 2 or height % 2:
            raise MediaError(
                f"{self.path}: a picture of {width} x {height} cannot be written; "
                "width and height must be even"
            )
        self._given = sound
        self._copies = isinstance(sound, str | Path) and CopiedSound.possible(
            Path(sound), self._kind
        )
        self._sound: CopiedSound | EncodedSound | None = None
        self._scaler = VideoReformatter()
        self._partial = self.path.with_name(
            f".{self.path.stem}.{os.getpid()}.part{self.path.suffix}"
        )
        self._container: OutputContainer | None = None

    @property
    def copies_sound(self) -> bool:
        """Whether the sound's packets are taken over as they are."""
        return self._copies

    @property
    def sound_seconds(self) -> float | None:
        """Length of the sound that was written, seconds; None without sound."""
        return None if self._sound is None else self._sound.end

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
        self._write(av.VideoFrame.from_ndarray(planes.packed(), format="yuv420p"))

    def write_rgb(self, rgb: npt.NDArray[np.uint8]) -> None:
        """Write the next frame from (height, width, 3) uint8 RGB."""
        self.write_planes(rgb_to_planes(rgb, self.colour))

    def write_rgba(self, rgba: npt.NDArray[np.uint8]) -> None:
        """Write the next frame from (height, width, 4) uint8 RGB and alpha, not premultiplied."""
        if rgba.shape != (self.height, self.width, 4):
            raise MediaError(
                f"{self.path}: frame {self.frames} has shape {rgba.shape}, "
                f"not {(self.height, self.width, 4)}"
            )
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(rgba), format="rgba")
        full = ColorRange.JPEG if self.colour.full_range else ColorRange.MPEG
        self._write(
            self._scaler.reformat(
                frame,
                format=self._codec.pixels,
                dst_colorspace=_SPACES[self.colour.matrix],
                src_color_range=ColorRange.JPEG,
                dst_color_range=ColorRange.JPEG if self._codec.pixels == "bgra" else full,
                interpolation=_EXACT,
            )
        )

    def _write(self, frame: av.VideoFrame) -> None:
        if self._container is None:
            raise MediaError(f"{self.path}: is not open; use the writer in a with statement")
        try:
            frame.pts = self.frames
            frame.time_base = 1 / self.fps
            if frame.format.name != "bgra":
                frame.colorspace = _MATRIX_NUMBERS[self.colour.matrix]
                frame.color_range = _RANGE_NUMBERS[self.colour.full_range]
            self._container.mux(self._video.encode(frame))
            self.frames += 1
            if self._sound is not None:
                self._sound.write(self.frames / self.fps, final=False)
        except (av.FFmpegError, OSError, ValueError) as error:
            raise MediaError(f"{self.path}: cannot be written ({reason(error)})") from error

    def _open(self) -> None:
        # SVT-AV1 tells its life on the terminal otherwise; 1 is errors only.
        os.environ.setdefault("SVT_LOG", "1")
        container = av.open(
            str(self._partial), "w", format=self._kind.format, options=dict(self._kind.options)
        )
        self._container = container
        container.metadata.update(self._metadata)
        video = container.add_stream(self._codec.encoder, rate=self.fps)
        if not isinstance(video, VideoStream):
            raise ValueError(f"{self._codec.encoder} is not a video encoder")
        video.width, video.height, video.pix_fmt = self.width, self.height, self._codec.pixels
        video.codec_context.time_base = 1 / self.fps
        video.codec_context.options = self._options
        if self._codec.pixels != "bgra":
            video.colorspace = _MATRIX_NUMBERS[self.colour.matrix]
            video.color_range = _RANGE_NUMBERS[self.colour.full_range]
            video.color_primaries = self.colour.primaries
            video.color_trc = self.colour.transfer
        self._video = video
        if self._given is not None:
            self._sound = (
                CopiedSound(Path(str(self._given)), container)
                if self._copies
                else EncodedSound(self._given, container, self._kind.sound)
            )
        container.start_encoding()

    def _complete(self) -> None:
        if self.frames == 0:
            raise MediaError(f"{self.path}: no frame was written")
        if self._container is None:
            raise MediaError(f"{self.path}: is not open")
        if self._sound is not None:
            self._sound.write(self.frames / self.fps, final=True)
            self._sound.close()
        self._container.mux(self._video.encode(None))
        self._container.close()
        self._container = None
        self._partial.replace(self.path)

    def _discard(self) -> None:
        if self._sound is not None:
            self._sound.close()
        if self._container is not None:
            # It is removed anyway, and the first error is the one to tell.
            with suppress(av.FFmpegError, OSError, ValueError):
                self._container.close()
            self._container = None
        self._partial.unlink(missing_ok=True)


def check_place(path: Path) -> None:
    """Refuse a place where no file can be written.

    Raises
    ------
    MediaError
        If its folder does not exist or may not be written to, or it is a folder itself.
    """
    if not path.parent.is_dir():
        raise MediaError(f"{path}: the folder {path.parent} does not exist; create it first")
    if path.is_dir():
        raise MediaError(f"{path}: is a folder")
    if not os.access(path.parent, os.W_OK):
        raise MediaError(f"{path}: the folder {path.parent} cannot be written to")
