"""How like the real person: a database evaluated on sentences that it does not hold.

Each held-out clip is aligned and analysed by default settings, with the database's mask,
principal components and lighting rule, and never put in step (analysis/lag.py); its phones are
given to the selection; the mouths that come back are compared with the recorded ones, frame by
frame (unitsel/likeness/comparison.py). unitsel/likeness/folds.py does it without held-out clips.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from analysis.clip import sha256_of
from analysis.corpus import find_clips
from database.errors import CorpusError, UnitselError
from database.reader import UnitDatabase
from unitsel.likeness.comparison import ALL, METHODS, Evaluator, Sentence
from unitsel.likeness.recorded import Target
from unitsel.likeness.scores import Scores, Trajectories, mean_scores
from unitsel.settings import SelectionSettings

__all__ = [
    "ALL",
    "METHODS",
    "Evaluation",
    "Evaluator",
    "Scores",
    "Sentence",
    "Target",
    "Trajectories",
    "evaluate",
]


@dataclass(frozen=True)
class Evaluation:
    """Sentences, their means, and the clips that could not be used.

    Parameters
    ----------
    sentences : tuple of Sentence
    skipped : tuple of (str, str)
        Clips and why.
    settings : SelectionSettings
        What was evaluated as ``"selected"``.
    folds : int or None
        Folds of the database's own sentences, None for held-out clips.
    """

    sentences: tuple[Sentence, ...]
    skipped: tuple[tuple[str, str], ...]
    settings: SelectionSettings
    folds: int | None = None

    @cached_property
    def means(self) -> dict[str, Scores]:
        """Mean over the sentences, method by method, in the order of `METHODS`."""
        found = {}
        for method in METHODS:
            having = [s.scores for s in self.sentences if method in s.scores]
            if having:
                found[method] = mean_scores(
                    [s[method] for s in having], [s["real"] for s in having]
                )
        return found

    def as_json(self) -> dict[str, Any]:
        """The evaluation for machines."""
        return {
            **{m: asdict(scores) for m, scores in self.means.items()},
            "settings": self.settings.as_json(),
            "folds": self.folds,
            "sentences": [
                {
                    "clip": s.clip,
                    "words": s.words,
                    "fallbacks": list(s.fallbacks),
                    **{m: asdict(scores) for m, scores in s.scores.items()},
                }
                for s in self.sentences
            ],
            "skipped": [{"clip": c, "reason": r} for c, r in self.skipped],
        }


def evaluate(
    database: UnitDatabase,
    heldout: str | Path,
    *,
    settings: SelectionSettings | None = None,
    methods: Collection[str] = (),
    limit: int | None = None,
    models: str | Path | None = None,
    dictionary: str | Path | None = None,
    keep_selections: bool = False,
    progress: Callable[[str, int, int], None] | None = None,
) -> Evaluation:
    """Evaluate a database on clips that it does not hold.

    Parameters
    ----------
    database : UnitDatabase
    heldout : path
        Folder of clips with their words or timings.
    settings : SelectionSettings, optional
        How units are selected; the database's own by default.
    methods : collection of str, optional
        Other target costs to compare; see `Evaluator`.
    limit : int, optional
        Only so many clips.
    models, dictionary : path, optional
        As for a build.
    keep_selections : bool
        Whether sentences keep what was selected, to be shown (unitsel/likeness/side_by_side.py).
    progress : callable, optional

    Returns
    -------
    Evaluation

    Raises
    ------
    CorpusError
        If no clip can be used; one that is part of the database cannot.
    SelectionError
        If a target cost needs a guide that the database does not hold.
    """
    clips = find_clips(heldout, limit=limit)
    evaluator = Evaluator(
        database,
        settings,
        methods=methods,
        models=models,
        dictionary=dictionary,
        keep_selections=keep_selections,
    )
    _ = evaluator.footage  # Missing models are no fault of the first clip.
    known = set(database.sequences.sha256)
    sentences: list[Sentence] = []
    skipped: list[tuple[str, str]] = []
    for i, clip in enumerate(clips):
        if progress is not None:
            progress("evaluating", i, len(clips))
        try:
            if sha256_of(clip.media) in known:
                raise CorpusError(
                    f"{clip.media}: is part of the database, so it tests nothing; build without "
                    f"it (--exclude {clip.name})"
                )
            sentences.append(evaluator.compare(evaluator.target(clip)))
        except UnitselError as error:
            skipped.append((clip.name, str(error)))
        except Exception as error:  # As in a build: one bad clip does not end the rest.
            what = f"{clip.media}: unexpected {type(error).__name__}: {error}"
            skipped.append((clip.name, what))
    if progress is not None:
        progress("evaluating", len(clips), len(clips))
    if not sentences:
        raise CorpusError(f"{heldout}: no clip could be evaluated; the first: {skipped[0][1]}")
    return Evaluation(tuple(sentences), tuple(skipped), evaluator.settings)
