"""How fast a portrait speaks: seconds of video to a second of work, from phonemes to planes.

    python benchmarks/portrait_speed.py [PHOTO]

The photo is matplotlib's sample portrait, cut to 2 : 3, or the one named. A sentence of 20 s is
driven (with blinks and head motion) and drawn at 200 x 300, the size that Image Talk reports 20 to
60 frames a second for, and larger; what is measured ends with the encoder's planes. The ratio to
real time at 25 frames a second is of this run alone: once by the clock, which others on the
machine slow down, and once by the processor time of all threads.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import matplotlib.cbook as cbook
from PIL import Image

from analysis.portrait import make_portrait
from database.heads import open_portrait
from database.track import Interval, PhonemeTrack
from unitsel.portrait.synthesizer import PortraitSynthesizer

SECONDS = 20.0
BAR = 10
SIZES = ((200, 300), (400, 600), (800, 1200))
RUNS = 3


def sentence() -> PhonemeTrack:
    """Twenty seconds of hello."""
    spans, at = [], 0.0
    while at < SECONDS:
        for phoneme, length in (("hh", 0.06), ("eh", 0.08), ("l", 0.06), ("ow", 0.12), ("m", 0.08)):
            spans.append(Interval(at, at + length, phoneme))
            at += length
    return PhonemeTrack.from_intervals(spans, name="hello")


def main() -> None:
    """Print the ratios."""
    with tempfile.TemporaryDirectory() as folder:
        photo = Path(folder) / "photo.png"
        if len(sys.argv) > 1:
            picture = Image.open(sys.argv[1]).convert("RGB")
        else:
            sample = str(cbook.get_sample_data("grace_hopper.jpg", asfileobj=False))
            picture = Image.open(sample).convert("RGB")
        width, height = picture.size
        across = min(width, height * 2 // 3)
        left = (width - across) // 2
        picture.crop((left, 0, left + across, across * 3 // 2)).save(photo)
        path = Path(folder) / "head.h5"
        began = time.perf_counter()
        make_portrait(photo, path)
        print(f"the head: {time.perf_counter() - began:.2f} s from photo to file")
        track = sentence()
        with open_portrait(path) as head:
            synthesizer = PortraitSynthesizer(head)
            performance = synthesizer.select(track)
            for size in SIZES:
                # OpenGL starts with the first picture.
                next(iter(synthesizer.render(performance, size=size)))
                best, work, frames = float("inf"), float("inf"), 0
                for _ in range(RUNS):
                    began, used = time.perf_counter(), time.process_time()
                    frames = sum(1 for _ in synthesizer.render(performance, size=size))
                    best = min(best, time.perf_counter() - began)
                    work = min(work, time.process_time() - used)
                bar = f"   bar {BAR}" if size == SIZES[0] else ""
                print(
                    f"{size[0]} x {size[1]}: {frames} frames, {frames / best:.0f} a second; real "
                    f"time x {track.end / best:.1f} by the clock, x {track.end / work:.1f} by "
                    f"processor time{bar}"
                )


if __name__ == "__main__":
    main()
