"""Videos of evaluated sentences: the recording on the left, what was made of it on the right.

The right picture is the recording's own with another mouth, so nothing but the mouth differs. Of a
clip the longest stretch is shown in which the face was seen in every frame. A thin strip above the
pictures names the sides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, cast

import cv2
import numpy as np
import numpy.typing as npt

from database.errors import MediaError, UnitselError
from database.media import probe, read_video
from database.piece import Piece
from database.planes import Planes, rgb_to_planes
from database.reader import UnitDatabase
from database.sound import read_sound
from database.track import frame_count
from database.video_writer import VideoWriter
from render.background import Background
from unitsel.likeness.comparison import Sentence
from unitsel.unit_pictures import UnitPictures

LABELS: Final = ("recorded", "synthesised")
STRIP: Final = 20
"""Rows of the strip; even, as planes need it."""


def video_folder(folder: str | Path) -> Path:
    """The folder, made if only it is missing.

    Raises
    ------
    MediaError
        If it cannot be made.
    """
    path = Path(folder)
    try:
        path.mkdir(exist_ok=True)
    except OSError as error:
        raise MediaError(
            f"{path}: the folder for the videos cannot be made ({error.strerror or error}); choose "
            "another place"
        ) from error
    return path


def write_side_by_side(
    database: UnitDatabase,
    sentences: Sequence[Sentence],
    folder: str | Path,
    *,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[list[Path], list[tuple[str, str]]]:
    """Write an mp4 of each sentence, with the recording's sound.

    Parameters
    ----------
    database : UnitDatabase
    sentences : sequence of Sentence
        Evaluated with ``keep_selections``.
    folder : path
        Videos are named after the clips; one that is there is replaced when the new one is
        complete.
    progress : callable, optional

    Returns
    -------
    written : list of Path
    skipped : list of (clip, reason)
        Clips whose recording cannot be read any more.

    Raises
    ------
    MediaError
        If the folder cannot be made.
    """
    place = video_folder(folder)
    pictures = UnitPictures(database)
    written: list[Path] = []
    skipped: list[tuple[str, str]] = []
    for i, sentence in enumerate(sentences):
        if progress is not None:
            progress("writing videos", i, len(sentences))
        # Names of clips in folders hold slashes.
        path = place / f"{sentence.clip.replace('/', '-')}.mp4"
        try:
            _write(database, pictures, sentence, path)
            written.append(path)
        except UnitselError as error:
            skipped.append((sentence.clip, str(error)))
    if progress is not None:
        progress("writing videos", len(sentences), len(sentences))
    return written, skipped


def _write(database: UnitDatabase, pictures: UnitPictures, sentence: Sentence, path: Path) -> None:
    selection, footage = sentence.selection, sentence.footage
    if selection is None or footage is None:
        raise MediaError(f"{sentence.clip}: the evaluation kept no selection of it to be shown")
    fps, media = database.fps, footage.media
    source = Piece(media, footage.start)
    info = probe(source)
    if path.exists() and path.samefile(media):
        raise MediaError(f"{path}: is the recording itself; name another folder")
    background = Background.from_tracked(media, fps, footage.frames, footage.poses, footage.start)
    first = background.first
    n = min(len(background), max(0, frame_count(selection.duration, fps) - first))
    if n == 0:
        raise MediaError(f"{media}: shows no face while the sentence is said")
    shown = replace(selection, units=selection.units[first : first + n], duration=n / fps)
    height, width = info.height // 2 * 2, info.width // 2 * 2
    strip = rgb_to_planes(_strip(width), info.colour)
    sound = None
    if info.has_sound:
        sound = read_sound(Piece(media, footage.start + first / fps), None)
    made = cast(Iterator[Planes], pictures.draw(shown, background, fps=fps))
    with VideoWriter(path, 2 * width, height + STRIP, fps, sound, colour=info.colour) as video:
        for left, right in zip(_recorded(source, fps, first, n), made, strict=True):
            video.write_planes(_joined(strip, left, right))


def _recorded(source: Piece, fps: float, first: int, n: int) -> Iterator[Planes]:
    for frame in read_video(source, fps):
        if frame.index >= first + n:
            return
        if frame.index >= first:
            yield frame.planes


def _strip(width: int) -> npt.NDArray[np.uint8]:
    """The names of both sides, (STRIP, 2 width, 3) uint8."""
    strip = np.full((STRIP, 2 * width, 3), 24, np.uint8)
    for side, label in enumerate(LABELS):
        place = (side * width + 6, STRIP - 6)
        cv2.putText(
            strip, label, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (225, 225, 225), 1, cv2.LINE_AA
        )
    return strip


def _joined(strip: Planes, left: Planes, right: Planes) -> Planes:
    """Two pictures beside each other, below the strip."""
    y, u, v = (
        np.vstack([getattr(strip, p), np.hstack([getattr(left, p), getattr(right, p)])])
        for p in ("y", "u", "v")
    )
    return Planes(y, u, v)
