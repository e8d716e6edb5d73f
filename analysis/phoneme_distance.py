"""How different two phonemes look: the matrix M of equation 5 (Liu and Ostermann 2009).

M is measured on the corpus's own frames. No corpus speaks every phoneme, so what is missing is
filled in from how the phonemes are articulated:

* a phoneme whose visible articulation is that of measured ones (its twins: n looks as d and t
  do) takes their mean picture;
* any other takes its articulatory distances, brought to the measured scale by a regression
  through the measured pairs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.cost_definition import CostSettings
from database.phonemes import N_PHONEMES, PHONEMES

FloatArray = npt.NDArray[np.float64]

MIN_FRAMES: Final = 5
"""Frames below which a phoneme counts as not measured: a mean of fewer is one clip's accident."""


@dataclass(frozen=True)
class Articulation:
    """How a phoneme is made, in what of it can be seen.

    Parameters
    ----------
    place : float
        From the lips (0) to the throat (1); for vowels from front to back of the tongue.
    manner : float
        From a full closure (0) over friction and approach to a free vowel (1).
    rounding : float
        From spread (0) over neutral (0.2) to rounded lips (1).
    height : float
        Opening of jaw and lips, from closed (0) to wide open (1).
    voiced : bool
        Kept for completeness: nobody sees it, so it has no weight.
    """

    place: float
    manner: float
    rounding: float
    height: float
    voiced: bool


_CLOSURE, _FRICTION, _APPROACH, _VOWEL = 0.0, 0.35, 0.65, 1.0
_FRONT, _CENTRAL, _BACK = 0.55, 0.7, 0.85

# A diphthong is the mean of its two ends. Nasals close the mouth as stops do, affricates look
# like their fricatives. Silence is the mouth at rest: lips together, nothing rounded.
_ARTICULATIONS: Final[dict[str, Articulation]] = {
    "sil": Articulation(0.2, _CLOSURE, 0.2, 0.05, False),
    "ae": Articulation(_FRONT, _VOWEL, 0.1, 0.75, True),
    "ax": Articulation(_CENTRAL, _VOWEL, 0.2, 0.4, True),
    "ah": Articulation(_CENTRAL, _VOWEL, 0.2, 0.6, True),
    "aa": Articulation(_BACK, _VOWEL, 0.2, 0.95, True),
    "ao": Articulation(_BACK, _VOWEL, 0.7, 0.75, True),
    "ey": Articulation(_FRONT, _VOWEL, 0.05, 0.45, True),
    "eh": Articulation(_FRONT, _VOWEL, 0.1, 0.55, True),
    "uh": Articulation(_BACK, _VOWEL, 0.6, 0.35, True),
    "er": Articulation(_CENTRAL, _VOWEL, 0.5, 0.35, True),
    "iy": Articulation(_FRONT, _VOWEL, 0.0, 0.25, True),
    "y": Articulation(_FRONT, _APPROACH, 0.05, 0.2, True),
    "ih": Articulation(_FRONT, _VOWEL, 0.1, 0.35, True),
    "ix": Articulation(_CENTRAL, _VOWEL, 0.15, 0.3, True),
    "w": Articulation(_BACK, _APPROACH, 1.0, 0.1, True),
    "uw": Articulation(_BACK, _VOWEL, 1.0, 0.2, True),
    "ow": Articulation(_BACK, _VOWEL, 0.85, 0.45, True),
    "aw": Articulation(_BACK, _VOWEL, 0.5, 0.7, True),
    "oy": Articulation(_CENTRAL, _VOWEL, 0.45, 0.55, True),
    "ay": Articulation(_CENTRAL, _VOWEL, 0.1, 0.7, True),
    "h": Articulation(1.0, _FRICTION, 0.2, 0.4, False),
    "hh": Articulation(1.0, _FRICTION, 0.2, 0.4, False),
    "r": Articulation(0.55, _APPROACH, 0.55, 0.25, True),
    "l": Articulation(0.45, _APPROACH, 0.2, 0.35, True),
    "s": Articulation(0.45, _FRICTION, 0.1, 0.15, False),
    "z": Articulation(0.45, _FRICTION, 0.1, 0.15, True),
    "sh": Articulation(0.55, _FRICTION, 0.6, 0.2, False),
    "ch": Articulation(0.55, _FRICTION, 0.6, 0.2, False),
    "jh": Articulation(0.55, _FRICTION, 0.6, 0.2, True),
    "zh": Articulation(0.55, _FRICTION, 0.6, 0.2, True),
    "th": Articulation(0.3, _FRICTION, 0.15, 0.25, False),
    "dh": Articulation(0.3, _FRICTION, 0.15, 0.25, True),
    "f": Articulation(0.15, _FRICTION, 0.2, 0.1, False),
    "v": Articulation(0.15, _FRICTION, 0.2, 0.1, True),
    "d": Articulation(0.45, _CLOSURE, 0.15, 0.25, True),
    "t": Articulation(0.45, _CLOSURE, 0.15, 0.25, False),
    "n": Articulation(0.45, _CLOSURE, 0.15, 0.25, True),
    "k": Articulation(0.85, _CLOSURE, 0.2, 0.35, False),
    "g": Articulation(0.85, _CLOSURE, 0.2, 0.35, True),
    "ng": Articulation(0.85, _CLOSURE, 0.2, 0.35, True),
    "p": Articulation(0.0, _CLOSURE, 0.2, 0.0, False),
    "b": Articulation(0.0, _CLOSURE, 0.2, 0.0, True),
    "m": Articulation(0.0, _CLOSURE, 0.2, 0.0, True),
}

