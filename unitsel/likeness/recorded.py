"""Recorded sentences as targets: of clips that a database does not hold, or of its own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from analysis.aam_fit import LipFitter
from analysis.align import Aligner
from analysis.clip import analyse_clip
from analysis.corpus import Clip
from analysis.corpus_lips import find_lips
from analysis.face import FaceFinder
from analysis.lips import mesh_mouth_height
from analysis.reference import from_stored
from analysis.texture import describe_clip
from database.mask import Poses
from database.pictures import decode
from database.reader import UnitDatabase
from database.track import PhonemeTrack
from unitsel.likeness.eye_measures import lip_opening

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Footage:
    """Where a recorded sentence is to be seen.

    Parameters
    ----------
    media : Path
    start : float
        Seconds in the file at which frames are counted from 0.
    frames : (n,) int64
        Numbers of the frames with a face, at the database's rate.
    poses : Poses
        Of these.
    """

    media: Path
    start: float
    frames: IntArray
    poses: Poses


@dataclass(frozen=True)
class Target:
    """What a recorded sentence asks for, and what was recorded of it.

    Parameters
    ----------
    clip, words : str
    track : PhonemeTrack
    frames : (n,) int64
        Numbers of the frames with a face, at the database's rate.
    pca : (n, K) float32
        PCA weights, in the database's components and lighting.
    height : (n,) float64
        Mouth height, mm.
    mesh : (n,) float64
        Mouth height of the raw face mesh (`analysis.lips.mesh_mouth_height`).
    opening : (n,) float64
        Opening of the raw mesh's lips (`unitsel.likeness.eye_measures.lip_opening`).
    sound : (steps, 26) float, optional
    footage : Footage, optional
        `database.sound_features.sound_features` of the recording.
    """

    clip: str
    words: str
    track: PhonemeTrack
    frames: npt.NDArray[np.int64]
    pca: npt.NDArray[np.float32]
    height: FloatArray
    mesh: FloatArray
    opening: FloatArray
    sound: npt.NDArray[np.floating] | None = None
    footage: Footage | None = None


def analysed_target(
    database: UnitDatabase, clip: Clip, finder: FaceFinder, aligner: Aligner
) -> Target:
    """Analyse a clip in the database's mask, components and lighting.

    By its lip model, too, where mouths were chosen to be measured by that.

    Raises
    ------
    UnitselError
        Of the kind that says what is wrong with the clip.
    """
    ruled = database.settings.get("lips", {}).get("source") == "aam"
    model = database.lip_model if ruled else None
    analysed = analyse_clip(
        clip,
        database.mask,
        database.camera,
        finder,
        aligner,
        fps=database.fps,
        reference=from_stored(database.rigid),
        codec=None if model is None else database.codec,
    )
    face, lips = analysed.face, analysed.lips
    if model is not None:
        pictures = (decode(data, database.codec) for data in analysed.pictures)
        lips = find_lips(
            LipFitter(model),
            pictures,
            face.landmarks,
            face.poses,
            database.mask,
            face.camera,
            face.numbers,
        ).geometry
    return Target(
        clip.name,
        analysed.alignment.text,
        analysed.alignment.track,
        face.numbers.astype(np.int64),
        describe_clip(analysed.reduced, database.texture),
        lips.height.astype(np.float64),
        mesh_mouth_height(face.landmarks),
        lip_opening(face.landmarks),
        analysed.sound if len(analysed.sound) else None,
        Footage(clip.media, clip.start, face.numbers.astype(np.int64), face.poses),
    )


def stored_target(
    database: UnitDatabase, sequence: int, mesh: FloatArray, opening: FloatArray
) -> Target:
    """A sequence of the database, as it is stored.

    Parameters
    ----------
    database : UnitDatabase
    sequence : int
    mesh, opening : (N,) float64
        Of all units (`unitsel.likeness.rulers.Rulers.mesh`).
    """
    units, sequences = database.units, database.sequences
    first = int(sequences.first_unit[sequence])
    own = slice(first, first + int(sequences.units[sequence]))
    return Target(
        sequences.name[sequence],
        sequences.words[sequence],
        database.sequence_track(sequence),
        units.frame[own].astype(np.int64),
        units.pca[own],
        units.mouth_height[own].astype(np.float64),
        mesh[own],
        opening[own],
        database.sound(sequence),
        Footage(
            Path(sequences.media[sequence]),
            float(database.starts[sequence]),
            units.frame[own].astype(np.int64),
            Poses(units.rotation[own], units.translation[own]),
        ),
    )
