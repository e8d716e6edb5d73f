"""Arguments that several commands share."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from database.errors import UnitselError
from database.fingerprint import identity
from database.reader import UnitDatabase
from unitsel.settings import TARGETS, SelectionSettings, default_settings, settings_for

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction[argparse.ArgumentParser]
else:
    Commands = object


def positive_int(text: str) -> int:
    """A whole number above zero."""
    try:
        value = int(text)
    except ValueError:
        value = 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above zero")
    return value


def positive_number(text: str) -> float:
    """A finite number above zero."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above zero")
    return value


def quality(text: str) -> int:
    """A whole number from 0 on."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 on")
    return int(text)


def picture_size(text: str) -> tuple[int, int]:
    """Width and height: 720x576."""
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text!r} is not a size such as 720x576")
    return int(width), int(height)


def add_jobs(parser: argparse.ArgumentParser, what: str) -> None:
    """Add ``--jobs``: of `what` so many at a time."""
    parser.add_argument(
        "--jobs",
        type=positive_int,
        default=max(1, os.cpu_count() or 1),
        metavar="N",
        help=f"{what} (default: the number of cores)",
    )


def add_models(parser: argparse.ArgumentParser) -> None:
    """Add --models and --dictionary, of the commands that look at footage."""
    add_face_models(parser)
    add_dictionary(parser)


def add_face_models(parser: argparse.ArgumentParser) -> None:
    """Add --models."""
    parser.add_argument(
        "--models", metavar="DIR", help="folder with the face models (default: fetched once)"
    )


def add_dictionary(parser: argparse.ArgumentParser) -> None:
    """Add --dictionary, of the commands that pronounce words."""
    parser.add_argument(
        "--dictionary",
        metavar="FILE",
        help="pronunciations to add to the CMU dictionary's: WORD PHONES a line",
    )


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Add --weights and --target, of the commands that select units."""
    parser.add_argument(
        "--weights",
        metavar="FILE",
        help="weights.json of `unitsel train` (default: the database's own)",
    )
    parser.add_argument(
        "--target",
        choices=TARGETS,
        help="target cost: the paper's phonemes, guided by a predicted trajectory, mixed, or "
        "guided by the sound too (default: the weights' own)",
    )


def selection_settings(options: argparse.Namespace, database: UnitDatabase) -> SelectionSettings:
    """Settings as the options ask for them.

    Raises
    ------
    SelectionError
        If the file of weights cannot be used with this database.
    """
    if options.weights is not None:
        settings = SelectionSettings.read(options.weights, database=identity(database))
    else:
        settings = default_settings(database)
        if options.target not in (None, settings.target.name):
            return replace(settings_for(options.target), lips=settings.lips)
    if options.target is not None:
        settings = replace(settings, target=replace(settings.target, name=options.target))
    return settings


def check_output(name: str, extensions: Collection[str]) -> None:
    """Refuse an output that cannot be written, before the work and not after it.

    Raises
    ------
    UnitselError
        If the extension is none of these, the folder does not exist, or it is a folder itself.
    """
    path = Path(name)
    if path.suffix.lower() not in extensions:
        raise UnitselError(f"{path}: give it one of the extensions {', '.join(extensions)}")
    if not path.parent.is_dir():
        raise UnitselError(f"{path}: the folder {path.parent} does not exist; make it first")
    if path.is_dir():
        raise UnitselError(f"{path}: is a folder; name a file")
