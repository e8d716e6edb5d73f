"""A corpus into a database.

Clips are analysed side by side in processes, each leaving a shard in a folder beside the output,
so that memory does not grow with the corpus, a build that was ended goes on where it was, and a
later one of more clips analyses only those. What depends on all clips (lighting reference,
principal components, cost model, guides) follows, each time anew, and the database is written in
one go. A clip that fails is skipped, named and counted; it never ends the build.

The mask is made of the first clips by name that show the face well, or of those that are asked for.
So a database depends on its clips and settings alone, never on the order in which they were
added; and clips that sort behind those leave the mask, and with it all shards, as they are.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Final

from analysis.build_lock import clear_partials, only_build
from analysis.build_settings import BuildReport, BuildSettings, ShardSettings
from analysis.build_work import Progress, Speech, Work
from analysis.consent import checked_consent
from analysis.corpus import Clip, picked
from analysis.corpus_lips import read_lip_marks
from analysis.estimate import Estimate
from analysis.footage import clips_of
from analysis.g2p import speaking_lexicon
from analysis.interrupts import workers_uninterrupted
from analysis.models import find_models
from analysis.shard_store import ShardStore
from database.errors import CorpusError, DatabaseError
from database.pictures import AUTO_CODEC, find_codec

__all__ = ["BuildReport", "BuildSettings", "Progress", "ShardSettings", "build_database"]

DATABASE_EXTENSIONS: Final = (".h5", ".hdf5")

SHARDS_SUFFIX: Final = ".shards"
"""What is added to a database's name for the folder of its shards."""


def build_database(
    corpus: str | Path | Sequence[Clip],
    output: str | Path,
    *,
    settings: BuildSettings | None = None,
    jobs: int = 2,
    limit: int | None = None,
    exclude: Sequence[str] = (),
    timing: str | Path | None = None,
    person: Sequence[str] = (),
    models: str | Path | None = None,
    dictionary: str | Path | None = None,
    shards: ShardSettings | None = None,
    announce: Callable[[Estimate], None] | None = None,
    progress: Progress | None = None,
) -> BuildReport:
    """Build a database from footage.

    A build that was killed or interrupted goes on where it was when it is started again, and
    one of more clips analyses only those; either gives what a build in one go gives.

    Parameters
    ----------
    corpus : path or sequence of Clip
        Folder, manifest or one long video; see `analysis.footage`.
    output : path
        The database, replaced when the new one is complete.
    settings : BuildSettings, optional
    jobs : int
        Clips analysed at a time.
    limit : int, optional
        Take only so many clips, spread evenly over the sorted names.
    exclude : sequence of str
        Clips to leave out.
    timing : path, optional
        Timing file of one long video; by default the one beside it.
    person : sequence of str
        Clips to make the mask of, in this order of preference; by default all, sorted by name.
    models : path, optional
        Folder with the face models; see `analysis.models`.
    dictionary : path, optional
        Pronunciations to add to the CMU dictionary's.
    shards : ShardSettings, optional
    announce : callable, optional
        Called with the estimate of time and space before the work begins; what it raises ends
        the build.
    progress : callable, optional

    Returns
    -------
    BuildReport

    Raises
    ------
    CorpusError
        If the folder holds no usable clip.
    ModelError, PronunciationError
        If the models or the dictionary cannot be read.
    DatabaseError
        If the database cannot be written, there is too little space for it, or another build is
        at work on it.
    KeyboardInterrupt
        As ever; it says how many clips are kept.
    """
    started = time.monotonic()
    chosen = settings or BuildSettings()
    kept = shards or ShardSettings()
    target = Path(output)
    if chosen.codec != AUTO_CODEC:
        find_codec(chosen.codec)
    if chosen.consent:
        chosen = replace(chosen, consent=checked_consent(chosen.consent))
    _check_output(target)
    if jobs < 1:
        raise CorpusError(f"the number of jobs must be at least 1, not {jobs}")
    # Absolute, since a worker may have been started in another folder.
    if isinstance(corpus, str | Path):
        found = clips_of(corpus, timing=timing, limit=limit, exclude=exclude)
    else:
        found = picked(list(corpus), target, limit=limit, exclude=exclude)
    clips = [c.absolute() for c in found]
    marks = read_lip_marks(chosen.lips, [c.name for c in clips])
    speech = Speech(speaking_lexicon(dictionary), dictionary)
    face_models = find_models(models)
    folder = Path(kept.folder or target.with_name(target.name + SHARDS_SUFFIX)).absolute()
    with ExitStack() as held:
        held.enter_context(only_build(target.with_name(f".{target.name}.lock"), target))
        store = ShardStore(folder, fresh=kept.restart, others=kept.others)
        held.enter_context(only_build(store.lock, folder, lasting=True))
        held.enter_context(workers_uninterrupted())
        clear_partials(target.parent, f".{target.name}.*.partial")
        work = Work(target, store, chosen, face_models, jobs, progress or _nobody)
        try:
            work.begin(clips, person, speech)
            if announce is not None:
                announce(work.estimate)
            work.analyse(speech)
            content = work.write(marks)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(work.interrupted()) from None
        except OSError as error:
            reason = error.strerror or error
            raise DatabaseError(f"{target}: cannot be written ({reason})") from error
        finally:
            store.tidy()
        if kept.folder is None and kept.keep:
            store.forget_others()
        elif kept.folder is None:
            store.forget_all()
        return BuildReport(
            target,
            len(content.units),
            len(content.sequences),
            tuple(work.skipped.items()),
            tuple((r["clip"], r["note"]) for r in content.report["repaired"]),
            time.monotonic() - started,
            work.reused,
            tuple(store.damaged),
            work.changed,
            work.person,
            folder if folder.is_dir() else None,
            store.size() if folder.is_dir() else 0,
            work.estimate,
        )


def _check_output(target: Path) -> None:
    if not target.parent.is_dir():
        raise DatabaseError(f"{target}: the folder {target.parent} does not exist; make it first")
    if target.is_dir():
        raise DatabaseError(f"{target}: is a folder; name a file")
    if target.suffix.lower() not in DATABASE_EXTENSIONS:
        # So that a slip of the hand never replaces footage.
        raise DatabaseError(f"{target}: must end in {' or '.join(DATABASE_EXTENSIONS)}")


def _nobody(stage: str, done: int, total: int) -> None:
    """Hear of progress and do nothing."""
