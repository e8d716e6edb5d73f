"""A manifest: clips listed in a table instead of lying in a folder.

A CSV file with a header. Columns, in any order: ``media`` (a file, from the manifest's folder),
``words`` (what is said) or ``timing`` (a timing file), and ``start`` and ``end`` (seconds; blank
means from the beginning, to the end). Times in a timing file are those of the media file. A row
with neither words nor timing takes what lies beside its media file.
"""

from __future__ import annotations

import csv
import io
import math
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from analysis.corpus import MEDIA_EXTENSIONS, Clip, clip_name, scripts_beside, snapped
from database.errors import CorpusError, TimingError
from database.timing import clean_word, timing_extensions
from database.timing.source import quoted, read_source

COLUMNS: Final = ("media", "words", "timing", "start", "end")

MANIFEST_EXTENSION: Final = ".csv"


@dataclass(frozen=True)
class _Row:
    """One line of the table."""

    path: Path
    line: int
    values: dict[str, str] = field(default_factory=dict)

    def get(self, column: str) -> str:
        return self.values.get(column, "")

    def error(self, column: str, what: str) -> CorpusError:
        return CorpusError(f"{self.path}: line {self.line}, column {column!r}: {what}")

    def seconds(self, column: str) -> float | None:
        text = self.get(column)
        if not text:
            return None
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and value >= 0):
            raise self.error(column, f"expected seconds, 0 or more, got {quoted(text)}")
        return value

    def file(self, column: str, extensions: tuple[str, ...], kind: str) -> Path | None:
        text = self.get(column)
        if not text:
            return None
        if "\0" in text:
            raise self.error(column, f"expected {kind}, got {quoted(text)}")
        file = self.path.parent / text
        if file.suffix.lower() not in extensions:
            raise self.error(
                column, f"expected {kind} ({', '.join(sorted(extensions))}), got {quoted(text)}"
            )
        if not file.is_file():
            raise self.error(column, f"there is no file {file}")
        return file


def read_manifest(path: str | Path) -> list[Clip]:
    """The clips of a manifest, in its order.

    Parameters
    ----------
    path : path

    Raises
    ------
    CorpusError
        If the manifest cannot be read, or a row of it is wrong; names the line and the column.
    """
    rows = _rows(Path(path))
    shared = Counter(
        stem for stem, _ in {(Path(r.get("media")).stem, r.get("media")) for r in rows}
    )
    seen: dict[str, int] = {}
    clips = []
    for row in rows:
        clip = _clip(row, shared)
        if clip.name in seen:
            raise row.error("media", f"names {clip.name} again, as line {seen[clip.name]} did")
        seen[clip.name] = row.line
        clips.append(clip)
    return clips


def _clip(row: _Row, shared: Counter[str]) -> Clip:
    media = row.file("media", tuple(MEDIA_EXTENSIONS), "a media file")
    if media is None:
        raise row.error("media", "expected a media file, got nothing")
    given, end = row.seconds("start"), row.seconds("end")
    start = snapped(media, given or 0.0)
    if end is not None and end <= max(start, given or 0.0):
        raise row.error("end", f"{end:g} s is not after the start at {given or 0.0:g} s")
    timing = row.file("timing", timing_extensions(), "a timing file")
    words = tuple(w for token in row.get("words").split() if (w := clean_word(token)))
    if row.get("words") and not words:
        raise row.error("words", f"expected words, got {quoted(row.get('words'))}")
    scripts: tuple[Path, ...] = (timing,) if timing is not None else ()
    if not scripts and not words:
        scripts = scripts_beside(media)
        if not scripts:
            raise row.error(
                "words", f"gives none, nor a timing, and there is none beside {media.name}"
            )
    stem = media.stem if shared[media.stem] == 1 else row.get("media")
    name = clip_name(stem, given, end)
    return Clip(name, media, scripts, start, end, words)


def _rows(path: Path) -> list[_Row]:
    try:
        text = read_source(path).text
    except TimingError as error:
        raise CorpusError(str(error)) from error
    reader = csv.reader(io.StringIO(text, newline=""), strict=True, skipinitialspace=True)
    header: list[str] | None = None
    rows = []
    try:
        for cells in reader:
            values = [c.strip() for c in cells]
            if not any(values):
                continue
            if header is None:
                header = _checked_header(path, reader.line_num, values)
                continue
            if len(values) != len(header):
                raise CorpusError(
                    f"{path}: line {reader.line_num}: has {len(values)} cells, the header has "
                    f"{len(header)} ({', '.join(header)}); put words with commas in quotes"
                )
            rows.append(_Row(path, reader.line_num, dict(zip(header, values, strict=True))))
    except csv.Error as error:
        raise CorpusError(f"{path}: line {reader.line_num}: {error}") from error
    if not rows:
        raise CorpusError(f"{path}: lists no clip; expected a header and one line a clip")
    return rows


def _checked_header(path: Path, line: int, names: list[str]) -> list[str]:
    header = [n.lower() for n in names]
    for name in header:
        if name not in COLUMNS:
            raise CorpusError(
                f"{path}: line {line}, column {name!r}: is none of the header's columns, "
                f"which are {', '.join(COLUMNS)} (separated by commas)"
            )
        if header.count(name) > 1:
            raise CorpusError(f"{path}: line {line}, column {name!r}: is named twice")
    if "media" not in header:
        raise CorpusError(f"{path}: line {line}: the header has no column 'media'")
    return header
