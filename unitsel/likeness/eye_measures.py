"""What the eye punishes: missed closures, lips that move in silence, jumps at joins.

The paper's measures (measures.py) are averages; a viewer sees the one wrong frame. All
are pure functions of arrays over the frames of one sentence, at the database's rate; frames
without a face are left out, so each frame comes with its number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError
from database.mask import INNER_LIPS, OUTER_EYE_CORNERS
from database.phonemes import CLOSURES
from database.track import PhonemeTrack
from unitsel.likeness.measures import joins

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.integer]
BoolArray = npt.NDArray[np.bool_]

CLOSED_SHARE: Final = 0.25
"""Lips are closed up to this share of the way from their rest to wide open. The mesh never shows
an opening of 0: on GRID (a mouth of 41 pixels) it reads 0.013 at rest, 0.022 in p, b and m, and
0.035 to 0.06 in other speech, in parts of the distance between the eyes' outer corners."""

WIDE_OPEN: Final = 95.0
"""Percentile of the openings in speech that counts as wide open."""

CLOSURE_SECONDS: Final = 0.08
"""Shortest time, two frames at 25 a second, that counts as a closure: the mesh's opening is
noisy, and the eye does not take a flicker of one frame for a closure. Measured on 412 p, b and m
of GRID: recordings 0.93, units of random visemes 0.55; with one frame they had 0.95 and 0.85."""

LONG_SILENCE: Final = 0.2
"""Seconds from which on a silence is looked at."""

NATURAL: Final = 95.0
"""Percentile of the natural steps that a jump is compared with."""

