"""Measures of a mouth's picture, of sound, and of lips that follow phones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import uniform_filter1d

from database.errors import RenderError
from database.mask import OUTER_LIPS
from database.phonemes import N_PHONEMES, SILENCE
from database.sound import Sound
from unitsel.doctor.facts import SoundFacts

Picture = npt.NDArray[np.uint8]
FloatArray = npt.NDArray[np.float64]

BLACK: Final = 4
WHITE: Final = 251
"""Grey levels up to and from which a pixel counts as clipped."""

MOUTH_CORNERS: Final = (61, 291)
"""Mesh points of the corners of the mouth."""

MARGIN: Final = 0.35
"""Of a mouth's width, added around its lips."""

SHORTEST_PHONE: Final = 0.0305
"""Seconds: three hundredths, the aligner's shortest, and rounding."""

SOUND_STEP: Final = 0.02
"""Seconds over which loudness is measured."""

EXPECTED_SMOOTHING: Final = 0.12
"""Seconds over which expected mouths are smoothed: lips do not leap from phone to phone."""

FEWEST_FRAMES: Final = 10
"""Frames of speech below which a correlation tells nothing."""


def sharpness(mouth: Picture) -> float:
    """Variance of the Laplacian in relation to that of the grey levels.

    The division takes contrast and light out of it; what is left falls with blur. It depends on
    how large the mouth is in pixels, so compare it inside one corpus only.

    Parameters
    ----------
    mouth : (h, w, 3) uint8
    """
    grey = cv2.cvtColor(mouth, cv2.COLOR_RGB2GRAY).astype(np.float32)
    spread = float(grey.var())
    return float(cv2.Laplacian(grey, cv2.CV_32F).var()) / spread if spread > 1.0 else 0.0


def clipped_share(mouth: Picture) -> float:
    """Share of pixels whose channels are all black, or all white, to the end of the scale."""
    low, high = mouth.max(axis=2) <= BLACK, mouth.min(axis=2) >= WHITE
    return float((low | high).mean())


def mouth_width(points: npt.NDArray[np.floating]) -> float:
    """Distance of the corners of the mouth in pixels, of a face mesh (468, 2)."""
    return float(np.linalg.norm(points[MOUTH_CORNERS[1], :2] - points[MOUTH_CORNERS[0], :2]))


def mouth_box(frame: Picture, points: npt.NDArray[np.floating]) -> Picture:
    """The part of a frame around the lips; empty where they lie outside of it."""
    lips = points[list(OUTER_LIPS), :2]
    margin = MARGIN * float(np.ptp(lips[:, 0]))
    low = np.floor(lips.min(axis=0) - margin).astype(int).clip(0)
    high = np.ceil(lips.max(axis=0) + margin).astype(int) + 1
    return frame[low[1] : max(high[1], 0), low[0] : max(high[0], 0)]


def drift(brightness: Sequence[float]) -> float:
    """Greatest less least mean brightness of a clip's thirds, in parts of their mean."""
    if len(brightness) < 3:
        return 0.0
    thirds = [float(np.mean(part)) for part in np.array_split(np.array(brightness), 3)]
    return (max(thirds) - min(thirds)) / max(float(np.mean(thirds)), 1.0)


def small_jpeg(picture: Picture, width: int = 150) -> bytes:
    """A picture as a small JPEG."""
    height, own = picture.shape[:2]
    if own > width:
        size = (width, max(1, round(height * width / own)))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    done, data = cv2.imencode(
        ".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), (cv2.IMWRITE_JPEG_QUALITY, 75)
    )
    if not done:
        raise RenderError(f"a picture of {picture.shape} cannot be made a JPEG")
    return bytes(data.tobytes())


def sound_facts(sound: Sound) -> SoundFacts | None:
    """Loudness of speech (95th percentile over steps), of noise (10th), and clipping.

    Returns
    -------
    SoundFacts or None
        None for less than a tenth of a second.
    """
    samples = np.nan_to_num(sound.samples.astype(np.float64))
    step = round(SOUND_STEP * sound.rate)
    n = len(samples) // step
    if n < 5:
        return None
    power = (samples[: n * step].reshape(n, step) ** 2).mean(axis=1)
    quiet, loud = np.percentile(10 * np.log10(np.maximum(power, 1e-10)), [10, 95])
    return SoundFacts(float(loud), float(loud - quiet), float((np.abs(samples) >= 0.999).mean()))


def short_share(starts: FloatArray, ends: FloatArray, phonemes: npt.NDArray[np.integer]) -> float:
    """Share of phones, silence left out, that are as short as the aligner makes them."""
    spoken = phonemes != SILENCE
    if not spoken.any():
        return 0.0
    return float(((ends - starts)[spoken] <= SHORTEST_PHONE).mean())


def lip_agreements(
    values: npt.NDArray[np.floating],
    phoneme: npt.NDArray[np.integer],
    clip: npt.NDArray[np.integer],
    clips: int,
    fps: float,
) -> list[float | None]:
    """How well the lips of each clip follow its phones.

    What is expected of a frame is the mean over the same phoneme's frames in all other clips,
    smoothed over time.

    Parameters
    ----------
    values : (N, d) float
        What is seen: mouth height, first PCA weight.
    phoneme, clip : (N,) int
        Of each frame; frames of a clip stand together.
    clips : int
    fps : float

    Returns
    -------
    list of float or None
        For each clip the mean over the d values of the correlation inside speech; None where
        there is too little speech.
    """
    seen = np.asarray(values, dtype=np.float64)
    d = seen.shape[1]
    sums, counts = np.zeros((N_PHONEMES, d)), np.zeros(N_PHONEMES)
    np.add.at(sums, phoneme, seen)
    np.add.at(counts, phoneme, 1)
    everywhere = seen.mean(axis=0) if len(seen) else np.zeros(d)
    span = max(1, round(EXPECTED_SMOOTHING * fps))
    out: list[float | None] = []
    for c in range(clips):
        own = np.flatnonzero(clip == c)
        said, mine = phoneme[own], seen[own]
        spoken = said != SILENCE
        if spoken.sum() < FEWEST_FRAMES:
            out.append(None)
            continue
        own_sums, own_counts = np.zeros_like(sums), np.zeros_like(counts)
        np.add.at(own_sums, said, mine)
        np.add.at(own_counts, said, 1)
        left = (counts - own_counts)[:, None]
        means = np.where(left > 0, (sums - own_sums) / np.maximum(left, 1), everywhere)
        expected = uniform_filter1d(means[said], span, axis=0, mode="nearest")[spoken]
        a, b = expected - expected.mean(axis=0), mine[spoken] - mine[spoken].mean(axis=0)
        size = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
        out.append(float(np.mean((a * b).sum(axis=0) / np.maximum(size, 1e-12))))
    return out
