"""Where a build's time goes: frames a second of one core, everything included, stage by stage.

One process on one thread builds a database from some clips; every stage's time is its own, without
that of the stages inside it. What depends on all clips is there as well, at the size asked for.

    python benchmarks/build_stages.py [--clips 40]
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import cv2
import h5py
import numba
from threadpoolctl import threadpool_limits

from analysis.build import ShardSettings, build_database

ROOT: Final = Path(__file__).resolve().parent.parent
CORPUS: Final = ROOT.parent / "shared" / "corpus" / "grid-s1" / "build"

STAGES: Final = {
    "decoding pictures": ("analysis.clip:read_video", "analysis.person:read_video"),
    "decoding and describing sound": ("analysis.clip:read_sound", "analysis.clip:sound_features"),
    "aligning": ("analysis.clip:align_clip",),
    "finding the face": ("analysis.face:FaceFinder.find",),
    "head motion": ("analysis.clip:HeadFollower.add", "analysis.clip:HeadFollower.finish"),
    "lips, teeth and tongue": ("analysis.clip:lip_geometry", "analysis.clip:teeth_and_tongue"),
    "cutting crops": ("analysis.clip:cut_crop", "analysis.clip:reduce_crop"),
    "encoding pictures": ("analysis.clip:encode",),
    "writing shards": ("analysis.clip_workers:write_shard",),
    "texture PCA": ("analysis.assemble:fit_texture", "analysis.assemble:texture_weights"),
    "lip model": ("analysis.assemble:fit_corpus_lips",),
    "putting clips in step": ("analysis.assemble:find_lags",),
    "cost model": ("analysis.assemble:fit_cost_model",),
    "guides": ("analysis.assemble:fit_guides",),
    "writing the database": ("analysis.build_work:write_database",),
}
"""Functions of each stage, ``module:name``, as the module that calls them names them."""


class Watch:
    """Adds up the time of stages, each without those inside it."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._inside: list[str] = ["the rest"]
        self._since = time.perf_counter()

    def enter(self, stage: str) -> None:
        """Stop the clock of the stage around this one and start this one's."""
        self._count()
        self._inside.append(stage)

    def leave(self) -> None:
        """Go back to the stage around."""
        self._count()
        self._inside.pop()

    def _count(self) -> None:
        now = time.perf_counter()
        self.seconds[self._inside[-1]] += now - self._since
        self._since = now

    def watched(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, its time counted; of a generator that of each step."""

        def steps(iterator: Iterator[Any]) -> Iterator[Any]:
            while True:
                self.enter(stage)
                try:
                    item = next(iterator, self)
                finally:
                    self.leave()
                if item is self:
                    return
                yield item

        def call(*arguments: Any, **options: Any) -> Any:
            self.enter(stage)
            try:
                result = function(*arguments, **options)
            finally:
                self.leave()
            return steps(result) if isinstance(result, Iterator) else result

        return call

    def place(self) -> None:
        """Put a clock around every function of `STAGES`."""
        for stage, places in STAGES.items():
            for place in places:
                module, _, names = place.partition(":")
                owner: Any = importlib.import_module(module)
                *classes, name = names.split(".")
                for part in classes:
                    owner = getattr(owner, part)
                setattr(owner, name, self.watched(stage, getattr(owner, name)))


def main() -> int:
    """Build and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clips", type=int, default=40)
    parser.add_argument(
        "--corpus", type=Path, default=Path(os.environ.get("UNITSEL_CORPUS", CORPUS))
    )
    options = parser.parse_args()
    if not options.corpus.is_dir():
        print(f"needs footage: no folder {options.corpus}; set UNITSEL_CORPUS to one")
        return 0
    cv2.setNumThreads(1)
    numba.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder, threadpool_limits(1):
        # Compiled code and the aligner's model are loaded once a process, whatever the corpus.
        build_database(options.corpus, Path(folder) / "warm.h5", limit=1, jobs=1)
        watch = Watch()
        watch.place()
        path = Path(folder) / "x.h5"
        started = time.perf_counter()
        build_database(
            options.corpus, path, limit=options.clips, jobs=1, shards=ShardSettings(keep=False)
        )
        whole = time.perf_counter() - started
        watch.enter("end")
        with h5py.File(path) as file:
            frames = int(file["sequences/frames"][()].sum())
    print(f"{options.clips} clips, {frames} frames, one core")
    print("| stage | ms a frame | share |")
    print("| --- | --- | --- |")
    for stage in (*STAGES, "the rest"):
        seconds = watch.seconds[stage]
        print(f"| {stage} | {1000 * seconds / frames:.2f} | {100 * seconds / whole:.0f} % |")
    print(f"{frames / whole:.0f} frames a second, everything included")
    return 0


if __name__ == "__main__":
    sys.exit(main())