_FACING: Final = tuple((INNER_LIPS[i], INNER_LIPS[-i]) for i in range(1, len(INNER_LIPS) // 2))
"""Points of the inner contour that face each other, upper and lower."""


@dataclass(frozen=True)
class SilenceMotion:
    """How much a mouth moves while nothing is said.

    Parameters
    ----------
    sd : float
        Standard deviation of the mouth height, each silence about its own mean.
    step : float
        Mean absolute change from one frame to the next.
    """

    sd: float
    step: float


def lip_opening(landmarks: npt.NDArray[np.floating]) -> FloatArray:
    """Opening of the lips straight from the raw face mesh.

    Like `analysis.lips.mesh_mouth_height`, a ruler that analysis does not move.

    Parameters
    ----------
    landmarks : (n, 468, 2) float

    Returns
    -------
    (n,) float64
        Greatest distance across the eye line between facing points of the inner contour, in
        parts of the distance between the outer eye corners; below 0 where all overlap.
    """
    points = np.asarray(landmarks, dtype=np.float64)
    left, right = OUTER_EYE_CORNERS
    eyes = points[:, right] - points[:, left]
    squared = (eyes**2).sum(axis=1)
    upper, lower = (points[:, [pair[k] for pair in _FACING]] for k in (0, 1))
    down = np.stack([-eyes[:, 1], eyes[:, 0]], axis=1)
    gaps = np.einsum("npk,nk->np", lower - upper, down)
    return np.asarray(gaps.max(axis=1) / squared, dtype=np.float64)


def closure_threshold(rest: npt.NDArray[np.floating], speech: npt.NDArray[np.floating]) -> float:
    """Opening up to which a person's lips count as closed.

    Parameters
    ----------
    rest : (n,) float
        Openings in the person's rest frames (amid silence).
    speech : (m,) float
        Openings in speech.

    Returns
    -------
    float
        `CLOSED_SHARE` of the way from the median at rest to the opening in speech that 95 % do
        not exceed. A person who was never recorded at rest has the narrowest 5 % of speech for it.

    Raises
    ------
    SelectionError
        If there is no speech, or a value is not finite.
    """
    if len(speech) == 0 or not (np.isfinite(rest).all() and np.isfinite(speech).all()):
        raise SelectionError("measures: closures need finite lip openings, some of them in speech")
    wide = float(np.percentile(speech, WIDE_OPEN))
    still = float(np.median(rest)) if len(rest) else float(np.percentile(speech, 100 - WIDE_OPEN))
    return still + CLOSED_SHARE * (wide - still)


def closed_frames(
    opening: npt.NDArray[np.floating], frames: IntArray, threshold: float, fps: float
) -> BoolArray:
    """Frames in which the lips are closed.

    Parameters
    ----------
    opening : (n,) float
        Of `lip_opening`.
    frames : (n,) int
        Frame numbers, rising.
    threshold : float
        Of `closure_threshold`.
    fps : float
        Frames a second.

    Returns
    -------
    (n,) bool
        True where the opening is at most the threshold, and so it is in all frames of a stretch
        of `CLOSURE_SECONDS` or more that this one belongs to.
    """
    _fitting(opening, frames, fps)
    low = np.asarray(opening) <= threshold
    # A stretch ends where the state changes or a frame is missing.
    edges = np.flatnonzero((np.diff(low) != 0) | (np.diff(frames) != 1)) + 1
    bounds = np.concatenate([[0], edges, [len(low)]])
    lengths = np.diff(bounds)
    shortest = max(1, round(CLOSURE_SECONDS * fps))
    return np.asarray(low & np.repeat(lengths >= shortest, lengths), dtype=np.bool_)


def closure_hit_rate(
    closed: BoolArray, frames: IntArray, track: PhonemeTrack, fps: float
) -> float | None:
    """Share of the p, b and m of a sentence in which the lips are closed at the right time.

    Parameters
    ----------
    closed : (n,) bool
        Of `closed_frames`.
    frames : (n,) int
        Frame numbers, rising.
    track : PhonemeTrack
        What is said.
    fps : float
        Frames a second.

    Returns
    -------
    float or None
        A phone is hit if the lips are closed in one of its frames, or in the frame before the
        first or after the last of them. Phones of which no such frame was seen do not count;
        None where there is no phone to count.
    """
    _fitting(closed, frames, fps)
    times = (np.asarray(frames) + 0.5) / fps
    hits = []
    for i in np.flatnonzero(np.isin(track.phonemes, list(CLOSURES))):
        start, end = track.boundaries[i] - 1 / fps, track.boundaries[i + 1] + 1 / fps
        # Middles of frames may fall on a boundary: rounding must not decide.
        near = (times >= start - 1e-9) & (times < end - 1e-9)
        if near.any():
            hits.append(bool(closed[near].any()))
    return float(np.mean(hits)) if hits else None


def silence_motion(
    height: npt.NDArray[np.floating], frames: IntArray, track: PhonemeTrack, fps: float
) -> SilenceMotion | None:
    """Movement of the lips in silences of `LONG_SILENCE` or more.

    Parameters
    ----------
    height : (n,) float
        Mouth height.
    frames : (n,) int
        Frame numbers, rising.
    track : PhonemeTrack
        What is said; phones of silence in a row are one silence.
    fps : float
        Frames a second.

    Returns
    -------
    SilenceMotion or None
        In the unit of `height`; None where no such silence has two frames in a row.
    """
    _fitting(height, frames, fps)
    values = np.asarray(height, dtype=np.float64)
    times = (np.asarray(frames) + 0.5) / fps
    deviations: list[FloatArray] = []
    steps: list[FloatArray] = []
    for start, end in track.silences(LONG_SILENCE):
        inside = np.flatnonzero((times >= start - 1e-9) & (times < end - 1e-9))
        if len(inside) >= 2:
            here = values[inside]
            deviations.append(here - here.mean())
            steps.append(np.abs(np.diff(here))[np.diff(np.asarray(frames)[inside]) == 1])
    if sum(map(len, steps)) == 0:
        return None
    pooled = np.concatenate(deviations)
    return SilenceMotion(float(np.sqrt(np.mean(pooled**2))), float(np.concatenate(steps).mean()))


def natural_step(pca: npt.NDArray[np.floating], sequence: IntArray, frame: IntArray) -> float:
    """Size of a great natural step: the 95th percentile of all from one frame to the next.

    Parameters
    ----------
    pca : (N, K) float
        PCA weights of a database's units.
    sequence, frame : (N,) int
        Where each was recorded.

    Returns
    -------
    float
        In the unit of `pca`; 0 where no two units follow each other.
    """
    natural = ~joins(sequence, frame)
    steps = _steps(pca)[natural]
    return float(np.percentile(steps, NATURAL)) if len(steps) else 0.0


def greatest_join_jump(
    pca: npt.NDArray[np.floating], sequence: IntArray, frame: IntArray, natural: float
) -> float:
    """Greatest jump at a join, in relation to natural motion from frame to frame.

    Parameters
    ----------
    pca : (N, K) float
        PCA weights of the unit of each frame.
    sequence, frame : (N,) int
        Sequence and recorded frame number of the unit of each frame.
    natural : float
        Of `natural_step`, above 0.

    Returns
    -------
    float
        Greatest ``||PCA_i - PCA_{i+1}||_2`` over the joins, divided by `natural`; 0 without a
        join. Up to 1 a jump is no greater than what the mouth does anyway.
    """
    if not (np.isfinite(natural) and natural > 0):
        raise SelectionError(f"measures: the natural step must be above 0, got {natural!r}")
    jumps = _steps(pca)[joins(sequence, frame)]
    return float(jumps.max() / natural) if len(jumps) else 0.0


def _steps(pca: npt.NDArray[np.floating]) -> FloatArray:
    steps: FloatArray = np.linalg.norm(np.diff(np.asarray(pca, np.float64), axis=0), axis=1)
    return steps


def _fitting(values: npt.NDArray[np.generic], frames: IntArray, fps: float) -> None:
    if len(values) != len(frames) or len(values) == 0:
        raise SelectionError(
            f"measures: {len(values)} values do not fit {len(frames)} frames, at least 1"
        )
    if not (np.isfinite(fps) and fps > 0):
        raise SelectionError(f"measures: frame rate must be positive, got {fps!r}")
