"""HTK label files: ``start end label`` in whole units of 100 ns.

A .lab file without times holds words only, as MFA takes them beside a recording; that is not a
timing file and says so. Labels that are no phonemes make a tier of words.
"""

from __future__ import annotations

import re

from database.timing.source import Source
from database.timing.tiers import Timing, single_tier
from database.timing.whole_units import read_spans, write_spans
from database.timing.words import fill_gaps

UNITS = 10_000_000
"""Units a second."""


def read(source: Source, alphabet: str) -> Timing:
    """Read an HTK label file."""
    lines = source.lines()
    if not any(re.match(r"[-+]?\.?\d", text) for _, text in lines):
        raise source.error(
            "expected lines 'start end label' in units of 100 ns, got words without times; "
            "give it as a words file, or align it with the sound first",
            lines[0][0],
        )
    return single_tier(source, read_spans(source, UNITS), alphabet)


def write(timing: Timing) -> str:
    """Format the phones, or the words where there are no phones."""
    track = timing.phones or timing.words
    assert track is not None
    return write_spans(fill_gaps(track.intervals(), timing.end, "sil"), UNITS)
