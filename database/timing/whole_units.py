"""Lines of ``start end label`` in whole units of time, as HTK and GRID write them."""

from __future__ import annotations

from collections.abc import Iterable

from database.errors import TimingError
from database.timing.source import Source, quoted
from database.timing.tiers import Span
from database.track import Interval


def read_spans(source: Source, units: int) -> list[Span]:
    """Read ``start end label`` lines; what follows the label is not read.

    Parameters
    ----------
    source : Source
    units : int
        Units a second.
    """
    spans = []
    for line, text in source.lines():
        parts = text.split()
        if len(parts) < 3:
            raise source.error(
                f"expected 'start end label' in units of 1/{units} s, got {quoted(text)}", line
            )
        start = source.whole(parts[0], "the start", line)
        end = source.whole(parts[1], "the end", line)
        spans.append(Span(start / units, end / units, parts[2], line))
    return spans


def write_spans(intervals: Iterable[Interval], units: int) -> str:
    """Format intervals as lines, times rounded to whole units.

    Raises
    ------
    TimingError
        If an interval is shorter than the units can say.
    """
    lines = []
    for it in intervals:
        start, end = round(it.start * units), round(it.end * units)
        if end <= start:
            raise TimingError(
                f"{it.label!r} from {it.start:g} to {it.end:g} s is too short for units of "
                f"1/{units} s; choose another format"
            )
        lines.append(f"{start} {end} {it.label}")
    return "\n".join(lines) + "\n"
