"""Pronunciations of words, and phones of words that have times but no sound.

The default is the CMU dictionary that the pocketsphinx package carries. A user's own file adds
to it: lines of ``WORD PH PH ...`` in any alphabet of `database.symbols`, variants as further
lines or as ``WORD(2)``, comments after ``;;;`` or ``#``.
"""

from __future__ import annotations

import itertools
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cache

from database.errors import PhonemeError, PronunciationError, TimingError
from database.symbols import best_alphabet, to_arpabet, to_phonemes
from database.timing.source import read_source
from database.timing.words import WordTrack, clean_word, fill_gaps
from database.track import Interval, PhonemeTrack

Pronunciation = tuple[str, ...]

MAX_COMPOUND_VARIANTS = 8
"""Pronunciations of a compound ("well-known") that are made of its parts'."""

DURATIONS: dict[str, int] = {
    "aa": 240, "ae": 230, "ah": 140, "ao": 240, "aw": 260, "ax": 120, "er": 180, "ay": 250,
    "eh": 150, "ey": 190, "ih": 135, "ix": 110, "iy": 155, "ow": 220, "oy": 280, "uh": 160,
    "uw": 210, "w": 80, "y": 80, "r": 80, "l": 80, "h": 80, "hh": 80, "m": 70, "n": 60, "ng": 95,
    "f": 100, "v": 60, "th": 90, "dh": 50, "s": 105, "z": 75, "sh": 105, "zh": 70, "p": 90,
    "b": 85, "t": 75, "d": 75, "k": 80, "g": 80, "ch": 70, "jh": 70, "sil": 100,
}  # fmt: skip
"""Typical lengths of phones in ms, after the inherent durations of Allen, Hunnicutt and Klatt,
From Text to Speech (1987); only their ratios are used."""

_COUNT = re.compile(r"(?<=.)\(\d+\)$")
_PROBABILITY = re.compile(r"\d+\.\d+")


class Lexicon:
    """Words and their pronunciations.

    Small to hand to another process: the CMU dictionary is not part of it but read there.

    Parameters
    ----------
    entries : mapping of str to sequence of tuple of str
        Pronunciations as names of Table 1, the likeliest first; they replace the CMU
        dictionary's of the same word.
    cmu : bool
        Whether to look further in the CMU dictionary.

    Raises
    ------
    PronunciationError
        If an entry holds no phoneme or a name that is not in Table 1.
    """

    def __init__(
        self, entries: Mapping[str, Sequence[Pronunciation]] | None = None, *, cmu: bool = False
    ) -> None:
        self._own: dict[str, tuple[Pronunciation, ...]] = {}
        self._cmu = cmu
        for word, variants in (entries or {}).items():
            try:
                known = tuple(
                    tuple(p for s in v for p in to_phonemes(s, "table")) for v in variants
                )
            except PhonemeError as error:
                raise PronunciationError(f"pronunciation of {word!r}: {error}") from error
            if not known or not all(known):
                raise PronunciationError(f"pronunciation of {word!r}: holds no phoneme")
            self._own[_key(word)] = known

    @classmethod
    def default(cls) -> Lexicon:
        """Make a lexicon of the CMU dictionary; the file is read at the first look-up."""
        return cls(cmu=True)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Lexicon:
        """Read a user's dictionary, alone.

        Raises
        ------
        PronunciationError
            Naming the file and the line.
        """
        return cls(_read_entries(path))

    def extended(self, path: str | os.PathLike[str]) -> Lexicon:
        """Add a user's dictionary file, whose words replace those of the same spelling.

        Raises
        ------
        PronunciationError
            Naming the file and the line.
        """
        return self.with_entries(_read_entries(path))

    def with_entries(self, entries: Mapping[str, Sequence[Pronunciation]]) -> Lexicon:
        """Add pronunciations (names of Table 1), as a G2P makes them."""
        return Lexicon({**self._own, **entries}, cmu=self._cmu)

    def __contains__(self, word: str) -> bool:
        return bool(self._find(word))

    def pronunciations(self, word: str) -> list[Pronunciation]:
        """All pronunciations of a word as names of Table 1, the likeliest first.

        Case and punctuation around the word do not matter; a compound ("well-known") is made
        of its parts. Numbers in digits are not words. The CMU dictionary's "a" gives the
        letter's name first, then the article.

        Raises
        ------
        PronunciationError
            For an unknown word, with the remedy.
        """
        found = self._find(word)
        if not found:
            raise PronunciationError(
                f"no pronunciation for the word {word[:40]!r}: add it to a dictionary file "
                "(--dictionary FILE, lines 'word PH PH ...'), or install the espeak extra "
                "(pip install 'unitsel[espeak]')"
                + ("; write numbers as words" if any(c.isdigit() for c in word) else "")
            )
        return list(found)

    def arpabet(self, word: str) -> list[Pronunciation]:
        """All pronunciations of a word in pocketsphinx's phones, upper case without stress.

        Raises
        ------
        PronunciationError
            For an unknown word.
        """
        variants = (tuple(map(to_arpabet, v)) for v in self.pronunciations(word))
        return list(dict.fromkeys(variants))

    def words(self) -> list[str]:
        """List all words that can be looked up as they are, sorted."""
        return sorted({*self._own, *(_cmu_dictionary() if self._cmu else ())})

    def missing(self, words: Iterable[str]) -> list[str]:
        """List the words without a pronunciation, each once, in order."""
        return [w for w in dict.fromkeys(words) if not self._find(w)]

    def _find(self, word: str) -> tuple[Pronunciation, ...]:
        key = _key(word)
        bare = clean_word(key)
        forms = [bare, key, bare.strip("'"), f"{bare}." if "." in bare else ""]
        for form in forms:
            if form and (found := self._exact(form)):
                return found
        parts = [p for p in bare.split("-") if p]
        if len(parts) < 2 or not (variants := [self._find(p) for p in parts]) or not all(variants):
            return ()
        joined = (sum(choice, ()) for choice in itertools.product(*variants))
        return tuple(itertools.islice(joined, MAX_COMPOUND_VARIANTS))

    def _exact(self, form: str) -> tuple[Pronunciation, ...]:
        if form in self._own:
            return self._own[form]
        if not self._cmu:
            return ()
        lines = _cmu_dictionary().get(form, ())
        found = [tuple(p for s in v.split() for p in to_phonemes(s, "arpabet")) for v in lines]
        if form == "a":  # of letters, the only one that is first of all another word
            found.sort(key=lambda v: v != ("ey",))
        return tuple(found)


