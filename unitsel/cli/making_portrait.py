"""What `synth`, `say` and `dub` do with a portrait's head."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from database.errors import SelectionError
from database.heads import open_portrait
from database.pinyin import TimedSyllable
from database.reader import open_database
from database.track import PhonemeTrack
from unitsel.cli.driving import driving_settings
from unitsel.cli.output import Output
from unitsel.pieces import pieces
from unitsel.portrait.synthesizer import PortraitSynthesizer
from unitsel.writing import Encoding

_FOR_FOOTAGE = ("weights", "target", "explain", "background", "alpha")


def check_portrait_options(options: argparse.Namespace) -> None:
    """Refuse a head that cannot be opened, or options that would change nothing in a portrait.

    Raises
    ------
    DatabaseError, SelectionError
        Naming the file or the option.
    """
    for name in _FOR_FOOTAGE:
        if getattr(options, name, None) not in (None, False):
            raise SelectionError(
                f"--{name}: is for heads built from footage, and {options.database} is a "
                "portrait's; leave it out"
            )
    driving_settings(options)
    with open_portrait(options.database) as head:
        head.mask  # noqa: B018 - read, so that a damaged one is told now
    if options.like is not None:
        open_database(options.like).close()


def make_of_portrait(
    options: argparse.Namespace,
    output: Output,
    track: PhonemeTrack,
    encoding: Encoding,
    *,
    audio: str | Path | None,
    syllables: Sequence[TimedSyllable] = (),
) -> tuple[dict[str, Any], str]:
    """Drive, render and write: the document for `--json`, and the text."""
    check_portrait_options(options)
    with contextlib.ExitStack() as stack:
        head = stack.enter_context(open_portrait(options.database))
        like = None
        if options.like is not None:
            like = stack.enter_context(open_database(options.like))
        synthesizer = PortraitSynthesizer(head, driving_settings(options), like=like)
        parts = pieces(track)
        if len(parts) == 1:
            written = synthesizer.write(
                synthesizer.select(track, syllables=syllables),
                options.output,
                audio=audio,
                fps=options.fps,
                encoding=encoding,
                progress=output.progress,
            )
        else:
            written = synthesizer.write_stream(
                parts,
                options.output,
                audio=audio,
                fps=options.fps,
                encoding=encoding,
                progress=output.progress,
                seconds=track.end,
                syllables=syllables,
            )
    document: dict[str, Any] = {
        "video": str(written.path),
        "portrait": options.database,
        "frames": written.frames,
        "fps": written.fps,
        "seconds": round(written.seconds, 4),
        "sound_copied": written.sound_copied,
    }
    text = (
        f"{written.path}: {written.frames} frames at {written.fps:g} a second, of the portrait "
        f"{options.database}"
    )
    return document, text
