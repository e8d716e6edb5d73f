"""What the costs need of the corpus as a whole: M, and the scales that give costs a unit.

The paper's costs have no units, so its weights mean nothing in another database. Two scales
repair that: the median target cost over random pairs of frames and the median visual cost over
random pairs inside a viseme are both 1 after division (database/cost_definition.py).
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from analysis.phoneme_distance import phoneme_distances
from database.cost_definition import GROUPS, CostSettings, context_weights, feature_groups
from database.errors import CorpusError
from database.phonemes import N_VISEMES
from database.schema import CostModel, Units

N_PAIRS: Final = 20_000
"""Random pairs whose median is a scale (standard error of such a median: below 1 %)."""

IntArray = npt.NDArray[np.int64]


def fit_cost_model(
    units: Units,
    contexts: npt.NDArray[np.uint8],
    eigenvalues: npt.NDArray[np.floating],
    fps: float,
    seed: int = 0,
    settings: CostSettings | None = None,
) -> CostModel:
    """Measure M and the scales on the units of a database.

    Parameters
    ----------
    units : Units
        N units.
    contexts : (N, 2n + 1) uint8
        Phonemes around each unit in its own sequence, at `fps`.
    eigenvalues : (K or more,) float
        Variance along each PCA component.
    fps : float
        Frame rate of the database, 1/s.
    seed : int
        Seed of the random pairs.
    settings : CostSettings, optional
        Constants of the costs.

    Returns
    -------
    CostModel

    Raises
    ------
    CorpusError
        If there is no unit, the contexts do not belong to the units, or a feature is not finite.
    """
    settings = settings or CostSettings()
    if len(units) == 0:
        raise CorpusError("corpus: holds no frame with a face, so no costs can be measured")
    if contexts.ndim != 2 or len(contexts) != len(units) or contexts.shape[1] % 2 == 0:
        raise CorpusError(
            f"corpus: contexts of shape {contexts.shape} do not fit {len(units)} units"
        )
    groups = feature_groups(units, eigenvalues)
    for name, values in zip(GROUPS, groups, strict=True):
        if not np.isfinite(values).all():
            raise CorpusError(f"corpus: a unit's {name} features are not finite")
    rng = np.random.default_rng(seed)
    m = phoneme_distances(units.pca, units.phoneme, settings)

    v = context_weights(contexts.shape[1] // 2, fps, settings.beta1)
    first, second = _random_pairs(len(units), rng)
    target = m.astype(np.float64)[contexts[first], contexts[second]] @ v

    scales = np.array([_spread(x) for x in groups])
    first, second = _pairs_inside_visemes(units.viseme, rng)
    distances = [np.linalg.norm(x[first] - x[second], axis=1) for x in groups]
    k = settings.features.normalised
    visual = np.sum([k[d] * distances[d] / scales[d] for d in range(len(GROUPS))], axis=0)
    return CostModel(
        phoneme_distance=m,
        target_scale=_scale(target),
        feature_scales=scales,
        visual_scale=_scale(np.asarray(visual)),
    )


def _scale(values: npt.NDArray[np.float64]) -> float:
    """Median of the values, or of those above 0 where it is 0 (a feature mostly at rest); else 1.

    Not the mean: where one pair in a thousand differs, it would make that pair cost a thousand.
    """
    for part in (values, values[values > 0]):
        if part.size and np.median(part) > 0:
            return float(np.median(part))
    return 1.0


def _spread(values: npt.NDArray[np.float64]) -> float:
    """Root mean square distance of two units drawn at random; 1 for a group that never changes.

    Not a median: teeth and tongue are at zero most of the time, and the median of their
    distances would measure noise.
    """
    spread = float(np.sqrt(2 * values.var(axis=0).sum()))
    # A mean is rounded, so a value that never changes may seem to.
    return spread if spread > 1e-9 * float(np.abs(values).max(initial=0)) else 1.0


def _random_pairs(n: int, rng: np.random.Generator) -> tuple[IntArray, IntArray]:
    """Pairs of two different units; none where there is only one unit."""
    if n < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    first = rng.integers(0, n, N_PAIRS)
    second = (first + rng.integers(1, n, N_PAIRS)) % n
    return first, second


def _pairs_inside_visemes(
    viseme: npt.NDArray[np.integer], rng: np.random.Generator
) -> tuple[IntArray, IntArray]:
    """Pairs of two different units of one viseme; none where every viseme has one unit."""
    order = np.argsort(viseme, kind="stable")
    counts = np.bincount(viseme, minlength=N_VISEMES)
    starts = np.concatenate([[0], np.cumsum(counts)])[:-1]
    of = viseme[order]
    usable = np.flatnonzero(counts[of] > 1)
    if usable.size == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    place = usable[rng.integers(0, usable.size, N_PAIRS)]
    start, count = starts[of[place]], counts[of[place]]
    step = rng.integers(1, count)
    other = start + (place - start + step) % count
    return order[place], order[other]
