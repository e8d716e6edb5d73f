"""What of English a corpus holds, and the sentences that would fill its gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from database.phonemes import N_VISEMES, PHONEMES, SILENCE, VISEME_OF, VISEMES
from unitsel.doctor.english import English, count_diphones

ENOUGH: Final = 3
"""Recordings of a diphone from which on the selection has a choice."""

COMMON: Final = 2e-4
"""Share of English above which a missing diphone is named: one in 5000."""

THIN: Final = 0.25
"""A viseme with less than this part of its share in English is thin."""

FEW_VISEMES: Final = 20
"""Recordings of a viseme below which it is thin, whatever its share."""

NAMED: Final = 100
"""Missing diphones that a document for machines names at most."""


@dataclass(frozen=True)
class Coverage:
    """Diphones of a corpus against English's.

    Parameters
    ----------
    diphones : (43, 43) int64
        Recordings of each.
    frames : (22,) int64, or None
        Frames of each viseme, where they are known.
    english : English
    """

    diphones: npt.NDArray[np.int64]
    frames: npt.NDArray[np.int64] | None
    english: English

    @property
    def phonemes(self) -> npt.NDArray[np.int64]:
        """Recordings of each phoneme, (43,)."""
        # The last phone before an end without silence is no diphone's first.
        return np.asarray(np.maximum(self.diphones.sum(axis=1), self.diphones.sum(axis=0)))

    @property
    def visemes(self) -> npt.NDArray[np.int64]:
        """Recordings of each viseme, (22,)."""
        counts = np.bincount(VISEME_OF, weights=self.phonemes, minlength=N_VISEMES)
        return counts.astype(np.int64)

    def share(self, least: int = 1) -> float:
        """Share of English's diphones, by how often they come, that have `least` recordings."""
        return float(self.english.diphones[self.diphones >= least].sum())

    def viseme_share(self) -> float:
        """Share of English's steps from viseme to viseme that have a recording.

        What the lips do between two sounds; a selection falls back on it where the very
        phonemes were never recorded.
        """
        place = np.ix_(VISEME_OF, VISEME_OF)
        steps = np.zeros((N_VISEMES, N_VISEMES), dtype=np.int64)
        np.add.at(steps, (VISEME_OF[:, None], VISEME_OF[None]), self.diphones)
        return float(self.english.diphones[steps[place] > 0].sum())

    def missing_phonemes(self) -> list[str]:
        """Phonemes of English without a recording, the commonest first."""
        wanted = self.english.phonemes
        order = np.argsort(-wanted, kind="stable")
        return [PHONEMES[p] for p in order if wanted[p] > 0 and self.phonemes[p] == 0]

    def viseme_ratios(self) -> npt.NDArray[np.float64]:
        """Share of each viseme here over its share in English; silence counts as 1, (22,)."""
        counts = self.visemes.astype(np.float64)
        counts[VISEME_OF[SILENCE]] = 0.0
        total, wanted = counts.sum(), self.english.visemes
        ratios = np.ones(N_VISEMES)
        known = wanted > 0
        ratios[known] = counts[known] / max(total, 1.0) / wanted[known]
        return ratios

    def thin_visemes(self) -> list[int]:
        """Visemes with too few recordings (none included), the scarcest first."""
        ratios, counts = self.viseme_ratios(), self.visemes
        thin = (ratios < THIN) | (counts < FEW_VISEMES)
        thin[VISEME_OF[SILENCE]] = False
        thin &= self.english.visemes > 0
        return sorted(np.flatnonzero(thin).tolist(), key=lambda v: (ratios[v], v))

    def gaps(self, below: int = 1) -> list[tuple[int, int]]:
        """Diphones of English recorded less than `below` times, the commonest first."""
        wanted = self.english.diphones
        first, second = np.nonzero((self.diphones < below) & (wanted > 0))
        order = np.argsort(-wanted[first, second], kind="stable")
        return list(zip(first[order].tolist(), second[order].tolist(), strict=True))

    def as_json(self) -> dict[str, Any]:
        """The coverage for machines."""
        wanted = self.english.diphones
        frames = {} if self.frames is None else {"frames": self.frames.tolist()}
        missing = self.gaps()
        return {
            "diphones_recorded": int((self.diphones > 0).sum()),
            "diphones_of_english": int((wanted > 0).sum()),
            "share_of_english": round(self.share(), 4),
            "share_of_english_3_times": round(self.share(ENOUGH), 4),
            "share_of_viseme_steps": round(self.viseme_share(), 4),
            "missing_phonemes": self.missing_phonemes(),
            "visemes": {
                f"{v} {' '.join(VISEMES[v])}": {
                    "recordings": int(n),
                    "ratio_to_english": round(float(r), 3),
                }
                for v, (n, r) in enumerate(zip(self.visemes, self.viseme_ratios(), strict=True))
            },
            **frames,
            "thin_visemes": self.thin_visemes(),
            "missing_diphones": [diphone_name(d) for d in missing[:NAMED] if wanted[d] >= COMMON],
        }


