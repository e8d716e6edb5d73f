"""pocketsphinx's JSON: ``{"b": begin, "d": duration, "t": text, "w": [...]}``, nested.

The utterance's "w" are words, a word's "w" its phones (with -phone_align), a phone's its states,
which are not used. Segments without phones below them are phones themselves where they look
like it (-allphone), else words. Several utterances may follow one another.
"""

from __future__ import annotations

import json
from bisect import bisect_left
from typing import Any

from database.timing.json_text import has_key, member, read_values
from database.timing.source import Source
from database.timing.tiers import Span, Timing, looks_like_phones, phone_track, word_track
from database.timing.words import is_word_silence
from database.track import Interval

SLACK = 1.5e-3
"""Seconds: begins and durations are each rounded to a millisecond."""


def recognise(source: Source) -> bool:
    """Whether the file names words as pocketsphinx does."""
    return has_key(source, "w") and not has_key(source, "tiers")


def read(source: Source, alphabet: str) -> Timing:
    """Read pocketsphinx's JSON."""
    words: list[Span] = []
    phones: list[Span] = []
    end = 0.0
    utterances = read_values(source)
    for u, utterance in enumerate(utterances, 1):
        place = f"utterance {u}" if len(utterances) > 1 else "top level"
        for i, word in enumerate(member(source, utterance, "w", list, place), 1):
            here = f"{place}, word {i}"
            words.append(_span(source, word, here))
            if "w" in word:
                inner = member(source, word, "w", list, here)
                phones += [_span(source, p, f"{here}, phone {j}") for j, p in enumerate(inner, 1)]
        if "b" in utterance and "d" in utterance:
            begin = source.number(utterance["b"], "'b' in seconds", place)
            end = max(end, begin + source.number(utterance["d"], "'d' in seconds", place))
    if not words:
        raise source.error("holds no word; the speech was not recognised or not aligned")
    if not phones and looks_like_phones([w.label for w in words]):
        words, phones = [], words
    said = any(not is_word_silence(w.label) for w in words)
    if not phones and not said:
        raise source.error("holds no word and no phone")
    return Timing(
        phone_track(source, phones, alphabet, slack=SLACK, end=end) if phones else None,
        word_track(source, words, end, SLACK) if said else None,
    )


def _span(source: Source, value: Any, place: str) -> Span:
    label = member(source, value, "t", str, place)
    times = []
    for key, what in (("b", "'b', the begin in seconds"), ("d", "'d', the duration in seconds")):
        if key not in value:
            raise source.error(f"expected a member {key!r}", place)
        times.append(source.number(value[key], what, place))
    return Span(times[0], times[0] + times[1], label, place)


def _segment(it: Interval, inner: list[Interval] | None = None) -> dict[str, Any]:
    out: dict[str, Any] = {"b": it.start, "d": it.end - it.start, "p": 1.0, "t": it.label}
    if inner is not None:
        out["w"] = [_segment(p) for p in inner]
    return out


def write(timing: Timing) -> str:
    """Format the phones inside their words, or either alone."""
    phones = timing.phones.intervals() if timing.phones else []
    words = timing.words.intervals() if timing.words else []
    rows: list[dict[str, Any]] = []
    if not words or not phones:
        rows = [_segment(i) for i in phones or words]
    else:
        middles, done, before = [(p.start + p.end) / 2 for p in phones], 0, 0.0
        for word in [*words, Interval(timing.end, timing.end, "")]:
            first, after = bisect_left(middles, word.start), bisect_left(middles, word.end)
            silent, inner = phones[done:first], phones[first:after]
            done = max(done, after)
            if silent:
                start, end = max(before, silent[0].start), min(silent[-1].end, word.start)
                rows.append(_segment(Interval(start, end, "<sil>"), silent))
            if word.label:
                rows.append(_segment(word, inner))
            before = word.end
    text = " ".join(w.label for w in words)
    value = {"b": 0.0, "d": timing.end, "p": 1.0, "t": text, "w": rows}
    return json.dumps(value, ensure_ascii=False) + "\n"
