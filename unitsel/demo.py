"""``make demo``: a photo speaks; a person says a sentence that the database does not hold.

The photo (unitsel/demo_portrait.py) needs nothing but what is installed, the rest footage. A clip
of a corpus is left out, a database is built from others, and the left-out sentence is spoken with
its own sound and phones, in pictures of the other clips, over another clip's background. Where
espeak is installed, the person then says a typed sentence with espeak's voice.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from analysis.build import build_database
from analysis.corpus import Clip, find_clips
from analysis.espeak import library
from analysis.face import FaceFinder
from analysis.models import find_models
from database.errors import CorpusError, UnitselError
from database.media import probe, read_video
from database.reader import open_database
from database.timing import write_timing
from unitsel.cli.output import Output
from unitsel.demo_portrait import portrait_demo
from unitsel.likeness.evaluation import Evaluator, Target
from unitsel.likeness.measures import joins
from unitsel.plots import strip
from unitsel.speech.spoken import speak
from unitsel.synthesizer import Synthesizer

CORPUS_ENV: Final = "UNITSEL_CORPUS"
CLIPS_ENV: Final = "UNITSEL_DEMO_CLIPS"
DEFAULT_CORPUS: Final = Path("..") / "shared" / "corpus" / "grid-s1" / "build"
DEFAULT_CLIPS: Final = 60

TYPED: Final = "Hello! This is a new sentence. I never said a word of it."

NO_CORPUS: Final = f"""\
From footage of one person speaking the demo does more: real mouths, chosen from recordings. It
found none.

  Point it at a folder of clips, each with its words in a text file beside it
  (hello.mp4 and hello.txt):

      {CORPUS_ENV}=/path/to/clips make demo

  Your own footage will do (a few minutes of one face, looking into the camera), or a
  public corpus such as GRID: the videos and word alignments of one of its speakers,
  https://zenodo.org/records/3625687 (CC BY 4.0), put into one folder.
"""


def main() -> int:
    """Run the demo; the exit status."""
    output = Output(json=False)
    named = os.environ.get(CORPUS_ENV) or None
    corpus = Path(named) if named else DEFAULT_CORPUS
    footage = named is not None or corpus.is_dir()
    try:
        # What is wrong with the footage is told before a photo speaks.
        count, clips = (_clip_count(), _clips(corpus)) if footage else (0, [])
        portrait_demo(Path("out"), output)
        if not footage:
            print(NO_CORPUS)
            return 0
        _demo(corpus, clips, count, Path("out"), output)
    except (UnitselError, OSError) as error:
        return output.failed(str(error), 2)
    finally:
        output.close()
    return 0


def _clip_count() -> int:
    text = os.environ.get(CLIPS_ENV, "")
    if not text:
        return DEFAULT_CLIPS
    if not text.isdecimal() or int(text) < 2:
        raise CorpusError(f"{CLIPS_ENV} must be a whole number from 2 on, not {text!r}")
    return int(text)


def _clips(corpus: Path) -> list[Clip]:
    clips = find_clips(corpus)
    if len(clips) < 3:
        raise CorpusError(f"{corpus}: holds {len(clips)} clips; the demo needs at least 3")
    return clips


def _demo(corpus: Path, clips: list[Clip], count: int, out: Path, output: Output) -> None:
    left_out = _sentence(clips)
    out.mkdir(exist_ok=True)
    print(f"Building out/demo.h5 from {min(count, len(clips) - 1)} clips of {corpus}.")
    report = build_database(
        corpus,
        out / "demo.h5",
        jobs=os.cpu_count() or 1,
        limit=count,
        exclude=[left_out.name],
        progress=output.progress,
    )
    output.close()
    print(
        f"  {report.units} units from {report.sequences} clips in {report.seconds:.0f} s; "
        f"clips skipped: {len(report.skipped)}, repairs: {len(report.repaired)}."
    )
    for clip, what in report.skipped:
        print(f"  skipped {clip}: {what}")

    with open_database(out / "demo.h5") as database:
        evaluator = Evaluator(database)
        target = evaluator.target(left_out)
        write_timing(out / "demo.TextGrid", target.track)
        synthesizer = Synthesizer(database)
        selection = synthesizer.select(target.track)
        units = database.units
        segments = 1 + int(
            joins(units.sequence[selection.units], units.frame[selection.units]).sum()
        )
        written = synthesizer.write(
            selection, out / "demo.mp4", audio=left_out.media, progress=output.progress
        )
        output.close()
        scores = evaluator.compare(target).scores["selected"]
        held = target.words in database.sequences.words
        novelty = "as another clip does too" if held else "which no clip of the database says"
    _contact_sheet(written.path, left_out.media, target, out / "demo.png")
    print(f"Wrote {written.path}: the person says {target.words!r}, {novelty}.")
    print(
        f"  Sound and phones are those of {left_out.name}; the {written.frames} mouths come in "
        f"{segments}\n  segments from other clips, over the background of "
        f"{written.background.name}."
    )
    if selection.fallbacks:
        print("  " + "\n  ".join(str(f) for f in selection.fallbacks))
    print(
        f"  Likeness to the real clip inside speech: mouth height r = {scores.r_h_speech:.2f}, "
        f"texture r = {scores.r_pca_speech:.2f}."
    )
    print("  out/demo.png shows its frames (upper rows) beside the real ones (lower rows).")
    if library() is not None:
        _say(out, output)


def _say(out: Path, output: Output) -> None:
    """A typed sentence in espeak's voice: out/demo-say.mp4, and twelve frames of it."""
    speech = speak(TYPED, wav=out / "demo-say.wav")
    with open_database(out / "demo.h5") as database:
        synthesizer = Synthesizer(database)
        written = synthesizer.write(
            synthesizer.select(speech.track),
            out / "demo-say.mp4",
            audio=out / "demo-say.wav",
            progress=output.progress,
        )
    output.close()
    (out / "demo-say.wav").unlink()
    wanted = np.linspace(*speech.track.speech_span(), 12) * written.fps
    faces = [f.rgb for f in read_video(written.path) if f.index in wanted.astype(int)]
    _write_sheet(strip(_faces(faces), 6), out / "demo-say.png")
    print(f"Wrote {written.path}: the person says {TYPED!r} in espeak's voice.")
    print("  out/demo-say.png shows twelve frames across it.")


