"""``unitsel align``: sound and words into a timing file."""

from __future__ import annotations

import argparse

from database.timing import Timing, timing_extensions, write_timing
from unitsel.cli.arguments import Commands, add_dictionary, check_output
from unitsel.cli.output import Output
from unitsel.speech_track import align_media


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "align",
        help="align the sound of a media file to its words",
        description="Write the phones and words of a media file with their times; the "
        "extension of the output chooses its format.",
    )
    parser.add_argument("media", metavar="MEDIA")
    parser.add_argument("words", metavar="WORDS_FILE", help="a text, or a timing file with words")
    parser.add_argument("-o", "--output", metavar="OUT.TextGrid", required=True)
    add_dictionary(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Align, write and report."""
    check_output(options.output, timing_extensions())
    alignment = align_media(options.media, options.words, dictionary=options.dictionary)
    write_timing(options.output, Timing(alignment.track, alignment.words))
    words = () if alignment.words is None else alignment.words.intervals()
    phones = alignment.track.intervals()
    document = {
        "timing": options.output,
        "words": [
            {"word": i.label, "start": round(i.start, 4), "end": round(i.end, 4)} for i in words
        ],
        "phones": [
            {"phone": i.label, "start": round(i.start, 4), "end": round(i.end, 4)} for i in phones
        ],
        "attempts": alignment.attempts,
        "notes": list(alignment.notes),
    }
    text = (
        f"{options.output}: {len(words)} words, {len(phones)} phones, {alignment.track.end:.2f} s"
    )
    output.result(document, "\n".join([text, *alignment.notes]))
