"""MFA's JSON: ``{"start", "end", "tiers": {name: {"type": "interval", "entries": [[b, e, label]]}}}``.

Tiers of points are not used. Its csv is in `database.timing.delimited`.
"""  # noqa: E501

from __future__ import annotations

import json
from typing import Any

from database.timing.json_text import has_key, member, read_values
from database.timing.source import Source, quoted
from database.timing.tiers import Span, Tier, Timing, choose_tiers


def recognise(source: Source) -> bool:
    """Whether the file names tiers, or nothing that another aligner's JSON has."""
    return has_key(source, "tiers") or not has_key(source, "w", "words", "mouthCues")


def read(source: Source, alphabet: str) -> Timing:
    """Read MFA's JSON."""
    values = read_values(source)
    if len(values) != 1:
        raise source.error(f"expected one JSON object, got {len(values)}")
    named = member(source, values[0], "tiers", dict, "top level")
    end = source.number(values[0].get("end", 0), "'end' in seconds", "top level")
    tiers = []
    for name, tier in named.items():
        place = f"tier {quoted(name)}"
        if isinstance(tier, dict) and tier.get("type", "interval") != "interval":
            continue
        entries = member(source, tier, "entries", list, place)
        spans = [_span(source, e, f"{place}, entry {i}") for i, e in enumerate(entries, 1)]
        tiers.append(Tier(name, spans, end))
    return choose_tiers(source, tiers, alphabet)


def _span(source: Source, entry: Any, place: str) -> Span:
    if not isinstance(entry, list) or len(entry) != 3 or not isinstance(entry[2], str):
        raise source.error(f"expected [begin, end, label], got {quoted(entry)}", place)
    begin = source.number(entry[0], "the begin in seconds", place)
    return Span(begin, source.number(entry[1], "the end in seconds", place), entry[2], place)


def write(timing: Timing) -> str:
    """Format words and phones as MFA does."""
    tiers = {
        name: {"type": "interval", "entries": [[i.start, i.end, i.label] for i in t.intervals()]}
        for name, t in (("words", timing.words), ("phones", timing.phones))
        if t is not None
    }
    value = {"start": 0, "end": timing.end, "tiers": tiers}
    return json.dumps(value, indent=1, ensure_ascii=False) + "\n"
