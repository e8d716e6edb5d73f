"""``unitsel synth``: phoneme timings into a video."""

from __future__ import annotations

import argparse

from database.timing import read_timing
from unitsel.cli.arguments import Commands
from unitsel.cli.making import add_making, check_making, make
from unitsel.cli.output import Output
from unitsel.speech_track import length_note, track_of_timing


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
    add_making(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Select, render, write and report."""
    check_making(options)
    timing = read_timing(options.timing)
    track = track_of_timing(
        timing, audio=options.audio, dictionary=options.dictionary, name=options.timing
    )
    made = make(options, output, track, audio=options.audio, words=timing.words)
    note = None if options.audio is None else length_note(timing, options.audio)
    notes = [] if note is None else [note]
    output.result(made.document | {"notes": notes}, "\n".join([made.text, *notes]))
