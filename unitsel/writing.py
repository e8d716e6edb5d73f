"""Pictures and sound into a video file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from database.errors import MediaError
from database.photo import frame_format
from database.planes import Planes
from database.sound import Sound
from database.video_writer import VideoWriter


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
    """

    path: Path
    background: Path
    frames: int
    fps: float
    seconds: float


def write_video(
    pictures: Iterable[Planes],
    path: str | Path,
    *,
    background: Path,
    rate: Fraction,
    audio: str | Path | Sound | None = None,
    crf: int = 18,
) -> Written:
    """Write pictures that were drawn onto a background.

    Parameters
    ----------
    pictures : iterable of Planes
        Of the background's size.
    path : path
        Written beside and renamed when complete.
    background : Path
        Video whose size and colours they have.
    rate : Fraction
        Frames a second.
    audio : path or Sound, optional
    crf : int

    Raises
    ------
    MediaError
        If sound or video cannot be read or written.
    """
    _refuse_own_input(Path(path), background, audio)
    info = frame_format(background)
    with VideoWriter(
        path, info.width, info.height, rate, audio, colour=info.colour, crf=crf
    ) as video:
        for planes in pictures:
            video.write_planes(planes)
    return Written(Path(path), background, video.frames, float(rate), video.frames / float(rate))


def _refuse_own_input(output: Path, background: Path, audio: str | Path | Sound | None) -> None:
    """A video that replaced what it was made from could not be made again."""
    for source in (background, None if isinstance(audio, Sound) else audio):
        if source is None or not (output.exists() and Path(source).exists()):
            continue
        if output.samefile(source):
            raise MediaError(f"{output}: is an input of this video too; name another output")
