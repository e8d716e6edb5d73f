"""Phonemes over time, and the relation of frame numbers to time.

The convention, for the whole project: frame ``i`` of a video at ``fps`` frames a second shows
the time ``[i/fps, (i+1)/fps)``; its phoneme is the one at the middle of that span. Beyond the
ends of a track is silence.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from database.errors import TrackError
from database.phonemes import PHONEME_INDEX, PHONEMES, SILENCE

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

SMALL_GAP = 1e-6
"""Seconds: boundaries closer than this are one boundary (rounding in text files)."""

CONTEXT_SECONDS = 0.2
"""Reach of the phoneme context on each side (paper: 10 frames at 50 fps)."""


def frame_times(n_frames: int, fps: float) -> FloatArray:
    """Middles of the first `n_frames` frames, in seconds, shape (n_frames,)."""
    return np.asarray((np.arange(n_frames) + 0.5) / fps, dtype=np.float64)


def frame_count(duration: float, fps: float) -> int:
    """Number of frames that cover `duration` seconds (a last part of half a frame counts)."""
    return max(1, round(duration * fps))


def context_frames(fps: float, seconds: float = CONTEXT_SECONDS) -> int:
    """Frames of context on each side of a frame: 0.2 s, so 10 at 50 fps and 5 at 25."""
    return max(1, round(seconds * fps))


def context_windows(phonemes: npt.NDArray[np.integer], n: int) -> npt.NDArray[np.uint8]:
    """Phonemes around each frame of one sequence.

    Parameters
    ----------
    phonemes : (n_frames,) int
        Phoneme index of each frame.
    n : int
        Frames on each side.

    Returns
    -------
    (n_frames, 2n + 1) uint8
        Row i holds the phonemes of frames i-n .. i+n; silence beyond the ends.
    """
    padded = np.pad(np.asarray(phonemes, dtype=np.uint8), n, constant_values=SILENCE)
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * n + 1).copy()


@dataclass(frozen=True)
class Interval:
    """A labelled span of time in seconds."""

    start: float
    end: float
    label: str


@dataclass(frozen=True)
class PhonemeTrack:
    """Contiguous phonemes, each with a start and an end.

    Parameters
    ----------
    phonemes : (n,) int
        Indexes into `database.phonemes.PHONEMES`.
    boundaries : (n + 1,) float
        Seconds; phoneme i lasts from ``boundaries[i]`` to ``boundaries[i + 1]``.

    Raises
    ------
    TrackError
        If there is no phoneme, a time is not finite or negative, or a boundary does not
        follow the one before it.
    """

    phonemes: IntArray
    boundaries: FloatArray
    name: str = field(default="track", compare=False)

    def __post_init__(self) -> None:
        phonemes = np.array(self.phonemes, dtype=np.int64)
        boundaries = np.array(self.boundaries, dtype=np.float64)
        if phonemes.ndim != 1 or len(phonemes) == 0:
            raise TrackError(f"{self.name}: holds no phoneme")
        if boundaries.shape != (len(phonemes) + 1,):
            raise TrackError(
                f"{self.name}: {len(phonemes)} phonemes need {len(phonemes) + 1} boundaries, "
                f"got {boundaries.size}"
            )
        if phonemes.min() < 0 or phonemes.max() >= len(PHONEMES):
            raise TrackError(f"{self.name}: phoneme indexes must lie in 0..{len(PHONEMES) - 1}")
        if not np.isfinite(boundaries).all() or boundaries[0] < 0:
            raise TrackError(f"{self.name}: times must be finite and not negative")
        steps = np.diff(boundaries)
        if (steps <= 0).any():
            i = int(np.argmax(steps <= 0))
            raise TrackError(
                f"{self.name}: phoneme {i + 1} ({PHONEMES[phonemes[i]]}) ends at "
                f"{boundaries[i + 1]:g} s, not after its start at {boundaries[i]:g} s"
            )
        phonemes.setflags(write=False)
        boundaries.setflags(write=False)
        object.__setattr__(self, "phonemes", phonemes)
        object.__setattr__(self, "boundaries", boundaries)

    @classmethod
    def from_intervals(cls, intervals: Iterable[Interval], *, name: str = "track") -> PhonemeTrack:
        """Build a track from intervals whose labels are names of Table 1, in order.

        Gaps, and the time before the first interval, become silence. Overlap, disorder and
        lengths of zero or less raise.

        Raises
        ------
        TrackError
            Naming the interval and both times.
        """
        phonemes: list[int] = []
        bounds: list[float] = [0.0]
        for i, it in enumerate(intervals, 1):
            where = f"{name}: interval {i} ({it.label!r}, {it.start:g} to {it.end:g} s)"
            if not (np.isfinite(it.start) and np.isfinite(it.end)) or it.start < 0:
                raise TrackError(f"{where}: times must be finite and not negative")
            if it.label not in PHONEME_INDEX:
                raise TrackError(f"{where}: {it.label!r} is not a phoneme of Table 1")
            if it.end - it.start <= SMALL_GAP:
                raise TrackError(f"{where}: has no length")
            if it.start < bounds[-1] - SMALL_GAP:
                raise TrackError(
                    f"{where}: starts before the end of the one before it, {bounds[-1]:g} s"
                )
            if it.start > bounds[-1] + SMALL_GAP:
                phonemes.append(SILENCE)
                bounds.append(it.start)
            phonemes.append(PHONEME_INDEX[it.label])
            bounds.append(it.end)
        if not phonemes:
            raise TrackError(f"{name}: holds no phoneme")
        return cls(np.array(phonemes), np.array(bounds), name)

    @property
    def start(self) -> float:
        """Start of the first phoneme, seconds."""
        return float(self.boundaries[0])

    @property
    def end(self) -> float:
        """End of the last phoneme, seconds; a video of the track lasts from 0 to here."""
        return float(self.boundaries[-1])

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the phonemes."""
        return tuple(PHONEMES[p] for p in self.phonemes)

    def intervals(self) -> list[Interval]:
        """The phonemes as labelled spans."""
        b = self.boundaries
        return [
            Interval(float(b[i]), float(b[i + 1]), label) for i, label in enumerate(self.labels)
        ]

    def at(self, times: Sequence[float] | FloatArray) -> IntArray:
        """Phoneme index at each time in seconds, shape of `times`; silence outside."""
        t = np.asarray(times, dtype=np.float64)
        place = np.searchsorted(self.boundaries, t, side="right") - 1
        inside = (place >= 0) & (place < len(self.phonemes))
        out = self.phonemes[np.clip(place, 0, len(self.phonemes) - 1)]
        return np.where(inside, out, SILENCE)

    def sample(self, fps: float, n_frames: int | None = None) -> npt.NDArray[np.uint8]:
        """Phoneme index of each frame at a frame rate.

        Parameters
        ----------
        fps : float
            Frames a second.
        n_frames : int, optional
            Number of frames; by default as many as the track is long.

        Returns
        -------
        (n_frames,) uint8
        """
        if not (np.isfinite(fps) and fps > 0):
            raise TrackError(f"{self.name}: frame rate must be positive, got {fps!r}")
        n = frame_count(self.end, fps) if n_frames is None else n_frames
        return self.at(frame_times(n, fps)).astype(np.uint8)

    def silences(self, shortest: float) -> list[tuple[float, float]]:
        """Start and end, in seconds, of each silence of a length or more.

        Phones of silence in a row are one silence.
        """
        silent = self.phonemes == SILENCE
        firsts = np.concatenate([[0], np.flatnonzero(np.diff(silent)) + 1])
        bounds = self.boundaries[np.concatenate([firsts, [len(silent)]])]
        return [
            (float(a), float(b))
            for i, a, b in zip(firsts, bounds[:-1], bounds[1:], strict=True)
            if silent[i] and b - a >= shortest - 1e-9
        ]

    def speech_span(self) -> tuple[float, float]:
        """Start of the first and end of the last phoneme that is not silence, seconds.

        The whole track where all is silence.
        """
        spoken = np.flatnonzero(self.phonemes != SILENCE)
        if len(spoken) == 0:
            return self.start, self.end
        return float(self.boundaries[spoken[0]]), float(self.boundaries[spoken[-1] + 1])
