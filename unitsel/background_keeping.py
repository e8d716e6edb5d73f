"""Backgrounds put into a database and taken out of it, so that they need not be tracked again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from analysis.background_tracking import TrackedBackground
from analysis.clip import sha256_of
from database.errors import RenderError
from database.photo import frame_format
from database.reader import UnitDatabase, open_database
from database.stored_backgrounds import StoredBackgrounds
from database.writer import store_backgrounds
from render.background import longest_run
from unitsel.backgrounds import TRACKING, BackgroundTracker, Progress


def add_backgrounds(
    path: str | Path,
    videos: Sequence[str | Path],
    *,
    models: str | Path | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Track videos or photos of the person and keep them in a database.

    The database holds the head's poses and where the media are, not the media. One that it holds
    already, by its content, is tracked anew and takes the place of the old one.

    Parameters
    ----------
    path : path
        The database; a copy with the backgrounds replaces it once that is complete.
    videos : sequence of path
    models : path, optional
        Folder with the face models.
    progress : callable, optional

    Returns
    -------
    tuple of str
        Their names, for `--background`: the files' names without extension, with a number where
        that is taken.

    Raises
    ------
    MediaError, FaceError
        If one cannot be read, or shows no face for long enough; nothing is added then.
    DatabaseError
        If the database cannot be read or written.
    """
    with open_database(path) as database:
        kept = database.backgrounds
        taken = {*database.sequences.name}
        files = [Path(video).absolute() for video in videos]
        for file in files:
            frame_format(file)
        tracker = BackgroundTracker(database, models)
        tracked = []
        for done, file in enumerate(files):
            if progress is not None:
                progress(TRACKING, done, len(files))
            tracked.append((sha256_of(file), tracker.track(file)))
        if progress is not None:
            progress(TRACKING, len(files), len(files))
    names = []
    for checksum, one in tracked:
        kept = kept.chosen([i for i in range(len(kept)) if kept.sha256[i] != checksum])
        names.append(_free_name(one.path.stem, taken | {*kept.name}))
        kept = kept.joined(_as_stored(names[-1], checksum, one))
    store_backgrounds(path, kept)
    return tuple(names)


def remove_backgrounds(path: str | Path, names: Sequence[str]) -> None:
    """Take backgrounds out of a database; their media stay where they are.

    Parameters
    ----------
    path : path
        The database; a copy without them replaces it once that is complete.
    names : sequence of str
        Names or files of backgrounds that were added.

    Raises
    ------
    RenderError
        If the database holds none of that name; it is as it was then.
    DatabaseError
        If the database cannot be read or written.
    """
    with open_database(path) as database:
        kept = database.backgrounds
        clips = database.sequences.name
    gone = set()
    for name in names:
        file = str(Path(name).absolute())
        found = {i for i in range(len(kept)) if name == kept.name[i] or file == kept.media[i]}
        if not found and name in clips:
            raise RenderError(
                f"{path}: {name} is a clip that the database was built from; only backgrounds that "
                "were added can be removed"
            )
        if not found:
            held = ", ".join(kept.name) or "none"
            raise RenderError(f"{path}: holds no background {name}; it holds {held}")
        gone |= found
    store_backgrounds(path, kept.chosen([i for i in range(len(kept)) if i not in gone]))


def shape_note(database: UnitDatabase, media: Path) -> str | None:
    """What to say of pictures of another shape than those that the database was built from."""
    form, camera = frame_format(media), database.camera
    if abs(form.width / form.height / (camera.width / camera.height) - 1) < 0.01:
        return None
    return (
        f"{media}: its pictures of {form.width} x {form.height} are of another shape than the "
        f"clips' {camera.width} x {camera.height}; the camera is taken to be the same, cut "
        "evenly at the top and the bottom"
    )


def _free_name(stem: str, taken: set[str]) -> str:
    name, number = stem, 1
    while name in taken:
        number += 1
        name = f"{stem}-{number}"
    return name


def _as_stored(name: str, checksum: str, tracked: TrackedBackground) -> StoredBackgrounds:
    """Keep the longest run of frames with a face."""
    start, stop = longest_run(tracked.numbers)
    run = slice(start, stop)
    return StoredBackgrounds(
        (name,),
        (str(tracked.path),),
        (checksum,),
        np.array([tracked.still], np.uint8),
        np.array([tracked.fps]),
        tracked.numbers[run][:1].astype(np.int32),
        np.array([stop - start], np.int32),
        tracked.poses.rotations[run].astype(np.float32),
        tracked.poses.translations[run].astype(np.float32),
        tracked.opening[run],
        tracked.chin[run],
        tracked.light[run],
    )
