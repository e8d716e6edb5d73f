"""Teeth and tongue as measured beside teeth and tongue as seen by a person.

Tracks the clips of tests/data/articulators.csv as a build does, measures the frames that were
labelled by eye and prints the rank correlations, on the clips that the measure was tuned on and
on those that were kept back, and beside them what the opening of the lips alone would reach.
The corpus is the folder of clips named as the first argument or in UNITSEL_CORPUS.
"""

from __future__ import annotations

import csv
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.stats import rankdata, spearmanr

from analysis.articulators import teeth_and_tongue
from analysis.clip import cut_crops, track_face
from analysis.face import FaceFinder
from analysis.lips import lip_geometry
from analysis.models import find_models
from analysis.person import study_person

LABELS = Path(__file__).parent.parent / "tests" / "data" / "articulators.csv"
KEPT_BACK = 3
"""Every third clip, by name, was kept back from tuning."""


@dataclass(frozen=True)
class Seen:
    """Labelled frames of some clips, and their measures.

    Parameters
    ----------
    labels : (n, 2, 2) float64
        Teeth and tongue by eye, each twice.
    measured : (n, 2) float64
        Teeth and tongue, 0..1.
    opening : (n,) float64
        Opening of the lips, mm.
    kept_back : (n,) bool
        Whether the clip was kept back from tuning.
    milliseconds : float
        Of one measurement, the median.
    """

    labels: npt.NDArray[np.float64]
    measured: npt.NDArray[np.float64]
    opening: npt.NDArray[np.float64]
    kept_back: npt.NDArray[np.bool_]
    milliseconds: float

    def correlation(self, which: int, rows: npt.NDArray[np.bool_] | slice = slice(None)) -> float:
        """Spearman's rank correlation of teeth (0) or tongue (1) with the mean of the labels."""
        by_eye = self.labels[rows, which].mean(axis=-1)
        return float(spearmanr(self.measured[rows, which], by_eye).statistic)

    def tongue_told(self, rows: npt.NDArray[np.bool_] | slice = slice(None)) -> float:
        """How often a frame that shows a tongue measures more of it than one that does not.

        Few frames show one, and ranks among the others mean nothing: the area under the
        curve, 0.5 for guesses.
        """
        shows = self.labels[rows, 1].mean(axis=-1) > 0
        ranks = rankdata(self.measured[rows, 1])
        n, others = int(shows.sum()), int((~shows).sum())
        return float((ranks[shows].sum() - n * (n + 1) / 2) / (n * others))


def labelled_frames() -> list[dict[str, str]]:
    """Read the table of labels, a row a frame."""
    with LABELS.open() as file:
        return list(csv.DictReader(line for line in file if not line.startswith("#")))


def look(corpus: Path, finder: FaceFinder, only_kept_back: bool = False) -> Seen:
    """Measure the labelled frames, or those of the clips that were kept back."""
    rows = labelled_frames()
    clips = sorted({row["clip"] for row in rows})
    person = study_person(sorted(corpus.glob("*.mpg"))[:5], finder)
    mask, camera = person.mask, person.camera
    labels, measured, opening, kept, times = [], [], [], [], []
    for k, clip in enumerate(clips):
        is_kept = k % KEPT_BACK == KEPT_BACK - 1
        if only_kept_back and not is_kept:
            continue
        mine = {int(r["frame"]): r for r in rows if r["clip"] == clip}
        face = track_face(corpus / f"{clip}.mpg", mask, camera, finder)
        lips = lip_geometry(face.landmarks, face.poses, mask, face.camera, face.numbers)
        for i, crop in enumerate(cut_crops(corpus / f"{clip}.mpg", face, mask)):
            row = mine.get(int(face.numbers[i]))
            if row is None:
                continue
            began = time.perf_counter()
            found = teeth_and_tongue(crop, lips.contours[i], float(lips.opening[i]), mask.patch)
            times.append(1e3 * (time.perf_counter() - began))
            measured.append(found)
            labels.append([[float(row[w]), float(row[f"{w}_again"])] for w in ("teeth", "tongue")])
            opening.append(float(lips.opening[i]))
            kept.append(is_kept)
    return Seen(
        np.array(labels),
        np.array(measured),
        np.array(opening),
        np.array(kept),
        float(np.median(times)),
    )


def main() -> int:
    """Print the table; without footage say what is missing."""
    named = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("UNITSEL_CORPUS")
    corpus = Path(named or "../shared/corpus/grid-s1/build")
    if not corpus.is_dir():
        print(f"articulators: no corpus at {corpus}; name one or set UNITSEL_CORPUS")
        return 0
    seen = look(corpus, FaceFinder(find_models()))
    own = [spearmanr(seen.labels[:, w, 0], seen.labels[:, w, 1]).statistic for w in (0, 1)]
    shown = int((seen.labels[:, 1].mean(axis=-1) > 0).sum())
    print(
        f"{len(seen.labels)} frames, {shown} of which show a tongue; "
        f"{seen.milliseconds:.2f} ms a frame"
    )
    print("rank correlation with the eye    frames  teeth  opening alone  tongue  tongue told")
    for name, rows in (
        ("clips that it was tuned on", ~seen.kept_back),
        ("clips kept back", seen.kept_back),
        ("all", np.ones(len(seen.labels), bool)),
        ("all, lips more than 4 mm open", seen.opening > 4),
    ):
        alone = spearmanr(seen.opening[rows], seen.labels[rows, 0].mean(axis=-1)).statistic
        print(
            f"  {name:<30} {rows.sum():6} {seen.correlation(0, rows):6.2f} {alone:14.2f} "
            f"{seen.correlation(1, rows):7.2f} {seen.tongue_told(rows):12.2f}"
        )
    print(f"the eye with itself: teeth {own[0]:.2f}, tongue {own[1]:.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
