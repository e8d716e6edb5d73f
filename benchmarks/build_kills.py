"""Kill builds at drawn instants, resume them, and compare the databases.

    python benchmarks/build_kills.py --kills 20 --clips 40

Each build runs in a process group of its own, from nothing, and the whole group is killed
(SIGKILL) when its progress comes to an instant that was drawn: while clips are analysed, in each
of the fits that depend on all clips, while the file is written, at its renaming, and when the
database is done but its process is not. The build is then started again. Its database must have
the content of one that was never killed, and nothing may be left in /dev/shm or beside it.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from analysis.build import BuildSettings, build_database
from analysis.corpus_lips import LipSettings
from analysis.guide import GuideSettings
from database.fingerprint import content_hash

CORPUS = Path(__file__).parent.parent.parent / "shared" / "corpus" / "grid-s1" / "build"
SHARED_MEMORY = Path("/dev/shm")
STAGES = (
    *("analysing clips", "describing mouths", "analysing clips", "learning from phonemes"),
    *("writing", "analysing clips", "renaming", "learning from sound", "finding the person"),
    *("analysing clips", "training the lip model", "fitting lips", "renamed", "done"),
)
"""Stages in which builds are killed, in turn."""

EARLY = ("finding the person", "analysing clips")
"""Those in which clips are not kept yet."""


@dataclass(frozen=True)
class Instant:
    """When to kill: at a share of a stage, and a little later."""

    stage: str
    share: float
    delay: float

    def __str__(self) -> str:
        return f"{self.stage}, {100 * self.share:.0f} % + {1000 * self.delay:.0f} ms"


@dataclass(frozen=True)
class Outcome:
    """What came of one kill.

    Parameters
    ----------
    instant : Instant
    killed : bool
        Whether the build was still at work when it was to be killed.
    left : int
        Names in /dev/shm that the kill left.
    reused : int
        Clips that the second build did not analyse again.
    after : int
        Names in /dev/shm after the second build.
    litter : list of str
        What else lies beside the database.
    content : str
        The database's content hash.
    """

    instant: Instant
    killed: bool
    left: int
    reused: int
    after: int
    litter: list[str]
    content: str


def kill_builds(
    corpus: Path,
    folder: Path,
    instants: Sequence[Instant],
    *,
    jobs: int = 2,
    again: int | None = None,
    guide: GuideSettings | None = None,
    lips: str = LipSettings.source,
    kept: bool = False,
) -> tuple[str, list[Outcome]]:
    """Build once without a kill, then once for each instant.

    Parameters
    ----------
    corpus : Path
    folder : Path
        An empty one for the databases.
    instants : sequence of Instant
    jobs : int
        Of the builds that are killed.
    again : int, optional
        Of all others; the same by default.
    guide : GuideSettings, optional
    lips : str
        One of `analysis.corpus_lips.SOURCES`.
    kept : bool
        Whether builds that are killed after the clips' analysis find it done, which is quicker.

    Returns
    -------
    content : str
        Content hash of the database whose build was not killed.
    outcomes : list of Outcome
    """
    settings = json.dumps({"guide": asdict(guide or GuideSettings()), "lips": lips})
    whole = folder / "whole.h5"
    again = jobs if again is None else again
    _run(corpus, whole, again, settings)
    content = content_hash(whole)
    outcomes = []
    for i, instant in enumerate(instants):
        place = folder / f"kill{i}"
        place.mkdir()
        database = place / "killed.h5"
        if kept and instant.stage not in EARLY:
            shutil.copytree(folder / "whole.h5.shards", place / "killed.h5.shards")
        pid, killed = _run_and_kill(corpus, database, instant, jobs, settings)
        left = len(_in_shared_memory(pid))
        second, report = _run(corpus, database, again, settings)
        after = len(_in_shared_memory(pid)) + len(_in_shared_memory(second))
        litter = sorted({p.name for p in place.iterdir()} - {"killed.h5", "killed.h5.shards"})
        litter += [p.name for p in place.rglob("*.partial")]
        outcomes.append(
            Outcome(instant, killed, left, report["reused"], after, litter, content_hash(database))
        )
        shutil.rmtree(place)
    return content, outcomes


def draw_instants(count: int, seed: int = 0) -> list[Instant]:
    """Draw instants over all stages of a build."""
    rng = random.Random(seed)
    return [
        Instant(STAGES[i % len(STAGES)], rng.random(), rng.random() * 0.05) for i in range(count)
    ]


def _start(corpus: Path, database: Path, jobs: int, settings: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, __file__, "--child", str(corpus), str(database), str(jobs), settings],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


def _run(corpus: Path, database: Path, jobs: int, settings: str) -> tuple[int, dict[str, Any]]:
    child = _start(corpus, database, jobs, settings)
    out, _ = child.communicate()
    if child.returncode != 0:
        raise SystemExit(f"a build failed with {child.returncode}")
    report: dict[str, Any] = json.loads(out.splitlines()[-1])
    return child.pid, report


def _run_and_kill(
    corpus: Path, database: Path, instant: Instant, jobs: int, settings: str
) -> tuple[int, bool]:
    """Start a build and kill its group at an instant; its process, and whether it was alive."""
    child = _start(corpus, database, jobs, settings)
    assert child.stdout is not None
    last = instant.stage in ("renaming", "renamed")
    for line in child.stdout:
        if line.startswith("{"):  # The report: only the process's end is left.
            break
        words = line.rsplit(" ", 2)
        if len(words) != 3 or not words[2].strip().isdecimal():
            continue
        stage, done, total = words[0], int(words[1]), int(words[2])
        wanted = total if last else round(instant.share * total)
        if stage == ("writing" if last else instant.stage) and done >= wanted:
            break
    if instant.stage == "renamed":
        while child.poll() is None and not database.exists():
            time.sleep(0.0005)
    elif instant.stage != "done":
        time.sleep(instant.delay)
    killed = child.poll() is None
    # Its workers may outlive it, so the group is killed in any case.
    try:
        os.killpg(child.pid, signal.SIGKILL)
    except ProcessLookupError:
        killed = False
    child.communicate()
    return child.pid, killed


def _in_shared_memory(pid: int) -> list[str]:
    """Names in /dev/shm that carry a process's number."""
    ours = re.compile(rf"(?:sem\.loky-{pid}-|joblib_memmapping_folder_{pid}_)")
    return [p.name for p in SHARED_MEMORY.iterdir() if ours.match(p.name)]


