"""From labelled spans of a file to tracks: which tier is which, and what is wrong where."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from database.alphabets import SILENCE_MARKS
from database.errors import PhonemeError, TrackError
from database.symbols import best_alphabet, expand_intervals, to_phonemes, unknown_symbols
from database.timing.source import CONTROL, Source, quoted
from database.timing.words import WordTrack, is_word_silence
from database.track import SMALL_GAP, Interval, PhonemeTrack

PHONE_TIERS = ("phones", "phone", "phonemes", "phoneme", "segments", "segment", "mau", "phonalign")
WORD_TIERS = ("words", "word", "ort-mau", "ort", "tokens", "tokensalign")
"""Names of tiers, lower case, the surest first."""

MAX_SPANS = 500_000
"""More in one row are a mistake: ten hours of speech have fewer phones."""

MOST_SYMBOLS = 2000
"""Distinct labels: no alphabet has so many, not with all marks of stress and length."""

MAX_SECONDS = 1e6
"""Later times are mistakes, of the unit for example: nobody speaks for eleven days."""


_UNPRINTED = re.compile(CONTROL.pattern + "|[\ud800-\udfff]")


@dataclass(frozen=True)
class Timing:
    """What a timing file holds: phones, words, or both.

    Parameters
    ----------
    phones : PhonemeTrack or None
    words : WordTrack or None
    shapes_only : bool
        Whether the phones only stand for mouth shapes, and so do not say what was spoken.

    Raises
    ------
    TrackError
        If both are None.
    """

    phones: PhonemeTrack | None
    words: WordTrack | None = None
    shapes_only: bool = False

    def __post_init__(self) -> None:
        if self.phones is None and self.words is None:
            raise TrackError("timing: holds neither phones nor words")

    @property
    def end(self) -> float:
        """End of the last phone or word, seconds."""
        ends = [self.phones.end] if self.phones else []
        return max([*ends, self.words.duration] if self.words else ends)


@dataclass(frozen=True)
class Span:
    """A labelled span and where it stands in its file, a line number or words for a reader."""

    start: float
    end: float
    label: str
    place: str | int


@dataclass(frozen=True)
class Tier:
    """A named row of spans."""

    name: str
    spans: list[Span]
    end: float = 0.0


def _checked(source: Source, spans: Sequence[Span], slack: float) -> list[Interval]:
    """Spans as intervals, in order and apart; those closer than `slack` are made to touch."""
    out: list[Interval] = []
    before = 0.0
    if len(spans) > MAX_SPANS:
        raise source.error(f"expected at most {MAX_SPANS} spans in a row, got {len(spans)}")
    for s in spans:
        if _UNPRINTED.search(s.label):
            raise source.error(
                f"expected a label without control characters, got {quoted(s.label)}", s.place
            )
        shown = f"{quoted(s.label)} from {s.start:g} to {s.end:g} s"
        if s.start < 0:
            raise source.error(f"expected times from 0 on, got {shown}", s.place)
        if s.end > MAX_SECONDS:
            raise source.error(f"expected times below {MAX_SECONDS:g} s, got {shown}", s.place)
        if s.end - s.start <= SMALL_GAP:
            raise source.error(f"expected an end after the start, got {shown}", s.place)
        if s.start < before - slack:
            raise source.error(
                f"expected a start at or after {before:g} s, where the one before ends, "
                f"got {shown}",
                s.place,
            )
        start = before if out and abs(s.start - before) <= slack else s.start
        if s.end - start <= SMALL_GAP:
            raise source.error(f"expected an end after {start:g} s, got {shown}", s.place)
        out.append(Interval(start, s.end, s.label))
        before = s.end
    return out


def _check_end(source: Source, end: float) -> None:
    if end > MAX_SECONDS:
        raise source.error(f"expected times below {MAX_SECONDS:g} s, got an end at {end:g} s")


def phone_track(
    source: Source,
    spans: Sequence[Span],
    alphabet: str = "auto",
    *,
    preferred: str | None = None,
    slack: float = SMALL_GAP,
    end: float = 0.0,
) -> PhonemeTrack:
    """Spans of one file to a track.

    Parameters
    ----------
    source : Source
        The file, for messages.
    spans : sequence of Span
        Phones in order.
    alphabet : str
        See `database.symbols.to_phonemes`; "auto" detects it from all labels.
    preferred : str, optional
        Alphabet to try first where `alphabet` is "auto".
    slack : float
        Seconds by which neighbours may overlap or miss each other (rounding).
    end : float
        Seconds; silence follows the last phone until then.

    Raises
    ------
    TimingError
        Naming the file and the place.
    """
    labels = [s.label.strip() for s in spans]
    if not labels:
        raise source.error("holds no phone")
    if (n := len(set(labels))) > MOST_SYMBOLS:
        raise source.error(f"expected phones, got {n} different labels; are they words?")
    known, unknown = alphabet, unknown_symbols(labels, alphabet)
    if alphabet == "auto":
        known, unknown = best_alphabet(labels)
        if preferred and len(misses := unknown_symbols(labels, preferred)) <= len(unknown):
            known, unknown = preferred, misses
    missing = frozenset(unknown)
    for span, label in zip(spans, labels, strict=True):
        if label in missing:
            try:
                to_phonemes(label, known)
            except PhonemeError as error:
                raise source.error(str(error), span.place) from error
            raise source.error(
                f"expected ARPAbet phonemes in one case, got {quoted(label)} among others",
                span.place,
            )
    checked = _checked(source, spans, slack)
    named = [Interval(i.start, i.end, i.label.strip()) for i in checked]
    _check_end(source, end)
    if end > named[-1].end + slack:
        named.append(Interval(named[-1].end, end, ""))
    try:
        return PhonemeTrack.from_intervals(expand_intervals(named, known), name=str(source.path))
    except (TrackError, PhonemeError) as error:
        raise source.error(str(error)) from error


def word_track(
    source: Source, spans: Sequence[Span], duration: float = 0.0, slack: float = SMALL_GAP
) -> WordTrack:
    """Spans of one file to words; a label of several words shares its time among them."""
    intervals: list[Interval] = []
    cues: list[int] = []
    _check_end(source, duration)
    for cue, it in enumerate(_checked(source, spans, slack)):
        # Of several pronunciations pocketsphinx calls the second word(2).
        parts = [re.sub(r"(?<=.)(\(\d{1,3}\))+$", "", p) for p in it.label.split()] or [""]
        if len(intervals) + len(parts) > MAX_SPANS:
            raise source.error(f"expected at most {MAX_SPANS} words", spans[cue].place)
        cues += [cue] * len(parts)
        sizes = [len(p) for p in parts]
        at, step = it.start, (it.end - it.start) / max(1, sum(sizes))
        for k, part in enumerate(parts):
            end = it.end if k == len(parts) - 1 else at + step * sizes[k]
            intervals.append(Interval(at, end, part))
            at = end
    if all(is_word_silence(i.label) for i in intervals):
        raise source.error("holds no word")
    try:
        return WordTrack.from_intervals(
            intervals,
            duration=duration,
            name=str(source.path),
            cues=cues if len(set(cues)) < len(cues) else (),
        )
    except TrackError as error:
        raise source.error(str(error)) from error


def without_position(label: str) -> str:
    """A phone without Kaldi's mark of its place in the word: begin, inside, end, single."""
    return re.sub(r"(?<=.)_[BIES]$", "", label)


