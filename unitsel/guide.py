"""The guided target cost: how far a unit is from the mouth that a guide expects.

Beside the paper's cost, which compares phonemes, this one compares mouths: the guide
(database/guide_model.py) predicts the trajectory of a sentence, and a unit costs the visual
distance f (equation 7) between the predicted mouth and its own, divided by the median of f over
random pairs of units, so that it is counted as the paper's cost is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt
from numba import njit

from database.cost_definition import FeatureWeights, visual_features
from database.errors import SelectionError
from database.guide_model import N_PHONE_INPUTS, N_SOUND_INPUTS, guide_inputs, predict
from database.schema import CostModel, GuideModel
from database.sound import Sound
from database.sound_features import sound_features
from database.track import PhonemeTrack, frame_count, frame_times

FloatArray = npt.NDArray[np.float64]

N_PAIRS: Final = 20_000
"""Random pairs whose median is the scale."""


@dataclass(frozen=True)
class Guide:
    """A guide, and what turns its predictions into features.

    Parameters
    ----------
    model : GuideModel
    eigenvalues : (K or more,) float32
        Of the database's PCA.
    costs : CostModel
        Of the database.
    features : FeatureWeights
        k_d, as the visual cost has them.
    """

    model: GuideModel
    eigenvalues: npt.NDArray[np.floating]
    costs: CostModel
    features: FeatureWeights

    @property
    def hears(self) -> bool:
        """Whether the guide wants sound."""
        return bool(self.model.columns[-1] >= N_PHONE_INPUTS)

    def predicted(
        self, track: PhonemeTrack, fps: float, sound: npt.NDArray[np.floating] | Sound | None = None
    ) -> npt.NDArray[np.float32]:
        """Features of the mouths that a sentence is expected to show.

        Parameters
        ----------
        track : PhonemeTrack
        fps : float
            Frame rate of the database.
        sound : Sound or (steps, 26) float, optional
            What is heard, or its `sound_features`; only for a guide that hears.

        Returns
        -------
        (T, G) float32
            In the space of `database.cost_definition.visual_features`.

        Raises
        ------
        SelectionError
            If the guide hears and there is no sound, or it does not fit this program.
        """
        heard: npt.NDArray[np.float32] | None = None
        if self.hears:
            if sound is None:
                raise SelectionError(
                    "target cost 'sound' needs the sound that is spoken; give it (--audio), or "
                    "choose another target cost"
                )
            given = sound_features(sound) if isinstance(sound, Sound) else sound
            heard = np.asarray(given, dtype=np.float32)
        known = N_PHONE_INPUTS + (N_SOUND_INPUTS if self.hears else 0)
        if self.model.columns[-1] >= known:
            raise SelectionError("database: its guide has inputs that this program does not know")
        inputs = guide_inputs(track, frame_times(frame_count(track.end, fps), fps), heard)
        mouths = predict(self.model, inputs)
        return visual_features(mouths, self.eigenvalues, self.costs, self.features)[0]


def guide_scale(
    features: npt.NDArray[np.float32], groups: npt.NDArray[np.int64], seed: int = 0
) -> float:
    """Median of f over random pairs of units, 1 where all are alike."""
    rng = np.random.default_rng(seed)
    first, second = rng.integers(0, len(features), (2, N_PAIRS))
    between = features[first].astype(np.float64) - features[second]
    f = np.sqrt(np.add.reduceat(between**2, groups[:-1], axis=1)).sum(axis=1)
    median = float(np.median(f))
    return median if median > 1e-9 else 1.0


def guided_costs(
    predicted: npt.NDArray[np.float32],
    features: npt.NDArray[np.float32],
    groups: npt.NDArray[np.int64],
    candidates: npt.NDArray[np.int32],
) -> FloatArray:
    """Distance f of each candidate to one predicted mouth, before the scale.

    Parameters
    ----------
    predicted : (G,) float32
    features : (N, G) float32
    groups : (n_groups + 1,) int64
    candidates : (m,) int32

    Returns
    -------
    (m,) float64
    """
    out = np.empty(len(candidates), dtype=np.float64)
    _distances(predicted, features, groups, candidates, out)
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _distances(
    predicted: npt.NDArray[np.float32],
    features: npt.NDArray[np.float32],
    groups: npt.NDArray[np.int64],
    candidates: npt.NDArray[np.int32],
    out: FloatArray,
) -> None:
    for c in range(candidates.size):
        row = features[candidates[c]]
        total = 0.0
        for g in range(groups.size - 1):
            square = np.float32(0.0)
            for k in range(groups[g], groups[g + 1]):
                d = row[k] - predicted[k]
                square += d * d
            total += np.sqrt(np.float64(square))
        out[c] = total
