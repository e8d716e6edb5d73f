"""``unitsel say``: a text into a video, spoken by a synthesizer."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

from database.errors import SpeechError
from unitsel.cli.arguments import Commands, check_output, positive_number
from unitsel.cli.making import Made, add_making, check_database, check_making, make
from unitsel.cli.output import Output
from unitsel.speech.spoken import ESPEAK, Speech, speak
from unitsel.speech.text import checked_text, read_text


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "say",
        help="make the person of a database say a text",
        description="Speak a text with espeak-ng, another program or a recording, and show the "
        "person of the database saying it.",
    )
    parser.add_argument("database", metavar="DB.h5")
    parser.add_argument(
        "text", metavar="TEXT", nargs="?", help="what to say; - reads standard input"
    )
    parser.add_argument("-o", "--output", metavar="OUT.mp4", required=True)
    parser.add_argument("--file", metavar="FILE.txt", help="read the text from a file")
    parser.add_argument(
        "--voice",
        metavar="NAME",
        help="espeak's voice or language, such as en-us, en-gb, el, cmn (default: en-us)",
    )
    parser.add_argument(
        "--rate", type=positive_number, metavar="R", help="words a minute, 80 to 450 (default: 175)"
    )
    parser.add_argument(
        "--tts",
        metavar="espeak|COMMAND|FILE",
        default=ESPEAK,
        help="what speaks: espeak; a command that writes the file {wav}, with {text} or "
        "{text_file} or the text on its standard input; or a recording of these words "
        "(default: espeak)",
    )
    parser.add_argument("--audio-out", metavar="FILE.wav", help="also keep the sound")
    add_making(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Speak, select, render, write and report."""
    check_making(options)
    if options.audio_out is not None:
        check_output(options.audio_out, (".wav",))
    text = _text(options)
    check_database(options)  # Before the speaking, which may take a large model's time.
    with tempfile.TemporaryDirectory(prefix="unitsel-") as folder:
        wav = options.audio_out
        if wav is None and (options.tts == ESPEAK or "{" in options.tts):
            wav = Path(folder) / "speech.wav"
        speech = speak(
            text,
            voice=options.voice,
            rate=options.rate,
            tts=options.tts,
            wav=wav,
            dictionary=options.dictionary,
        )
        audio = speech.sound if isinstance(speech.sound, Path) else None
        made = make(
            options,
            output,
            speech.track,
            audio=audio,
            words=speech.words,
            syllables=speech.syllables,
        )
    document = made.document | told(speech)
    if options.audio_out is not None:
        document["audio"] = options.audio_out
    output.result(document, "\n".join([made.text, *_lines(speech, made)]))


def told(speech: Speech) -> dict[str, Any]:
    """What `--json` says of the speech."""
    return {
        "words": 0 if speech.words is None else len(speech.words),
        "approximated": [
            {"symbol": r.symbol, "phonemes": list(r.phonemes), "known": r.known}
            for r in speech.approximated
        ],
        "notes": list(speech.notes),
    }


def _lines(speech: Speech, made: Made) -> list[str]:
    lines = list(speech.notes)
    # A portrait has mouths for Mandarin's own syllables.
    own = made.target is None and bool(speech.syllables)
    if speech.approximated and not own:
        listed = ", ".join(map(str, speech.approximated))
        lines.append(f"sounds that English lacks are shown by the nearest it has: {listed}")
    return lines


def _text(options: argparse.Namespace) -> str:
    if (options.text is None) == (options.file is None):
        raise SpeechError(
            "give the text, - for standard input, or --file FILE.txt: one of them, not "
            + ("none" if options.text is None else "two")
        )
    if options.file is not None:
        return read_text(options.file)
    return read_text("-") if options.text == "-" else checked_text(options.text)
