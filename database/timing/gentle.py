"""Gentle's JSON: ``{"transcript", "words": [{"word", "case", "start", "end", "phones"}]}``.

A phone has a duration only; the first begins with its word. Words of the case
"not-found-in-audio" have no times and are left out, as what Gentle did not hear. Words heard but
"not-found-in-transcript" count. A word outside Gentle's dictionary has times but the phone "oov":
then the file gives words alone, whose phones `unitsel align` can find.

Not carried on writing: silence after the last word, words that mark no speech, and a word's own
ends where its phones lie beyond them. Phones outside all words are written as ``<unk>``, heard
but not in the transcript.
"""

from __future__ import annotations

import json
from bisect import bisect_left
from typing import Any

from database.errors import TimingError
from database.timing.json_text import has_key, member, read_values
from database.timing.source import Source, quoted
from database.timing.tiers import Span, Timing, phone_track, without_position, word_track
from database.timing.words import is_word_silence
from database.track import SMALL_GAP, Interval

SLACK = 5.1e-3
"""Seconds: times are multiples of a hundredth."""

_MISFIT = 0.05
"""Seconds by which the phones of a word may be longer or shorter than the word."""

_UNKNOWN = "<unk>"
_NOISES = frozenset({"noise", "laughter", "breath", "cough", "nsn", "lau", "brth"})


def recognise(source: Source) -> bool:
    """Whether the file names Gentle's members and no other aligner's."""
    return has_key(source, "words") and not has_key(source, "tiers", "w", "mouthCues")


def read(source: Source, alphabet: str) -> Timing:
    """Read Gentle's JSON."""
    values = read_values(source)
    if len(values) != 1:
        raise source.error(f"expected one JSON object, got {len(values)}")
    words: list[Span] = []
    phones: list[Span] = []
    complete = True
    heard = 0
    for i, word in enumerate(member(source, values[0], "words", list, "top level"), 1):
        place = f"word {i}"
        label = member(source, word, "word", str, place).strip()
        case = word.get("case", "success")
        if case == "not-found-in-audio":
            continue
        if case not in ("success", "not-found-in-transcript"):
            raise source.error(
                "expected the case 'success', 'not-found-in-audio' or 'not-found-in-transcript', "
                f"got {quoted(case)}",
                place,
            )
        heard += 1
        span = Span(_time(source, word, "start", place), _time(source, word, "end", place),
                    label, place)  # fmt: skip
        inner = _phones(source, word, span)
        if label != _UNKNOWN:
            words.append(span)
            complete &= bool(inner) or is_word_silence(label)
        complete &= all(p.label != "oov" for p in inner)
        phones += inner
    if not heard:
        raise source.error("holds no word that was found in the audio")
    said = any(not is_word_silence(w.label) for w in words)
    timed = bool(phones) and complete
    if not timed and not said:
        raise source.error("holds no word and no phone that is known")
    return Timing(
        phone_track(source, phones, alphabet, preferred="arpabet", slack=SLACK) if timed else None,
        word_track(source, words, slack=SLACK) if said else None,
    )


def _time(source: Source, value: dict[str, Any], key: str, place: str) -> float:
    if key not in value:
        raise source.error(f"expected a member {key!r}, got {quoted(list(value))}", place)
    return source.number(value[key], f"{key!r} in seconds", place)


def _phones(source: Source, word: dict[str, Any], span: Span) -> list[Span]:
    """A word's phones, one after another from its start."""
    out: list[Span] = []
    at = span.start
    found = member(source, word, "phones", list, str(span.place)) if "phones" in word else []
    for j, phone in enumerate(found, 1):
        place = f"{span.place}, phone {j}"
        label = without_position(member(source, phone, "phone", str, place).strip())
        length = _time(source, phone, "duration", place)
        if length < 0:
            raise source.error(f"expected a duration of 0 or more, got {length:g}", place)
        if length > SMALL_GAP:
            out.append(Span(at, at + length, "sil" if label in _NOISES else label, place))
        at += length
    if out and abs(at - span.end) > _MISFIT:
        raise source.error(
            f"expected phones as long as the word, {span.end - span.start:g} s, "
            f"got {at - span.start:g} s",
            span.place,
        )
    return out


def write(timing: Timing) -> str:
    """Format the phones inside their words, or words without phones."""
    phones = timing.phones.intervals() if timing.phones else []
    middles = [(p.start + p.end) / 2 for p in phones]
    entries: list[tuple[Interval, list[Interval]]] = []
    done = 0
    for word in timing.words.intervals() if timing.words else []:
        first, last = bisect_left(middles, word.start), bisect_left(middles, word.end)
        entries += [*_others(phones[done:first]), (word, _spoken(phones[first:last]))]
        done = last
    entries += _others(phones[done:])
    rows: list[dict[str, Any]] = []
    length = 0
    for k, (word, inner) in enumerate(entries):
        start = min(word.start, inner[0].start) if inner else word.start
        end = max(word.end, inner[-1].end) if inner else word.end
        if k + 1 < len(entries):
            after, later = entries[k + 1]
            end = min(end, after.start, later[0].start) if later else min(end, after.start)
        row: dict[str, Any] = {"word": word.label, "start": start, "end": end}
        if word.label == _UNKNOWN:
            row["case"] = "not-found-in-transcript"
        else:
            row |= {"case": "success", "alignedWord": word.label.lower()}
            row |= {"startOffset": length, "endOffset": length + len(word.label)}
            length += len(word.label) + 1
        if inner:
            row["phones"] = [{"phone": p.label, "duration": p.end - p.start}
                             for p in _filled(start, end, inner)]  # fmt: skip
        rows.append(row)
    if not rows:
        raise TimingError("a Gentle file needs words or sounds, this timing holds silence only")
    text = " ".join(word.label for word, _ in entries if word.label != _UNKNOWN)
    return json.dumps({"transcript": text, "words": rows}, indent=1, ensure_ascii=False) + "\n"


def _spoken(phones: list[Interval]) -> list[Interval]:
    """A word's phones without silence at its ends."""
    sounds = [i for i, p in enumerate(phones) if p.label != "sil"]
    return phones[sounds[0] : sounds[-1] + 1] if sounds else []


def _others(phones: list[Interval]) -> list[tuple[Interval, list[Interval]]]:
    """Runs of sounds that stand in no word."""
    runs: list[list[Interval]] = []
    for p in phones:
        if p.label == "sil":
            continue
        if runs and abs(runs[-1][-1].end - p.start) <= SMALL_GAP:
            runs[-1].append(p)
        else:
            runs.append([p])
    return [(Interval(run[0].start, run[-1].end, _UNKNOWN), run) for run in runs]


def _filled(start: float, end: float, phones: list[Interval]) -> list[Interval]:
    """A word's phones with silence where its ends lie beyond them."""
    first, last = phones[0], phones[-1]
    before = [Interval(start, first.start, "sil")] if first.start - start > SMALL_GAP else []
    after = [Interval(last.end, end, "sil")] if end - last.end > SMALL_GAP else []
    return [*before, *phones, *after]
