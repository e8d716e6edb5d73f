"""Word times of the GRID corpus (.align): ``start end word`` in whole units of 1/25000 s."""

from __future__ import annotations

from database.errors import TimingError
from database.timing.source import Source
from database.timing.tiers import Timing, word_track
from database.timing.whole_units import read_spans, write_spans
from database.timing.words import fill_gaps

UNITS = 25_000
"""Units a second."""


def read(source: Source, alphabet: str) -> Timing:
    """Read a GRID word file; the alphabet plays no part."""
    return Timing(None, word_track(source, read_spans(source, UNITS)))


def write(timing: Timing) -> str:
    """Format the words, silences between them as ``sil``."""
    if timing.words is None:
        raise TimingError("a GRID word file (.align) needs words, this timing holds phones only")
    return write_spans(fill_gaps(timing.words.intervals(), timing.words.duration, "sil"), UNITS)
