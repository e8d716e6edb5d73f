"""What `synth`, `say` and `dub` share: phonemes and sound into a video, and what is said of it."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from database.errors import RenderError, SelectionError
from database.heads import is_portrait
from database.pinyin import TimedSyllable
from database.reader import UnitDatabase, open_database
from database.sound import Sound, read_sound
from database.timing.words import WordTrack
from database.track import PhonemeTrack
from database.video_codecs import CODEC_NAMES, CONTAINERS
from unitsel.cli.arguments import (
    add_models,
    add_selection,
    check_output,
    picture_size,
    positive_number,
    quality,
    selection_settings,
)
from unitsel.cli.driving import add_driving, living_background, refuse_driving
from unitsel.cli.making_portrait import check_portrait_options, make_of_portrait
from unitsel.cli.output import Output
from unitsel.explain import explain, write_explanation
from unitsel.likeness.measures import joins
from unitsel.pieces import pieces, sound_part
from unitsel.select import Fallback, Selection
from unitsel.settings import SelectionSettings
from unitsel.synthesizer import Synthesizer
from unitsel.writing import Encoding, Written, is_folder


@dataclass(frozen=True)
class Made:
    """A video that was made.

    Parameters
    ----------
    document : dict
        What `--json` prints.
    text : str
        The same for people.
    target : str, optional
        Name of the target cost; a portrait has none.
    """

    document: dict[str, Any]
    text: str
    target: str | None


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
        "--eyes",
        metavar="VIDEO",
        help="video of the person whose eyes (blinks, gaze) are laid on the background",
    )
    parser.add_argument(
        "--fps", type=positive_number, metavar="F", help="frame rate (default: the background's)"
    )
    parser.add_argument(
        "--size",
        type=picture_size,
        metavar="WxH",
        help="size of the pictures, of the background's shape (default: the background's)",
    )
    parser.add_argument(
        "--codec",
        choices=CODEC_NAMES,
        help="video codec (default: what the suffix suggests: h264 in .mp4, vp9 in .webm)",
    )
    parser.add_argument(
        "--crf",
        type=quality,
        metavar="N",
        help="quality, the codec's own constant rate factor; less is better (default: 18 for h264)",
    )
    parser.add_argument(
        "--alpha",
        action="store_true",
        help="write the mouth alone, transparent around it, for laying over the background "
        "elsewhere: .mov, .webm, .mkv, or a folder of pictures",
    )
    parser.add_argument("--comment", metavar="TEXT", help="comment in the file's tags")
    add_selection(parser)
    parser.add_argument(
        "--explain",
        metavar="FILE.html",
        help="also write a page that shows the chosen units, their costs and joins",
    )
    add_models(parser)
    add_driving(parser)


def check_making(options: argparse.Namespace) -> None:
    """Refuse outputs that cannot be written, before the work and not after it."""
    if not is_folder(Path(options.output)):
        check_output(options.output, tuple(CONTAINERS))
    _encoding(options).check(Path(options.output))
    if options.alpha and options.eyes is not None:
        raise RenderError("--eyes lays eyes on a background, and --alpha writes no background")
    if options.explain is not None:
        check_output(options.explain, (".html", ".htm"))


def check_database(options: argparse.Namespace) -> None:
    """Refuse a database that cannot be used, or lacks the network that is asked for.

    Raises
    ------
    DatabaseError, SelectionError
        Naming the file and what is wrong with it.
    """
    if is_portrait(options.database):
        check_portrait_options(options)
        return
    refuse_driving(options)
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
    syllables: Sequence[TimedSyllable] = (),
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
    syllables : sequence of TimedSyllable
        Mandarin's, for a portrait.
    hearing : bool
        Whether the sound is to guide the choice where nothing else was asked for and the database
        has a guide for it.
    """
    if is_portrait(options.database):
        encoding = _encoding(options)
        document, text = make_of_portrait(
            options, output, track, encoding, audio=audio, syllables=syllables
        )
        return Made(document, text, None)
    refuse_driving(options)
    with (
        living_background(options, track.end, output) as alive,
        open_database(options.database) as database,
    ):
        background = alive or options.background
        settings = _settings(options, database, hearing)
        synthesizer = Synthesizer(database, settings, models=options.models)
        hears = settings.target.guide == "sound" and audio is not None
        sound: Sound | None = read_sound(audio) if hears and audio is not None else None
        told = _Told(database)
        parts = [track] if options.explain is not None else pieces(track)
        if len(parts) == 1:
            selection = synthesizer.select(track, sound=sound, progress=output.progress)
            told.add(selection)
            if options.explain is not None:
                page = explain(database, track, selection, settings, words=words)
            written = synthesizer.write(
                selection,
                options.output,
                audio=audio,
                background=background,
                eyes=options.eyes,
                fps=options.fps,
                encoding=_encoding(options),
                progress=output.progress,
            )
            if options.explain is not None:
                write_explanation(options.explain, page)
        else:
            written = synthesizer.write_stream(
                _spoken(parts, sound),
                options.output,
                audio=audio,
                background=background,
                eyes=options.eyes,
                fps=options.fps,
                encoding=_encoding(options),
                begun=lambda utterance: told.add(utterance.selection),
                progress=output.progress,
                seconds=track.end,
            )
    if alive is not None:
        written = replace(written, background=Path(options.background))
    return _made(options, written, told, settings)


