"""What a sound says of the mouth: a mel spectrum in short steps of time.

Loudness of 26 bands on the mel scale, 100 times a second (step k is centred at k / 100 s of the
picture's time), as logarithms, relative to each band's mean and spread over the whole file: so
neither the microphone nor the voice's timbre decides, and another speaker's sound may guide too.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from database.sound import SPEECH_RATE, Sound

F32 = npt.NDArray[np.float32]

FEATURE_RATE: Final = 100
"""Steps a second."""

BANDS: Final = 26
WINDOW: Final = 512
"""Samples at 16 kHz: 32 ms."""

LOWEST, HIGHEST = 60.0, 7600.0
PRE_EMPHASIS: Final = 0.97
FLOOR: Final = 1e-8
"""Added to the power before the logarithm: digital silence has none."""


def sound_features(sound: Sound) -> F32:
    """Describe a sound.

    Parameters
    ----------
    sound : Sound
        At 16 000 samples a second (`database.sound.read_sound` gives it so).

    Returns
    -------
    (steps, 26) float32
        Of mean 0 and spread 1 in each band.

    Raises
    ------
    ValueError
        If the sound has another rate.
    """
    if sound.rate != SPEECH_RATE:
        raise ValueError(f"sound features are taken at {SPEECH_RATE} samples a second")
    hop = SPEECH_RATE // FEATURE_RATE
    samples = np.asarray(sound.samples, dtype=np.float32)
    samples = np.append(samples[:1], samples[1:] - np.float32(PRE_EMPHASIS) * samples[:-1])
    steps = len(samples) // hop + 1
    padded = np.pad(samples, (WINDOW // 2, WINDOW))
    frames = np.lib.stride_tricks.sliding_window_view(padded, WINDOW)[: steps * hop : hop]
    power = np.abs(np.fft.rfft(frames * np.hamming(WINDOW).astype(np.float32), axis=1)) ** 2
    mel = np.log(power @ _filters().T + FLOOR)
    spread = mel.std(axis=0) + 1e-3
    return np.asarray((mel - mel.mean(axis=0)) / spread, dtype=np.float32)


def band_centres() -> npt.NDArray[np.float64]:
    """Frequencies of the 26 bands' middles, hertz."""
    return _edges()[1:-1]


def moved_features(features: npt.NDArray[Any], seconds: float) -> npt.NDArray[Any]:
    """Features that come later by some seconds (earlier below 0); the ends repeat."""
    place = np.arange(len(features)) - round(seconds * FEATURE_RATE)
    return np.asarray(features[np.clip(place, 0, len(features) - 1)]) if len(features) else features


def around(
    features: npt.NDArray[np.floating], times: npt.NDArray[np.floating], n: int, step: float
) -> F32:
    """Means of the features in bins around some times.

    Parameters
    ----------
    features : (steps, B) float
    times : (m,) float
        Seconds.
    n : int
        Bins on each side.
    step : float
        Width of a bin, seconds.

    Returns
    -------
    (m, (2n + 1) B) float32
        Bins in order of time; beyond the ends the first and the last step.
    """
    width = max(1, round(step * FEATURE_RATE))
    middles = np.asarray(times)[:, None] + np.arange(-n, n + 1) * step
    first = np.round((middles - step / 2) * FEATURE_RATE).astype(np.int64)
    sums = np.zeros((len(times), 2 * n + 1, features.shape[1]), dtype=np.float32)
    for k in range(width):
        sums += features[np.clip(first + k, 0, len(features) - 1)]
    return (sums / np.float32(width)).reshape(len(times), -1)


def _filters() -> npt.NDArray[np.float64]:
    """Triangular filters, evenly spaced on the mel scale, (BANDS, WINDOW // 2 + 1)."""
    hertz = _edges()
    bins = np.arange(WINDOW // 2 + 1) * (SPEECH_RATE / WINDOW)
    rise = (bins - hertz[:-2, None]) / (hertz[1:-1] - hertz[:-2])[:, None]
    fall = (hertz[2:, None] - bins) / (hertz[2:] - hertz[1:-1])[:, None]
    return np.asarray(np.clip(np.minimum(rise, fall), 0.0, None))


def _edges() -> npt.NDArray[np.float64]:
    mel = 2595 * np.log10(1 + np.array([LOWEST, HIGHEST]) / 700)
    edges = 700 * (10 ** (np.linspace(mel[0], mel[1], BANDS + 2) / 2595) - 1)
    return np.asarray(edges, dtype=np.float64)
