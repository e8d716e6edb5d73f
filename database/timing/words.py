"""Words: their times (`WordTrack`), and files that hold words only."""

from __future__ import annotations

import math
import os
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import compress

from database.errors import TrackError
from database.timing.source import Source, decoded, read_source
from database.track import SMALL_GAP, Interval

WORD_SILENCES = frozenset(
    {"", "sil", "sp", "spn", "ssil", "_", "#", "<sil>", "<s>", "</s>", "<eps>", "<p:>", "[sil]"}
    | {"[noise]", "<noise>", "++noise++", "+noise+", "[speech]", "sent-start", "sent-end"}
)
"""Labels of a word tier that are no words, lower case."""

_TIMED = (*(".align", ".textgrid", ".csv", ".json", ".pho", ".ctm", ".tsv", ".srt", ".vtt"),)


_LONGEST = 1000
"""Characters of a word."""


@dataclass(frozen=True)
class WordTrack:
    """Words with their times, in order and apart; what lies between them is silence.

    Parameters
    ----------
    words : tuple of str
        One word each, no spaces.
    starts, ends : tuple of float
        Seconds, one for each word.
    duration : float, optional
        Seconds from 0 to the end of the recording; by default the last word's end.
    cues : tuple of int, optional
        For each word the number of the label it stood in, where labels held several words: only
        the ends of a cue are known, the words inside share its time by their letters.

    Raises
    ------
    TrackError
        If there is no word, a word is blank or holds a space, or times are not finite,
        ordered and apart; names the word and its times.
    """

    words: tuple[str, ...]
    starts: tuple[float, ...]
    ends: tuple[float, ...]
    duration: float = 0.0
    name: str = field(default="words", compare=False)
    cues: tuple[int, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        if not self.words:
            raise TrackError(f"{self.name}: holds no word")
        if not len(self.words) == len(self.starts) == len(self.ends):
            raise TrackError(
                f"{self.name}: {len(self.words)} words have {len(self.starts)} starts and "
                f"{len(self.ends)} ends"
            )
        if self.cues and len(self.cues) != len(self.words):
            raise TrackError(f"{self.name}: {len(self.words)} words have {len(self.cues)} cues")
        before = 0.0
        for i, (word, start, end) in enumerate(
            zip(self.words, self.starts, self.ends, strict=True), 1
        ):
            where = f"{self.name}: word {i} ({word[:40]!r}, {start:g} to {end:g} s)"
            if len(word.split()) != 1 or word != word.strip():
                raise TrackError(f"{where}: must be one word, without spaces")
            if not (math.isfinite(start) and math.isfinite(end)) or start < 0:
                raise TrackError(f"{where}: times must be finite and not negative")
            if end - start <= SMALL_GAP:
                raise TrackError(f"{where}: has no length")
            if start < before - SMALL_GAP:
                raise TrackError(f"{where}: starts before the end of the one before it, {before:g}")
            before = end
        if not math.isfinite(self.duration):
            raise TrackError(f"{self.name}: duration must be finite, got {self.duration}")
        object.__setattr__(self, "duration", max(float(self.duration), self.ends[-1]))

    def __len__(self) -> int:
        return len(self.words)

    @classmethod
    def from_intervals(
        cls,
        intervals: Sequence[Interval],
        *,
        duration: float = 0.0,
        name: str = "words",
        cues: Sequence[int] = (),
    ) -> WordTrack:
        """Build from labelled spans; those that mark silence only lengthen the duration."""
        told = [not is_word_silence(i.label) for i in intervals]
        said = list(compress(intervals, told))
        return cls(
            tuple(i.label for i in said),
            tuple(i.start for i in said),
            tuple(i.end for i in said),
            max([duration, *(i.end for i in intervals)]),
            name,
            tuple(compress(cues, told)),
        )

    def intervals(self) -> list[Interval]:
        """List the words as labelled spans."""
        return [
            Interval(s, e, w) for w, s, e in zip(self.words, self.starts, self.ends, strict=True)
        ]


def is_word_silence(label: str) -> bool:
    """Whether a label of a word tier marks silence."""
    return label.strip().lower() in WORD_SILENCES


def fill_gaps(intervals: Iterable[Interval], end: float, label: str) -> list[Interval]:
    """Intervals from 0 to `end` without gaps: `label` where nothing is."""
    out: list[Interval] = []
    at = 0.0
    for it in intervals:
        if it.start - at > SMALL_GAP:
            out.append(Interval(at, it.start, label))
        out.append(it)
        at = it.end
    if end - at > SMALL_GAP:
        out.append(Interval(at, end, label))
    return out


def clean_word(token: str) -> str:
    """Strip quotes and punctuation from around a word; empty where nothing is left.

    Points inside an abbreviation ("a.m.") and an apostrophe on one side ("'cause") stay; the
    curly apostrophe becomes the straight one. Upper and lower case are kept.
    """
    # Sorting a long run of accents takes very long, and nothing so long is a word.
    word = unicodedata.normalize("NFC", token) if len(token) <= _LONGEST else token
    word = word.replace("\u2019", "'").replace("\u2018", "'")
    first, end, after = 0, len(word), len(word)
    while True:
        while first < end and _is_mark(word[first]):
            first += 1
        while first < end and _is_mark(word[end - 1]):
            end -= 1
        if not (first < end and word[first] == word[end - 1] == "'"):
            break
        first, end = first + 1, end - 1
        after = end
    bare = word[first:end]
    return bare + "." if "." in bare and word[end:after] == "." else bare


def _is_mark(c: str) -> bool:
    return c != "'" and unicodedata.category(c)[0] in "PSCZ"


def read_words(path: str | os.PathLike[str]) -> list[str]:
    """Read the words of NAME.txt, or of a .lab file that holds words only.

    Words are separated by any white space; punctuation around them is dropped, case is kept.

    Raises
    ------
    TimingError
        If the file cannot be read, is empty or binary, holds no word, or is a timing file.
    """
    return _words_of(read_source(path))


def parse_words(path: str | os.PathLike[str], data: bytes) -> list[str]:
    """Read the bytes of a words file; see `read_words`."""
    return _words_of(decoded(path, data))


def _words_of(source: Source) -> list[str]:
    first = source.lines()[0][1].split()
    timed = source.path.suffix.lower() in _TIMED or (
        source.path.suffix.lower() == ".lab" and len(first) > 1 and all(map(_is_time, first[:2]))
    )
    if timed:
        raise source.error("expected words only, this is a timing file; read its times instead")
    words = [w for token in source.text.split() if (w := clean_word(token))]
    if not words:
        raise source.error("expected words, got only punctuation")
    return words


def _is_time(text: str) -> bool:
    return text.isascii() and text.isdigit()
