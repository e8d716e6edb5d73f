"""What `synth`, `say` and `dub` share: phonemes and sound into a video, and what is said of it."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from database.errors import SelectionError
from database.reader import UnitDatabase, open_database
from database.sound import Sound, read_sound
from database.timing.words import WordTrack
from database.track import PhonemeTrack
from database.video_writer import SUFFIXES
from unitsel.cli.arguments import (
    add_models,
    add_selection,
    check_output,
    positive_number,
    selection_settings,
)
from unitsel.cli.output import Output
from unitsel.explain import explain, write_explanation
from unitsel.likeness.measures import joins
from unitsel.settings import SelectionSettings
from unitsel.synthesizer import Synthesizer


@dataclass(frozen=True)
class Made:
    """A video that was made.

    Parameters
    ----------
    document : dict
        What `--json` prints.
    text : str
        The same for people.
    target : str
        Name of the target cost.
    """

    document: dict[str, Any]
    text: str
    target: str


def add_making(parser: argparse.ArgumentParser) -> None:
    """Add the options of the commands that make a video."""
    parser.add_argument(
        "--background",
        metavar="VIDEO",
        action="append",
        help="video or photo of the person, or the name of one that `unitsel backgrounds` lists; "
        "several are joined (default: the first of that list)",
    )
    parser.add_argument(
        "--fps", type=positive_number, metavar="F", help="frame rate (default: the background's)"
    )
    add_selection(parser)
    parser.add_argument(
        "--explain",
        metavar="FILE.html",
        help="also write a page that shows the chosen units, their costs and joins",
    )
    add_models(parser)


def check_making(options: argparse.Namespace) -> None:
    """Refuse outputs that cannot be written, before the work and not after it."""
    check_output(options.output, SUFFIXES)
    if options.explain is not None:
        check_output(options.explain, (".html", ".htm"))


def check_database(options: argparse.Namespace) -> None:
    """Refuse a database that cannot be used, or lacks the network that is asked for.

    Raises
    ------
    DatabaseError, SelectionError
        Naming the file and what is wrong with it.
    """
    with open_database(options.database) as database:
        target = selection_settings(options, database).target
        if target.guide is not None and target.guide not in database.guides:
            raise SelectionError(
                f"{options.database}: target cost {target.name!r} needs a guide from "
                f"{target.guide}, the database holds {', '.join(database.guides) or 'none'}; build "
                "it again from more clips, or choose 'paper'"
            )


def make(
    options: argparse.Namespace,
    output: Output,
    track: PhonemeTrack,
    *,
    audio: str | Path | None,
    words: WordTrack | None = None,
    hearing: bool = False,
) -> Made:
    """Select, render and write.

    Parameters
    ----------
    options : Namespace
        Those of `add_making`, `database` and `output`.
    output : Output
    track : PhonemeTrack
    audio : path, optional
        Sound of the video, which the target cost "sound" hears.
    words : WordTrack, optional
        For the page that explains.
    hearing : bool
        Whether the sound is to guide the choice where nothing else was asked for and the database
        has a guide for it.
    """
    with open_database(options.database) as database:
        settings = _settings(options, database, hearing)
        synthesizer = Synthesizer(database, settings, models=options.models)
        hears = settings.target.guide == "sound" and audio is not None
        sound: Sound | None = read_sound(audio) if hears and audio is not None else None
        selection = synthesizer.select(track, sound=sound, progress=output.progress)
        if options.explain is not None:
            page = explain(database, track, selection, settings, words=words)
        written = synthesizer.write(
            selection,
            options.output,
            audio=audio,
            background=options.background,
            fps=options.fps,
            progress=output.progress,
        )
        if options.explain is not None:
            write_explanation(options.explain, page)
        units = database.units
        segments = 1 + int(
            joins(units.sequence[selection.units], units.frame[selection.units]).sum()
        )
    fallbacks = [str(f) for f in selection.fallbacks]
    document = {
        "video": str(written.path),
        "background": str(written.background),
        "frames": written.frames,
        "fps": written.fps,
        "seconds": round(written.seconds, 4),
        "segments": segments,
        "cost": selection.costs.cost,
        "fallbacks": fallbacks,
    }
    if options.explain is not None:
        document["explanation"] = options.explain
    text = (
        f"{written.path}: {written.frames} frames at {written.fps:g} a second, {segments} "
        f"segments, over {written.background}"
    )
    return Made(document, "\n".join([text, *fallbacks]), settings.target.name)


def _settings(
    options: argparse.Namespace, database: UnitDatabase, hearing: bool
) -> SelectionSettings:
    settings = selection_settings(options, database)
    chosen = options.target is not None or options.weights is not None
    if hearing and not chosen and "sound" in database.guides:
        return replace(settings, target=replace(settings.target, name="sound"))
    return settings