def _key(word: str) -> str:
    return word.strip().lower().replace("\u2019", "'")


@cache
def _cmu_dictionary() -> dict[str, list[str]]:
    """Words of the CMU dictionary and their pronunciations, as written."""
    import pocketsphinx  # here, because most commands never look a word up

    path = pocketsphinx.get_model_path("en-us/cmudict-en-us.dict")
    try:
        text = read_source(path).text
    except TimingError as error:
        raise PronunciationError(f"the pocketsphinx package is incomplete: {error}") from error
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        word, _, phones = line.partition(" ")
        if word.endswith(")"):
            word = _COUNT.sub("", word)
        found.setdefault(word, []).append(phones)
    return found


def _read_entries(path: str | os.PathLike[str]) -> dict[str, list[Pronunciation]]:
    """Read a user's dictionary file in whatever alphabet its phones are."""
    try:
        source = read_source(path)
    except TimingError as error:
        raise PronunciationError(str(error)) from error
    lines: list[tuple[int, str, list[str]]] = []
    for line, text in source.lines():
        if text.startswith((";;;", "#")):
            continue
        word, *phones = text.split()
        while phones and _PROBABILITY.fullmatch(phones[0]):  # MFA's columns
            phones = phones[1:]
        if not phones:
            raise PronunciationError(
                str(source.error(f"expected 'word phone phone ...', got {text[:40]!r}", line))
            )
        lines.append((line, word, phones))
    alphabet, _ = best_alphabet(p for _, _, phones in lines for p in phones)
    entries: dict[str, list[Pronunciation]] = {}
    for line, word, phones in lines:
        try:
            names = tuple(p for s in phones for p in to_phonemes(s, alphabet))
        except PhonemeError as error:
            raise PronunciationError(str(source.error(str(error), line))) from error
        if set(names) == {"sil"}:  # "<unk> spn": a mark, not a word
            continue
        variants = entries.setdefault(_key(_COUNT.sub("", word)), [])
        if names not in variants:
            variants.append(names)
    if not entries:
        raise PronunciationError(str(source.error("holds no word")))
    return entries


def spread_words(words: WordTrack, lexicon: Lexicon) -> PhonemeTrack:
    """Phones of words whose times are known, where there is no sound to align them to.

    Each word is said in its first pronunciation; its phones share its time in proportion to
    `DURATIONS`. What lies between words, and after them to the track's duration, is silence.

    Parameters
    ----------
    words : WordTrack
    lexicon : Lexicon

    Returns
    -------
    PhonemeTrack
        From 0 to ``words.duration`` seconds.

    Raises
    ------
    PronunciationError
        For an unknown word.
    TrackError
        For a word too short for its phones.
    """
    intervals: list[Interval] = []
    for span in words.intervals():
        phones = lexicon.pronunciations(span.label)[0]
        weights = list(itertools.accumulate((DURATIONS[p] for p in phones), initial=0))
        scale = (span.end - span.start) / weights[-1]
        edges = [span.start + w * scale for w in weights[:-1]] + [span.end]
        intervals += [Interval(edges[i], edges[i + 1], p) for i, p in enumerate(phones)]
    return PhonemeTrack.from_intervals(fill_gaps(intervals, words.duration, "sil"), name=words.name)
