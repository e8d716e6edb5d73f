"""How well a short background is played on: a minute of it, compared with how it was recorded.

Takes a database of real footage (the first argument, UNITSEL_BENCH_DB, or out/demo.h5), the best
clip of `unitsel backgrounds`, and the three best joined, and plays each for a minute. Of each:

* jump: the greatest difference from one frame to the next where the picture changes to other frames
  of the recording, over the 95th percentile of the recording's own; so for the whole picture (mean
  difference of luma), for the block of 16 x 16 samples that changes most, and for the head (motion
  of the mask's points). The mouth is left out: it will be covered. Beside it the greatest of the
  recording's own.
* the share of frames that are blends, and the longest stretch that is shown a second time.

The baseline is the same clips started again at their end: a cut. The longest stretch is sought in
the first 3000 frames. `--strip FILE.png` draws the frames
around the worst change of each and around one that is drawn by lot; `--seconds` plays longer and
tells the peak memory after a tenth of it and at the end.
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

import unitsel
from database.mask import project
from database.reader import UnitDatabase
from render.background import Background
from render.playback import Playback, PlayedFrame
from render.similar_frames import HEAD_BOX

BLOCK = 16
SEED = 1
STRIP = 12


@dataclass(frozen=True)
class Change:
    """Differences from each frame to the next, (n - 1,) each, and where they are changes."""

    whole: np.ndarray
    block: np.ndarray
    head: np.ndarray
    changed: np.ndarray


class Steps:
    """Differences between frames outside the mouth."""

    def __init__(self, database: UnitDatabase, played: Playback) -> None:
        self._camera = played.camera
        self._border = database.mask.patch.grid.reshape(-1, 3)
        self._last: tuple[np.ndarray, np.ndarray, PlayedFrame] | None = None
        self._rows: list[tuple[float, float, float, bool]] = []

    def add(self, frame: PlayedFrame) -> None:
        """Take the next frame."""
        luma = frame.planes.y.astype(np.float32)
        mouth = project(self._border, frame.pose, self._camera)
        low, high = mouth.min(axis=0).astype(int), mouth.max(axis=0).astype(int) + 1
        seen = np.ones(luma.shape, bool)
        seen[max(0, low[1]) : high[1], max(0, low[0]) : high[0]] = False
        head = project(HEAD_BOX, frame.pose, self._camera)
        if self._last is not None:
            before, was, shown = self._last
            apart = np.where(seen, np.abs(luma - before), 0)
            height, width = (s // BLOCK * BLOCK for s in apart.shape)
            blocks = apart[:height, :width].reshape(height // BLOCK, BLOCK, -1, BLOCK).mean((1, 3))
            moved = float(np.sqrt(((head - was) ** 2).sum(axis=1).mean()))
            follows = frame.part == shown.part and frame.place == shown.place + 1
            changed = frame.blended or shown.blended or not follows
            self._rows.append((float(apart[seen].mean()), float(blocks.max()), moved, changed))
        self._last = luma, head, frame

    def result(self) -> Change:
        """All differences so far."""
        whole, block, head, changed = np.array(self._rows).T
        return Change(whole, block, head, changed > 0)


def longest_repeat(places: list[tuple[int, int]]) -> int:
    """Frames of the longest stretch that occurs twice (the two may overlap)."""
    names = {place: k for k, place in enumerate(sorted(set(places)))}
    values = np.array([names[p] for p in places])
    longest = 0
    for shift in range(1, len(values)):
        same = np.concatenate([[0], values[shift:] == values[:-shift], [0]])
        edges = np.flatnonzero(np.diff(same))
        if len(edges):
            longest = max(longest, int((edges[1::2] - edges[::2]).max()))
    return longest


def cut(frames: list[PlayedFrame], n: int) -> Iterator[PlayedFrame]:
    """The clip again and again."""
    return (frames[i % len(frames)] for i in range(n))


def measure(
    name: str, database: UnitDatabase, background: Background, options: argparse.Namespace
) -> list[np.ndarray]:
    """Print a background's figures; gives rows of pictures if a strip is asked for."""
    rate = background.fps
    n = round(options.seconds * rate)
    patch, camera = database.mask.patch, database.camera
    natural: list[np.ndarray] = []
    own: list[list[PlayedFrame]] = []
    for part in background.parts:
        with Playback(part, rate, patch, camera, length=len(part)) as played:
            steps, frames = Steps(database, played), []
            for _ in range(len(part)):
                frames.append(next(played))
                steps.add(frames[-1])
            own.append(frames)
            found = steps.result()
            natural.append(np.stack([found.whole, found.block, found.head]))
    recorded = np.concatenate(natural, axis=1)
    usual, most = np.percentile(recorded, 95, axis=1), recorded.max(axis=1)
    print(f"{name}: {', '.join(p.path.stem for p in background.parts)}, {n / rate:.0f} s")
    print(f"  {'':<28}{'whole':>7}{'block':>7}{'head':>7}")
    print(f"  {'recorded, greatest':<28}" + "".join(f"{v:>7.2f}" for v in most / usual))
    memory = []
    with Playback(background, rate, patch, camera, seed=SEED) as played:
        steps, places, blended = Steps(database, played), [], []
        kept: list[PlayedFrame] = []
        spent = 0.0
        for k in range(n):
            began = time.perf_counter()
            frame = next(played)
            spent += time.perf_counter() - began
            steps.add(frame)
            places.append((frame.part, frame.place))
            blended.append(frame.blended)
            if options.strip and k < 3000:
                kept.append(frame)
            if k in (n // 10, n - 1):
                memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        found = steps.result()
        notes = played.notes
    values = np.stack([found.whole, found.block, found.head])
    for what, chosen in (
        ("walk, greatest at a change", np.max),
        ("walk, median at a change", np.median),
    ):
        ratio = (
            chosen(values[:, found.changed], axis=1) / usual if found.changed.any() else usual * 0
        )
        print(f"  {what:<28}" + "".join(f"{v:>7.2f}" for v in ratio))
    with Playback(background.parts[0], rate, patch, camera, length=1) as played:
        steps = Steps(database, played)
        for frame in cut([frame for frames in own for frame in frames], 3 * sum(map(len, own))):
            steps.add(frame)
    cuts = steps.result()
    values = np.stack([cuts.whole, cuts.block, cuts.head])[:, cuts.changed]
    print(f"  {'cut, greatest':<28}" + "".join(f"{v:>7.2f}" for v in values.max(axis=1) / usual))
    total = sum(map(len, own))
    changes = int((np.diff(np.array(blended).astype(int)) > 0).sum())
    print(
        f"  longest stretch shown twice: walk {longest_repeat(places[:3000]) / rate:.1f} s, cut "
        f"{(n - total) / rate:.1f} s, of {total / rate:.1f} s of material; blends "
        f"{100 * np.mean(blended):.0f} %, changes {changes}"
    )
    print(
        f"  {1000 * spent / n:.2f} ms a frame; peak memory {memory[0]:.0f} MB after a tenth, "
        f"{memory[-1]:.0f} MB at the end"
    )
    for note in notes:
        print(f"  {note}")
    return strips(kept, found.whole) if options.strip else []


def strips(frames: list[PlayedFrame], whole: np.ndarray) -> list[np.ndarray]:
    """Frames around the worst change, and around one drawn by lot."""
    blended = np.array([frame.blended for frame in frames])
    starts = np.flatnonzero(blended[1:] & ~blended[:-1])
    starts = starts[(starts > 1) & (starts + STRIP < len(frames))]
    if not len(starts):
        return []
    worst = max(starts, key=lambda at: whole[at : at + STRIP].max())
    drawn = np.random.default_rng(SEED).choice(starts)
    return [np.hstack([frames[at + k].rgb for k in range(STRIP)]) for at in (worst, drawn)]


def main() -> int:
    """Print the figures; without a database say what is missing."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("database", nargs="?", default=os.environ.get("UNITSEL_BENCH_DB"))
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--clips", help="names of clips, comma-separated, in place of the best")
    parser.add_argument("--strip", metavar="FILE.png")
    options = parser.parse_args()
    path = Path(options.database or "out/demo.h5")
    if not path.is_file():
        print(f"background_walk: no database at {path}; make demo writes one, or name one")
        return 0
    rows = []
    with unitsel.open_database(path) as database:
        synthesizer = unitsel.Synthesizer(database)
        there = [one for one in unitsel.rank_backgrounds(database)[:12] if one.state == "there"]
        names = options.clips.split(",") if options.clips else [one.name for one in there]
        if not names:
            print(f"background_walk: the footage of {path} is not there")
            return 0
        rows += measure("one clip", database, synthesizer.background(names[0]), options)
        if len(names) > 2:
            rows += measure("three clips", database, synthesizer.background(*names[:3]), options)
    if rows and options.strip:
        cv2.imwrite(options.strip, np.vstack(rows)[..., ::-1])
    return 0


if __name__ == "__main__":
    sys.exit(main())
