"""Clips analysed side by side in processes, each into its shard."""

from __future__ import annotations

import os
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Final

import cv2
from joblib import Parallel, delayed
from joblib.externals.loky.process_executor import TerminatedWorkerError

from analysis.align import Aligner, AlignSettings
from analysis.clip import AnalysedClip, analyse_clip
from analysis.corpus import Clip
from analysis.face import FaceFinder, FaceSettings
from analysis.models import FaceModels
from analysis.motion import MotionSettings
from analysis.person import Person
from analysis.shards import Refusal, Shard, write_refusal, write_shard
from database.errors import CorpusError, DatabaseError, MediaError, ModelError, UnitselError
from database.lexicon import Lexicon

WATCH_SECONDS: Final = 1.0


@dataclass(frozen=True)
class ClipTask:
    """A clip to analyse, what its media must be, and where its shard goes."""

    clip: Clip
    sha256: str
    path: Path


@dataclass(frozen=True)
class Shared:
    """What every worker needs; small, since it travels with every clip."""

    person: Person
    fps: float
    models: FaceModels
    lexicon: Lexicon
    codec: str
    face: FaceSettings
    motion: MotionSettings
    align: AlignSettings
    build: str = field(default_factory=lambda: uuid.uuid4().hex)
    """Tells this build from an earlier one in workers that serve several."""
    process: int = field(default_factory=os.getpid)
    """The process that builds."""


def analyse_clips(
    tasks: Sequence[ClipTask],
    shared: Shared,
    jobs: int,
    done: Callable[[ClipTask, Shard | Refusal], None],
) -> None:
    """Analyse clips; `done` hears of each as it is finished, in any order.

    Memory is bounded by the number of jobs: what comes back of a clip is small.

    Raises
    ------
    DatabaseError
        If a shard cannot be written.
    CorpusError
        If a worker is ended from outside.
    """
    if not tasks:
        return
    run = Parallel(
        n_jobs=min(jobs, len(tasks)),
        return_as="generator_unordered",
        batch_size=1,
        pre_dispatch="2*n_jobs",
    )
    work = (delayed(_analyse_into)(i, task, shared) for i, task in enumerate(tasks))
    try:
        with closing(run(work)) as results:
            for i, outcome in results:
                done(tasks[i], outcome)
    except TerminatedWorkerError as error:
        raise CorpusError(
            "a worker of the build was ended from outside (out of memory?); what is analysed is "
            "kept: build again, with fewer --jobs if memory was short"
        ) from error


@cache
def _end_with(parent: int) -> None:
    """See to it that this worker ends when the building process is killed without it.

    loky's workers would wait five minutes for work, with all their memory.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH_SECONDS)
        os._exit(1)

    if os.getpid() != parent:
        threading.Thread(target=watch, name="parent watch", daemon=True).start()


@cache
def _finder(models: FaceModels, settings: FaceSettings) -> FaceFinder:
    return FaceFinder(models, settings)


_aligners: dict[str, Aligner] = {}


def _aligner(shared: Shared) -> Aligner:
    """One aligner a process and build: its acoustic model takes a third of a second to load."""
    if shared.build not in _aligners:
        _aligners.clear()
        _aligners[shared.build] = Aligner(shared.lexicon, shared.align)
    return _aligners[shared.build]


def _analyse_into(i: int, task: ClipTask, shared: Shared) -> tuple[int, Shard | Refusal]:
    """Analyse a clip in a worker; its shard, or why it is skipped."""
    _end_with(shared.process)
    cv2.setNumThreads(1)  # Clips run side by side; threads inside would fight.
    started = time.monotonic()
    media = task.clip.source
    try:
        analysed: AnalysedClip = analyse_clip(
            task.clip,
            shared.person.mask,
            shared.person.camera,
            _finder(shared.models, shared.face),
            _aligner(shared),
            fps=shared.fps,
            codec=shared.codec,
            settings=shared.motion,
            reference=shared.person.reference,
        )
    except (MediaError, ModelError) as error:
        # Perhaps a disk's or memory's fault and not the clip's: tried again next time.
        return i, Refusal(str(error))
    except UnitselError as error:
        write_refusal(task.path, task.clip, str(error))
        return i, Refusal(str(error))
    except Exception as error:  # One bad clip never ends an hour's build.
        return i, Refusal(f"{media}: unexpected {type(error).__name__}: {error}")
    if analysed.sha256 != task.sha256:
        return i, Refusal(f"{media}: was changed while it was read; build again to take it")
    try:
        return i, write_shard(task.path, task.clip, analysed, time.monotonic() - started)
    except OSError as error:
        raise DatabaseError(f"{task.path}: cannot be written ({error.strerror})") from error
