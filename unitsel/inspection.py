"""What a database holds, in numbers and in pictures."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from database.phonemes import CLOSURES, N_PHONEMES, N_VISEMES, PHONEMES, SILENCE, VISEMES
from database.reader import UnitDatabase
from database.schema import GuideModel


@dataclass(frozen=True)
class Inspection:
    """Counts and ranges of a database.

    Parameters
    ----------
    path : Path
    units, sequences : int
    fps, seconds : float
        Frame rate; length of all units.
    crop : (width, height)
        Pixels of a mouth picture.
    codec : str
    bytes_per_unit : float
        Mean size of an encoded picture.
    phonemes, visemes : dict of str to int
        Units of each; visemes are named by their number and phonemes.
    missing_phonemes : tuple of str
        Phonemes without any unit.
    ranges : dict of str to (low, median, high)
        1st, 50th and 99th percentile of the parameters, in the units of `database.schema`.
    marks : dict of str to dict
        Of p, b, m and silences (``sil``): ``phones``, and of these those ``found`` closed or at
        rest, in ``both`` sound and lips.
    guides : dict of str to (r of the first PCA weight, r of the mouth height)
        How well each guide predicts speech on clips that were held back from it.
    own_settings : dict
        Settings of the selection that the database carries; empty where it carries none.
    consent : str
        What the person filmed has agreed to, as noted at the build; empty without a note.
    skipped, repaired : tuple of dict
        What the build reported.
    clips : tuple of dict
        Sequences: name, words, units, frames.
    """

    path: Path
    units: int
    sequences: int
    fps: float
    seconds: float
    crop: tuple[int, int]
    codec: str
    bytes_per_unit: float
    phonemes: dict[str, int]
    visemes: dict[str, int]
    missing_phonemes: tuple[str, ...]
    ranges: dict[str, tuple[float, float, float]]
    marks: dict[str, dict[str, int]]
    guides: dict[str, tuple[float, float]]
    own_settings: dict[str, Any]
    consent: str
    skipped: tuple[dict[str, Any], ...]
    repaired: tuple[dict[str, Any], ...]
    clips: tuple[dict[str, Any], ...]

    def as_json(self) -> dict[str, Any]:
        """The inspection for machines."""
        document = dict(vars(self))
        document["path"] = str(self.path)
        for name in ("crop", "missing_phonemes", "skipped", "repaired", "clips"):
            document[name] = list(document[name])
        document["guides"] = {k: list(v) for k, v in self.guides.items()}
        document["ranges"] = {k: list(v) for k, v in self.ranges.items()}
        return document


def inspect_database(database: UnitDatabase) -> Inspection:
    """Count and measure what a database holds.

    Raises
    ------
    DatabaseError
        If it cannot be read.
    """
    units, sequences = database.units, database.sequences
    by_phoneme = np.bincount(units.phoneme, minlength=N_PHONEMES)
    by_viseme = np.bincount(units.viseme, minlength=N_VISEMES)
    measured = {
        "mouth_width": units.mouth_width,
        "mouth_height": units.mouth_height,
        "inner_opening": units.inner_opening,
        "teeth": units.teeth,
        "tongue": units.tongue,
        **{f"pca_{k + 1}": units.pca[:, k] for k in range(min(3, units.pca.shape[1]))},
        **{f"turn_{axis}": units.rotation[:, k] for k, axis in enumerate("xyz")},
        **{f"place_{axis}": units.translation[:, k] for k, axis in enumerate("xyz")},
    }
    patch = database.mask.patch
    report = database.report
    return Inspection(
        path=database.path,
        units=len(database),
        sequences=len(sequences),
        fps=database.fps,
        seconds=len(database) / database.fps,
        crop=(patch.crop_width, patch.crop_height),
        codec=database.codec,
        bytes_per_unit=float(database.picture_lengths.mean()),
        phonemes={p: int(by_phoneme[i]) for i, p in enumerate(PHONEMES)},
        visemes={f"{v} {' '.join(g)}": int(by_viseme[v]) for v, g in enumerate(VISEMES)},
        missing_phonemes=tuple(p for i, p in enumerate(PHONEMES) if by_phoneme[i] == 0),
        ranges={name: _range(values) for name, values in measured.items()},
        marks=_marks(database),
        guides={kind: _skill(database.guide(kind)) for kind in database.guides},
        own_settings=database.selection,
        consent=database.consent,
        skipped=tuple(report.get("skipped", ())),
        repaired=tuple(report.get("repaired", ())),
        clips=tuple(
            {
                "name": sequences.name[s],
                "words": sequences.words[s],
                "units": int(sequences.units[s]),
                "frames": int(sequences.frames[s]),
            }
            for s in range(len(sequences))
        ),
    )


def typical_units(database: UnitDatabase) -> dict[int, int]:
    """For each viseme that occurs, the unit nearest to its mean texture."""
    units = database.units
    found: dict[int, int] = {}
    for viseme in np.unique(units.viseme):
        mine = np.flatnonzero(units.viseme == viseme)
        distance = np.linalg.norm(units.pca[mine] - units.pca[mine].mean(axis=0), axis=1)
        found[int(viseme)] = int(mine[distance.argmin()])
    return found


def extreme_units(database: UnitDatabase) -> dict[str, int]:
    """The units at the ends of each parameter, a hundredth of all units cut off as outliers."""
    units = database.units
    parameters = {
        "mouth width": units.mouth_width,
        "mouth height": units.mouth_height,
        "opening": units.inner_opening,
        "teeth": units.teeth,
        "tongue": units.tongue,
        "first PCA": units.pca[:, 0],
        "second PCA": units.pca[:, 1] if units.pca.shape[1] > 1 else units.pca[:, 0],
    }
    found: dict[str, int] = {}
    for name, values in parameters.items():
        order = np.argsort(values, kind="stable")
        cut = len(order) // 100
        found[f"least {name}"] = int(order[cut])
        found[f"most {name}"] = int(order[len(order) - 1 - cut])
    return found


def _marks(database: UnitDatabase) -> dict[str, dict[str, int]]:
    """Closures and rests that were found, of those spoken."""
    spoken, marks = database.phones.phoneme, database.marks
    of_mark = spoken[marks.phone]
    both = (marks.sound & marks.lips).astype(bool)
    return {
        PHONEMES[p]: {
            "phones": int((spoken == p).sum()),
            "found": int((of_mark == p).sum()),
            "both": int(((of_mark == p) & both).sum()),
        }
        for p in (*sorted(CLOSURES), SILENCE)
    }


def _skill(guide: GuideModel) -> tuple[float, float]:
    """Skill in the first PCA weight and the mouth height (outputs: K weights, width, height...)."""
    return round(float(guide.skill[0]), 3), round(float(guide.skill[-4]), 3)


def _range(values: npt.NDArray[np.floating]) -> tuple[float, float, float]:
    low, middle, high = np.percentile(values, [1, 50, 99])
    return round(float(low), 4), round(float(middle), 4), round(float(high), 4)