def _child(corpus: str, database: str, jobs: str, settings: str) -> None:
    """Build in this process, telling each step on standard output."""

    def tell(stage: str, done: int, total: int) -> None:
        print(stage, done, total, flush=True)

    given = json.loads(settings)
    report = build_database(
        corpus,
        database,
        settings=BuildSettings(
            guide=GuideSettings(**given["guide"]), lips=LipSettings(source=given["lips"])
        ),
        jobs=int(jobs),
        progress=tell,
    )
    print(json.dumps(report.as_json()), flush=True)


def main() -> int:
    """Run and print a table; the exit status is 1 if any database differs or anything is left."""
    if sys.argv[1:2] == ["--child"]:
        _child(*sys.argv[2:])
        return 0
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--clips", type=int, default=40)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--corpus", type=Path, default=Path(os.environ.get("UNITSEL_CORPUS", CORPUS))
    )
    options = parser.parse_args()
    if not options.corpus.is_dir():
        print(f"needs footage: no folder {options.corpus}; set UNITSEL_CORPUS to one")
        return 0
    with tempfile.TemporaryDirectory() as name:
        corpus, databases = Path(name) / "corpus", Path(name) / "databases"
        corpus.mkdir()
        databases.mkdir()
        stems = sorted({p.stem for p in options.corpus.iterdir()})[: options.clips]
        for path in options.corpus.iterdir():
            if path.stem in stems:
                (corpus / path.name).symlink_to(path.resolve())
        started = time.monotonic()
        content, outcomes = kill_builds(
            corpus,
            databases,
            draw_instants(options.kills, options.seed),
            jobs=options.jobs,
            # So that a small build, too, has fits to be killed in, though short ones.
            guide=GuideSettings(
                fewest_clips=min(20, options.clips), members=1, epochs=2, steps=200
            ),
        )
    print("| killed at | clips kept | /dev/shm after kill, after resume | content |")
    print("| --- | --- | --- | --- |")
    for o in outcomes:
        same = "the same" if o.content == content else "OTHER"
        alive = "" if o.killed else " (was done already)"
        print(f"| {o.instant}{alive} | {o.reused} | {o.left}, {o.after} | {same} |")
    good = [o for o in outcomes if o.content == content and not o.after and not o.litter]
    print(
        f"{len(good)} of {len(outcomes)} killed builds gave the content of the one that was not, "
        f"and left nothing ({time.monotonic() - started:.0f} s in all)"
    )
    return 0 if len(good) == len(outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
