"""One long recording cut at its pauses, and the timing file cut with it.

Cuts lie in the middle of silences, never inside a word, on frames of the video.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from database.errors import CorpusError
from database.phonemes import PHONEME_INDEX, SILENCE
from database.timing import Timing, WordTrack
from database.track import Interval, PhonemeTrack


@dataclass(frozen=True)
class CutSettings:
    """Where a long recording is cut.

    Parameters
    ----------
    silence : float
        Seconds that a pause must last to be cut in.
    shortest, wanted, longest : float
        Length of a piece in seconds. Where speech goes on for too long without a pause, a piece
        is longer.
    tolerance : float
        Seconds by which a word or phone may reach over the edge of a piece that somebody else
        has cut.
    """

    silence: float = 0.2
    shortest: float = 2.0
    wanted: float = 6.0
    longest: float = 12.0
    tolerance: float = 0.02


def pauses(timing: Timing, duration: float, silence: float) -> list[tuple[float, float]]:
    """Silences between words, or between phones where no words are given.

    Parameters
    ----------
    timing : Timing
    duration : float
        Length of the recording, seconds.
    silence : float
        Shortest that counts, seconds.

    Returns
    -------
    list of (start, end)
        Seconds, rising; what lies before the first sound and after the last is not among them.
    """
    silent = _between(_sounds(timing), silence)
    if timing.words is not None and timing.phones is not None:
        # A pause that only one of them knows is not safe.
        between = _between(timing.words.intervals(), silence)
        silent = [
            (max(a, c), min(b, d))
            for a, b in silent
            for c, d in between
            if min(b, d) - max(a, c) >= silence
        ]
    return [(a, b) for a, b in silent if b < duration]


def cut_at_pauses(
    timing: Timing, duration: float, fps: float, settings: CutSettings | None = None
) -> list[tuple[float, float]]:
    """Pieces of a long recording.

    Of the pauses within reach the one is taken that brings a piece nearest to the wanted
    length.

    Parameters
    ----------
    timing : Timing
    duration : float
        Length of the recording, seconds.
    fps : float
        Frame rate of its video.
    settings : CutSettings, optional

    Returns
    -------
    list of (start, end)
        Seconds; together they cover the recording from its start to its end.
    """
    chosen = settings or CutSettings()
    places = [round((a + b) / 2 * fps) / fps for a, b in pauses(timing, duration, chosen.silence)]
    cuts = [0.0]
    while ahead := [p for p in places if p - cuts[-1] >= chosen.shortest]:
        if duration - cuts[-1] <= chosen.wanted:
            break
        near = [p for p in ahead if p - cuts[-1] <= chosen.longest] or ahead[:1]
        wanted = cuts[-1] + chosen.wanted
        best = min(near, key=lambda p: abs(p - wanted))
        if duration - best < chosen.shortest:
            break
        cuts.append(best)
    return list(zip(cuts, [*cuts[1:], duration], strict=True))


def timing_of_piece(
    timing: Timing, start: float, end: float, name: str, tolerance: float = CutSettings.tolerance
) -> Timing:
    """What a timing file says of a piece, in the piece's time.

    Parameters
    ----------
    timing : Timing
        Of the whole recording.
    start, end : float
        Of the piece, seconds.
    name : str
        For messages: the timing file.
    tolerance : float
        Seconds by which a sound may reach over an edge.

    Raises
    ------
    CorpusError
        If an edge lies inside a word or phone, or the piece holds none.
    """
    phones = words = None
    if timing.words is not None:
        spans = _inside(timing.words.intervals(), start, end, name, "word", tolerance)
        if spans:
            words = WordTrack.from_intervals(spans, duration=end - start, name=name)
    if timing.phones is not None:
        sounds = [i for i in timing.phones.intervals() if PHONEME_INDEX[i.label] != SILENCE]
        spans = _inside(sounds, start, end, name, "phone", tolerance)
        if spans:
            if spans[-1].end < end - start - 1e-6:
                spans.append(Interval(spans[-1].end, end - start, "sil"))
            phones = PhonemeTrack.from_intervals(spans, name=name)
    if phones is None and words is None:
        raise CorpusError(f"{name}: has no word from {start:.2f} to {end:.2f} s")
    return Timing(phones, words)


def _sounds(timing: Timing) -> list[Interval]:
    if timing.phones is not None:
        return [i for i in timing.phones.intervals() if PHONEME_INDEX[i.label] != SILENCE]
    return timing.words.intervals() if timing.words is not None else []


def _between(sounds: Sequence[Interval], silence: float) -> list[tuple[float, float]]:
    return [
        (before.end, after.start)
        for before, after in pairwise(sounds)
        if after.start - before.end >= silence - 1e-6
    ]


def _inside(
    spans: Sequence[Interval], start: float, end: float, name: str, kind: str, tolerance: float
) -> list[Interval]:
    """Spans of a piece, in its time; silence between them is left out."""
    out = []
    for span in spans:
        if span.end <= start + tolerance or span.start >= end - tolerance:
            continue
        if span.start < start - tolerance or span.end > end + tolerance:
            edge = start if span.start < start - tolerance else end
            raise CorpusError(
                f"{name}: the piece's edge at {edge:.2f} s lies inside the {kind} {span.label!r} "
                f"({span.start:.2f} to {span.end:.2f} s); move it to a pause"
            )
        out.append(Interval(max(0.0, span.start - start), min(end, span.end) - start, span.label))
    return out
