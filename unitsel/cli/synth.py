"""``unitsel synth``: phoneme timings into a video."""

from __future__ import annotations

import argparse

from database.reader import open_database
from database.sound import read_sound
from database.timing import read_timing
from database.video_writer import SUFFIXES
from unitsel.cli.arguments import (
    Commands,
    add_models,
    add_selection,
    check_output,
    positive_number,
    selection_settings,
)
from unitsel.cli.output import Output
from unitsel.explain import explain, write_explanation
from unitsel.likeness.measures import joins
from unitsel.speech_track import track_of_timing
from unitsel.synthesizer import Synthesizer


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "synth",
        help="make the person of a database say a timing file",
        description="Select a recorded mouth for every frame of a timing file and stitch the "
        "mouths onto a background video of the same person.",
    )
    parser.add_argument("database", metavar="DB.h5")
    parser.add_argument("timing", metavar="TIMING_FILE")
    parser.add_argument("-o", "--output", metavar="OUT.mp4", required=True)
    parser.add_argument("--audio", metavar="FILE", help="sound of the video")
    parser.add_argument(
        "--background",
        metavar="VIDEO",
        help="video of the person (default: the steadiest clip that the database was built from)",
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
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Select, render, write and report."""
    check_output(options.output, SUFFIXES)
    if options.explain is not None:
        check_output(options.explain, (".html", ".htm"))
    timing = read_timing(options.timing)
    with open_database(options.database) as database:
        settings = selection_settings(options, database)
        synthesizer = Synthesizer(database, settings, models=options.models)
        track = track_of_timing(
            timing, audio=options.audio, dictionary=options.dictionary, name=options.timing
        )
        hears = settings.target.guide == "sound" and options.audio is not None
        sound = read_sound(options.audio) if hears else None
        selection = synthesizer.select(track, sound=sound, progress=output.progress)
        if options.explain is not None:
            page = explain(database, track, selection, settings, words=timing.words)
        written = synthesizer.write(
            selection,
            options.output,
            audio=options.audio,
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
    output.result(document, "\n".join([text, *fallbacks]))
