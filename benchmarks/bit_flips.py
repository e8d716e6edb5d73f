"""Single flipped bits in a database of real footage: refused, or read right; never silently wrong.

Half of the bits are in what tells where and how long things are: HDF5's own metadata, attributes,
and the datasets of lengths and counts; the other half in all other data. After each flip everything
is read: every picture and mesh, every field, track, sound and guide, and the content hash.

    python benchmarks/bit_flips.py [--flips 500] [--clips 3]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Final

import h5py
import numpy as np
import numpy.typing as npt

from analysis.build import ShardSettings, build_database
from database.schema import FIELDS

ROOT: Final = Path(__file__).resolve().parent.parent
CORPUS: Final = ROOT.parent / "shared" / "corpus" / "grid-s1" / "build"
PROBE: Final = ROOT / "tests" / "damage_probe.py"
LENGTHS: Final = (
    *("pictures/length", "sequences/first_unit", "sequences/units", "sequences/frames"),
    *("sound/steps", "units/sequence", "units/frame", "mask/crop_size"),
)


def places(path: Path) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Bytes that tell where and how long things are, and all others."""
    telling = np.ones(path.stat().st_size, dtype=bool)
    with h5py.File(path) as file:
        for field in FIELDS:
            if field.path not in file:
                continue
            dataset = file[field.path].id
            for i in range(dataset.get_num_chunks()):
                chunk = dataset.get_chunk_info(i)
                end = chunk.byte_offset + chunk.size
                telling[chunk.byte_offset : end] = field.path in LENGTHS
    return np.flatnonzero(telling), np.flatnonzero(~telling)


def flipped(path: Path, flips: int, seed: int) -> list[tuple[str, str]]:
    """What became of each flip: where it was, and the probe's verdict."""
    rng = np.random.default_rng(seed)
    telling, other = places(path)
    plan, kinds = [], []
    for k in range(flips):
        kind, where = ("lengths and metadata", telling) if k % 2 else ("data", other)
        plan.append({"flip": [int(rng.choice(where)), int(rng.integers(8))]})
        kinds.append(kind)
    orders, results = path.with_name("plan.json"), path.with_name("results.txt")
    orders.write_text(json.dumps(plan))
    done = subprocess.run([sys.executable, PROBE, path, orders, results], check=False)
    verdicts = results.read_text().splitlines()
    if done.returncode:
        verdicts += ["the interpreter crashed"] * (flips - len(verdicts))
    return list(zip(kinds, verdicts, strict=True))


def main() -> int:
    """Build a small database, damage it, print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flips", type=int, default=500)
    parser.add_argument("--clips", type=int, default=3)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--corpus", type=Path, default=Path(os.environ.get("UNITSEL_CORPUS", CORPUS))
    )
    options = parser.parse_args()
    if not options.corpus.is_dir():
        print(f"needs footage: no folder {options.corpus}; set UNITSEL_CORPUS to one")
        return 0
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "x.h5"
        report = build_database(
            options.corpus, path, limit=options.clips, shards=ShardSettings(keep=False)
        )
        found = flipped(path, options.flips, options.seed)
    print(f"{options.flips} flips in a database of {report.units} units")
    print("| bits in | refused | read right | silently wrong or crashed |")
    print("| --- | --- | --- | --- |")
    bad = 0
    for kind in ("data", "lengths and metadata"):
        count = Counter(verdict for where, verdict in found if where == kind)
        wrong = sum(n for verdict, n in count.items() if verdict not in ("refused", "right"))
        print(f"| {kind} | {count['refused']} | {count['right']} | {wrong} |")
        bad += wrong
    for where, verdict in found:
        if verdict not in ("refused", "right"):
            print(f"{where}: {verdict}")
    print(f"{time.monotonic() - started:.0f} s in all")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
