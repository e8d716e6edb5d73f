"""A text file as the timing readers see it, and the one error they all raise."""

from __future__ import annotations

import codecs
import contextlib
import math
import os
import re
import uuid
from dataclasses import dataclass
from pathlib import Path

from database.errors import TimingError

MAX_BYTES = 64 * 2**20
"""Larger files are refused: hours of speech have a few megabytes of times."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_WHOLE = re.compile(r"[-+]?\d{1,18}", re.ASCII)


@dataclass(frozen=True)
class Source:
    """The text of one file.

    Parameters
    ----------
    path : Path
    text : str
    """

    path: Path
    text: str

    def lines(self) -> list[tuple[int, str]]:
        """Lines that are not blank, with their numbers from 1."""
        numbered = enumerate(re.split(r"\r\n|\r|\n", self.text), 1)
        return [(n, line.strip()) for n, line in numbered if line.strip()]

    def error(self, what: str, place: str | int | None = None) -> TimingError:
        """One line for the user: file, place (a line number or words), what was expected."""
        where = f"line {place}: " if isinstance(place, int) else f"{place}: " if place else ""
        return TimingError(f"{self.path}: {where}{what}")

    def number(self, text: object, what: str, place: str | int | None) -> float:
        """Read a finite number, or raise naming what it should have been."""
        if isinstance(text, (int, float)) and not isinstance(text, bool):
            value = float(text) if abs(text) < 1e18 else math.inf
        elif isinstance(text, str) and _NUMBER.fullmatch(text.strip()):
            value = float(text)
        else:
            raise self.error(f"expected {what} as a number, got {quoted(text)}", place)
        if not math.isfinite(value):
            raise self.error(f"expected {what} as a finite number, got {quoted(text)}", place)
        return value

    def whole(self, text: str, what: str, place: str | int | None) -> int:
        """Read a whole number, or raise naming what it should have been."""
        if not _WHOLE.fullmatch(text):
            raise self.error(f"expected {what} as a whole number, got {quoted(text)}", place)
        return int(text)


def quoted(value: object) -> str:
    """Show a value in a message, on one line and cut to a readable length."""
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def read_source(path: str | os.PathLike[str]) -> Source:
    """Read a text file: UTF-8, with or without byte order mark, or UTF-16 with one.

    Raises
    ------
    TimingError
        If there is no such file, or it is empty, binary, too large or in another encoding.
    """
    try:
        file = Path(path)
        with file.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise TimingError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:  # a path that holds a zero byte
        raise TimingError(f"{os.fspath(path)!r}: cannot be read: {error}") from error
    source = Source(file, "")
    if len(data) > MAX_BYTES:
        raise source.error(f"larger than {MAX_BYTES >> 20} MiB, not a timing or words file")
    encoding = "utf-8-sig"
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1 if encoding == "utf-8-sig" else None
        raise source.error(
            f"expected text in UTF-8, got byte 0x{data[error.start]:02x} at offset {error.start}; "
            f"is this a text file? If so, save it as UTF-8",
            line,
        ) from error
    if not text.strip():
        raise source.error("the file is empty")
    binary = re.search(r"[\x00-\x08\x0e-\x1f\x7f]", text)
    if binary:
        line = text.count("\n", 0, binary.start()) + 1
        raise source.error(f"expected text, got the control character {binary[0]!r}", line)
    return Source(file, text)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write UTF-8 beside the file and rename, so that no half-written file is ever seen.

    Raises
    ------
    TimingError
        If the folder does not exist or cannot be written.
    """
    try:
        file = Path(path)
        beside = file.with_name(f".{file.name}.{uuid.uuid4().hex[:12]}.part")
        try:
            beside.write_text(text, encoding="utf-8", newline="\n")
            beside.replace(file)
        except BaseException:
            with contextlib.suppress(OSError):
                beside.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise TimingError(f"{path}: cannot be written: {error.strerror or error}") from error
    except ValueError as error:  # a zero byte, no name, a lone surrogate
        raise TimingError(f"{os.fspath(path)!r}: cannot be written: {error}") from error
