"""Long speech from a looped text: memory at minute 5 and at the end, drift at the end.

Usage: long_run.py [DB.h5] [--minutes 10] [--fps 29.97]; 60 is the hour that README names. Uses a
database of real footage, named here or in UNITSEL_BENCH_DB, else out/demo.h5, which `make demo`
leaves;
speech is espeak's (the extra `espeak`), sentence by sentence, and the video is written to a file as
it comes.

The baseline of memory is minute 5 of the same run. Drift is the distance of the last sentence's
click in the file's sound from the time stamp of its first picture.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle
from pathlib import Path

import av
import numpy as np

import unitsel
from database.errors import SpeechError
from database.sound import Sound, iter_sound
from unitsel.placed import Placed
from unitsel.select import Selection
from unitsel.speech.spoken import speak

SENTENCES = (
    "The weather stayed fine for most of the week, and nobody thought of going home.",
    "We walked along the river every morning, bought bread and apples, and talked.",
    "On Friday a strong wind came up from the west.",
    "Five boats broke loose, and the ferry could not leave before noon.",
    "Who would have thought that?",
    "My brother paid the captain twice, which made him very happy.",
)
CLICK = 64
"""Samples at the start of each sentence that are loud."""


def spoken(minutes: float) -> Iterator[tuple[unitsel.PhonemeTrack, Sound]]:
    """Sentences of the text, again and again, each with a click at its start."""
    said = 0.0
    for text in cycle(SENTENCES):
        if said >= 60 * minutes:
            return
        speech = speak(text)
        sound = speech.sound
        assert isinstance(sound, Sound)
        samples = 0.5 * sound.samples
        samples[:CLICK] = 0.95
        said += speech.track.end
        yield speech.track, replace(sound, samples=samples)


def resident() -> float:
    """Megabytes of memory that the process holds now."""
    with Path("/proc/self/statm").open() as file:
        return int(file.read().split()[1]) * resource.getpagesize() / 1e6


def peak() -> float:
    """Megabytes that it has held at most."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def loud_at(path: Path, near: float) -> float:
    """Time of the click that is nearest to a time, seconds of a file."""
    rate = 16000
    place, found = 0, []
    for piece in iter_sound(path, rate, "mono"):
        stop = place + piece.shape[1]
        if stop > (near - 2) * rate:
            found += [(place + i) / rate for i in np.flatnonzero(np.abs(piece[0]) > 0.7)]
        place = stop
    return min(found, key=lambda t: abs(t - near))


def main() -> int:
    """Print the table; without a database or espeak say what is missing."""
    parser = argparse.ArgumentParser()
    parser.add_argument("database", nargs="?")
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--fps", type=float, default=29.97)
    options = parser.parse_args()
    path = Path(options.database or os.environ.get("UNITSEL_BENCH_DB") or "out/demo.h5")
    if not path.is_file():
        print(f"long_run: no database at {path}; make demo writes one, or name one")
        return 0
    try:
        speak("warm")
    except SpeechError as error:
        print(f"long_run: {error}")
        return 0
    with unitsel.open_database(path) as database, tempfile.TemporaryDirectory() as folder:
        synthesizer = unitsel.Synthesizer(database)
        out = Path(folder) / "long.mp4"
        last: list[Placed[Selection]] = []
        memory: dict[int, tuple[float, float]] = {}
        started = time.perf_counter()

        def progress(stage: str, done: int, total: int) -> None:
            minute, rest = divmod(done, round(60 * options.fps))
            if stage == "rendering" and rest == 0:
                memory[minute] = (resident(), peak())
                if minute in (1, 5) or minute % 10 == 0:
                    taken = time.perf_counter() - started
                    print(
                        f"  minute {minute}: {memory[minute][0]:.0f} MB, peak "
                        f"{memory[minute][1]:.0f} MB, {60 * minute / taken:.1f} times real time",
                        flush=True,
                    )

        def begun(utterance: Placed[Selection]) -> None:
            last[:] = [utterance]

        written = synthesizer.write_stream(
            spoken(options.minutes), out, fps=options.fps, begun=begun, progress=progress
        )
        with av.open(str(out)) as container:
            video = container.streams.video[0]
            stamps = sorted(float(p.pts * p.time_base) for p in container.demux(video) if p.size)
            start = float(video.start_time * video.time_base)
        final = last[0]
        shown = stamps[final.first] - start
        click = loud_at(out, final.start)
        apart = abs(shown - click) * written.fps
        taken = time.perf_counter() - started
        print(f"{written.frames} frames, {written.seconds / 60:.1f} minutes, in {taken:.0f} s")
        early = min(5, max(memory))
        late = max(memory)
        grown = memory[late][1] / memory[early][1] - 1
        print(
            f"peak memory: minute {early} {memory[early][1]:.0f} MB, minute {late} "
            f"{memory[late][1]:.0f} MB, {100 * grown:+.1f} %"
        )
        print(
            f"drift at the end: sentence {final.index + 1} is heard at {click:.3f} s and seen at "
            f"{shown:.3f} s, {apart:.2f} frames apart"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
