"""Clips whose sound and picture are apart.

A few clips of a corpus lose frames or start their sound late, and all their phones then name
the wrong pictures (in GRID about one clip in thirty is two frames off). What mouths do around a
phoneme is learnt from the other clips; a clip whose lips follow that much better a few frames
earlier or later is moved there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from database.phonemes import N_PHONEMES, SILENCE
from database.track import Interval, PhonemeTrack, context_frames, context_windows

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LagSettings:
    """When a clip is moved.

    Parameters
    ----------
    furthest : float
        Seconds that are tried each way.
    least : float
        Seconds below which nothing is moved: alignment is no surer than that.
    gain : float
        By how much the mean correlation of lips and expectation must grow.
    correlation : float
        What it must reach.
    fewest_clips : int
        Clips from which on the expectation is worth something.
    folds : int
        A clip's expectation is learnt from the other folds' clips.
    """

    furthest: float = 0.16
    least: float = 0.06
    gain: float = 0.25
    correlation: float = 0.5
    fewest_clips: int = 30
    folds: int = 3


def find_lags(
    tracks: Sequence[PhonemeTrack],
    frames: Sequence[npt.NDArray[np.int32]],
    trajectories: Sequence[npt.NDArray[np.floating]],
    fps: float,
    settings: LagSettings | None = None,
) -> list[float]:
    """By how much each clip's lips come after its phones.

    Parameters
    ----------
    tracks : S tracks
    frames : S arrays (n,) int
        Frame numbers with a face.
    trajectories : S arrays (n, d) float
        What is expected of the mouth: height, first PCA weights.
    fps : float
    settings : LagSettings, optional

    Returns
    -------
    list of float
        Seconds for each clip, negative where the lips lead; 0 where the two fit, or there is
        too little to tell.
    """
    chosen = settings or LagSettings()
    if len(tracks) < chosen.fewest_clips:
        return [0.0] * len(tracks)
    sampled = [t.sample(fps, int(f.max()) + 1)[f] for t, f in zip(tracks, frames, strict=True)]
    expected = _expectations(tracks, frames, trajectories, fps, chosen.folds)
    reach = int(chosen.furthest * fps)
    lags = []
    for phonemes, wanted, seen in zip(sampled, expected, trajectories, strict=True):
        r = _correlations(phonemes, wanted, np.asarray(seen, dtype=np.float64), reach)
        best = int(np.argmax(r)) - reach
        sure = r.max() - r[reach] >= chosen.gain and r.max() >= chosen.correlation
        lags.append(best / fps if sure and abs(best) / fps >= chosen.least else 0.0)
    return lags


def moved(track: PhonemeTrack, lag: float, duration: float) -> PhonemeTrack:
    """A track moved by a lag, cut at 0 and at the clip's end, silence where nothing is left."""
    intervals = [
        Interval(max(0.0, i.start + lag), min(duration, i.end + lag), i.label)
        for i in track.intervals()
    ]
    kept = [i for i in intervals if i.end - i.start > 1e-3]
    if kept and kept[-1].end < duration - 1e-3:
        kept.append(Interval(kept[-1].end, duration, "sil"))
    return PhonemeTrack.from_intervals(kept, name=track.name)


def _expectations(
    tracks: Sequence[PhonemeTrack],
    frames: Sequence[npt.NDArray[np.int32]],
    trajectories: Sequence[npt.NDArray[np.floating]],
    fps: float,
    folds: int,
) -> list[FloatArray]:
    """Trajectories as the phonemes around each frame let one expect them, from other clips."""
    from sklearn.linear_model import Ridge  # Slow to load, and only builds need it.

    n = context_frames(fps)
    inputs = []
    for track, numbers in zip(tracks, frames, strict=True):
        context = context_windows(track.sample(fps, int(numbers.max()) + 1), n)[numbers]
        hot = np.zeros((len(context), context.shape[1], N_PHONEMES), np.float32)
        np.put_along_axis(hot, context[..., None].astype(np.int64), 1.0, axis=2)
        inputs.append(hot.reshape(len(context), -1))
    out: list[FloatArray] = [np.zeros((0, 0))] * len(tracks)
    for fold in range(min(folds, len(tracks))):
        others = [i for i in range(len(tracks)) if i % folds != fold]
        model = Ridge(30.0).fit(
            np.concatenate([inputs[i] for i in others]),
            np.concatenate([trajectories[i] for i in others]),
        )
        for i in range(fold, len(tracks), folds):
            out[i] = np.asarray(model.predict(inputs[i]), dtype=np.float64)
    return out


def _correlations(
    phonemes: npt.NDArray[np.uint8], wanted: FloatArray, seen: FloatArray, reach: int
) -> FloatArray:
    """Mean correlation inside speech with what is seen -reach .. reach frames later."""
    spoken = np.flatnonzero(phonemes != SILENCE)
    out = np.zeros(2 * reach + 1)
    if len(spoken) == 0:
        return out
    for k, shift in enumerate(range(-reach, reach + 1)):
        first = max(int(spoken[0]), -shift, 0)
        last = min(int(spoken[-1]) + 1, len(seen) - max(shift, 0))
        if last - first < 5:
            continue
        a, b = wanted[first:last], seen[first + shift : last + shift]
        a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        size = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
        out[k] = float(np.mean((a * b).sum(axis=0) / np.maximum(size, 1e-12)))
    return out