def _sentence(clips: list[Clip]) -> Clip:
    """A clip with words and sound, from the middle of the list."""
    middle = len(clips) // 2
    for clip in sorted(clips, key=lambda c: abs(clips.index(c) - middle)):
        if clip.scripts and probe(clip.media).has_sound:
            return clip
    raise CorpusError(f"{clips[0].media.parent}: no clip has both words and sound")


def _contact_sheet(made: Path, real: Path, target: Target, path: Path) -> None:
    """Faces of the sentence spoken, made above real, eight to a row."""
    start, end = target.track.speech_span()
    faces = []
    for video in (made, real):
        # Only what is shown is kept: a clip may be long.
        wanted = np.unique((np.linspace(start, end, 24) * probe(video).fps).astype(int))
        faces.append(_faces([f.rgb for f in read_video(video) if f.index in wanted]))
    pairs = [
        part
        for i in range(0, min(len(f) for f in faces), 8)
        for part in (_padded(faces[0][i : i + 8]), _padded(faces[1][i : i + 8]))
    ]
    _write_sheet(np.concatenate(pairs), path)


def _write_sheet(sheet: npt.NDArray[np.uint8], path: Path) -> None:
    if not cv2.imwrite(str(path), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR)):
        raise CorpusError(f"{path}: cannot be written")


def _faces(pictures: list[npt.NDArray[np.uint8]]) -> list[npt.NDArray[np.uint8]]:
    """The part of each picture around the first one's face, at one size."""
    mesh = FaceFinder(find_models()).find(pictures[0])
    height, width = pictures[0].shape[:2]
    if mesh is None:
        x0, y0, x1, y1 = 0, 0, width, height
    else:
        low, high = mesh.points[:, :2].min(axis=0), mesh.points[:, :2].max(axis=0)
        (x, y), side = (low + high) / 2, 0.75 * float((high - low).max())
        x0, x1 = max(0, round(float(x) - side)), min(width, round(float(x) + side))
        y0, y1 = max(0, round(float(y) - side)), min(height, round(float(y) + side))
    return [
        np.asarray(cv2.resize(p[y0:y1, x0:x1], (200, 200), interpolation=cv2.INTER_AREA))
        for p in pictures
    ]


def _padded(pictures: list[npt.NDArray[np.uint8]]) -> npt.NDArray[np.uint8]:
    return strip([*pictures, *[np.zeros_like(pictures[0])] * (8 - len(pictures))], 8)


if __name__ == "__main__":
    sys.exit(main())
