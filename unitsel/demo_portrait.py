"""The part of ``make demo`` that needs no footage: a photo speaks English and Mandarin.

The photo is Grace Hopper's, which is in the public domain and part of matplotlib; the voice is
espeak's.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import cv2
import matplotlib.cbook as cbook
import numpy as np

from analysis.espeak import library
from analysis.portrait import make_portrait
from database.errors import SpeechError
from database.heads import open_portrait
from database.media import read_video
from database.portrait_file import PortraitHead
from unitsel.cli.output import Output
from unitsel.plots import strip
from unitsel.portrait.plots import face_of
from unitsel.portrait.synthesizer import PortraitSynthesizer
from unitsel.speech.spoken import Speech, speak

SENTENCES: Final = (
    ("en", "en-us", "Hello! One photo is enough. My mouth was closed, and now I speak."),
    ("zh", "cmn", "你好！一张照片就够了，我也会说中文。"),
)
"""Suffix of the video, espeak's voice, and what is said."""

SHOWN: Final = 24
"""Frames of each video that are laid side by side."""


def portrait_demo(out: Path, output: Output) -> None:
    """Have the sample photo speak: out/portrait-en.mp4 and out/portrait-zh.mp4.

    Parameters
    ----------
    out : Path
        Folder, made if it is not there.
    output : Output
        For the progress.

    Raises
    ------
    UnitselError
        If the face models cannot be fetched, or something cannot be drawn or written.
    """
    if library() is None:
        print("A photo would speak here; it needs espeak: pip install 'unitsel[espeak]'")
        return
    out.mkdir(exist_ok=True)
    photo = str(cbook.get_sample_data("grace_hopper.jpg", asfileobj=False))
    report = make_portrait(photo, out / "portrait.h5", progress=output.progress)
    output.close()
    print(f"Made {report.path} of one photo ({Path(photo).name}, which matplotlib ships).")
    with open_portrait(report.path) as head:
        synthesizer = PortraitSynthesizer(head)
        for suffix, voice, text in SENTENCES:
            wav = out / f"portrait-{suffix}.wav"
            try:
                speech = speak(text, voice=voice, wav=wav)
            except SpeechError as error:
                print(f"  {error}")
                continue
            written = synthesizer.write(
                synthesizer.select(speech.track, syllables=speech.syllables),
                out / f"portrait-{suffix}.mp4",
                audio=wav,
                progress=output.progress,
            )
            output.close()
            wav.unlink()
            sheet = out / f"portrait-{suffix}.png"
            _write_strip(head, written.path, speech, sheet)
            print(
                f"Wrote {written.path}: the photo says {text!r}; {sheet.name} shows frames of it."
            )


def _write_strip(head: PortraitHead, video: Path, speech: Speech, path: Path) -> None:
    """Frames across a sentence, twelve to a row."""
    start, end = speech.track.speech_span()
    wanted = np.unique((np.linspace(start, end, SHOWN) * head.fps).astype(int))
    faces = [face_of(head, frame.rgb) for frame in read_video(video) if frame.index in wanted]
    faces += [np.zeros_like(faces[0])] * (-len(faces) % 12)
    if not cv2.imwrite(str(path), cv2.cvtColor(strip(faces, 12), cv2.COLOR_RGB2BGR)):
        raise SpeechError(f"{path}: cannot be written")
