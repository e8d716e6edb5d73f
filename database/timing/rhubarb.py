"""Rhubarb's mouth shapes, .json (``{"mouthCues": [{"start", "end", "value"}]}``) and .tsv.

A .tsv line is ``seconds TAB shape``; the last one marks the end of the sound. The shapes A to H
and X are Hanna-Barbera's, as Rhubarb's manual describes them. They say how the mouth looks and
not what is spoken, so on reading one phoneme stands for each (`STAND_INS`), and on writing each
phoneme becomes one shape, a diphthong two (`SHAPES`). From shapes to phonemes and back nothing
changes; from phonemes to shapes and back only the shape is kept. Times are hundredths of a second.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import pairwise
from typing import Final

from database.errors import TimingError
from database.timing.json_text import has_key, member, read_values
from database.timing.source import Source, quoted
from database.timing.tiers import Span, Timing, phone_track
from database.timing.words import fill_gaps
from database.track import Interval

STAND_INS: Final[Mapping[str, str]] = {
    "A": "m", "B": "s", "C": "eh", "D": "aa", "E": "ao", "F": "uw", "G": "f", "H": "l", "X": "sil",
}  # fmt: skip
"""The phoneme that stands for each shape: one of those that Rhubarb's manual describes it by."""

_PHONEMES: Final[Mapping[str, str]] = {
    "A": "p b m", "B": "iy ih ix y r s z sh ch jh zh th dh d t n k g ng", "C": "ae ax ah eh",
    "D": "aa", "E": "ao er", "F": "uw uh w", "G": "f v", "H": "l", "X": "sil",
    "CB": "ey", "DB": "ay", "DE": "aw", "EF": "ow", "EB": "oy",
}  # fmt: skip
SHAPES: Final[Mapping[str, str]] = {p: s for s, ps in _PHONEMES.items() for p in ps.split()}
"""Shape of each phoneme, two for a diphthong; an h has the shape of what follows it."""

_OPEN = "C"
_FIRST_PART = 0.6
"""Share of a diphthong's time that its first shape has."""


def recognise(source: Source) -> bool:
    """Whether the file names mouth cues."""
    return has_key(source, "mouthCues") and not has_key(source, "tiers", "w")


def _timing(source: Source, spans: list[Span]) -> Timing:
    phones = []
    for s in spans:
        shape = s.label.strip().upper()
        if shape not in STAND_INS:
            raise source.error(
                f"expected a mouth shape, one of {', '.join(STAND_INS)}, got {quoted(s.label)}",
                s.place,
            )
        if s.end != s.start:
            phones.append(Span(s.start, s.end, STAND_INS[shape], s.place))
    return Timing(phone_track(source, phones, "table"), None, shapes_only=True)


def read_json(source: Source, alphabet: str) -> Timing:
    """Read mouth cues from JSON; the alphabet plays no part."""
    values = read_values(source)
    if len(values) != 1:
        raise source.error(f"expected one JSON object, got {len(values)}")
    spans = []
    for i, cue in enumerate(member(source, values[0], "mouthCues", list, "top level"), 1):
        place = f"mouth cue {i}"
        label = member(source, cue, "value", str, place)
        for key in ("start", "end"):
            if key not in cue:
                raise source.error(f"expected a member {key!r}, got {quoted(list(cue))}", place)
        start = source.number(cue["start"], "'start' in seconds", place)
        spans.append(Span(start, source.number(cue["end"], "'end' in seconds", place), label,
                          place))  # fmt: skip
    return _timing(source, spans)


def read_tsv(source: Source, alphabet: str) -> Timing:
    """Read mouth shapes from lines; the alphabet plays no part."""
    marks: list[Span] = []
    for line, text in source.lines():
        parts = text.split()
        if len(parts) != 2:
            raise source.error(
                f"expected 'seconds TAB shape', got {quoted(text)}; a table of start, end and "
                "label is read as .csv",
                line,
            )
        at = source.number(parts[0], "the time in seconds", line)
        marks.append(Span(at, at, parts[1], line))
    if len(marks) < 2:
        raise source.error("expected two lines or more, the last marks the end", marks[0].place)
    spans = [Span(a.start, b.start, a.label, a.place) for a, b in pairwise(marks)]
    last = marks[-1]
    return _timing(source, [*spans, Span(last.start, last.start, last.label, last.place)])


def shapes(timing: Timing) -> list[Interval]:
    """Mouth shapes of a timing's phones, times in whole hundredths of a second.

    Raises
    ------
    TimingError
        If the timing holds no phones, or is too short to say anything.
    """
    if timing.phones is None:
        raise TimingError("a file of mouth shapes needs phones, this timing holds words only")
    parts: list[Interval] = []
    after = _OPEN
    # Backwards, since an h takes the shape of what follows.
    for it in reversed(fill_gaps(timing.phones.intervals(), timing.end, "sil")):
        shape = SHAPES.get(it.label, after if after != "X" else _OPEN)
        middle = it.start + _FIRST_PART * (it.end - it.start)
        if len(shape) == 2:
            parts.append(Interval(middle, it.end, shape[1]))
        parts.append(Interval(it.start, middle if len(shape) == 2 else it.end, shape[0]))
        after = shape[0]
    out: list[Interval] = []
    for it in reversed(parts):
        start, end = round(it.start * 100) / 100, round(it.end * 100) / 100
        if out and out[-1].label == it.label:
            out[-1] = Interval(out[-1].start, end, it.label)
        elif end > start:
            out.append(Interval(start, end, it.label))
    if not out:
        raise TimingError(
            f"{timing.end:g} s are too short for hundredths of a second; choose another format"
        )
    return out


def write_json(timing: Timing) -> str:
    """Format the mouth shapes as Rhubarb's JSON."""
    cues = [{"start": i.start, "end": i.end, "value": i.label} for i in shapes(timing)]
    value = {"metadata": {"soundFile": "", "duration": cues[-1]["end"]}, "mouthCues": cues}
    return json.dumps(value, indent=1) + "\n"


def write_tsv(timing: Timing) -> str:
    """Format the mouth shapes as Rhubarb's lines, with a closed mouth at the end."""
    found = shapes(timing)
    lines = [f"{i.start:.2f}\t{i.label}" for i in found]
    return "\n".join([*lines, f"{found[-1].end:.2f}\tX"]) + "\n"
