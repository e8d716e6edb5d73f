"""NIST's CTM: ``file channel start duration token [confidence]``, seconds, words or phones.

What follows the token is not read, nor are comments (``;;``); of alternatives the first counts.
Kaldi's marks of a phone's place in its word (AH0_I) are taken off. A file may hold many
recordings: then the one named as the file itself is read. Not carried on writing: silence around
words, and times finer than a microsecond.
"""

from __future__ import annotations

from database.timing.source import Source, quoted
from database.timing.tiers import Span, Timing, single_tier, without_position
from database.timing.words import fill_gaps

SLACK = 1.01e-2
"""Seconds: starts and durations are often rounded to a hundredth each."""


def read(source: Source, alphabet: str) -> Timing:
    """Read a CTM file."""
    found: dict[tuple[str, str], list[Span]] = {}
    skipped = False
    for line, text in source.lines():
        if text.startswith(";;"):
            continue
        parts = text.split()
        if len(parts) < 5:
            raise source.error(
                f"expected 'file channel start duration token', got {quoted(text)}", line
            )
        if parts[4].upper() in ("<ALT_BEGIN>", "<ALT>", "<ALT_END>"):
            skipped = parts[4].upper() == "<ALT>"
            continue
        if skipped:
            continue
        start = source.number(parts[2], "the start in seconds", line)
        length = source.number(parts[3], "the duration in seconds", line)
        if length < 0:
            raise source.error(f"expected a duration of 0 or more, got {quoted(parts[3])}", line)
        row = found.setdefault((parts[0], parts[1]), [])
        if length > 0 and parts[4] != "@":  # NIST's token for no word
            row.append(Span(start, start + length, parts[4], line))
    spans = _chosen(source, found)
    bare = [Span(s.start, s.end, without_position(s.label), s.place) for s in spans]
    if sum(s != b for s, b in zip(spans, bare, strict=True)) * 2 > len(spans):
        spans = bare
    return single_tier(source, spans, alphabet, slack=SLACK)


def _chosen(source: Source, found: dict[tuple[str, str], list[Span]]) -> list[Span]:
    """The one recording of the file."""
    own = [key for key in found if key[0] == source.path.stem]
    keys = own if len(found) > 1 and own else list(found)
    if len(keys) > 1:
        named = ", ".join(quoted(" ".join(k)) for k in keys[:5])
        raise source.error(
            f"expected one recording, got several ({named}); leave one of them in the file, or "
            "name the file as the recording"
        )
    if not keys or not found[keys[0]]:
        raise source.error("holds no word and no phone with a duration")
    return found[keys[0]]


def write(timing: Timing) -> str:
    """Format the phones, or the words where there are no phones."""
    if timing.phones is not None:
        rows = fill_gaps(timing.phones.intervals(), timing.end, "sil")
    else:
        assert timing.words is not None
        rows = timing.words.intervals()
    lines = []
    for it in rows:
        start, end = round(it.start * 1e6), round(it.end * 1e6)
        lines.append(f"speech 1 {_seconds(start)} {_seconds(end - start)} {it.label}")
    return "\n".join(lines) + "\n"


def _seconds(micros: int) -> str:
    return f"{micros // 1_000_000}.{micros % 1_000_000:06d}"
