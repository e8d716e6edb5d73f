"""What a training was asked for and what it found, as objects and for weights.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from unitsel.settings import SelectionSettings, TargetSettings
from unitsel.training.pareto import Evolution, ParetoSettings
from unitsel.training.rehearsal import TrialMeasures

FloatArray = npt.NDArray[np.float64]

SENTENCES: Final = 30
"""Training sentences, as in the paper (section 7.2)."""

FRONT_KEPT: Final = 100
"""Sets of the front that the file of weights shows; a front may have a thousand."""

LIBRARIES: Final = ("unitsel", "numpy", "numba", "pymoo")

OBJECTIVES: Final[dict[str, str]] = {
    "tc_avg": "small: mean target cost, scaled",
    "sl_avg": "large: mean segment length, frames",
    "vc_avg": "small: PCA distance at joins, over the steps",
}


@dataclass(frozen=True)
class TrainingSettings:
    """What is trained, and how.

    Parameters
    ----------
    target : TargetSettings
        The target cost that the weights are for.
    sentences : int
        At most so many of the clips, spread evenly.
    features : bool
        Whether the feature weights, beta1 and the context are trained too.
    pareto : ParetoSettings
    """

    target: TargetSettings = field(default_factory=TargetSettings)
    sentences: int = SENTENCES
    features: bool = False
    pareto: ParetoSettings = field(default_factory=ParetoSettings)


@dataclass(frozen=True)
class Trial:
    """Settings and how they did."""

    settings: SelectionSettings
    measures: TrialMeasures

    def as_json(self, features: bool = False) -> dict[str, Any]:
        """The ratios (and with features what else is trained) and the measures."""
        weights, costs = self.settings.weights, self.settings.costs
        found: dict[str, Any] = {"visual": weights.visual, "skip": weights.skip}
        if features:
            found |= {"features": asdict(costs.features)}
            found |= {"beta1": costs.beta1, "context": costs.context}
        return found | self.measures.means


def smoothest_of_the_best(front: Sequence[Trial]) -> tuple[Trial, Trial]:
    """The set to take of a front, and the one of the greatest likeness.

    Along much of a front the likeness hardly changes, and the greatest is so by chance. Sets
    that a difference of no more than its standard error (over the sentences, pair by pair) keeps
    from the greatest count as good as it; of these the one with the least VC_avg is taken, whose
    joins are seen least.

    Parameters
    ----------
    front : sequence of Trial
        By falling TC_avg, or in any order that decides between equals.

    Returns
    -------
    chosen, most_alike : Trial
    """
    best = max(front, key=lambda t: t.measures.likeness)
    top = np.array(best.measures.sentences)
    lost = [top - np.array(t.measures.sentences) for t in front]
    error = [x.std(ddof=1) / np.sqrt(x.size) if x.size > 1 else 0.0 for x in lost]
    equal = [t for t, x, e in zip(front, lost, error, strict=True) if x.mean() <= e]
    return min(equal, key=lambda t: (t.measures.vc_avg, -t.measures.likeness)), best


@dataclass(frozen=True)
class Motion:
    """A training sentence as it was recorded and as the chosen settings play it.

    Parameters
    ----------
    clip, words : str
    seconds : (n,) float64
        Middle of each frame.
    real_pca, real_height, made_pca, made_height : (n,) float64
        First PCA weight, and mouth height in mm.
    r_pca, r_h : float
        Inside speech.
    speech : (float, float)
        Start and end of speech, seconds.
    """

    clip: str
    words: str
    seconds: FloatArray
    real_pca: FloatArray
    real_height: FloatArray
    made_pca: FloatArray
    made_height: FloatArray
    r_pca: float
    r_h: float
    speech: tuple[float, float]


@dataclass(frozen=True)
class Training:
    """What a training found.

    Parameters
    ----------
    chosen, most_alike : Trial
        Of the front (`smoothest_of_the_best`).
    default : Trial
        The weights that the training started from, for comparison.
    front : tuple of Trial
        By falling TC_avg.
    trials : tuple of Trial
        All sets.
    evolution : Evolution
    settings : TrainingSettings
    database : str
        Its identity (`database.fingerprint.identity`).
    sentences : tuple of (clip, words)
    skipped : tuple of (clip, reason)
    example : Motion
        The sentence of median likeness.
    tried : int
        Sets that were tried now; the others came from an earlier run.
    seconds : float
        Time that took.
    """

    chosen: Trial
    most_alike: Trial
    default: Trial
    front: tuple[Trial, ...]
    trials: tuple[Trial, ...]
    evolution: Evolution
    settings: TrainingSettings
    database: str
    sentences: tuple[tuple[str, str], ...]
    skipped: tuple[tuple[str, str], ...]
    example: Motion
    tried: int
    seconds: float

    def along(self, count: int) -> list[Trial]:
        """At most so many sets of the front, evenly in their order."""
        last = len(self.front) - 1
        places = np.linspace(0, last, min(count, last + 1)).round().astype(int)
        return [self.front[i] for i in places]

    def about(self) -> dict[str, Any]:
        """Where the weights come from, for their file: the same for the same run."""
        features, pareto = self.settings.features, self.settings.pareto
        return {
            "trained": "NSGA-II from a grid; of the sets of the front whose likeness (mean of "
            "r_pca_speech and r_h_speech) is within a standard error of the greatest, that with "
            "the least vc_avg",
            "objectives": OBJECTIVES,
            "chosen": self.chosen.as_json(features),
            "most_alike": self.most_alike.as_json(features),
            "default": self.default.as_json(features),
            "front_size": len(self.front),
            "front": [t.as_json(features) for t in self.along(FRONT_KEPT)],
            "sets": len(self.trials),
            "generations": self.evolution.generations,
            "stable": self.evolution.stable,
            "hypervolume": self.evolution.hypervolumes[-1],
            "settings": {"features": features, **asdict(pareto)},
            "sentences": [{"clip": c, "words": w} for c, w in self.sentences],
            "versions": {name: metadata.version(name) for name in LIBRARIES},
        }

    def as_json(self) -> dict[str, Any]:
        """The training for machines: the file's content, and how it went."""
        return {
            **self.chosen.settings.as_json(),
            "database": self.database,
            **self.about(),
            "front": [t.as_json(self.settings.features) for t in self.front],
            "skipped": [{"clip": c, "reason": r} for c, r in self.skipped],
            "tried": self.tried,
            "seconds": round(self.seconds, 3),
        }

    def write(self, path: str | Path) -> None:
        """Write the chosen settings with their provenance (`SelectionSettings.write`)."""
        self.chosen.settings.write(path, database=self.database, about=self.about())