# What is seen first are the lips: their opening and rounding weigh most.
_WEIGHTS: Final = np.array([0.5, 0.5, 1.0, 1.0])


def articulatory_distances() -> FloatArray:
    """Distances between phonemes by their visible articulation, (43, 43), no unit."""
    rows = [_ARTICULATIONS[p] for p in PHONEMES]
    x = np.array([[a.place, a.manner, a.rounding, a.height] for a in rows]) * _WEIGHTS
    return np.asarray(np.linalg.norm(x[:, None] - x[None], axis=2), dtype=np.float64)


def component_weights(k: int, beta2: float) -> FloatArray:
    """Weights gamma of the first `k` PCA components in M (equation 5), (k,) float64."""
    return np.exp(beta2 * np.abs(np.arange(1, k + 1) - k))


def phoneme_distances(
    pca: npt.NDArray[np.floating],
    phoneme: npt.NDArray[np.integer],
    settings: CostSettings | None = None,
    min_frames: int = MIN_FRAMES,
) -> npt.NDArray[np.float32]:
    """Visual distance of each pair of phonemes: M (equation 5).

    Parameters
    ----------
    pca : (N, K) float
        PCA weights of each unit; the first ``settings.components`` count.
    phoneme : (N,) int
        Phoneme of each unit.
    settings : CostSettings, optional
        beta2 and the number of components.
    min_frames : int
        Phonemes with fewer units than this are filled in.

    Returns
    -------
    (43, 43) float32
        Symmetric, finite, zero on the diagonal; in the unit of `pca`.
    """
    settings = settings or CostSettings()
    k = min(settings.components, pca.shape[1])
    means, known = _phoneme_means(np.asarray(pca[:, :k], dtype=np.float64), phoneme, min_frames)
    gamma = component_weights(k, settings.beta2)
    seen = means * (gamma / gamma.sum())
    measured = np.linalg.norm(seen[:, None] - seen[None], axis=2)
    articulated = articulatory_distances()
    both = known[:, None] & known[None]
    power = float((articulated[both] ** 2).sum())
    scale = float((articulated[both] * measured[both]).sum()) / power if power > 0 else 0.0
    # Without two different measured phonemes there is no scale to take over.
    filled = articulated * (scale if scale > 0 else 1.0)
    matrix = np.where(both, measured, filled)
    matrix = (matrix + matrix.T) / 2
    np.fill_diagonal(matrix, 0.0)
    return matrix.astype(np.float32)


def _phoneme_means(
    pca: FloatArray, phoneme: npt.NDArray[np.integer], min_frames: int
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Mean PCA weights of each phoneme (43, K), and which are known, by frames or by twins."""
    counts = np.bincount(phoneme, minlength=N_PHONEMES)
    sums = np.zeros((N_PHONEMES, pca.shape[1]))
    for a in np.flatnonzero(counts >= min_frames):
        sums[a] = pca[phoneme == a].sum(axis=0)
    measured = counts >= max(1, min_frames)
    known = measured.copy()
    means = np.zeros_like(sums)
    means[measured] = sums[measured] / counts[measured, None]
    twins = articulatory_distances() < 1e-9
    for a in np.flatnonzero(~measured):
        same = twins[a] & measured
        if same.any():
            means[a] = sums[same].sum(axis=0) / counts[same].sum()
            known[a] = True
    return means, known
