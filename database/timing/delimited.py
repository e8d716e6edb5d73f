"""Comma-separated tables: MFA's (Begin, End, Label, Type, Speaker) and plain ones.

A plain table has the columns start, end and label, named in a header or in this order; times are
seconds. A label column named "word" holds words. Semicolons and tabs separate as well.
"""

from __future__ import annotations

import csv
import io

from database.timing.source import Source, quoted
from database.timing.tiers import Span, Tier, Timing, choose_tiers, single_tier
from database.timing.words import fill_gaps

_START = ("start", "begin", "onset", "xmin", "tmin")
_END = ("end", "offset", "xmax", "tmax", "stop")
_LABEL = ("label", "phone", "phoneme", "text", "symbol", "word")

Row = tuple[int, list[str]]


def _rows(source: Source) -> list[Row]:
    """Rows that are not blank, with the number of the line each ends on."""
    head = source.lines()[0][1]
    comma = max(",;\t", key=head.count)
    reader = csv.reader(io.StringIO(source.text, newline=""), delimiter=comma, strict=True)
    try:
        rows = [(reader.line_num, [c.strip() for c in row]) for row in reader]
    except csv.Error as error:
        raise source.error(f"expected comma-separated values: {error}", reader.line_num) from error
    filled = [(n, row) for n, row in rows if any(row)]
    if not filled:
        raise source.error("expected rows of start, end and label, got none")
    return filled


def _columns(header: list[str]) -> tuple[int, int, int] | None:
    """Places of start, end and label; None where the row does not name them."""
    names = [cell.lower() for cell in header]
    places = [
        next((names.index(n) for n in known if n in names), -1) for known in (_START, _END, _LABEL)
    ]
    return None if min(places) < 0 else (places[0], places[1], places[2])


def is_mfa(source: Source) -> bool:
    """Whether the first line is MFA's header."""
    names = {cell.strip(' "').lower() for cell in source.lines()[0][1].split(",")}
    return {"begin", "end", "label", "type"} <= names


def _spans(source: Source, rows: list[Row], columns: tuple[int, int, int]) -> list[Span]:
    spans = []
    for line, row in rows:
        # An empty label at the end of a line may stand without its comma.
        cells = [*row, ""] if len(row) == max(columns) == columns[2] else row
        if len(cells) <= max(columns):
            raise source.error(
                f"expected {max(columns) + 1} columns or more (start, end, label), "
                f"got {quoted(','.join(row))}",
                line,
            )
        start = source.number(cells[columns[0]], "the start in seconds", line)
        end = source.number(cells[columns[1]], "the end in seconds", line)
        spans.append(Span(start, end, cells[columns[2]], line))
    return spans


def read_plain(source: Source, alphabet: str) -> Timing:
    """Read a table of start, end and label, with or without a header."""
    rows = _rows(source)
    line, first = rows[0]
    columns = _columns(first)
    if columns:
        is_words = first[columns[2]].lower() == "word"
        rows = rows[1:]
    else:
        is_words, columns = False, (0, 1, 2)
        if not any(c in "0123456789" for c in first[0]):
            raise source.error(
                f"expected the header 'start,end,label' or a time, got {quoted(','.join(first))}",
                line,
            )
    spans = _spans(source, rows, columns)
    if not spans:
        raise source.error("expected rows of start, end and label after the header", line)
    return single_tier(source, spans, alphabet, is_words=is_words)


def read_mfa(source: Source, alphabet: str) -> Timing:
    """Read MFA's table; rows of other types than words and phones are not used."""
    rows = _rows(source)
    names = [cell.lower() for cell in rows[0][1]]
    columns = _columns(rows[0][1])
    if columns is None or "type" not in names:
        raise source.error("expected the header 'Begin,End,Label,Type,Speaker'", rows[0][0])
    kind, speaker = names.index("type"), names.index("speaker") if "speaker" in names else None
    grouped: dict[str, list[Row]] = {}
    for line, row in rows[1:]:
        if len(row) < len(names):
            raise source.error(f"expected {len(names)} columns, got {quoted(','.join(row))}", line)
        who = f"{row[speaker]} - " if speaker is not None and row[speaker] else ""
        grouped.setdefault(who + row[kind], []).append((line, row))
    tiers = [Tier(name, _spans(source, some, columns)) for name, some in grouped.items()]
    return choose_tiers(source, tiers, alphabet)


def _text(rows: list[list[str]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def write_plain(timing: Timing) -> str:
    """Format the phones, or the words where there are no phones, with a header."""
    track = timing.phones or timing.words
    assert track is not None
    rows = [["start", "end", "label" if timing.phones else "word"]]
    for it in fill_gaps(track.intervals(), timing.end, "sil"):
        rows.append([repr(it.start), repr(it.end), it.label])
    return _text(rows)


def write_mfa(timing: Timing) -> str:
    """Format words and phones as MFA does, without rows for silent words."""
    rows = [["Begin", "End", "Label", "Type", "Speaker"]]
    for kind, track in (("words", timing.words), ("phones", timing.phones)):
        if track is not None:
            rows += [
                [repr(i.start), repr(i.end), i.label, kind, "speaker"] for i in track.intervals()
            ]
    return _text(rows)
