"""A text file as the timing readers see it, and the one error they all raise."""

from __future__ import annotations

import codecs
import contextlib
import math
import os
import re
import reprlib
import uuid
from dataclasses import dataclass
from pathlib import Path

from database.errors import TimingError

MAX_BYTES = 16 * 2**20
"""Larger files are refused: an hour of speech has a few megabytes of times."""

MAX_LINES = 1_000_000
"""Files of more lines are refused: five hours of phones in a TextGrid have fewer."""

_LONGEST_NUMBER = 100
"""Characters; no time needs more, and very long numbers take very long to read."""

CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
"""Characters that no text file holds."""

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
_WHOLE = re.compile(r"[-+]?\d{1,18}", re.ASCII)


_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3


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
            value = float(text) if len(text) <= _LONGEST_NUMBER else math.inf
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
    # A deep or large value is not written out only to be cut; a text is cut at its end.
    text = repr(value[:41]) if isinstance(value, str) else _SHORT.repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def read_source(path: str | os.PathLike[str]) -> Source:
    """Read a text file; see `decoded`.

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
    return decoded(file, data)


def _encoding(data: bytes) -> str:
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    # Without a mark: the ASCII that all formats begin with has a zero as every other byte.
    first, second = data[:64:2], data[1:64:2]
    if first and second:
        if not any(first) and all(second):
            return "utf-16-be"
        if not any(second) and all(first):
            return "utf-16-le"
    return "utf-8-sig"


def decoded(path: str | os.PathLike[str], data: bytes) -> Source:
    """Decode a file's bytes: UTF-8 or UTF-16 of either byte order, each with or without a mark.

    Parameters
    ----------
    path : path
        Where the bytes come from, for messages.
    data : bytes

    Raises
    ------
    TimingError
        If they are empty, binary, too many or in another encoding.
    """
    source = Source(Path(path), "")
    if len(data) > MAX_BYTES:
        raise source.error(f"larger than {MAX_BYTES >> 20} MiB, not a timing or words file")
    encoding = _encoding(data)
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        eight = encoding == "utf-8-sig"
        line = data[: error.start].count(b"\n") + 1 if eight else None
        raise source.error(
            f"expected text in {'UTF-8' if eight else 'UTF-16'}, got byte "
            f"0x{data[error.start]:02x} at offset {error.start}; "
            f"is this a text file? If so, save it as UTF-8",
            line,
        ) from error
    if not text.strip():
        raise source.error("the file is empty")
    binary = CONTROL.search(text)
    if binary:
        line = text.count("\n", 0, binary.start()) + 1
        raise source.error(f"expected text, got the control character {binary[0]!r}", line)
    if len(re.findall(r"\r\n|\r|\n", text)) > MAX_LINES:
        raise source.error(f"has more than {MAX_LINES} lines; split the recording and its times")
    return Source(source.path, text)


def write_text(path: str | os.PathLike[str], text: str, encoding: str = "utf-8") -> None:
    """Write text beside the file and rename, so that no half-written file is ever seen.

    Raises
    ------
    TimingError
        If the folder does not exist or cannot be written.
    """
    try:
        file = Path(path)
        beside = file.with_name(f".{file.name}.{uuid.uuid4().hex[:12]}.part")
        try:
            beside.write_text(text, encoding=encoding, newline="\n")
            beside.replace(file)
        except BaseException:
            with contextlib.suppress(OSError):
                beside.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise TimingError(f"{path}: cannot be written: {error.strerror or error}") from error
    except ValueError as error:  # a zero byte, no name, a lone surrogate
        raise TimingError(f"{os.fspath(path)!r}: cannot be written: {error}") from error
