"""Chinese text as Pinyin (pypinyin), and which sounds of espeak's are which syllable of it.

Characters with several readings and the sandhi of tones are pypinyin's, the optional extra
``mandarin``; without it espeak reads the characters itself. espeak is then given the
Pinyin, not the characters, so that what is heard is what the lips show: left to itself it reads
花儿 as "hua five". Each word's syllables are found among its sounds by their vowels; where the
numbers differ (figures, Latin words, names that pypinyin lacks) there are espeak's own sounds.
"""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from analysis.utterance import Utterance
from database.alphabets import IPA, VOWELS
from database.errors import PronunciationError, SpeechError
from database.pinyin import TimedSyllable, split
from database.track import Interval

MANDARIN: Final = "sit/cmn"
"""File of espeak's voice that reads characters."""

IN_PINYIN: Final = "cmn-latn-pinyin"
"""The same voice, reading Pinyin."""

MISSING: Final = (
    "Mandarin is read by espeak alone; with the optional extra (pip install 'unitsel[mandarin]') "
    "characters are read by their words, and portraits show Mandarin's own syllables"
)

_CHINESE: Final = re.compile("([\u3400-\u4dbf\u4e00-\u9fff\u3007\U00020000-\U0003ffff]+)")
_TOLD: Final = 4
"""Words that a note names."""


@dataclass(frozen=True)
class Word:
    """A piece of text between spaces, as espeak gets it.

    Parameters
    ----------
    written : str
        As it stands in the text.
    spoken : str
        As espeak gets it.
    syllables : tuple of (str, int)
        Pinyin without tone, and tone, of a Chinese word; empty for all else.
    """

    written: str
    spoken: str
    syllables: tuple[tuple[str, int], ...] = ()


def is_mandarin(identifier: str) -> bool:
    """Whether a voice reads Chinese characters as Mandarin, by its `find_voice`."""
    return identifier.partition("+")[0] == MANDARIN


def can_read() -> bool:
    """Whether the extra that reads characters is installed."""
    return importlib.util.find_spec("pypinyin") is not None


def words_of(text: str) -> tuple[Word, ...]:
    """Chinese text as words with their Pinyin.

    Parameters
    ----------
    text : str
        May hold other writing between; that is left as it is.

    Returns
    -------
    tuple of Word
        Punctuation stands with the word before it.

    Raises
    ------
    SpeechError
        Without the extra `mandarin` (`can_read`).
    """
    if not can_read():
        raise SpeechError(MISSING)
    from pypinyin import Style, lazy_pinyin
    from pypinyin.seg.mmseg import seg

    pieces = [p for p in _CHINESE.split(text) if p]
    # Words of Latin letters that Pinyin has too ("he can") would be read as Pinyin.
    as_pinyin = not any(
        _reads_as_pinyin(latin)
        for piece in pieces
        if not _CHINESE.fullmatch(piece)
        for latin in re.findall("[A-Za-züÜ]+", piece)
    )
    words: list[Word] = []
    for piece in pieces:
        if not _CHINESE.fullmatch(piece):
            # The commas of Chinese text stand without a space.
            marks = re.match(r"[^\w\s]*", piece)
            if words and marks is not None and marks[0]:
                last = words.pop()
                given = last.written + marks[0], last.spoken + marks[0]
                words.append(Word(*given, last.syllables))
                piece = piece[marks.end() :]
            words += [Word(token, token) for token in piece.split()]
            continue
        cut = list(seg.cut(piece))
        read = lazy_pinyin(cut, style=Style.TONE3, neutral_tone_with_five=True, tone_sandhi=True)
        if len(read) != len(piece):
            words.append(Word(piece, piece))
            continue
        at = 0
        for word in cut:
            mine = [_toned(r) for r in read[at : at + len(word)]]
            at += len(word)
            known = tuple(s for s in mine if s is not None)
            if len(known) < len(word):
                words.append(Word(word, word))
                continue
            pinyin = "".join(_for_espeak(s, tone) for s, tone in known)
            words.append(Word(word, pinyin if as_pinyin else word, known))
    return tuple(words)


def spelled(words: Sequence[Word]) -> tuple[str, bool]:
    """The text that espeak is to speak, and whether it holds Pinyin."""
    pinyin = any(w.syllables and w.spoken != w.written for w in words)
    return " ".join(w.spoken for w in words), pinyin


