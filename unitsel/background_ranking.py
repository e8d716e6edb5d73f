"""Which backgrounds suit best: a mouth at rest, steady light, a head that moves as heads do.

What the background's own mouth says must not show around the mouth that is laid over it. So first
come those whose mouth rests and whose chin keeps still; light, shut eyes and the motion of the head
count too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from analysis.background_tracking import chin_heights, skin_light
from analysis.clip import sha256_of
from analysis.shut_eyes import eye_brightness, shut_share
from database.errors import MediaError
from database.mask import Poses
from database.media import probe, read_video
from database.phonemes import SILENCE
from database.piece import Piece
from database.reader import UnitDatabase
from render.background import longest_run

FloatArray = npt.NDArray[np.float32]

CLOSELY: Final = 12
"""Clips whose chin and light are looked at: the best by mouth, motion and length. All of them
would take a second for each quarter of an hour of footage."""

EYES_SEEN: Final = 6
"""Clips whose frames are read for shut eyes: the best by all else. Reading takes 0.1 s a clip."""

SHUT_COST: Final = 3.0
"""Cost of eyes that are always shut."""

LIGHT_SAMPLES: Final = 5
"""Pictures of a clip in which its light is measured."""

RESTING_MM: Final = 1.0
"""The mouth rests while it is open no wider than at its rest and so much more."""

STILL_CHIN_MM: Final = 1.5
"""Standard deviation of the chin's height that costs as much as a mouth that never rests."""

STEADY_LIGHT: Final = 0.02
"""Standard deviation of the light, as a share of it, that costs as much."""

MOTION_COST: Final = 0.5
"""Cost of a head that moves 2.7 times as fast, or as slow, as is typical."""

LEAST_MOTION: Final = 0.1
"""Motion in parts of what is typical below which a head counts as one that keeps still."""

LONG_ENOUGH: Final = 6.0
"""Seconds from which on a background is no better for being longer."""

SHORT_COST: Final = 0.3
"""Cost of one 2.7 times as short."""

MOUTH_POINT: Final = np.array([0.0, 45.0, 0.0])
"""About where the mouth is, mm in the mask's frame: its motion is the head's."""


@dataclass(frozen=True)
class RankedBackground:
    """A background and how it suits.

    Parameters
    ----------
    name : str
        Of the clip or of the background that was added: `--background` takes it.
    media : Path
    sha256 : str
        Checksum that the media had.
    added : bool
        Whether a user added it.
    place : int
        Number of the clip or of the added background.
    still : bool
        Whether it is a photo.
    seconds : float
    rest : float
        Share of the frames in which its own mouth rests.
    chin : float or None
        Standard deviation of the chin's height, mm; None where it was not looked at.
    light : float or None
        Standard deviation of the light, as a share of it.
    motion : float
        Mean speed of the head at the mouth, mm/s.
    shut : float or None
        Share of the frames with eyes shut or nearly so; None where it was not looked at.
    cost : float
        What it is ranked by; less is better. Clips that were not looked at closely lack the
        costs of chin, light and eyes, and come after those that were.
    """

    name: str
    media: Path
    sha256: str
    added: bool
    place: int
    still: bool
    seconds: float
    rest: float
    chin: float | None
    light: float | None
    motion: float
    shut: float | None = None
    cost: float = 0.0

    @property
    def state(self) -> str:
        """Whether the media are ``there``, ``missing`` or ``changed``."""
        if not self.media.is_file():
            return "missing"
        return "there" if sha256_of(self.media) == self.sha256 else "changed"


def rank_backgrounds(database: UnitDatabase) -> list[RankedBackground]:
    """All backgrounds of a database, the best first.

    Videos that were added come before the clips, and photos last: a head that never moves is
    shown to who asks for it.

    Raises
    ------
    DatabaseError
        If the database cannot be read.
    """
    rest = resting_opening(database)
    clips = _clips(database, rest)
    typical = float(np.median([clip.motion for clip in clips]))
    clips = _ranked(clips, typical)
    near = _ranked([_looked_at(database, clip) for clip in clips[:CLOSELY]], typical)
    near[:EYES_SEEN] = _ranked(_eyes_seen(database, near[:EYES_SEEN]), typical)
    added = _ranked(_added(database, rest), typical)
    moving, still = ([one for one in added if one.still == photo] for photo in (False, True))
    return [*moving, *near, *clips[CLOSELY:], *still]


def resting_opening(database: UnitDatabase) -> float:
    """Inner opening of the person's mouth at rest, mm: the median over silences."""
    units = database.units
    silent = units.phoneme == SILENCE
    return float(np.median(units.inner_opening[silent if silent.any() else slice(None)]))


def head_speeds(rotations: FloatArray, translations: FloatArray) -> npt.NDArray[np.float64]:
    """How far the head moves at the mouth from each pose to the next, mm, (n - 1,)."""
    turned = Rotation.from_rotvec(np.asarray(rotations, np.float64)).apply(MOUTH_POINT)
    return np.asarray(np.linalg.norm(np.diff(turned + translations, axis=0), axis=1))


