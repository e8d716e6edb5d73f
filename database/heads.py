"""Heads of either kind: a database of units from footage, or a portrait from one photo."""

from __future__ import annotations

from pathlib import Path

from database.portrait_file import PortraitHead
from database.reader import UnitDatabase
from database.storage import PORTRAIT, kind_of


def open_head(path: str | Path) -> UnitDatabase | PortraitHead:
    """Open a head, whichever kind it is.

    Parameters
    ----------
    path : str or Path
        What `unitsel build` or `unitsel portrait` wrote.

    Raises
    ------
    DatabaseError
        If there is no such file, it is no head, it was made by a version of unitsel whose files
        this one does not read, or it is damaged.
    """
    return PortraitHead(path) if is_portrait(path) else UnitDatabase(path)


def open_portrait(path: str | Path) -> PortraitHead:
    """Open a portrait's head.

    Raises
    ------
    DatabaseError
        As `open_head`, and if it is a database of units.
    """
    return PortraitHead(path)


def is_portrait(path: str | Path) -> bool:
    """Whether a file holds a portrait's head.

    Raises
    ------
    DatabaseError
        If there is no such file, or it is no HDF5 file.
    """
    return kind_of(Path(path)) is PORTRAIT
