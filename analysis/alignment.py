"""What an alignment is, and how the recogniser's phones become a track."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from database.errors import AlignmentError
from database.symbols import to_phonemes
from database.timing.words import WordTrack
from database.track import Interval, PhonemeTrack

FRAME_SECONDS = 0.01
"""pocketsphinx counts time in hundredths of a second."""

WORD_GAP = 0.02
"""Seconds: words nearer than this to each other follow without silence."""


@dataclass(frozen=True)
class AlignedPhone:
    """A phone in time, in the recogniser's ARPAbet (``SIL`` for silence)."""

    start: float
    end: float
    symbol: str


@dataclass(frozen=True)
class Alignment:
    """Words and phones of a clip.

    Parameters
    ----------
    track : PhonemeTrack
        From 0 to the sound's end.
    words : WordTrack or None
        None where phones were given without the times of words.
    attempts : int
        How many tries the recogniser needed; 1 is the usual, 0 means that phones were given.
    notes : tuple of str
        What was repaired, for the build's report.
    text : str
        The words.
    """

    track: PhonemeTrack
    words: WordTrack | None
    attempts: int
    notes: tuple[str, ...] = field(default=())
    text: str = ""

    @property
    def given(self) -> bool:
        """Whether the phones were given and not found in the sound."""
        return self.attempts == 0


Word = tuple[str, list[AlignedPhone]]
"""A word, blank where it is silence, and its phones."""


def is_silence(word: str) -> bool:
    """Whether a word or phone of the recogniser is silence or noise."""
    return word.startswith(("<", "+", "[")) or word == "SIL"


def reaching(
    phones: list[AlignedPhone], low: float, high: float, words: WordTrack
) -> list[AlignedPhone]:
    """A word's phones, drawn out to its bounds where silence lies beyond them.

    The recogniser hears a weak first sound late and a weak last one not to its end; the lips
    know better, and so does who gave the bounds.
    """
    out = list(phones)
    if not any(abs(end - low) < WORD_GAP for end in words.ends) and out[0].start > low:
        out[0] = AlignedPhone(low, out[0].end, out[0].symbol)
    if not any(abs(start - high) < WORD_GAP for start in words.starts) and out[-1].end < high:
        out[-1] = AlignedPhone(out[-1].start, high, out[-1].symbol)
    return out


def untangled(words: list[Word]) -> list[Word]:
    """Words whose phones do not overlap: the later one gives way."""
    out: list[Word] = []
    now = 0.0
    for word, phones in words:
        kept = []
        for p in phones:
            start = max(p.start, now)
            if p.end > start + 1e-9:
                kept.append(AlignedPhone(start, p.end, p.symbol))
                now = p.end
        if kept:
            out.append((word, kept))
    return out


def _table_interval(phone: AlignedPhone) -> Interval:
    # Each of the recogniser's phones is one phoneme of Table 1.
    label = "sil" if is_silence(phone.symbol) else to_phonemes(phone.symbol, "arpabet")[0]
    return Interval(phone.start, phone.end, label)


def as_alignment(
    found: list[Word], duration: float, attempts: int, notes: tuple[str, ...], name: str
) -> Alignment:
    """An alignment of what was found, continued with silence to the sound's end."""
    phones = [_table_interval(p) for _, ps in found for p in ps]
    if not phones:
        raise AlignmentError(f"{name}: no word lies inside the sound")
    if phones[-1].end < duration - 1e-6:
        phones.append(Interval(phones[-1].end, duration, "sil"))
    track = PhonemeTrack.from_intervals(_merged(phones), name=name)
    spoken = [(w, ps) for w, ps in found if w and ps]
    words = WordTrack(
        tuple(w for w, _ in spoken),
        tuple(ps[0].start for _, ps in spoken),
        tuple(ps[-1].end for _, ps in spoken),
        duration,
        name,
    )
    return Alignment(track, words, attempts, notes, " ".join(words.words))


def _merged(intervals: Sequence[Interval]) -> list[Interval]:
    """Neighbouring silences made one."""
    out: list[Interval] = []
    for it in intervals:
        last = out[-1] if out else None
        if last and last.label == it.label == "sil" and it.start - last.end < FRAME_SECONDS:
            out[-1] = Interval(last.start, it.end, "sil")
        else:
            out.append(it)
    return out
