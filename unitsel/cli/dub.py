"""``unitsel dub``: a recording and its words into a video."""

from __future__ import annotations

import argparse
from pathlib import Path

from unitsel.cli.arguments import Commands
from unitsel.cli.making import add_making, check_database, check_making, make
from unitsel.cli.output import Output
from unitsel.speech_track import align_media


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "dub",
        help="make the person of a database say what a recording says",
        description="Align a recording to its words and show the person of the database saying "
        "it. Where the database has a network that hears, the sound guides the mouth.",
    )
    parser.add_argument("database", metavar="DB.h5")
    parser.add_argument("speech", metavar="SPEECH.wav", help="sound, or a video with sound")
    parser.add_argument("words", metavar="WORDS.txt", help="a text, or a timing file with words")
    parser.add_argument("-o", "--output", metavar="OUT.mp4", required=True)
    add_making(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Align, select, render, write and report."""
    check_making(options)
    check_database(options)
    found = align_media(options.speech, options.words, dictionary=options.dictionary)
    made = make(
        options,
        output,
        found.track,
        audio=Path(options.speech),
        words=found.words,
        hearing=True,
    )
    document = made.document | {
        "target": made.target,
        "words": 0 if found.words is None else len(found.words),
        "notes": list(found.notes),
    }
    how = "" if made.target is None else f", target {made.target}"
    output.result(document, "\n".join([made.text + how, *found.notes]))
