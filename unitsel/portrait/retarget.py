"""A photo's lips moved as a real person's did: geometry of selected units, laid on another face.

Units of the other person's database are selected for the sentence as for a video of that person.
What is taken of them is not their pictures but their lip contours, without head motion: how far
each point is from where it rests, in parts of the resting mouth's width. That is laid on the
points of the mask that stand for the same vertices of the face mesh, in parts of its own mouth's
width; jaw and chin follow the lower lip.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.aam_points import contours_of_points
from analysis.lips import lip_geometry
from database.errors import SelectionError
from database.mask import INNER_LIPS as MESH_INNER
from database.mask import OUTER_LIPS as MESH_OUTER
from database.mask import Poses
from database.phonemes import VISEME_OF
from database.portrait_mesh import INNER_LIPS, MESH_INDEX, N_MASK, OUTER_LIPS
from database.reader import UnitDatabase
from database.talk_mask import TalkMask
from database.track import PhonemeTrack, frame_count, frame_times
from unitsel.portrait.driver import LipMotion
from unitsel.portrait.keyframes import with_skin
from unitsel.synthesizer import Synthesizer

F64 = npt.NDArray[np.float64]
Progress = Callable[[str, int, int], None]

JAW_SHARE: Final = 0.85
"""Of the lower lip's way down that is the jaw's; the rest is the lip's own."""

MESH_SEES: Final = 0.65
"""How much of a mouth's motion the face mesh sees, about: 0.5 to 0.6 of one that is known
(tests/test_portrait_corpus.py), which real faces may be seen better than. An active appearance
model's points are taken as they are."""

REST_CLIPS: Final = 12
"""Clips whose silences say where the lips rest, at most."""

_JOIN: Final = np.array([0.25, 0.5, 0.25])
"""Over neighbouring frames: joins, and what a face mesh trembles."""

_VERTICES: Final = np.concatenate([OUTER_LIPS, INNER_LIPS])
_CONTOUR: Final = (*MESH_OUTER, *MESH_INNER)
_PLACES: Final = np.array([_CONTOUR.index(int(i)) for i in MESH_INDEX[_VERTICES]])
_LOWER_MIDDLE: Final = _CONTOUR.index(17)
_CORNERS: Final = (_CONTOUR.index(61), _CONTOUR.index(291))


def lips_like(
    database: UnitDatabase,
    track: PhonemeTrack,
    mask: TalkMask,
    fps: float,
    *,
    progress: Progress | None = None,
) -> LipMotion:
    """Move a mask's lips as a recorded person would for a track.

    Parameters
    ----------
    database : UnitDatabase
        Of that person.
    track : PhonemeTrack
    mask : TalkMask
        Of the photo.
    fps : float
        Frames a second of the result.
    progress : callable, optional

    Returns
    -------
    LipMotion
        ``frame_count(track.end, fps)`` frames.

    Raises
    ------
    SelectionError
        If nothing can be selected, or the database holds no frame at rest.
    """
    selection = Synthesizer(database).select(track, progress=progress)
    units = selection.units
    sequence = database.units.sequence
    used = np.unique(sequence[units])
    known = _resting(database, used)
    contours = _contours(database, np.union1d(used, known))
    still = np.concatenate([_of(database, s) for s in known])
    still = still[VISEME_OF[database.units.phoneme[still]] == 0]
    if len(still) == 0:
        raise SelectionError(
            f"{database.path}: holds no silence, so where the lips rest is not known; drive the "
            "portrait without it"
        )
    rest = np.median(contours[still], axis=0)
    width = float(np.linalg.norm(rest[_CORNERS[1]] - rest[_CORNERS[0]]))
    moved = (contours[units] - rest) / width
    moved = _smoothed(moved)
    # At the other rate, and on the other mouth.
    at = (np.arange(len(units)) + 0.5) / selection.fps
    times = frame_times(frame_count(track.end, fps), fps)
    flat = moved.reshape(len(units), -1)
    moved = np.stack([np.interp(times, at, column) for column in flat.T], axis=1).reshape(
        len(times), -1, 2
    )
    own = float(np.linalg.norm(np.diff(mask.normalised[OUTER_LIPS[[0, 10]]], axis=0)))
    moved *= own if _by_model(database) else own / MESH_SEES
    out = np.zeros((len(times), N_MASK, 2))
    out[:, _VERTICES] = moved[:, _PLACES]
    jaw = JAW_SHARE * np.maximum(0.0, moved[:, _LOWER_MIDDLE, 1])
    return LipMotion(with_skin(out, jaw), jaw)


def _of(database: UnitDatabase, sequence: int) -> npt.NDArray[np.int64]:
    """The units of a sequence."""
    first = int(database.sequences.first_unit[sequence])
    return np.arange(first, first + int(database.sequences.units[sequence]))


def _resting(database: UnitDatabase, used: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
    """Sequences that say where the lips rest: those in use, or others where they are too few."""
    others = np.setdiff1d(np.arange(len(database.sequences.units)), used)
    return np.concatenate([used, others])[:REST_CLIPS]


def _by_model(database: UnitDatabase) -> bool:
    """Whether its mouths are measured by the lip model's points, not by the face mesh."""
    ruled = database.settings.get("lips", {}).get("source") == "aam"
    return ruled and database.lips is not None


def _contours(database: UnitDatabase, sequences: npt.NDArray[np.integer]) -> F64:
    """Lip contours of whole sequences in the person's own frame, mm, (N, 40, 2).

    Units of other sequences are not a number.
    """
    units = database.units
    out = np.full((len(units.sequence), len(_CONTOUR), 2), np.nan)
    lips = database.lips if _by_model(database) else None
    for s in sequences:
        mine = _of(database, int(s))
        if lips is not None:
            out[mine] = contours_of_points(lips.points[mine])
            continue
        geometry = lip_geometry(
            database.landmarks(mine),
            Poses(units.rotation[mine], units.translation[mine]),
            database.mask,
            database.camera,
            units.frame[mine],
        )
        out[mine] = geometry.contours
    return out


def _smoothed(moved: F64) -> F64:
    """Over neighbouring frames, ends as they are."""
    if len(moved) < 3:
        return moved
    padded = np.concatenate([moved[:1], moved, moved[-1:]])
    return np.asarray(
        _JOIN[0] * padded[:-2] + _JOIN[1] * padded[1:-1] + _JOIN[2] * padded[2:], dtype=np.float64
    )