@dataclass(frozen=True)
class Advice:
    """A sentence to record.

    Parameters
    ----------
    sentence : str
    new : tuple of (int, int)
        Diphones that no recording has yet, the commonest in English first.
    more : tuple of (int, int)
        Diphones that have too few recordings yet.
    share : float
        Share of English's diphones that is covered once this and all before it are recorded.
    """

    sentence: str
    new: tuple[tuple[int, int], ...]
    more: tuple[tuple[int, int], ...]
    share: float

    def as_json(self) -> dict[str, Any]:
        """The advice for machines."""
        return {
            "sentence": self.sentence,
            "new": [diphone_name(d) for d in self.new],
            "more": [diphone_name(d) for d in self.more],
            "share_of_english": round(self.share, 4),
        }


def diphone_name(diphone: tuple[int, int]) -> str:
    """A diphone as text: ``th-r``."""
    return f"{PHONEMES[diphone[0]]}-{PHONEMES[diphone[1]]}"


def what_to_record(coverage: Coverage, number: int) -> list[Advice]:
    """Choose sentences that fill the gaps of a corpus.

    Greedy: each time the sentence that adds most for its length. A recording of a diphone is
    worth its share of English, halved for each recording that there is, nothing beyond `ENOUGH`.
    Such a worth has diminishing returns, so that the greedy choice is within 1 - 1/e of the best.

    Parameters
    ----------
    coverage : Coverage
    number : int
        Most sentences to choose; fewer where nothing is gained any more.
    """
    english = coverage.english
    have = coverage.diphones.copy()
    left = dict(enumerate(count_diphones([s]) for s in english.spoken))
    chosen: list[Advice] = []
    while left and len(chosen) < number:
        worth = {i: _worth(have, counts, english) for i, counts in left.items()}
        best = max(worth, key=lambda i: (worth[i], -i))
        if worth[best] <= 0:
            break
        counts = left.pop(best)
        order = _commonest(counts, english)
        new = tuple(d for d in order if have[d] == 0)
        more = tuple(d for d in order if 0 < have[d] < ENOUGH)
        have = have + counts
        share = float(english.diphones[have > 0].sum())
        chosen.append(Advice(english.sentences[best], new, more, share))
    return chosen


def _worth(have: npt.NDArray[np.int64], counts: npt.NDArray[np.int64], english: English) -> float:
    """What a sentence adds for each of its phones."""

    def filled(n: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        return 1 - 0.5 ** np.minimum(n, ENOUGH)

    places = np.nonzero(counts)
    gained = filled(have[places] + counts[places]) - filled(have[places])
    return float((gained * english.diphones[places]).sum() / counts.sum())


def _commonest(counts: npt.NDArray[np.int64], english: English) -> Sequence[tuple[int, int]]:
    first, second = np.nonzero(counts)
    order = np.argsort(-english.diphones[first, second], kind="stable")
    return list(zip(first[order].tolist(), second[order].tolist(), strict=True))
