"""The text that is to be spoken: given, from a file, or from standard input."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

from database.errors import SpeechError

LARGEST: Final = 16_000_000
"""Characters that espeak can count, which is some two hundred hours."""


def checked_text(text: str, name: str = "text") -> str:
    """The text, if there is anything in it to say.

    Raises
    ------
    SpeechError
        If it is empty, or too long.
    """
    text = text.removeprefix("\ufeff").strip()
    if not text:
        raise SpeechError(f"{name}: is empty; there is nothing to say")
    if len(text) > LARGEST:
        raise SpeechError(f"{name}: has {len(text)} characters; at most {LARGEST} can be spoken")
    return text


def read_text(source: str | Path) -> str:
    """The text of a file, or of standard input.

    Parameters
    ----------
    source : path
        UTF-8, or UTF-16 with its mark; ``-`` is standard input.

    Raises
    ------
    SpeechError
        If it cannot be read, is no text, or holds none.
    """
    name = "standard input" if source == "-" else str(source)
    try:
        data = sys.stdin.buffer.read() if source == "-" else Path(source).read_bytes()
        wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
        text = data.decode("utf-16" if wide else "utf-8")
    except OSError as error:
        raise SpeechError(f"{name}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise SpeechError(
            f"{name}: is not a text in UTF-8 (byte {error.start}); save it as UTF-8"
        ) from error
    if "\0" in text:
        raise SpeechError(f"{name}: holds zero bytes, so it is no text")
    return checked_text(text, name)