def _clips(database: UnitDatabase, rest: float) -> list[RankedBackground]:
    units, sequences, fps = database.units, database.sequences, database.fps
    steps = np.append(head_speeds(units.rotation, units.translation), 0.0)
    resting = units.inner_opening <= rest + RESTING_MM
    found = []
    for s in np.flatnonzero(sequences.units):
        n = int(sequences.units[s])
        mine = slice(int(sequences.first_unit[s]), int(sequences.first_unit[s]) + n)
        start, stop = longest_run(units.frame[mine])
        inner = slice(mine.start + start, mine.start + stop)
        speed = steps[inner][:-1].mean() * fps if stop - start > 1 else 0.0
        found.append(
            RankedBackground(
                sequences.name[s],
                Path(sequences.media[s]),
                sequences.sha256[s],
                False,
                int(s),
                False,
                (stop - start) / fps,
                float(resting[inner].mean()),
                None,
                None,
                float(speed),
            )
        )
    return found


def _looked_at(database: UnitDatabase, clip: RankedBackground) -> RankedBackground:
    """The same clip with its chin and its light."""
    units, sequences = database.units, database.sequences
    first, n = int(sequences.first_unit[clip.place]), int(sequences.units[clip.place])
    start, stop = longest_run(units.frame[first : first + n])
    rows = np.arange(first + start, first + stop)
    poses = Poses(units.rotation[rows], units.translation[rows])
    chin = chin_heights(database.landmarks(rows), poses, database.mask, database.camera)
    seen = np.unique(np.linspace(rows[0], rows[-1], LIGHT_SAMPLES).round().astype(int))
    light = [skin_light(database.picture(int(row))) for row in seen]
    return replace(clip, chin=float(chin.std()), light=float(np.std(light)))


def _eyes_seen(database: UnitDatabase, clips: Sequence[RankedBackground]) -> list[RankedBackground]:
    """The same clips with the share of frames in which the eyes are shut."""
    seen = {clip.place: _eye_brightness(database, clip) for clip in clips}
    known = [values for values in seen.values() if values is not None]
    if not known:
        return list(clips)
    usual = float(np.nanmedian(np.concatenate(known)))
    shares = {s: None if v is None else shut_share(v, usual) for s, v in seen.items()}
    return [replace(clip, shut=shares[clip.place]) for clip in clips]


def _eye_brightness(
    database: UnitDatabase, clip: RankedBackground
) -> npt.NDArray[np.float64] | None:
    """Of every frame with a face; None where the clip cannot be read any more."""
    if clip.state != "there":
        return None
    units, mask = database.units, database.mask
    first, n = (
        int(part[clip.place]) for part in (database.sequences.first_unit, database.sequences.units)
    )
    rows = {int(frame): first + i for i, frame in enumerate(units.frame[first : first + n])}
    found = []
    try:
        source = Piece(clip.media, float(database.starts[clip.place]))
        info = probe(source)
        camera = database.camera.scaled_to(info.width, info.height)
        for frame in read_video(source, database.fps):
            if (row := rows.get(frame.index)) is not None:
                pose = Poses(units.rotation[row : row + 1], units.translation[row : row + 1])
                found.append(eye_brightness(frame.planes.y, mask, pose.matrix(0), camera))
            if len(found) == len(rows):
                break
    except MediaError:
        return None
    return np.array(found)


def _added(database: UnitDatabase, rest: float) -> list[RankedBackground]:
    stored = database.backgrounds
    found = []
    for i in range(len(stored)):
        rows, n, fps = stored.rows(i), int(stored.frames[i]), float(stored.fps[i])
        steps = head_speeds(stored.rotation[rows], stored.translation[rows])
        found.append(
            RankedBackground(
                stored.name[i],
                Path(stored.media[i]),
                stored.sha256[i],
                True,
                i,
                bool(stored.still[i]),
                0.0 if stored.still[i] else n / fps,
                float((stored.opening[rows] <= rest + RESTING_MM).mean()),
                float(stored.chin[rows].std()),
                float(stored.light[rows].std()),
                float(steps.mean() * fps) if n > 1 else 0.0,
            )
        )
    return found


def _ranked(found: Sequence[RankedBackground], typical: float) -> list[RankedBackground]:
    """The same with their costs, the cheapest first."""
    costed = [replace(one, cost=_cost(one, typical)) for one in found]
    return sorted(costed, key=lambda one: (one.cost, one.name))


def _cost(one: RankedBackground, typical: float) -> float:
    pace = max(one.motion / typical, LEAST_MOTION) if typical > 0 else 1.0
    cost = 1 - one.rest + MOTION_COST * abs(float(np.log(pace)))
    if not one.still:
        cost += SHORT_COST * float(np.log(LONG_ENOUGH / min(max(one.seconds, 0.04), LONG_ENOUGH)))
    if one.chin is not None:
        cost += one.chin / STILL_CHIN_MM
    if one.light is not None:
        cost += one.light / STEADY_LIGHT
    if one.shut is not None:
        cost += SHUT_COST * one.shut
    return cost
