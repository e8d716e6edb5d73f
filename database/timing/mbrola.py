"""MBROLA .pho: ``phone milliseconds`` and pitch points, one phone a line, SAMPA.

Pitch points are not read, nor are comments (``;``) and the flush command (a lone ``#``). A phone
of no length is no phone. Table 1's h is written, and read back, as hh: SAMPA has one letter.
"""

from __future__ import annotations

from database.errors import TimingError
from database.symbols import to_sampa
from database.timing.source import Source, quoted
from database.timing.tiers import Span, Timing, phone_track
from database.timing.words import fill_gaps


def read(source: Source, alphabet: str) -> Timing:
    """Read a .pho file."""
    spans: list[Span] = []
    at = 0.0  # milliseconds
    for line, text in source.lines():
        parts = text.split(";", 1)[0].split() if text.startswith(";") else text.split()
        if not parts or parts == ["#"]:
            continue
        if len(parts) < 2:
            raise source.error(f"expected 'phone milliseconds', got {quoted(text)}", line)
        length = source.number(parts[1], "the length in milliseconds", line)
        if length < 0:
            raise source.error(f"expected a length of 0 or more, got {quoted(parts[1])}", line)
        if length > 0:
            spans.append(Span(at / 1000, (at + length) / 1000, parts[0], line))
        at += length
    return Timing(phone_track(source, spans, alphabet, preferred="sampa"), None)


def write(timing: Timing) -> str:
    """Format the phones, times rounded to a microsecond and lengths taken between them."""
    if timing.phones is None:
        raise TimingError("an MBROLA file (.pho) needs phones, this timing holds words only")
    lines = []
    for it in fill_gaps(timing.phones.intervals(), timing.end, "sil"):
        micros = round(it.end * 1e6) - round(it.start * 1e6)
        lines.append(f"{to_sampa(it.label)} {micros // 1000}.{micros % 1000:03d}")
    return "\n".join(line.rstrip("0").rstrip(".") for line in lines) + "\n"
