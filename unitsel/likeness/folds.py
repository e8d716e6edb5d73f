"""A database evaluated on its own sentences, each selected without its own recording.

The sentences are dealt into folds. Where a guide is used, it is fitted again for each fold,
without the fold's clips; the sentence's own units are never used. All else (the principal
components, phoneme distances, the scales of the costs) is the database's, which has seen the
sentence: held-out clips are the stricter test, this one needs no footage and is quick.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from joblib import Parallel, delayed
from joblib.externals.loky.process_executor import TerminatedWorkerError
from threadpoolctl import threadpool_limits

from analysis.guide import GuideClip, GuideSettings, fit_guides
from database.errors import CorpusError, SelectionError, UnitselError
from database.fingerprint import identity
from database.guide_model import mouth_parameters
from database.reader import UnitDatabase, open_database
from database.schema import GuideModel
from unitsel.likeness.comparison import Evaluator, Sentence, compared_settings
from unitsel.likeness.evaluation import Evaluation
from unitsel.settings import SelectionSettings, default_settings

PIECE: Final = 8
"""Sentences that a process takes at a time."""

Outcome = Sentence | tuple[str, str]
"""A sentence, or a clip and why it could not be used."""


def evaluate_folds(
    database: UnitDatabase,
    folds: int = 5,
    *,
    settings: SelectionSettings | None = None,
    methods: Collection[str] = (),
    limit: int | None = None,
    jobs: int = 1,
    keep_selections: bool = False,
    progress: Callable[[str, int, int], None] | None = None,
) -> Evaluation:
    """Evaluate a database on its own sentences, without their recordings.

    Parameters
    ----------
    database : UnitDatabase
    folds : int
        Number of folds, 2 or more: guides are fitted again without each.
    settings : SelectionSettings, optional
        How units are selected; the database's own by default.
    methods : collection of str, optional
        Other target costs to compare; see `unitsel.likeness.comparison.Evaluator`.
    limit : int, optional
        Only so many sentences, spread evenly over the database.
    jobs : int
        Processes; the result does not depend on it.
    keep_selections : bool
        Whether sentences keep what was selected, as in `unitsel.likeness.evaluation.evaluate`.
    progress : callable, optional

    Returns
    -------
    Evaluation

    Raises
    ------
    SelectionError
        If there are fewer sequences than folds, or a target cost needs a guide that the
        database does not hold.
    CorpusError
        If no sentence can be evaluated.
    """
    tell = progress or (lambda stage, done, total: None)
    usable = np.flatnonzero(database.sequences.units > 0)
    if not 2 <= folds <= len(usable):
        raise SelectionError(
            f"{database.path}: {len(usable)} sequences cannot be dealt into {folds} folds; give "
            "2 or more, and no more than there are sequences"
        )
    settings = settings or default_settings(database)
    compared = compared_settings(database, settings, methods)
    # What the phonemes alone predict is shown beside every selection.
    kinds = [
        k
        for k in database.guides
        if k == "phonemes" or k in {c.target.guide for c in compared.values()}
    ]
    fold_of = dict(zip(usable.tolist(), (np.arange(len(usable)) % folds).tolist(), strict=True))
    chosen = usable.tolist()
    if limit is not None and limit < len(chosen):
        chosen = [chosen[i] for i in np.linspace(0, len(chosen) - 1, limit).round().astype(int)]
    guides: dict[int, dict[str, GuideModel]] = {}
    used = sorted({fold_of[s] for s in chosen})
    for i, fold in enumerate(used if kinds else ()):
        tell("fitting guides", i, len(used))
        left_out = [s for s, f in fold_of.items() if f == fold]
        guides[fold] = guides_without(database, left_out, kinds, jobs)
        tell("fitting guides", i + 1, len(used))
    pieces = [
        (fold, piece)
        for fold in used
        for piece in _pieces([s for s in chosen if fold_of[s] == fold])
    ]
    path, token = database.path.absolute(), identity(database)
    done: dict[int, Outcome] = {}
    run = Parallel(n_jobs=min(jobs, len(pieces)), return_as="generator")
    tell("evaluating", 0, len(chosen))
    try:
        outcomes = run(
            delayed(_evaluated)(
                path, token, settings, tuple(methods), keep_selections, guides.get(fold, {}), piece
            )
            for fold, piece in pieces
        )
        for (_, piece), found in zip(pieces, outcomes, strict=True):
            done.update(zip(piece, found, strict=True))
            tell("evaluating", len(done), len(chosen))
    except TerminatedWorkerError as error:
        raise CorpusError(
            "a worker of the evaluation was ended from outside (out of memory?); fewer --jobs "
            "need less"
        ) from error
    finally:
        _evaluator.cache_clear()
    results = [done[s] for s in chosen]
    sentences = tuple(r for r in results if isinstance(r, Sentence))
    skipped = tuple(r for r in results if not isinstance(r, Sentence))
    if not sentences:
        raise CorpusError(
            f"{database.path}: no sentence could be evaluated; the first: {skipped[0][1]}"
        )
    return Evaluation(sentences, skipped, settings, folds)


def guides_without(
    database: UnitDatabase, leave_out: Collection[int], kinds: Collection[str], jobs: int = 1
) -> dict[str, GuideModel]:
    """Fit guides of a database again, as its build did, without some of its sequences.

    Raises
    ------
    SelectionError
        If too few clips are left for one of them.
    """
    if not kinds:
        return {}
    units, sequences = database.units, database.sequences
    parameters = mouth_parameters(units)
    clips = []
    for s in np.flatnonzero(sequences.units > 0).tolist():
        if s in leave_out:
            continue
        own = slice(sequences.first_unit[s], sequences.first_unit[s] + sequences.units[s])
        clips.append(
            GuideClip(
                database.sequence_track(s),
                ((units.frame[own] + 0.5) / database.fps).astype(np.float64),
                parameters[own],
                database.sound(s) if "sound" in kinds else None,
            )
        )
    fitted = fit_guides(clips, GuideSettings(**database.settings.get("guide", {})), jobs)
    if missing := [kind for kind in kinds if kind not in fitted]:
        raise SelectionError(
            f"{database.path}: without a fold too few clips are left to fit the guide from "
            f"{missing[0]} again; take more folds, or a database of more clips"
        )
    return {kind: fitted[kind] for kind in kinds}


def _pieces(sequences: Sequence[int]) -> list[list[int]]:
    return [list(sequences[i : i + PIECE]) for i in range(0, len(sequences), PIECE)]


@lru_cache(maxsize=1)
def _evaluator(
    path: Path, token: str, settings: SelectionSettings, methods: tuple[str, ...], keep: bool
) -> Evaluator:
    """Prepare a process's evaluator, kept from piece to piece; the token tells the file's state."""
    return Evaluator(open_database(path), settings, methods=methods, keep_selections=keep)


def _evaluated(
    path: Path,
    token: str,
    settings: SelectionSettings,
    methods: tuple[str, ...],
    keep: bool,
    guides: dict[str, GuideModel],
    sequences: Sequence[int],
) -> list[Outcome]:
    """Evaluate some sentences of a fold, each without its own units."""
    evaluator = _evaluator(path, token, settings, methods, keep).with_guides(guides)
    found: list[Outcome] = []
    # One thread, as worker processes have: sums in another order round otherwise.
    with threadpool_limits(1):
        for s in sequences:
            try:
                found.append(evaluator.compare(evaluator.recorded(s), [s]))
            except UnitselError as error:
                found.append((evaluator.database.sequences.name[s], str(error)))
    return found
