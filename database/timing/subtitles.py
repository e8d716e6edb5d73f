"""Subtitles, SubRip (.srt) and WebVTT (.vtt), as words with times.

The words of a cue share its time by their letters; the aligner then keeps them inside the cue, not
at these guesses. A time inside a cue (``<00:01.500>``, as of karaoke) divides it. Tags, settings,
comments, styles, character entities, sounds in brackets and punctuation are taken off. Written is
one cue a word, in milliseconds; silence after the last word is not carried.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator

from database.errors import TimingError
from database.timing.source import Source, quoted
from database.timing.tiers import Span, Timing, word_track
from database.timing.words import clean_word

SLACK = 1.1e-3
"""Seconds: times are rounded to a millisecond."""

_TIME = r"(?:(\d{1,4}):)?(\d{1,2}):(\d{1,2})(?:[.,](\d{1,3}))?"
_TIMING = re.compile(rf"{_TIME}[ \t]*-->[ \t]*{_TIME}(?:[ \t].*)?", re.ASCII)
_INNER_TIME = re.compile(rf"<{_TIME}>", re.ASCII)
_TAG = re.compile(r"</?[A-Za-z][^<>]*>|\{\\[^{}]*\}")
_SOUND = re.compile(r"\[[^\[\]]*\]|\([^()]*\)")

Block = list[tuple[int, str]]


def _blocks(source: Source) -> Iterator[Block]:
    """Lines between empty lines, with their numbers."""
    block: Block = []
    for number, line in enumerate(re.split(r"\r\n|\r|\n", source.text), 1):
        if line.strip():
            block.append((number, line.strip()))
        elif block:
            yield block
            block = []
    if block:
        yield block


def _seconds(source: Source, parts: tuple[str | None, ...], line: int) -> float:
    hours, minutes, seconds, fraction = parts
    if int(minutes or 0) > 59 or int(seconds or 0) > 59:
        raise source.error("expected minutes and seconds from 0 to 59", line)
    whole = int(hours or 0) * 3600 + int(minutes or 0) * 60 + int(seconds or 0)
    return (whole * 1000 + int((fraction or "0").ljust(3, "0"))) / 1000


def _replacement(tag: re.Match[str]) -> str:
    """A line break for a tag that is one: other tags may stand inside a word."""
    return " " if re.match(r"<br\b|\{\\N", tag[0], re.IGNORECASE) else ""


def _spans(source: Source, text: str, start: float, end: float, line: int) -> list[Span]:
    """The words of a cue, divided where times stand inside it."""
    pieces = _INNER_TIME.split(text)
    starts = [start] + [
        _seconds(source, tuple(pieces[i : i + 4]), line) for i in range(1, len(pieces), 5)
    ]
    spans = []
    for at, until, piece in zip(starts, [*starts[1:], end], pieces[::5], strict=True):
        plain = html.unescape(_TAG.sub(_replacement, piece))
        words = [w for token in _SOUND.sub(" ", plain).split() if (w := clean_word(token))]
        if words:
            spans.append(Span(at, until, " ".join(words), line))
    return spans


def _is_cue(block: Block) -> bool:
    return any("-->" in text for _, text in block[:2])


def read(source: Source, alphabet: str) -> Timing:
    """Read subtitles; the alphabet plays no part."""
    blocks = _blocks(source)
    if source.path.suffix.lower() == ".vtt":
        line, first = next(blocks)[0]
        if not re.match(r"WEBVTT(\s|$)", first):
            raise source.error(f"expected WEBVTT, got {quoted(first)}", line)
    spans: list[Span] = []
    for block in blocks:
        if not _is_cue(block):
            if re.match(r"(NOTE|STYLE|REGION|WEBVTT)\b", block[0][1]):
                continue
            raise source.error(
                f"expected 'HH:MM:SS,mmm --> HH:MM:SS,mmm', got {quoted(block[0][1])}; empty "
                "lines stand only between cues",
                block[0][0],
            )
        # A line before the times is the cue's name or number.
        line, times = block.pop(0) if "-->" in block[0][1] else block.pop(1)
        found = _TIMING.fullmatch(times)
        if found is None:
            raise source.error(f"expected 'HH:MM:SS,mmm --> HH:MM:SS,mmm', got {quoted(times)}",
                               line)  # fmt: skip
        start = _seconds(source, found.groups()[:4], line)
        end = _seconds(source, found.groups()[4:], line)
        if end <= start:
            raise source.error(f"expected an end after the start at {start:g} s", line)
        rows = [(n, text) for n, text in block if n > line]
        for n, text in rows:
            if "-->" in text:
                raise source.error("expected an empty line before the next cue", n)
        spans += _spans(source, "\n".join(text for _, text in rows), start, end, line)
    if not spans:
        raise source.error("holds no word")
    return Timing(None, word_track(source, spans, slack=SLACK))


def _cues(timing: Timing, point: str) -> list[str]:
    if timing.words is None:
        raise TimingError("subtitles need words, this timing holds phones only")
    out = []
    for i, it in enumerate(timing.words.intervals(), 1):
        start, end = round(it.start * 1000), round(it.end * 1000)
        if end <= start:
            raise TimingError(
                f"{it.label!r} from {it.start:g} to {it.end:g} s is too short for milliseconds; "
                "choose another format"
            )
        label = html.escape(it.label, quote=False)
        out.append(f"{i}\n{_clock(start, point)} --> {_clock(end, point)}\n{label}\n")
    return out


def _clock(millis: int, point: str) -> str:
    seconds, rest = divmod(millis, 1000)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}{point}{rest:03d}"


def write_srt(timing: Timing) -> str:
    """Format the words as SubRip, one cue a word."""
    return "\n".join(_cues(timing, ","))


def write_vtt(timing: Timing) -> str:
    """Format the words as WebVTT, one cue a word."""
    return "\n".join(["WEBVTT\n", *_cues(timing, ".")])
