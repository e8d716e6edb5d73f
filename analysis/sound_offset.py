"""A constant offset between sound and picture, heard and seen: loudness against lip motion.

When a voice grows louder the lips are opening, whoever speaks. The rise and fall of loudness in
the low bands, where vowels are, is compared with that of the mouth's height, a little earlier
and later, and over all clips together one shift stands out. Single clips that are out of step
with the others are another matter (analysis/lag.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from database.errors import CorpusError
from database.sound_features import FEATURE_RATE

FloatArray = npt.NDArray[np.float64]

LOW_BANDS: Final = 8
"""Mel bands that count as loudness: up to about 0.8 kHz. On GRID their changes agree best with
the lips' (0.54 against 0.45 for all bands)."""

LOUDNESS_SMOOTHING: Final = 9
"""Steps of 10 ms, two frames of 25 a second: what lips can follow."""

NATURAL: Final = -0.018
"""Seconds by which loudness follows the lips where sound and picture fit: on GRID's speaker it
leads a little, with a frame taken to show its middle."""

LARGEST_MS: Final = 2000.0
"""Milliseconds of offset that can be asked for."""


@dataclass(frozen=True)
class OffsetSettings:
    """How a constant offset is estimated, and what is done about it.

    Parameters
    ----------
    correct : float or "auto", optional
        Seconds by which the sound comes after the picture, to be taken out; "auto" takes out
        what is estimated, where that is sure; by default it is only reported.
    furthest : float
        Seconds that are tried each way.
    least : float
        Seconds below which nothing is reported or taken out: one speaker's lips lead a little
        more than another's.
    correlation : float
        What loudness and lips must reach at the best shift.
    clear : float
        By how much that must be above every other shift further than `apart` from it.
    apart : float
        Seconds.
    error : float
        Largest standard error of a sure estimate, seconds.
    agreement : float
        Share of resampled sets of clips that must give the same, to within `near`.
    near : float
        Seconds.
    fewest_frames : int
        Frames with face and sound that a clip needs to count.
    fewest_clips : int
    draws : int
        Resampled sets of clips behind the standard error and the agreement.
    """

    correct: float | str | None = None
    furthest: float = 0.5
    least: float = 0.04
    correlation: float = 0.2
    clear: float = 0.1
    apart: float = 0.1
    error: float = 0.02
    agreement: float = 0.9
    near: float = 0.04
    fewest_frames: int = 20
    fewest_clips: int = 5
    draws: int = 200


def read_offset(text: str) -> float | str:
    """What a user asks for: "auto", or milliseconds, given back as seconds.

    Raises
    ------
    CorpusError
        If it is neither, or more than two seconds.
    """
    if text == "auto":
        return text
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= LARGEST_MS:
        raise CorpusError(
            f"expected auto, or milliseconds from -{LARGEST_MS:g} to {LARGEST_MS:g}, got {text!r}"
        )
    return value / 1000


@dataclass(frozen=True)
class SoundOffset:
    """By how much the sound of a corpus comes after its lips.

    Parameters
    ----------
    seconds : float
        Negative where the sound leads.
    error : float
        Standard error over clips, seconds (robust: from the median of deviations).
    agreement : float
        Share of resampled sets of clips that give the same.
    correlation : float
        Mean over clips of the correlation of changes in loudness and in mouth height there.
    rival : float
        The greatest such correlation at a shift further off.
    clips : int
        Clips that were used.
    sure : bool
        Whether it may be believed.
    """

    seconds: float
    error: float
    agreement: float
    correlation: float
    rival: float
    clips: int
    sure: bool

    def as_json(self) -> dict[str, float | int | bool]:
        """The estimate for a report."""
        return {
            "milliseconds": round(1000 * self.seconds, 1),
            "error": round(1000 * self.error, 1),
            "agreement": round(self.agreement, 3),
            "correlation": round(self.correlation, 3),
            "rival": round(self.rival, 3),
            "clips": self.clips,
            "sure": self.sure,
        }


