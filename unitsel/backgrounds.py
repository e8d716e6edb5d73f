"""Which video of the person the mouth is laid on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from analysis.clip import sha256_of, track_face
from analysis.face import FaceFinder
from analysis.models import find_models
from analysis.reference import from_stored
from database.errors import RenderError
from database.mask import Poses
from database.media import probe
from database.reader import UnitDatabase
from render.background import Background

Progress = Callable[[str, int, int], None]


def find_background(
    database: UnitDatabase,
    video: str | Path | None = None,
    *,
    models: str | Path | None = None,
    progress: Progress | None = None,
) -> Background:
    """A video of the person, with the head's pose in each frame.

    Parameters
    ----------
    database : UnitDatabase
    video : path, optional
        A video file of the same person; one that the database was built from is known already,
        any other is tracked now. By default the database's steadiest clip.
    models : path, optional
        Folder with the face models.
    progress : callable, optional

    Raises
    ------
    RenderError
        If there is no video to use.
    MediaError, FaceError
        If the video cannot be read, or shows no face.
    """
    sequences = database.sequences
    if video is None:
        return _own_background(database, _steadiest(database))
    path = Path(video)
    probe(path)
    checksum = sha256_of(path)
    if checksum in sequences.sha256:
        # Of the pieces of one long video the longest: less turning back and forth.
        own = [i for i, known in enumerate(sequences.sha256) if known == checksum]
        return _own_background(database, max(own, key=lambda i: int(sequences.units[i])), path)
    if progress is not None:
        progress("tracking the background", 0, 1)
    finder = FaceFinder(find_models(models))
    reference = from_stored(database.rigid)
    face = track_face(path, database.mask, database.camera, finder, reference=reference)
    if progress is not None:
        progress("tracking the background", 1, 1)
    return Background.from_tracked(path, probe(path).fps, face.numbers, face.poses)


def _steadiest(database: UnitDatabase) -> int:
    """The sequence whose head moves least, of those whose footage is still what it was."""
    units, sequences = database.units, database.sequences
    longest = int(sequences.units.max())
    unrest = []
    for first, count in zip(sequences.first_unit, sequences.units, strict=True):
        mine = slice(first, first + count)
        # Turning counts by what it moves at the mouth, about 100 mm from the neck.
        motion = (
            units.translation[mine].std(axis=0)[:2].sum()
            + 100 * units.rotation[mine].std(axis=0).sum()
        )
        unrest.append(float(motion) * longest / max(1, int(count)))
    for s in np.argsort(unrest, kind="stable"):
        media = Path(sequences.media[s])
        if media.is_file() and sha256_of(media) == sequences.sha256[s]:
            return int(s)
    raise RenderError(
        f"{database.path}: no clip that it was built from is still where and what it was "
        f"(the first: {sequences.media[0]}); name a video of the person (--background VIDEO)"
    )


def _own_background(database: UnitDatabase, sequence: int, path: Path | None = None) -> Background:
    first = int(database.sequences.first_unit[sequence])
    units = np.arange(first, first + int(database.sequences.units[sequence]))
    return Background.from_tracked(
        path or database.sequences.media[sequence],
        database.fps,
        database.units.frame[units],
        Poses(database.units.rotation[units], database.units.translation[units]),
        float(database.starts[sequence]),
    )
