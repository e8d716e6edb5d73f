"""Figures of a selected path, and its likeness to the real sentence.

The first three are equations 12 to 15 of Liu and Ostermann 2009, the correlation is 16. All are
pure functions of arrays over the frames of one sentence, at the database's rate.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError
from database.track import PhonemeTrack, frame_times

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def joins(sequence: npt.NDArray[np.integer], frame: npt.NDArray[np.integer]) -> BoolArray:
    """Where one recorded segment ends and another begins.

    Parameters
    ----------
    sequence, frame : (N,) int
        Sequence and recorded frame number of the unit of each frame.

    Returns
    -------
    (N - 1,) bool
        True at i where frame i + 1 is not the recorded successor of frame i.
    """
    _same_length(sequence, frame)
    natural = (np.diff(sequence) == 0) & (np.diff(np.asarray(frame, dtype=np.int64)) == 1)
    return np.asarray(~natural, dtype=np.bool_)


def segment_lengths(
    sequence: npt.NDArray[np.integer], frame: npt.NDArray[np.integer]
) -> npt.NDArray[np.int64]:
    """Length of each recorded segment of a path, in frames, shape (L,)."""
    ends = np.flatnonzero(joins(sequence, frame)) + 1
    return np.diff(np.concatenate([[0], ends, [len(sequence)]])).astype(np.int64)


def tc_avg(target: npt.NDArray[np.floating]) -> float:
    """Average target cost (equation 12) of a path's target costs, (N,)."""
    _same_length(target)
    return float(np.mean(target))


def sl_avg(sequence: npt.NDArray[np.integer], frame: npt.NDArray[np.integer]) -> float:
    """Average segment length in frames (equation 13).

    Parameters
    ----------
    sequence, frame : (N,) int
        Sequence and recorded frame number of the unit of each frame.
    """
    return float(np.mean(segment_lengths(sequence, frame)))


def vc_avg(
    pca: npt.NDArray[np.floating],
    sequence: npt.NDArray[np.integer],
    frame: npt.NDArray[np.integer],
) -> float:
    """Average visual difference at the joins (equations 14 and 15), 0 for a single frame.

    Parameters
    ----------
    pca : (N, K) float
        PCA weights of the unit of each frame.
    sequence, frame : (N,) int
        Sequence and recorded frame number of the unit of each frame.

    Returns
    -------
    float
        Sum of the distances over the joins, divided by N - 1; in the unit of `pca`.
    """
    _same_length(pca, sequence, frame)
    if len(pca) < 2:
        return 0.0
    steps = np.linalg.norm(np.diff(np.asarray(pca, dtype=np.float64), axis=0), axis=1)
    return float(steps[joins(sequence, frame)].sum() / (len(pca) - 1))


def speech_frames(track: PhonemeTrack, fps: float, n_frames: int) -> BoolArray:
    """Frames inside speech: from the first to the last phoneme that is not silence.

    Parameters
    ----------
    track : PhonemeTrack
    fps : float
        Frames a second.
    n_frames : int
        Number of frames.

    Returns
    -------
    (n_frames,) bool
        True where the frame's middle lies inside; all true where the track is only silence.
    """
    if not (np.isfinite(fps) and fps > 0):
        raise SelectionError(f"measures: frame rate must be positive, got {fps!r}")
    start, end = track.speech_span()
    times = frame_times(n_frames, fps)
    inside = (times >= start) & (times < end)
    # Speech shorter than a frame, or all of it after the last frame, is not measurable.
    return inside if inside.any() else np.ones(n_frames, dtype=np.bool_)


def correlation(
    animated: npt.NDArray[np.floating],
    real: npt.NDArray[np.floating],
    inside: BoolArray | None = None,
) -> float:
    """Pearson correlation of two trajectories (equation 16); 0 where one is constant.

    Parameters
    ----------
    animated, real : (N,) float
        The same parameter of the selected and of the recorded frames.
    inside : (N,) bool, optional
        The frames to look at (`speech_frames`); all by default.

    Returns
    -------
    float
        From -1 to 1.
    """
    a, b = _trajectories(animated, real, inside)
    if _constant(a) or _constant(b):
        return 0.0
    a = a - a.mean()
    b = b - b.mean()
    r = float(a @ b / np.sqrt((a @ a) * (b @ b)))
    return min(1.0, max(-1.0, r))


def sd_ratio(
    animated: npt.NDArray[np.floating],
    real: npt.NDArray[np.floating],
    inside: BoolArray | None = None,
) -> float:
    """Compare how much two trajectories move: the ratio of their standard deviations.

    The animated one's over the real one's: 1 is as much motion as in the recording, a smoothed
    mean moves too little. 0 where the real one does not move: nothing to compare with.

    Parameters
    ----------
    animated, real : (N,) float
        The same parameter of the selected and of the recorded frames.
    inside : (N,) bool, optional
        The frames to look at (`speech_frames`); all by default.
    """
    a, b = _trajectories(animated, real, inside)
    return 0.0 if _constant(b) else float(a.std() / b.std())


def _trajectories(
    animated: npt.NDArray[np.floating], real: npt.NDArray[np.floating], inside: BoolArray | None
) -> tuple[FloatArray, FloatArray]:
    """Pick the frames to compare, as float64."""
    if inside is None:
        inside = np.ones(len(animated), dtype=np.bool_)
    _same_length(animated, real, inside)
    a = np.asarray(animated, dtype=np.float64)[inside]
    b = np.asarray(real, dtype=np.float64)[inside]
    if not (np.isfinite(a).all() and np.isfinite(b).all()):
        raise SelectionError("measures: a trajectory is not finite")
    return a, b


def _constant(x: FloatArray) -> bool:
    """Whether a trajectory does not move, but for rounding."""
    return x.size < 2 or float(np.ptp(x)) <= 1e-9 * float(np.abs(x).max())


def _same_length(*arrays: npt.NDArray[np.generic]) -> None:
    """Raise `SelectionError` unless all have one frame or more, and equally many."""
    lengths = [len(a) for a in arrays]
    if min(lengths) == 0 or len(set(lengths)) != 1:
        raise SelectionError(
            f"measures: need arrays of the same number of frames, at least 1, got {lengths}"
        )
