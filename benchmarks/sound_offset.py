"""Offsets of sound and lips that were put in by us, and what is found of them.

The sound of real clips, as a database keeps it, is moved by known amounts; the estimate sees the
clips in draws of twenty. The baseline is the truth. Beside that, sounds are exchanged between
clips, where nothing can be found: how often is it believed all the same?

    python benchmarks/sound_offset.py DB.h5 [--draws 40]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.sound_offset import find_sound_offset
from database.reader import UnitDatabase, open_database
from database.sound_features import moved_features

ROOT: Final = Path(__file__).resolve().parent.parent
OFFSETS: Final = (-0.3, -0.12, -0.04, 0.0, 0.04, 0.12, 0.3)
CLIPS: Final = 20


def clips_of(
    database: UnitDatabase,
) -> list[tuple[npt.NDArray[np.int32], npt.NDArray[np.float32], npt.NDArray[np.float16]]]:
    """Frame numbers, mouth heights and sound of every clip that has a sound."""
    units, found = database.units, []
    for s in range(len(database.sequences)):
        sound = database.sound(s)
        mine = np.flatnonzero(units.sequence == s)
        if sound is not None:
            found.append((units.frame[mine], units.mouth_height[mine], sound))
    return found


def main() -> int:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("database", type=Path, nargs="?", default=ROOT / "out" / "demo.h5")
    parser.add_argument("--draws", type=int, default=40)
    options = parser.parse_args()
    if not options.database.is_file():
        print(f"needs a database of real footage: no file {options.database}; name one")
        return 0
    with open_database(options.database) as database:
        clips, fps = clips_of(database), database.fps
    if len(clips) < 2:
        print(f"{options.database}: has too few clips with sound")
        return 0
    rng = np.random.default_rng(1)
    count = min(CLIPS, len(clips))
    print(f"{options.draws} draws of {count} clips each")
    print("| put in, ms | mean found | rms error | sure |")
    print("| --- | --- | --- | --- |")
    for offset in OFFSETS:
        seconds, sure = [], 0
        for _ in range(options.draws):
            chosen = [clips[i] for i in rng.choice(len(clips), count, replace=False)]
            frames, heights, sounds = zip(*chosen, strict=True)
            moved = [moved_features(s, offset) for s in sounds]
            found = find_sound_offset(frames, heights, moved, fps)
            if found is not None:
                seconds.append(found.seconds)
                sure += found.sure
        if not seconds:
            print(f"| {1000 * offset:+.0f} | none | | |")
            continue
        error = 1000 * float(np.sqrt(np.mean((np.array(seconds) - offset) ** 2)))
        print(
            f"| {1000 * offset:+.0f} | {1000 * np.mean(seconds):+.0f} | {error:.1f} | "
            f"{sure} of {options.draws} |"
        )
    believed = 0
    for _ in range(options.draws):
        chosen = [clips[i] for i in rng.choice(len(clips), count, replace=False)]
        frames, heights, sounds = zip(*chosen, strict=True)
        found = find_sound_offset(frames, heights, [*sounds[1:], sounds[0]], fps)
        believed += found is not None and found.sure
    print(f"of another clip's sound: sure {believed} of {options.draws}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
