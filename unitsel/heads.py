"""One way to use a head, whether it was built from footage or made of a photo."""

from __future__ import annotations

from pathlib import Path
from typing import overload

from database.errors import SelectionError
from database.portrait_file import PortraitHead
from database.reader import UnitDatabase
from unitsel.costs import Weights
from unitsel.portrait.driver import DriveSettings
from unitsel.portrait.synthesizer import PortraitSynthesizer
from unitsel.settings import SelectionSettings
from unitsel.synthesizer import Synthesizer


@overload
def synthesizer_of(
    head: UnitDatabase,
    settings: SelectionSettings | Weights | None = None,
    *,
    models: str | Path | None = None,
) -> Synthesizer: ...


@overload
def synthesizer_of(
    head: PortraitHead,
    settings: DriveSettings | None = None,
    *,
    models: str | Path | None = None,
) -> PortraitSynthesizer: ...


@overload
def synthesizer_of(
    head: UnitDatabase | PortraitHead,
    settings: None = None,
    *,
    models: str | Path | None = None,
) -> Synthesizer | PortraitSynthesizer: ...


def synthesizer_of(
    head: UnitDatabase | PortraitHead,
    settings: SelectionSettings | Weights | DriveSettings | None = None,
    *,
    models: str | Path | None = None,
) -> Synthesizer | PortraitSynthesizer:
    """The synthesizer of a head: both kinds select, render, stream and write alike.

    Parameters
    ----------
    head : UnitDatabase or PortraitHead
        What `open_head` gives.
    settings : SelectionSettings, Weights or DriveSettings, optional
        Of the head's kind.
    models : path, optional
        Folder with the face models, for backgrounds of a database.

    Raises
    ------
    SelectionError
        If the settings are for the other kind of head.
    """
    if isinstance(head, PortraitHead):
        if settings is not None and not isinstance(settings, DriveSettings):
            raise SelectionError(f"{head.path}: a portrait takes DriveSettings, no selection's")
        return PortraitSynthesizer(head, settings)
    if isinstance(settings, DriveSettings):
        raise SelectionError(f"{head.path}: was built from footage and takes SelectionSettings")
    return Synthesizer(head, settings, models=models)
