"""The note of what the person filmed has agreed to, which a database carries."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from database.checks import check_consent
from database.errors import DatabaseError


def read_consent(given: str) -> str:
    """The note that ``--consent`` gives.

    Parameters
    ----------
    given : str
        The note itself, or ``@`` and the name of a text file (UTF-8) that holds it.

    Raises
    ------
    DatabaseError
        If the file cannot be read, or there is no note in it.
    """
    if not given.startswith("@"):
        return checked_consent(given)
    path = Path(given[1:])
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise DatabaseError(
            f"{path}: the consent note cannot be read ({error.strerror or error})"
        ) from error
    except UnicodeDecodeError as error:
        raise DatabaseError(
            f"{path}: the consent note is no text in UTF-8; save it as such"
        ) from error
    return checked_consent(text, f"{path}: ")


def checked_consent(note: str, where: str = "") -> str:
    """The note without space around it.

    Raises
    ------
    DatabaseError
        If there is none, it is too long, or it is no text.
    """
    note = note.strip().replace("\r\n", "\n")
    try:
        check_consent(note)
    except ValueError as error:
        raise DatabaseError(
            f"{where}{error}; say in words who has agreed to what (--consent TEXT or @FILE)"
        ) from error
    return note


def merged_consent(notes: Sequence[tuple[str, str]]) -> str:
    """One note for several databases.

    Parameters
    ----------
    notes : sequence of (name of a database, its note)

    Returns
    -------
    str
        The note, where all have the same; else each with its database's name, and which have
        none. Empty where none has one.
    """
    texts = [note for _, note in notes]
    if len(set(texts)) == 1:
        return texts[0]
    return "\n".join(f"{name}: {note or 'no note'}" for name, note in notes)
