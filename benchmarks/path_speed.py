"""From phones to a video: time of each step in relation to the video's own length.

Uses a database of real footage, named as the first argument or in UNITSEL_BENCH_DB, else
out/demo.h5 that `make demo` leaves. Each of its sentences is selected from the other sequences.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

import unitsel

SENTENCES = 20


def main() -> int:
    """Print the table; without a database say what is missing."""
    named = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("UNITSEL_BENCH_DB")
    path = Path(named or "out/demo.h5")
    if not path.is_file():
        print(f"path_speed: no database at {path}; make demo writes one, or name one")
        return 0
    started = time.perf_counter()
    database = unitsel.open_database(path)
    opened = time.perf_counter() - started
    with database:
        names = database.sequences.name
        step = max(1, len(names) // SENTENCES)
        chosen = range(0, len(names), step)[:SENTENCES]
        synthesizer = unitsel.Synthesizer(database)
        tracks = [database.sequence_track(s) for s in chosen]
        background = synthesizer.background()
        # The first sentence compiles the search and starts OpenGL.
        warm = synthesizer.select(tracks[0], exclude_sequences=[chosen[0]])
        list(synthesizer.render(warm, background=background))

        started = time.perf_counter()
        selections = [
            synthesizer.select(t, exclude_sequences=[s])
            for t, s in zip(tracks, chosen, strict=True)
        ]
        selecting = time.perf_counter() - started
        started = time.perf_counter()
        for selection in selections:
            for _ in synthesizer.render(selection, background=background):
                pass
        rendering = time.perf_counter() - started
        started = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            for selection, s in zip(selections, chosen, strict=True):
                synthesizer.write(
                    selection,
                    Path(folder) / "out.mp4",
                    audio=database.sequences.media[s],
                    background=background,
                )
        writing = time.perf_counter() - started
        seconds = sum(t.end for t in tracks)
        print(f"{path}: {len(database)} units, opened in {1000 * opened:.1f} ms")
        print(
            f"{len(tracks)} sentences, {seconds:.0f} s of video; seconds of work a second of video:"
        )
        for what, taken in (
            ("selecting", selecting),
            ("rendering", rendering),
            ("rendering, encoding, writing", writing),
        ):
            print(f"  {what:<30} {taken / seconds:.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