def find_sound_offset(
    frames: Sequence[npt.NDArray[np.int32]],
    heights: Sequence[npt.NDArray[np.floating]],
    sounds: Sequence[npt.NDArray[np.floating]],
    fps: float,
    settings: OffsetSettings | None = None,
) -> SoundOffset | None:
    """Estimate the constant offset of a corpus.

    Parameters
    ----------
    frames : S arrays (n,) int
        Frame numbers with a face, rising.
    heights : S arrays (n,) float
        Mouth heights.
    sounds : S arrays (steps, 26) float
        `database.sound_features.sound_features`; without steps where a clip has no sound.
    fps : float
    settings : OffsetSettings, optional

    Returns
    -------
    SoundOffset or None
        None where fewer than `fewest_clips` clips can be used.
    """
    chosen = settings or OffsetSettings()
    reach = round(chosen.furthest * FEATURE_RATE)
    found = [
        _correlations(numbers, height, sound, fps, reach)
        for numbers, height, sound in zip(frames, heights, sounds, strict=True)
        if len(numbers) >= chosen.fewest_frames and len(sound) > 2 * LOUDNESS_SMOOTHING
    ]
    curves = np.array([c for c in found if c is not None])
    if len(curves) < chosen.fewest_clips:
        return None
    mean = curves.mean(axis=0)
    place = _peak(mean)
    rng = np.random.default_rng(0)
    again = [
        _peak(curves[rng.integers(0, len(curves), len(curves))].mean(axis=0))
        for _ in range(chosen.draws)
    ]
    deviations = np.abs(np.array(again) - place) / FEATURE_RATE
    error = 1.4826 * float(np.median(deviations))
    agreement = float(np.mean(deviations <= chosen.near))
    best = round(place)
    far = np.abs(np.arange(len(mean)) - best) > chosen.apart * FEATURE_RATE
    rival = float(mean[far].max())
    sure = (
        mean[best] >= chosen.correlation
        and mean[best] - rival >= chosen.clear
        and error <= chosen.error
        and agreement >= chosen.agreement
        and 0 < best < len(mean) - 1
    )
    return SoundOffset(
        (place - reach) / FEATURE_RATE - NATURAL,
        error,
        agreement,
        float(mean[best]),
        rival,
        len(curves),
        bool(sure),
    )


def correction(found: SoundOffset | None, settings: OffsetSettings) -> float:
    """Seconds by which the sound is taken to come after the lips; phones move by less that."""
    if settings.correct is None:
        return 0.0
    if settings.correct != "auto":
        return float(settings.correct)
    if found is None or not found.sure or abs(found.seconds) < settings.least:
        return 0.0
    return found.seconds


def offset_note(found: SoundOffset | None, settings: OffsetSettings) -> str | None:
    """What the build's report says of the offset; None where there is nothing to say."""
    applied = correction(found, settings)
    if settings.correct is not None and settings.correct != "auto":
        estimate = "" if found is None else f" (estimated: {_said(found)})"
        return (
            f"sound taken to come {1000 * applied:+.0f} ms after the lips{estimate}; phones moved"
        )
    if found is None or not found.sure:
        if settings.correct is None:
            return None
        why = "too few clips" if found is None else f"best guess: {_said(found)}"
        return f"whether sound and lips are apart cannot be told ({why}); phones left as they are"
    if abs(found.seconds) < settings.least:
        return None
    side = "after" if found.seconds > 0 else "before"
    what = "phones moved" if applied else "--sound-offset auto takes it out"
    return (
        f"sound comes {1000 * abs(found.seconds):.0f} ms {side} the lips ({_said(found)}); {what}"
    )


def _said(found: SoundOffset) -> str:
    return (
        f"{1000 * found.seconds:+.0f} ms, standard error {1000 * found.error:.0f} ms over "
        f"{found.clips} clips"
    )


def _correlations(
    numbers: npt.NDArray[np.int32],
    height: npt.NDArray[np.floating],
    sound: npt.NDArray[np.floating],
    fps: float,
    reach: int,
) -> FloatArray | None:
    """Correlation of changes with the sound -reach .. reach steps later; None without changes."""
    pairs = np.flatnonzero(np.diff(numbers) == 1)
    if len(pairs) < 2:
        return None
    opening = np.diff(np.asarray(height, dtype=np.float64))[pairs]
    between = (np.asarray(numbers, dtype=np.float64)[pairs] + 1.0) / fps
    half = LOUDNESS_SMOOTHING // 2
    loud = np.asarray(sound, dtype=np.float64)[:, :LOW_BANDS].mean(axis=1)
    kernel = np.full(LOUDNESS_SMOOTHING, 1 / LOUDNESS_SMOOTHING)
    loud = np.convolve(np.pad(loud, half, mode="edge"), kernel, mode="valid")
    rise = np.gradient(loud)
    # Beyond the sound's ends nothing changes.
    at = between[None, :] + np.arange(-reach, reach + 1)[:, None] / FEATURE_RATE
    heard = np.interp(at * FEATURE_RATE, np.arange(len(rise)), rise, left=0.0, right=0.0)
    opening = opening - opening.mean()
    heard = heard - heard.mean(axis=1, keepdims=True)
    size = np.sqrt((opening**2).sum() * (heard**2).sum(axis=1))
    if not size.max() > 0:
        return None
    return np.asarray(heard @ opening / np.maximum(size, 1e-3 * size.max()), dtype=np.float64)


def _peak(curve: FloatArray) -> float:
    """Place of the greatest value, between the samples by a parabola."""
    best = int(np.argmax(curve))
    if not 0 < best < len(curve) - 1:
        return float(best)
    low, top, high = curve[best - 1 : best + 2]
    bend = low - 2 * top + high
    return best + (0.5 * float((low - high) / bend) if bend < 0 else 0.0)
