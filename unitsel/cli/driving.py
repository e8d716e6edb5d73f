"""Options of the commands that have a portrait speak: its emotion, its life, whose lips it has."""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

from database.errors import SelectionError
from unitsel.cli.output import Output
from unitsel.portrait.driver import DriveSettings
from unitsel.portrait.emotions import EMOTIONS, parse_emotion
from unitsel.portrait.living import living_still

_OPTIONS: Final = ("emotion", "still", "seed", "amplitude", "blink_every", "head_motion", "like")
_LIFE: Final = ("blink_every", "head_motion", "seed")
"""Those that a photo behind a database's mouth can be given."""

PHOTOS: Final = (".jpg", ".jpeg", ".png")

LONGEST_STILL: Final = 60.0
"""Seconds of a living photo that are made."""


def add_driving(parser: argparse.ArgumentParser) -> None:
    """Add the options that only portraits have."""
    group = parser.add_argument_group("portraits (heads that `unitsel portrait` made of a photo)")
    group.add_argument(
        "--emotion",
        metavar="NAME[:S]",
        help=f"{', '.join(EMOTIONS)}; with a strength from 0 to 1, such as joy:0.6 (default: none)",
    )
    group.add_argument(
        "--still",
        action="store_true",
        help="move nothing but the mouth: no blinks, no head motion, no unrest",
    )
    group.add_argument(
        "--seed", type=_whole, metavar="N", help="of blinks and head motion (default: 0)"
    )
    group.add_argument(
        "--amplitude",
        type=_Upto(2),
        metavar="A",
        help="how far the mouth moves, 0 to 2 (default: 1)",
    )
    group.add_argument(
        "--blink-every",
        type=_Upto(60),
        metavar="S",
        help="mean seconds between blinks, 0 for none (default: 3.5)",
    )
    group.add_argument(
        "--head-motion",
        type=_Upto(4),
        metavar="F",
        help="head motion and unrest, as a factor, 0 for none (default: 1); with footage, "
        "gives a photo that is the --background life",
    )
    group.add_argument(
        "--like",
        metavar="DB.h5",
        help="move the lips as the person of this database does for the sentence",
    )


def driving_settings(options: argparse.Namespace) -> DriveSettings:
    """Settings as the options ask for them.

    Raises
    ------
    SelectionError
        For an emotion that there is not, or options that exclude each other.
    """
    if options.still and (options.blink_every is not None or options.head_motion is not None):
        raise SelectionError("--still: excludes --blink-every and --head-motion; leave one out")
    settings = DriveSettings(still=options.still)
    life = settings.life
    if options.blink_every is not None:
        life = replace(life, blink_every=options.blink_every)
    if options.head_motion is not None:
        factor = options.head_motion
        life = replace(
            life,
            turn=factor * life.turn,
            shift=factor * life.shift,
            perturbation=factor * life.perturbation,
        )
    if options.emotion is not None:
        name, strength = parse_emotion(options.emotion)
        settings = replace(settings, emotion=name, strength=strength)
    if options.amplitude is not None:
        settings = replace(settings, amplitude=options.amplitude)
    if options.seed is not None:
        settings = replace(settings, seed=options.seed)
    return replace(settings, life=life)


def refuse_driving(options: argparse.Namespace) -> None:
    """Refuse options that would change nothing in footage.

    A photo as the background can be given life.

    Raises
    ------
    SelectionError
        Naming the first of them.
    """
    photo = photo_behind(options)
    for name in _OPTIONS:
        if _given(options, name) and not (photo is not None and name in _LIFE):
            besides = " and photos as backgrounds" if name in _LIFE else ""
            raise SelectionError(
                f"--{name.replace('_', '-')}: is for portraits{besides} only, and "
                f"{options.database} was built from footage; leave it out"
            )


def photo_behind(options: argparse.Namespace) -> Path | None:
    """The photo that is the background, if it is one."""
    named = getattr(options, "background", None)
    paths = [named] if isinstance(named, str) else list(named or [])
    if len(paths) != 1 or Path(paths[0]).suffix.lower() not in PHOTOS:
        return None
    return Path(paths[0])


@contextmanager
def living_background(
    options: argparse.Namespace, seconds: float, output: Output
) -> Iterator[str | Path | None]:
    """The background, alive if it is a photo that is to live; None where there is no such photo.

    Parameters
    ----------
    options : Namespace
    seconds : float
        How long it is wanted; longer ones go on as footage does.
    output : Output
    """
    photo = photo_behind(options)
    if photo is None or not any(_given(options, name) for name in _LIFE):
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="unitsel-") as folder:
        moved = Path(folder) / f"{photo.stem}.mp4"
        living_still(
            photo,
            moved,
            min(seconds + 0.5, LONGEST_STILL),
            fps=options.fps or 25,
            settings=driving_settings(options),
            models=options.models,
            progress=output.progress,
        )
        yield moved


def _given(options: argparse.Namespace, name: str) -> bool:
    value = getattr(options, name, None)
    return value is not None and value is not False


def _whole(text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = -1
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 on")
    return value


class _Upto:
    """A number from 0 to a greatest one."""

    def __init__(self, greatest: float) -> None:
        self.greatest = greatest

    def __call__(self, text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0 <= value <= self.greatest:
            raise argparse.ArgumentTypeError(
                f"{text!r} is not a number from 0 to {self.greatest:g}"
            )
        return value
