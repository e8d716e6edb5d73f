"""Which video or photo of the person the mouth is laid on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from analysis.background_tracking import TrackedBackground, track_background
from analysis.clip import sha256_of
from analysis.face import FaceFinder
from analysis.models import find_models
from analysis.reference import from_stored
from database.errors import MediaError, RenderError
from database.mask import Poses
from database.media import probe
from database.photo import frame_format
from database.reader import UnitDatabase
from render.background import Background
from unitsel.background_ranking import rank_backgrounds

Progress = Callable[[str, int, int], None]

TRACKING = "tracking the background"
"""Name of the stage for the progress callback."""


def find_background(
    database: UnitDatabase,
    video: str | Path | Sequence[str | Path] | None = None,
    *,
    models: str | Path | None = None,
    progress: Progress | None = None,
) -> Background:
    """Videos or a photo of the person, with the head's pose in each frame.

    Parameters
    ----------
    database : UnitDatabase
    video : path, or sequence of paths, optional
        A video or photo (JPEG, PNG) of the same person; a clip of the database or a background
        that was added to it is known already, and may be given by its name; any other is
        tracked now. Several videos are joined in this order. By default the best one
        (`unitsel.background_ranking`) that is there.
    models : path, optional
        Folder with the face models.
    progress : callable, optional

    Raises
    ------
    RenderError
        If there is no video to use, or photos and videos are to be joined.
    MediaError, FaceError
        If a video cannot be read, or shows no face.
    """
    if video is None:
        return _best(database)
    named = [video] if isinstance(video, str | Path) else list(video)
    known = [_known(database, Path(one)) for one in named]
    unknown = [k for k, one in enumerate(known) if one is None]
    if unknown:
        tracker = BackgroundTracker(database, models)
        for done, k in enumerate(unknown):
            if progress is not None:
                progress(TRACKING, done, len(unknown))
            known[k] = as_background(tracker.track(Path(named[k])))
        if progress is not None:
            progress(TRACKING, len(unknown), len(unknown))
    found = [one for one in known if one is not None]
    stills = [one.path for one in found if one.still]
    if stills and len(found) > 1:
        raise RenderError(
            f"{stills[0]}: is a photo, which cannot be joined to other backgrounds; give it alone"
        )
    return Background.joined(found)


class BackgroundTracker:
    """Follows the head of a database's person through videos that are not in it.

    Parameters
    ----------
    database : UnitDatabase
    models : path, optional
        Folder with the face models.

    Raises
    ------
    ModelError
        If the models are missing.
    """

    def __init__(self, database: UnitDatabase, models: str | Path | None = None) -> None:
        self._database = database
        self._finder = FaceFinder(find_models(models))
        self._reference = from_stored(database.rigid)

    def track(self, path: Path) -> TrackedBackground:
        """Follow the head through a video, or find it in a photo.

        Raises
        ------
        MediaError, FaceError
            If it cannot be read, or shows no face for long enough.
        """
        db = self._database
        frame_format(path)
        return track_background(path, db.mask, db.camera, self._finder, self._reference, fps=db.fps)


def as_background(tracked: TrackedBackground) -> Background:
    """The longest run of frames with a face, ready to be played."""
    if tracked.still:
        return Background(tracked.path, tracked.fps, 0, tracked.poses, still=True)
    return Background.from_tracked(tracked.path, tracked.fps, tracked.numbers, tracked.poses)


def _best(database: UnitDatabase) -> Background:
    """The best ranked one of those whose media are still what they were."""
    ranked = rank_backgrounds(database)
    for one in ranked:
        if one.state == "there":
            return _stored(database, one.place) if one.added else _own(database, one.place)
    raise RenderError(
        f"{database.path}: none of its clips and backgrounds is still where and what it was (the "
        f"first: {ranked[0].media}); name a video of the person (--background VIDEO)"
    )


def _known(database: UnitDatabase, path: Path) -> Background | None:
    """A background whose poses the database holds, by its content or its name."""
    sequences, stored = database.sequences, database.backgrounds
    if not path.exists():
        return _by_name(database, path)
    if path.is_dir():
        raise MediaError(f"{path}: is a folder; give a video or photo in it")
    frame_format(path)
    checksum = sha256_of(path)
    if checksum in stored.sha256:
        return _stored(database, stored.sha256.index(checksum), path)
    if checksum in sequences.sha256:
        # Of the pieces of one long video the longest: less turning back and forth.
        own = [i for i, known in enumerate(sequences.sha256) if known == checksum]
        return _own(database, max(own, key=lambda i: int(sequences.units[i])), path)
    return None


def _by_name(database: UnitDatabase, path: Path) -> Background | None:
    sequences, stored = database.sequences, database.backgrounds
    name = str(path)
    if name in stored.name:
        i = stored.name.index(name)
        media, checksum, what = stored.media[i], stored.sha256[i], "background"
    elif name in sequences.name:
        i = sequences.name.index(name)
        media, checksum, what = sequences.media[i], sequences.sha256[i], "clip"
    else:
        probe(path)  # Tells that there is no such file, as it does for every other.
        return None
    if not Path(media).is_file():
        raise RenderError(
            f"{media}: is the {what} {name} of {database.path}, but is no longer there; put it "
            "back, or name another background"
        )
    if sha256_of(Path(media)) != checksum:
        raise RenderError(
            f"{media}: is the {what} {name} of {database.path}, but was changed since; add it "
            "again, or name another background"
        )
    return _stored(database, i) if what == "background" else _own(database, i)


def _own(database: UnitDatabase, sequence: int, path: Path | None = None) -> Background:
    first = int(database.sequences.first_unit[sequence])
    units = np.arange(first, first + int(database.sequences.units[sequence]))
    return Background.from_tracked(
        path or database.sequences.media[sequence],
        database.fps,
        database.units.frame[units],
        Poses(database.units.rotation[units], database.units.translation[units]),
        float(database.starts[sequence]),
    )


def _stored(database: UnitDatabase, i: int, path: Path | None = None) -> Background:
    stored = database.backgrounds
    rows = stored.rows(i)
    return Background(
        path or Path(stored.media[i]),
        float(stored.fps[i]),
        int(stored.first[i]),
        Poses(stored.rotation[rows], stored.translation[rows]),
        still=bool(stored.still[i]),
    )