def timed_syllables(
    words: Sequence[Word], said: Utterance
) -> tuple[tuple[TimedSyllable, ...], tuple[Interval, ...], tuple[str, ...]]:
    """When each syllable was said.

    Parameters
    ----------
    words : sequence of Word
    said : Utterance
        What espeak said of them.

    Returns
    -------
    syllables : tuple of TimedSyllable
        Of the words whose sounds have as many vowels as their Pinyin has syllables.
    words : tuple of Interval
        All words that were said, as they were written.
    others : tuple of str
        Those that espeak's own sounds stand for.
    """
    syllables: list[TimedSyllable] = []
    spans: list[Interval] = []
    others: list[str] = []
    heard = list(said.words)
    at = 0
    for word in words:
        size = _matching(word.spoken, heard[at:])
        if size == 0:
            if word.syllables:
                others.append(word.written)
            continue
        start, end = heard[at].start, heard[at + size - 1].end
        at += size
        spans.append(Interval(start, end, word.written))
        phones = [p for p in said.phones if start - 1e-6 <= p.start and p.end <= end + 1e-6]
        found = _divided(word.syllables, [p for p in phones if p.label])
        if found:
            syllables += found
        else:
            others.append(word.written)
    return tuple(syllables), tuple(spans), tuple(others)


def told(others: Sequence[str]) -> str:
    """A line that names the words which are not said by their Pinyin."""
    first = ", ".join(dict.fromkeys(others[:_TOLD]))
    more = f" and {len(others) - _TOLD} more" if len(others) > _TOLD else ""
    return f"said as espeak reads them, without Pinyin: {first}{more}"


def _matching(spoken: str, heard: Sequence[Interval]) -> int:
    """How many of espeak's words make up one of ours; 0 where they are others."""
    made = ""
    for i, word in enumerate(heard):
        made += word.label
        if made == spoken:
            return i + 1
        if not spoken.startswith(made):
            return 0
    return 0


def _divided(
    syllables: Sequence[tuple[str, int]], phones: Sequence[Interval]
) -> list[TimedSyllable]:
    """A word's phones divided among its syllables; nothing where the vowels do not count right."""
    every = [i for i, p in enumerate(phones) if _is_vowel(p.label)]
    lasts = np.cumsum([_vowels_of(s) for s, _ in syllables], dtype=np.int64)
    if not syllables or len(every) != lasts[-1]:
        return []
    vowels = [every[k - 1] for k in lasts]
    out: list[TimedSyllable] = []
    first = 0
    for k, ((pinyin, tone), vowel) in enumerate(zip(syllables, vowels, strict=True)):
        parts = split(pinyin)
        # The nasal behind a vowel is its own where the syllable ends in one.
        last = vowel + 1 if k + 1 < len(vowels) else len(phones)
        if parts.nasal and last < len(phones) and _bare(phones[last].label) in ("n", "ŋ"):
            last += 1
        mine = phones[first:last]
        onset = mine[0].end if parts.initial and len(mine) > 1 else mine[0].start
        out.append(TimedSyllable(mine[0].start, mine[-1].end, pinyin, tone, onset))
        first = last
    return out


def _for_espeak(pinyin: str, tone: int) -> str:
    """A syllable as espeak is given it: jiong, qiong and xiong are English to it."""
    if pinyin[1:] == "iong":
        return f"{pinyin[0]}i{tone}yong{tone}"
    return f"{pinyin.replace('ü', 'v')}{tone}"


def _vowels_of(pinyin: str) -> int:
    return 2 if pinyin[1:] == "iong" else 1


def _bare(label: str) -> str:
    return label.lstrip("ˈˌ")


def _is_vowel(label: str) -> bool:
    """Whether a sound of the voice is a vowel; j and w are glides, i. is the vowel of zhi."""
    first = _bare(label)[:1]
    return first == "y" or (first in IPA and IPA[first][0] in VOWELS)


def _toned(read: str) -> tuple[str, int] | None:
    """``hao3`` in its parts; None for what is no syllable."""
    match = re.fullmatch("([a-zêü]+)([1-5])", read)
    if match is None:
        return None
    try:
        split(match[1])
    except PronunciationError:
        return None
    return match[1], int(match[2])


def _reads_as_pinyin(latin: str) -> bool:
    """Whether a Latin word is one or two syllables of Pinyin too."""
    for cut in range(1, len(latin) + 1):
        try:
            split(latin[:cut])
            if cut < len(latin):
                split(latin[cut:])
        except PronunciationError:
            continue
        return True
    return False
