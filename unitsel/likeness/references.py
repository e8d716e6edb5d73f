"""What selections are compared with: chance, means, the best unit, and the guide alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from database.guide_model import PredictedMouths, guide_inputs, predict
from database.phonemes import N_PHONEMES
from database.schema import GuideModel
from database.track import PhonemeTrack, frame_count, frame_times

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

SMOOTHING_SECONDS: Final = 0.12
"""Span over which the phoneme means are smoothed: three frames at 25 fps."""

RANDOM_SEED: Final = 0

BLOCK: Final = 256
"""Frames whose distances to all units are held at a time."""


def random_units(candidates: Sequence[npt.NDArray[np.integer]]) -> IntArray:
    """A random candidate of each frame, so of the right viseme; the same ones every time."""
    rng = np.random.default_rng(RANDOM_SEED)
    return np.array([rng.choice(c) for c in candidates], dtype=np.int64)


def phoneme_means(values: npt.NDArray[np.floating], phoneme: npt.NDArray[np.uint8]) -> FloatArray:
    """Mean of each phoneme's frames; phonemes without any get the mean of all.

    Parameters
    ----------
    values : (N, m) float
    phoneme : (N,) uint8

    Returns
    -------
    (43, m) float64
    """
    out = np.tile(values.mean(axis=0, dtype=np.float64), (N_PHONEMES, 1))
    for p in np.unique(phoneme):
        out[p] = values[phoneme == p].mean(axis=0, dtype=np.float64)
    return out


def smoothed_means(means: FloatArray, phonemes: npt.NDArray[np.uint8], fps: float) -> FloatArray:
    """Mean of each frame's phoneme, smoothed over time: no selection at all.

    Parameters
    ----------
    means : (43, m) float64
        Of `phoneme_means`.
    phonemes : (T,) uint8
    fps : float
        Frames a second.

    Returns
    -------
    (T, m) float64
    """
    span = max(1, round(SMOOTHING_SECONDS * fps))
    smooth: FloatArray = uniform_filter1d(means[phonemes], span, axis=0, mode="nearest")
    return smooth


def nearest_units(
    pca: npt.NDArray[np.floating], wanted: npt.NDArray[np.floating], units: IntArray
) -> IntArray:
    """For each recorded frame the unit whose texture is nearest to its own.

    Parameters
    ----------
    pca : (N, K) float
        PCA weights of all units.
    wanted : (n, K) float
        Those of the recorded frames.
    units : (m,) int64
        Units that may be used.

    Returns
    -------
    (n,) int64
        Of any viseme and at no cost: the best that the database could do.
    """
    there = pca[units].astype(np.float64)
    squares = (there**2).sum(axis=1)
    found = np.empty(len(wanted), dtype=np.int64)
    for first in range(0, len(wanted), BLOCK):
        block = wanted[first : first + BLOCK].astype(np.float64)
        found[first : first + BLOCK] = np.argmin(squares - 2 * block @ there.T, axis=1)
    return units[found]


def predicted_mouths(
    guide: GuideModel,
    track: PhonemeTrack,
    fps: float,
    sound: npt.NDArray[np.floating] | None = None,
) -> PredictedMouths:
    """What a guide expects of a sentence, frame by frame: a trajectory without pictures.

    Parameters
    ----------
    guide : GuideModel
    track : PhonemeTrack
    fps : float
        Frames a second.
    sound : (steps, 26) float, optional
        `database.sound_features.sound_features`, for a guide that hears.
    """
    times = frame_times(frame_count(track.end, fps), fps)
    heard = None if sound is None else np.asarray(sound, dtype=np.float32)
    return predict(guide, guide_inputs(track, times, heard))
