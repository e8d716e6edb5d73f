"""What English asks of a corpus: how often its phonemes, visemes and diphones come.

The counts are the mean of two views. Running speech: the sentences of ``sentences.txt``, written
for this package to be phonetically rich, each in its first pronunciation and between silences.
Single words: every fourth word of the CMU dictionary, alphabetically. The sentences know what
happens between words but dwell on rare sounds; the dictionary holds the long tail but weighs rare
words as common ones. Neither is a census of spoken English, and shares of a thousandth or less
are only orders of magnitude.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Final

import numpy as np
import numpy.typing as npt

from database.errors import CorpusError
from database.lexicon import Lexicon
from database.phonemes import N_PHONEMES, N_VISEMES, PHONEME_INDEX, SILENCE, VISEME_OF

DICTIONARY_STEP: Final = 4
"""Every so many words of the dictionary are counted."""

_WORD: Final = re.compile(r"[a-z]+(?:['-][a-z]+)*")


@dataclass(frozen=True)
class English:
    """What is expected, and the sentences to record.

    Parameters
    ----------
    sentences : tuple of str
    spoken : tuple of (n,) int64
        Phonemes of each sentence, silence at both ends.
    diphones : (43, 43) float64
        Share of each pair of neighbouring phonemes; sums to 1.
    """

    sentences: tuple[str, ...]
    spoken: tuple[npt.NDArray[np.int64], ...]
    diphones: npt.NDArray[np.float64]

    @property
    def phonemes(self) -> npt.NDArray[np.float64]:
        """Share of each phoneme, silence left out, (43,) float64."""
        share = self.diphones.sum(axis=1)
        share[SILENCE] = 0.0
        return np.asarray(share / share.sum(), dtype=np.float64)

    @property
    def visemes(self) -> npt.NDArray[np.float64]:
        """Share of each viseme, silence left out, (22,) float64."""
        counts = np.bincount(VISEME_OF, weights=self.phonemes, minlength=N_VISEMES)
        return np.asarray(counts, dtype=np.float64)


def read_sentences() -> tuple[str, ...]:
    """The package's list of sentences.

    Raises
    ------
    CorpusError
        If the package has lost the file.
    """
    try:
        text = resources.files(__package__).joinpath("sentences.txt").read_text(encoding="utf-8")
    except OSError as error:
        raise CorpusError(f"sentences.txt of the package cannot be read ({error})") from error
    return tuple(line for line in text.splitlines() if line)


def words_of(sentence: str) -> list[str]:
    """Words of a sentence in lower case, without its punctuation."""
    return _WORD.findall(sentence.lower().replace("\u2019", "'"))


def phonemes_of(words: Iterable[str], lexicon: Lexicon) -> npt.NDArray[np.int64]:
    """Phonemes of words in their first pronunciations, silence at both ends.

    Raises
    ------
    PronunciationError
        For an unknown word.
    """
    said = [PHONEME_INDEX[p] for w in words for p in lexicon.pronunciations(w)[0]]
    return np.array([SILENCE, *said, SILENCE], dtype=np.int64)


def count_diphones(tracks: Sequence[npt.NDArray[np.integer]]) -> npt.NDArray[np.int64]:
    """How often each phoneme follows each other in some tracks, (43, 43) int64."""
    counts = np.zeros((N_PHONEMES, N_PHONEMES), dtype=np.int64)
    for track in tracks:
        np.add.at(counts, (track[:-1], track[1:]), 1)
    # A pause inside a pause is no diphone.
    counts[SILENCE, SILENCE] = 0
    return counts


@cache
def english() -> English:
    """Expected diphones and the sentences, computed once a process."""
    lexicon = Lexicon.default()
    sentences = read_sentences()
    spoken = tuple(phonemes_of(words_of(s), lexicon) for s in sentences)
    running = count_diphones(spoken).astype(np.float64)
    words = [w for w in lexicon.words()[::DICTIONARY_STEP] if w.isalpha()]
    # A word alone is not spoken between pauses: its ends tell nothing.
    single = count_diphones([phonemes_of([w], lexicon)[1:-1] for w in words]).astype(np.float64)
    return English(sentences, spoken, (running / running.sum() + single / single.sum()) / 2)