def looks_like_phones(labels: Sequence[str]) -> bool:
    """Whether at least half of the distinct labels are symbols of one alphabet.

    So that a misspelt phone is an error and words are words.
    """
    spoken = {s for label in labels if (s := label.strip()).lower() not in SILENCE_MARKS}
    if len(spoken) > MOST_SYMBOLS:
        return False
    return len(best_alphabet(spoken)[1]) * 2 <= len(spoken)


def _are_phones(labels: set[str]) -> bool:
    """Whether all labels, of which one is not blank, are symbols of one alphabet."""
    return any(labels) and len(labels) <= MOST_SYMBOLS and not best_alphabet(labels)[1]


def single_tier(
    source: Source,
    spans: Sequence[Span],
    alphabet: str,
    *,
    is_words: bool = False,
    slack: float = SMALL_GAP,
) -> Timing:
    """Spans of a file without named tiers: phones, or words where they do not look like phones."""
    labels = [s.label for s in spans]
    if is_words or (alphabet == "auto" and not looks_like_phones(labels)):
        several = next((s for s in spans if not is_words and len(s.label.split()) > 1), None)
        if several:
            raise source.error(
                f"expected one phone or one word a span, got {quoted(several.label)}", several.place
            )
        return Timing(None, word_track(source, spans, slack=slack))
    return Timing(phone_track(source, spans, alphabet, slack=slack), None)


def _named(tiers: Sequence[Tier], names: Sequence[str]) -> list[Tier]:
    """Tiers of the surest of the names.

    "speaker - phones", as MFA writes it, counts; and where no name is so plain, one that stands
    beside a speaker's as ELAN's users write it: "phones@anna", "anna_words", "Words (anna)".
    """
    plain = [re.split(r"\s+-\s+", t.name[:200].strip().lower())[-1] for t in tiers]
    parts = [re.split(r"[\s@_:/.()\[\]-]+", t.name[:200].strip().lower()) for t in tiers]
    for whole in (True, False):
        for name in names:
            found = [
                t
                for t, last, some in zip(tiers, plain, parts, strict=True)
                if (last == name if whole else name in some)
            ]
            if found:
                return found
    return []


def choose_tiers(
    source: Source, tiers: Sequence[Tier], alphabet: str, slack: float = SMALL_GAP
) -> Timing:
    """Find the tier of phones and the tier of words, by name and else by content.

    Parameters
    ----------
    source : Source
    tiers : sequence of Tier
    alphabet : str
        See `phone_track`.
    slack : float
        Seconds by which neighbours may overlap or miss each other (rounding).

    Raises
    ------
    TimingError
        If there is neither, or several of one name (several speakers).
    """
    phones, words = _named(tiers, PHONE_TIERS), _named(tiers, WORD_TIERS)
    for found in (phones, words):
        if len(found) > 1:
            raise source.error(
                "expected one speaker, got several tiers of one kind: "
                + ", ".join(quoted(t.name) for t in found[:5])
                + "; leave one of them in the file"
            )
    rest = [t for t in tiers if t.spans and not any(t is n for n in (*words, *phones))]
    if not phones:
        fits = [t for t in rest if _are_phones({s.label.strip() for s in t.spans})]
        phones = sorted(fits, key=lambda t: -len(t.spans))[:1]
    if not phones and not words and len(rest) == 1:
        return single_tier(source, rest[0].spans, alphabet, slack=slack)
    spoken = [t for t in words if any(not is_word_silence(s.label) for s in t.spans)]
    phone_spans = phones[0].spans if phones else []
    if not phone_spans and not spoken:
        raise source.error(
            f"expected a tier named {PHONE_TIERS[0]!r} or {WORD_TIERS[0]!r}, got "
            + (", ".join(quoted(t.name) for t in tiers[:5]) or "no tier of intervals")
        )
    return Timing(
        phone_track(source, phone_spans, alphabet, slack=slack, end=phones[0].end)
        if phone_spans
        else None,
        word_track(source, spoken[0].spans, spoken[0].end, slack) if spoken else None,
    )
