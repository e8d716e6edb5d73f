"""Phonemes over time: sampling, context, validation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from database.errors import TrackError
from database.phonemes import PHONEME_INDEX, PHONEMES, SILENCE
from database.track import (
    SMALL_GAP,
    Interval,
    PhonemeTrack,
    context_frames,
    context_windows,
    frame_count,
    frame_times,
)

M, AA, T = (PHONEME_INDEX[p] for p in ("m", "aa", "t"))


def track(*spans: tuple[float, float, str]) -> PhonemeTrack:
    return PhonemeTrack.from_intervals([Interval(*s) for s in spans], name="t")


@st.composite
def tracks(draw: st.DrawFn) -> PhonemeTrack:
    lengths = draw(st.lists(st.floats(0.005, 2.0), min_size=1, max_size=12))
    phonemes = [draw(st.sampled_from(range(len(PHONEMES)))) for _ in lengths]
    start = draw(st.floats(0, 3))
    return PhonemeTrack(np.array(phonemes), np.cumsum([start, *lengths]))


def test_a_frame_shows_the_phoneme_at_its_middle() -> None:
    t = track((0, 0.06, "m"), (0.06, 0.2, "aa"))
    # Middles at 25 fps: 0.02, 0.06, 0.10, 0.14, 0.18; the boundary belongs to what follows.
    assert t.sample(25).tolist() == [M, AA, AA, AA, AA]
    assert t.sample(50).tolist() == [M, M, M, *[AA] * 7]


def test_sampling_at_a_rate_that_is_no_whole_number() -> None:
    fps = 30000 / 1001
    t = track((0, 1, "m"), (1, 2, "t"))
    frames = t.sample(fps)
    assert len(frames) == 60
    # Frame 29 has its middle at 0.984 s, frame 30 at 1.018 s.
    assert frames[:30].tolist() == [M] * 30
    assert frames[30:].tolist() == [T] * 30


def test_beyond_the_ends_is_silence() -> None:
    t = PhonemeTrack(np.array([M]), np.array([0.1, 0.2]))
    assert t.at([0.0, 0.0999, 0.1, 0.1999, 0.2, 9.0]).tolist() == [0, 0, M, M, 0, 0]
    assert t.sample(50, 20).tolist() == [0] * 5 + [M] * 5 + [0] * 10


def test_at_keeps_the_shape_of_the_times() -> None:
    t = track((0, 1, "m"))
    assert t.at(np.array([[0.5, 1.5], [-0.1, 0.0]])).tolist() == [[M, 0], [0, M]]


def test_frames_and_times() -> None:
    assert frame_times(3, 50).tolist() == pytest.approx([0.01, 0.03, 0.05])
    assert frame_count(3.0, 25) == 75
    assert frame_count(0.001, 25) == 1
    assert (context_frames(50), context_frames(25), context_frames(30)) == (10, 5, 6)


def test_context_windows_reach_over_the_ends_into_silence() -> None:
    windows = context_windows(np.array([M, AA, T]), 2)
    assert windows.dtype == np.uint8
    assert windows.tolist() == [
        [0, 0, M, AA, T],
        [0, M, AA, T, 0],
        [M, AA, T, 0, 0],
    ]


def test_gaps_become_silence_and_rounding_does_not() -> None:
    t = track((0.1, 0.2, "m"), (0.2 + SMALL_GAP / 2, 0.3, "aa"), (0.4, 0.5, "t"))
    assert t.labels == ("sil", "m", "aa", "sil", "t")
    assert t.boundaries.tolist() == pytest.approx([0, 0.1, 0.2, 0.3, 0.4, 0.5])


def test_speech_span() -> None:
    assert track((0.1, 0.2, "m"), (0.5, 0.6, "t"), (0.6, 2, "sil")).speech_span() == (0.1, 0.6)
    assert track((0, 2, "sil")).speech_span() == (0, 2)


@pytest.mark.parametrize(
    ("spans", "said"),
    [
        ([], "holds no phoneme"),
        ([(0, 0.5, "m"), (0.4, 1, "t")], r"interval 2 \('t', 0.4 to 1 s\): starts before .*0.5 s"),
        ([(0, 0.5, "m"), (0.5, 0.5, "t")], "interval 2 .*has no length"),
        ([(0.5, 0.2, "m")], "has no length"),
        ([(-0.1, 0.2, "m")], "not negative"),
        ([(0, math.nan, "m")], "finite"),
        ([(0, math.inf, "m")], "finite"),
        ([(0, 1, "AA0")], "'AA0' is not a phoneme of Table 1"),
    ],
)
def test_intervals_that_cannot_be_a_track(spans: list[tuple[float, float, str]], said: str) -> None:
    with pytest.raises(TrackError, match=said):
        track(*spans)


@pytest.mark.parametrize(
    ("phonemes", "boundaries", "said"),
    [
        ([], [0.0], "holds no phoneme"),
        ([M], [0.0], "need 2 boundaries, got 1"),
        ([43], [0.0, 1.0], r"0\.\.42"),
        ([-1], [0.0, 1.0], r"0\.\.42"),
        ([M], [-1.0, 1.0], "not negative"),
        ([M], [0.0, math.inf], "finite"),
        ([M, T], [0.0, 1.0, 1.0], r"phoneme 2 \(t\) ends at 1 s, not after its start at 1 s"),
    ],
)
def test_arrays_that_cannot_be_a_track(
    phonemes: list[int], boundaries: list[float], said: str
) -> None:
    with pytest.raises(TrackError, match=said):
        PhonemeTrack(np.array(phonemes), np.array(boundaries), "t")


@pytest.mark.parametrize("fps", [0, -25, math.nan, math.inf])
def test_a_frame_rate_that_is_none(fps: float) -> None:
    with pytest.raises(TrackError, match="frame rate must be positive"):
        track((0, 1, "m")).sample(fps)


def test_a_track_does_not_change_with_the_arrays_it_was_made_of() -> None:
    phonemes, bounds = np.array([M]), np.array([0.0, 1.0])
    t = PhonemeTrack(phonemes, bounds)
    phonemes[0], bounds[1] = T, 5
    assert (t.labels, t.end) == (("m",), 1.0)
    with pytest.raises(ValueError, match="read-only"):
        t.boundaries[0] = 1


@given(tracks(), st.sampled_from([25.0, 30000 / 1001, 30.0, 50.0]))
def test_every_frame_has_the_phoneme_that_covers_its_middle(t: PhonemeTrack, fps: float) -> None:
    frames = t.sample(fps)
    assert len(frames) == frame_count(t.end, fps)
    for i, p in enumerate(frames):
        middle = (i + 0.5) / fps
        covering = [it.label for it in t.intervals() if it.start <= middle < it.end]
        assert [PHONEMES[p]] == (covering or ["sil"])


@given(tracks())
def test_a_track_is_what_its_intervals_say(t: PhonemeTrack) -> None:
    again = PhonemeTrack.from_intervals(t.intervals())
    times = frame_times(400, 40)
    assert again.at(times).tolist() == t.at(times).tolist()
    assert again.end == t.end


@given(st.lists(st.integers(0, 42), min_size=1, max_size=40), st.integers(0, 12))
def test_context_windows_are_shifts(phonemes: list[int], n: int) -> None:
    windows = context_windows(np.array(phonemes), n)
    assert windows.shape == (len(phonemes), 2 * n + 1)
    for i in range(len(phonemes)):
        for j in range(-n, n + 1):
            inside = 0 <= i + j < len(phonemes)
            assert windows[i, j + n] == (phonemes[i + j] if inside else SILENCE)