def _spoken(
    parts: list[PhonemeTrack], sound: Sound | None
) -> Iterator[tuple[PhonemeTrack, Sound | None]]:
    """Utterances of a long track, each with its part of the sound that is listened to."""
    start = 0.0
    for part in parts:
        end = start + part.end
        yield part, None if sound is None else sound_part(sound, start, end)
        start = end


class _Told:
    """What is said of all selections of a video."""

    def __init__(self, database: UnitDatabase) -> None:
        self._units = database.units
        self._last: int | None = None
        self._fallbacks: dict[tuple[int, int, int], Fallback] = {}
        self.segments = 0
        self.cost = 0.0

    def add(self, selection: Selection) -> None:
        """Count a selection that follows those before."""
        before = [] if self._last is None else [self._last]
        units = np.concatenate([np.array(before, dtype=np.int64), selection.units])
        sequence, frame = self._units.sequence[units], self._units.frame[units]
        self.segments += int(joins(sequence, frame).sum()) + (self._last is None)
        self.cost += selection.costs.cost
        self._last = int(selection.units[-1])
        for f in selection.fallbacks:
            key = (f.phoneme, f.missing, f.used)
            known = self._fallbacks.get(key)
            self._fallbacks[key] = (
                f if known is None else replace(f, frames=f.frames + known.frames)
            )

    @property
    def fallbacks(self) -> list[str]:
        """In words."""
        return [str(f) for f in self._fallbacks.values()]


def _made(
    options: argparse.Namespace, written: Written, told: _Told, settings: SelectionSettings
) -> Made:
    sounds = None if written.sound_seconds is None else round(written.sound_seconds, 4)
    document: dict[str, Any] = {
        "video": str(written.path),
        "background": str(written.background),
        "frames": written.frames,
        "fps": written.fps,
        "seconds": round(written.seconds, 4),
        "sound_copied": written.sound_copied,
        "sound_seconds": sounds,
        "segments": told.segments,
        "cost": told.cost,
        "fallbacks": told.fallbacks,
    }
    if options.explain is not None:
        document["explanation"] = options.explain
    text = (
        f"{written.path}: {written.frames} frames at {written.fps:g} a second, {told.segments} "
        f"segments, over {written.background}"
    )
    lines = [text, *told.fallbacks, *written.notes]
    if written.notes:
        document["background_notes"] = list(written.notes)
    return Made(document, "\n".join(lines), settings.target.name)


def _encoding(options: argparse.Namespace) -> Encoding:
    return Encoding(options.codec, options.crf, options.size, options.alpha, options.comment)


def _settings(
    options: argparse.Namespace, database: UnitDatabase, hearing: bool
) -> SelectionSettings:
    settings = selection_settings(options, database)
    chosen = options.target is not None or options.weights is not None
    if hearing and not chosen and "sound" in database.guides:
        return replace(settings, target=replace(settings.target, name="sound"))
    return settings
