"""How good synthesis will be: a database asked for sentences whose recordings it may not use."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from analysis.guide import GuideSettings
from database.errors import SelectionError
from database.reader import UnitDatabase
from unitsel.likeness.comparison import Evaluator, Sentence
from unitsel.likeness.folds import guides_without
from unitsel.settings import default_settings

SENTENCES: Final = 24
"""Sentences that are selected by default."""

FEWEST_SENTENCES: Final = 4
"""Sentences below which nothing is said."""

HELD_BACK: Final = (2, 3, 5, 10, 20)
"""One clip in so many is held back from the guide: the first that leaves enough to fit it."""

GOOD: Final = 0.85
FAIR: Final = 0.70
"""Correlations of the mouth's height from which on synthesis is called good, or fair."""

RESAMPLED: Final = 2000
"""Draws of the bootstrap."""

METHODS: Final = ("random", "phoneme_mean", "selected", "nearest")
"""Rows of the table, from the floor to the ceiling."""


@dataclass(frozen=True)
class Measured:
    """A correlation over sentences: its mean, and where the mean lies in 95 of 100 cases."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.mean:.2f} ({self.low:.2f} to {self.high:.2f})"


@dataclass(frozen=True)
class Quality:
    """Expected quality of synthesis.

    Parameters
    ----------
    target : str
        Target cost that selected.
    sentences : int
    learnt : float
        Share of the clips that the guide was fitted again on; 1 where none is used.
    heights, textures : dict of method to Measured
        Correlation of mouth height (of the raw face mesh) and of the first PCA weight with the
        recording: ``selected``, and what it is to be compared with.
    worst : tuple of (clip, words, r)
        Sentences that came out worst, by mouth height.
    """

    target: str
    sentences: int
    learnt: float
    heights: dict[str, Measured]
    textures: dict[str, Measured]
    worst: tuple[tuple[str, str, float], ...]

    @property
    def grade(self) -> str:
        """``good``, ``fair`` or ``poor``."""
        r = self.heights["selected"].mean
        return "good" if r >= GOOD else "fair" if r >= FAIR else "poor"

    @property
    def verdict(self) -> str:
        """The result in plain words, with its uncertainty."""
        r, floor = self.heights["selected"], self.heights["phoneme_mean"]
        ceiling = self.heights["nearest"]
        meaning = {
            "good": "the mouth opens and closes as the real one did nearly all the time",
            "fair": "most movements are right, but some sounds will look mumbled or late",
            "poor": "the mouth often does something else than the real one did",
        }[self.grade]
        sure = ""
        if (r.low >= GOOD) != (r.high >= GOOD) or (r.low >= FAIR) != (r.high >= FAIR):
            sure = f" The {self.sentences} sentences are too few to be sure of the grade."
        return (
            f"Expect {self.grade} synthesis of sentences like those recorded: {meaning} "
            f"(r of the mouth's height {r}; the mean mouth of each phoneme reaches "
            f"{floor.mean:.2f}, the best picture the database has for each frame "
            f"{ceiling.mean:.2f}).{sure}"
        )

    def as_json(self) -> dict[str, Any]:
        """The quality for machines."""
        return {
            "grade": self.grade,
            "verdict": self.verdict,
            "target": self.target,
            "sentences": self.sentences,
            "guide_learnt_on": round(self.learnt, 3),
            "r_h_mesh": {m: _rounded(v) for m, v in self.heights.items()},
            "r_pca": {m: _rounded(v) for m, v in self.textures.items()},
            "worst": [{"clip": c, "words": w, "r_h_mesh": round(r, 3)} for c, w, r in self.worst],
        }


def expected_quality(
    database: UnitDatabase,
    sentences: int,
    *,
    jobs: int,
    tell: Callable[[str, int, int], None],
) -> Quality | str:
    """Select some of the database's own sentences without their recordings.

    The guide is fitted again once, on half of the clips (or more where half are too few), and
    the sentences are of the others; no sentence may use its own pictures. All else is the
    database's, as in `unitsel.likeness.folds`.

    Returns
    -------
    Quality or str
        Why nothing can be said, in one sentence.

    Raises
    ------
    DatabaseError
        If the database cannot be read.
    """
    own = np.flatnonzero(database.sequences.units > 0)
    if len(own) < FEWEST_SENTENCES:
        return f"{len(own)} clips are too few to test one against the others"
    held, learnt = own, 1.0
    try:
        settings = default_settings(database)
        kinds = [] if settings.target.guide is None else [settings.target.guide]
        evaluator = Evaluator(database, settings)
        if kinds:
            held = own[:: _held_back(database, len(own))]
            learnt = 1 - len(held) / len(own)
            tell("fitting a guide", 0, 1)
            evaluator = evaluator.with_guides(guides_without(database, held.tolist(), kinds, jobs))
            tell("fitting a guide", 1, 1)
    except SelectionError as error:
        return str(error)
    places = np.linspace(0, len(held) - 1, min(sentences, len(held))).round().astype(int)
    found: list[Sentence] = []
    for i, s in enumerate(held[places].tolist()):
        tell("testing sentences", i, len(places))
        # One that cannot be selected tells nothing of the others; its clip's faults are told.
        with suppress(SelectionError):
            found.append(evaluator.compare(evaluator.recorded(s), [s]))
    tell("testing sentences", len(places), len(places))
    return _of_sentences(settings.target.name, learnt, found)


def _of_sentences(target: str, learnt: float, found: Sequence[Sentence]) -> Quality | str:
    """Means over sentences."""
    heights: dict[str, Measured] = {}
    textures: dict[str, Measured] = {}
    for method in METHODS:
        rows = [s.scores[method] for s in found if method in s.scores]
        tall = [r.r_h_mesh for r in rows if r.r_h_mesh is not None and np.isfinite(r.r_h_mesh)]
        alike = [r.r_pca for r in rows if r.r_pca is not None and np.isfinite(r.r_pca)]
        if len(tall) < FEWEST_SENTENCES or len(alike) < FEWEST_SENTENCES:
            return f"only {min(len(tall), len(alike))} sentences could be compared"
        heights[method] = _measured(np.array(tall))
        textures[method] = _measured(np.array(alike))
    worst = sorted(
        (
            (s.clip, s.words, float(s.scores["selected"].r_h_mesh))
            for s in found
            if s.scores["selected"].r_h_mesh is not None
        ),
        key=lambda row: (row[2], row[0]),
    )
    return Quality(target, len(found), learnt, heights, textures, tuple(worst[:5]))


def _held_back(database: UnitDatabase, usable: int) -> int:
    """Hold back one clip in how many, so that enough are left to fit a guide."""
    known = database.settings.get("guide", {})
    fewest = int(known.get("fewest_clips", GuideSettings.fewest_clips))
    for step in HELD_BACK:
        if usable - -(-usable // step) >= fewest:
            return step
    return usable


def _measured(values: npt.NDArray[np.float64]) -> Measured:
    draws = np.random.default_rng(0).integers(0, len(values), (RESAMPLED, len(values)))
    low, high = np.percentile(values[draws].mean(axis=1), [2.5, 97.5])
    return Measured(float(values.mean()), float(low), float(high))


def _rounded(value: Measured) -> list[float]:
    return [round(v, 4) for v in (value.mean, value.low, value.high)]
