"""Timing files: phones and words with their times, read and written by file extension.

`FORMATS` is the registry. Where formats share an extension (.csv, .json) the content tells them
apart on reading; on writing the first is taken unless another is named. Readers accept what a
format may hold, check all of it, and raise one `TimingError` that names the file, the place in it
and what was expected. Labels are Table 1's names on writing (SAMPA in .pho).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from database.errors import PhonemeError, TimingError, TrackError
from database.symbols import ALPHABETS
from database.timing import (
    ctm,
    delimited,
    gentle,
    grid,
    htk,
    mbrola,
    mfa_json,
    pocketsphinx,
    rhubarb,
    subtitles,
    textgrid,
)
from database.timing.source import Source, decoded, read_source, write_text
from database.timing.tiers import Timing
from database.timing.words import WordTrack, clean_word, read_words
from database.track import PhonemeTrack

__all__ = [
    "FORMATS",
    "Format",
    "Timing",
    "WordTrack",
    "clean_word",
    "parse_timing",
    "read_timing",
    "read_words",
    "timing_extensions",
    "timing_formats",
    "write_timing",
]


@dataclass(frozen=True)
class Format:
    """One timing format.

    Parameters
    ----------
    name : str
        Name to ask for it by, when writing.
    extensions : tuple of str
        Lower case, with the point.
    holds : str
        What is read and written, for a user.
    read : callable
        From a source and an alphabet.
    write : callable
        To the file's text.
    recognise : callable, optional
        Whether a source of this extension is of this format; by default any is.
    encoding : str
        Of the written file.
    """

    name: str
    extensions: tuple[str, ...]
    holds: str
    read: Callable[[Source, str], Timing]
    write: Callable[[Timing], str]
    recognise: Callable[[Source], bool] = lambda source: True
    encoding: str = "utf-8"


FORMATS: tuple[Format, ...] = (
    Format("textgrid", (".textgrid",), "Praat TextGrid, long or short: tiers phones, words",
           textgrid.read, textgrid.write_long),
    Format("textgrid-short", (".textgrid",), "Praat TextGrid, written short",
           textgrid.read, textgrid.write_short),
    Format("textgrid-utf16", (".textgrid",), "Praat TextGrid, written in UTF-16",
           textgrid.read, textgrid.write_long, encoding="utf-16"),
    Format("htk", (".lab",), "HTK labels: start end label, in 100 ns", htk.read, htk.write),
    Format("mbrola", (".pho",), "MBROLA: phone and milliseconds, SAMPA",
           mbrola.read, mbrola.write),
    Format("csv", (".csv",), "start, end, label in seconds, with or without header",
           delimited.read_plain, delimited.write_plain, lambda s: not delimited.is_mfa(s)),
    Format("mfa-csv", (".csv",), "Montreal Forced Aligner: Begin, End, Label, Type, Speaker",
           delimited.read_mfa, delimited.write_mfa, delimited.is_mfa),
    Format("mfa-json", (".json",), "Montreal Forced Aligner: tiers of entries",
           mfa_json.read, mfa_json.write, mfa_json.recognise),
    Format("pocketsphinx", (".json",), "pocketsphinx align: words with their phones",
           pocketsphinx.read, pocketsphinx.write, pocketsphinx.recognise),
    Format("gentle", (".json",), "Gentle: words with the durations of their phones",
           gentle.read, gentle.write, gentle.recognise),
    Format("rhubarb-json", (".json",), "Rhubarb: mouth shapes A to H and X, for phones",
           rhubarb.read_json, rhubarb.write_json, rhubarb.recognise),
    Format("rhubarb-tsv", (".tsv",), "Rhubarb: seconds and mouth shape a line, for phones",
           rhubarb.read_tsv, rhubarb.write_tsv),
    Format("ctm", (".ctm",), "NIST: file channel start duration token, words or phones",
           ctm.read, ctm.write),
    Format("grid", (".align",), "GRID words: start end word, in 1/25000 s", grid.read, grid.write),
    Format("srt", (".srt",), "SubRip subtitles: cues of words",
           subtitles.read, subtitles.write_srt),
    Format("vtt", (".vtt",), "WebVTT subtitles: cues of words",
           subtitles.read, subtitles.write_vtt),
)  # fmt: skip
"""All formats; of those that share an extension the first is the one written by default."""


def timing_formats() -> tuple[Format, ...]:
    """All formats, for listing."""
    return FORMATS


def timing_extensions() -> tuple[str, ...]:
    """Extensions that can be read and written, lower case, with the point."""
    return tuple(dict.fromkeys(e for f in FORMATS for e in f.extensions))


def _formats_of(path: str | os.PathLike[str]) -> list[Format]:
    extension = Path(path).suffix.lower()
    found = [f for f in FORMATS if extension in f.extensions]
    if not found:
        hint = "holds words without times; " if extension == ".txt" else ""
        raise TimingError(
            f"{path}: {hint}expected a timing file with one of the extensions "
            f"{', '.join(timing_extensions())}"
        )
    return found


def read_timing(path: str | os.PathLike[str], alphabet: str = "auto") -> Timing:
    """Read a timing file, its format told by its extension and content.

    Parameters
    ----------
    path : path
        See `timing_extensions`; upper or lower case.
    alphabet : str
        Alphabet of the phones (`database.symbols.ALPHABETS`); "auto" takes the first that knows
        all of the file's phones.

    Raises
    ------
    TimingError
        If the file cannot be read, or not as its format; names the file, the line where there
        is one, and what was expected.
    """
    formats = _readable(path, alphabet)
    return _read(read_source(path), formats, alphabet)


def parse_timing(path: str | os.PathLike[str], data: bytes, alphabet: str = "auto") -> Timing:
    """Read the bytes of a timing file.

    Parameters
    ----------
    path : path
        Where they come from; its extension tells the format.
    data : bytes
    alphabet : str
        See `read_timing`.

    Raises
    ------
    TimingError
        As of `read_timing`.
    """
    formats = _readable(path, alphabet)
    return _read(decoded(path, data), formats, alphabet)


def _readable(path: str | os.PathLike[str], alphabet: str) -> list[Format]:
    if alphabet != "auto" and alphabet not in ALPHABETS:
        raise TimingError(
            f"{path}: cannot be read in alphabet {alphabet!r}; choose one of auto, "
            + ", ".join(ALPHABETS)
        )
    return _formats_of(path)


def _read(source: Source, formats: list[Format], alphabet: str) -> Timing:
    chosen = next((f for f in formats if f.recognise(source)), formats[0])
    return chosen.read(source, alphabet)


def write_timing(
    path: str | os.PathLike[str],
    timing: Timing | PhonemeTrack | WordTrack,
    format: str | None = None,
) -> None:
    """Write a timing file beside its place and rename it when complete.

    Parameters
    ----------
    path : path
        Its extension chooses the format.
    timing : Timing, PhonemeTrack or WordTrack
        Formats with one tier (.lab, plain csv) take the phones where there are both.
    format : str, optional
        Name of a format of that extension, where it has several.

    Raises
    ------
    TimingError
        If no format has that extension, the format cannot hold the timing, or the folder cannot
        be written.
    """
    formats = _formats_of(path)
    chosen = formats[0] if format is None else next((f for f in formats if f.name == format), None)
    if chosen is None:
        raise TimingError(
            f"{path}: cannot be written as {format!r}; this extension takes "
            + ", ".join(f.name for f in formats)
        )
    if isinstance(timing, PhonemeTrack):
        timing = Timing(timing, None)
    elif isinstance(timing, WordTrack):
        timing = Timing(None, timing)
    try:
        text = chosen.write(timing)
    except (TimingError, TrackError, PhonemeError) as error:
        raise TimingError(f"{path}: {error}") from error
    write_text(path, text, chosen.encoding)
