"""Pictures and sound into a file, whoever drew them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from database.errors import MediaError
from database.photo import FrameFormat, frame_format
from database.picture_folder import PictureFolder, check_folder
from database.planes import Planes
from database.sound_out import SoundInput
from database.video_codecs import CONTAINERS, find_codec
from database.video_writer import VideoWriter, check_place
from unitsel.ahead import Ahead
from unitsel.provenance import Provenance

DRAWN_AHEAD: Final = 8
"""Frames that are drawn before they are encoded."""

Frame = Planes | npt.NDArray[np.uint8]
"""A picture's planes, or (height, width, 4) RGB and alpha."""


@dataclass(frozen=True)
class Encoding:
    """How a video is written; by default as its file's suffix suggests.

    Parameters
    ----------
    codec : str, optional
        h264, vp9, av1, ffv1; prores4444, vp9 or ffv1 where `alpha`.
    crf : int, optional
        Quality, the codec's own constant rate factor.
    size : (width, height), optional
        Of the pictures; by default the background's.
    alpha : bool
        The mouth alone, transparent around it, for laying over the background elsewhere.
    comment : str, optional
        For the file's tags.
    """

    codec: str | None = None
    crf: int | None = None
    size: tuple[int, int] | None = None
    alpha: bool = False
    comment: str | None = None

    def check(self, path: Path) -> None:
        """Refuse, before the work, a place or choices with which nothing can be written.

        Raises
        ------
        MediaError
            Naming what does not go together.
        """
        if is_folder(path):
            check_folder(path)
            if self.codec is not None or self.crf is not None:
                raise MediaError(f"{path}: pictures in a folder have no codec and no CRF")
            return
        find_codec(path, self.codec, crf=self.crf, alpha=self.alpha)
        check_place(path)


@dataclass(frozen=True)
class Written:
    """A video that was written.

    Parameters
    ----------
    path : Path
    background : Path
    frames : int
    fps : float
    seconds : float
        Length of the video.
    sound_copied : bool
        Whether its sound is the recording's own packets, not encoded again.
    notes : tuple of str
        What a user should know of how the background was played.
    sound_seconds : float, optional
        Length of its sound, if it has any. Less than `seconds` where a recording that was taken
        over as it is ends before the pictures do.
    """

    path: Path
    background: Path
    frames: int
    fps: float
    seconds: float
    sound_copied: bool = False
    notes: tuple[str, ...] = ()
    sound_seconds: float | None = None


def is_folder(path: Path) -> bool:
    """Whether a name without a suffix, or an existing folder, asks for numbered pictures."""
    return path.suffix.lower() not in CONTAINERS and (path.suffix == "" or path.is_dir())


def write_video(
    pictures: Iterable[Frame],
    path: str | Path,
    *,
    background: Path,
    rate: Fraction,
    form: FrameFormat | None = None,
    audio: SoundInput | None = None,
    encoding: Encoding | None = None,
    provenance: Provenance | None = None,
) -> Written:
    """Write pictures that were drawn onto a background.

    They are drawn in a thread, some frames before they are encoded.

    Parameters
    ----------
    pictures : iterable of Planes, or of (height, width, 4) uint8
        Of the encoding's size, else the background's.
    path : path
        Written beside and renamed when complete. A name without a suffix is a folder of numbered
        pictures, which have no sound.
    background : Path
        Video whose size and colours they have.
    rate : Fraction
        Frames a second.
    form : FrameFormat, optional
        Size and colours of the pictures where they are not a video's.
    audio : path, Sound or SoundQueue, optional
    encoding : Encoding, optional
    provenance : Provenance, optional
        For the file's tags.

    Raises
    ------
    MediaError
        If sound or video cannot be read or written.
    """
    path = Path(path)
    encoding = Encoding() if encoding is None else encoding
    _refuse_own_input(path, background, audio)
    form = frame_format(background) if form is None else form
    width, height = encoding.size or (form.width, form.height)
    tags = {} if provenance is None else provenance.tags()
    sink: PictureFolder | VideoWriter
    if is_folder(path):
        encoding.check(path)
        sink = PictureFolder(path, width, height, colour=form.colour, metadata=tags)
    else:
        sink = VideoWriter(
            path,
            width,
            height,
            rate,
            audio,
            colour=form.colour,
            crf=encoding.crf,
            codec=encoding.codec,
            alpha=encoding.alpha,
            metadata=tags,
        )
    with Ahead(pictures, DRAWN_AHEAD, "drawing") as ahead, sink:
        for picture in ahead:
            if isinstance(picture, Planes):
                sink.write_planes(picture)
            else:
                sink.write_rgba(picture)
    written = Written(path, background, sink.frames, float(rate), float(sink.frames / rate))
    if not isinstance(sink, VideoWriter):
        return written
    return replace(written, sound_copied=sink.copies_sound, sound_seconds=sink.sound_seconds)


def _refuse_own_input(output: Path, background: Path, audio: SoundInput | None) -> None:
    refuse_inputs(output, [background, *([audio] if isinstance(audio, str | Path) else [])])


def refuse_inputs(output: Path, sources: Iterable[str | Path]) -> None:
    """Refuse to replace what a video is made from: it could not be made again.

    Raises
    ------
    MediaError
        If the output is one of the sources.
    """
    for source in sources:
        if not (output.exists() and Path(source).exists()):
            continue
        if output.samefile(source):
            raise MediaError(f"{output}: is an input of this video too; name another output")
