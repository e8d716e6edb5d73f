"""The mel spectrum that a guide hears."""

from __future__ import annotations

import numpy as np
import pytest

from database.sound import SPEECH_RATE, Sound
from database.sound_features import BANDS, FEATURE_RATE, around, moved_features, sound_features


def tone(hertz: float, seconds: float = 0.5, size: float = 0.3) -> np.ndarray:
    t = np.arange(round(seconds * SPEECH_RATE)) / SPEECH_RATE
    return (size * np.sin(2 * np.pi * hertz * t)).astype(np.float32)


def silence(seconds: float = 0.5) -> np.ndarray:
    return np.zeros(round(seconds * SPEECH_RATE), np.float32)


def heard(*parts: np.ndarray) -> np.ndarray:
    return sound_features(Sound(np.concatenate(parts), SPEECH_RATE))


def test_steps_and_spread() -> None:
    features = heard(silence(), tone(500), silence())
    assert features.shape == (round(1.5 * FEATURE_RATE) + 1, BANDS)
    assert features.dtype == np.float32 and np.isfinite(features).all()
    assert np.allclose(features.mean(axis=0), 0, atol=1e-3)


def test_a_tone_is_heard_when_it_sounds() -> None:
    features = heard(silence(), tone(500), silence())
    loud = features.mean(axis=1)
    on = np.flatnonzero(loud > (loud.min() + loud.max()) / 2)
    # Half a second from 0.5 s on, to within a window.
    assert abs(on[0] - 50) <= 2 and abs(on[-1] - 100) <= 2


def test_pitch_is_told_by_its_band() -> None:
    features = heard(silence(), tone(300), tone(4000))
    low, high = features[60:95].mean(axis=0), features[110:145].mean(axis=0)
    change = high - low
    assert change.argmin() < BANDS // 3 < 2 * BANDS // 3 < change.argmax()


def test_loudness_of_the_recording_does_not_matter() -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 0.1, SPEECH_RATE).astype(np.float32) * np.linspace(0.1, 1, SPEECH_RATE)
    quiet, loud = heard(noise.astype(np.float32)), heard((4 * noise).astype(np.float32))
    assert np.abs(quiet - loud).max() < 0.02


def test_other_rates_are_refused() -> None:
    with pytest.raises(ValueError, match="16000"):
        sound_features(Sound(silence(), 8000))


def test_around_is_a_mean_of_each_bin() -> None:
    features = np.arange(100, dtype=np.float32)[:, None] * np.ones((1, 2), np.float32)
    out = around(features, np.array([0.5]), 2, 0.04).reshape(5, 2)
    # Bin k covers four steps around 50 + 4 k, from half a bin before.
    assert np.allclose(out[:, 0], 50 + 4 * np.arange(-2, 3) - 0.5)
    at_end = around(features, np.array([5.0]), 1, 0.04)
    assert np.allclose(at_end, 99)


def test_moved_features_come_later() -> None:
    features = np.arange(20, dtype=np.float16)[:, None]
    assert moved_features(features, 0.03)[10, 0] == 7
    assert moved_features(features, -0.03)[10, 0] == 13
    assert moved_features(features, 0.03)[0, 0] == 0
    assert len(moved_features(features[:0], 0.08)) == 0
