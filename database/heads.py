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
    return PortraitHead(path) if kind_of(Path(path)) is PORTRAIT else UnitDatabase(path)
