"""Measures on cases whose answers are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from database.errors import SelectionError
from database.phonemes import PHONEME_INDEX
from database.track import Interval, PhonemeTrack
from unitsel.likeness.measures import (
    correlation,
    joins,
    sd_ratio,
    segment_lengths,
    sl_avg,
    speech_frames,
    tc_avg,
    vc_avg,
)


def segments(*lengths):
    """Make a path of segments of given lengths, each from a place of its own."""
    sequence = np.repeat(np.arange(len(lengths)), lengths)
    frame = np.concatenate([10 * i + np.arange(n) for i, n in enumerate(lengths)])
    return sequence, frame


def test_example_of_the_paper():
    sequence, frame = segments(6, 3, 2, 11, 3)
    assert segment_lengths(sequence, frame).tolist() == [6, 3, 2, 11, 3]
    assert sl_avg(sequence, frame) == 5


def test_a_skip_a_repeat_and_a_step_back_end_a_segment():
    sequence = np.zeros(6, dtype=np.int32)
    frame = np.array([3, 4, 6, 6, 5, 6], dtype=np.int32)
    assert joins(sequence, frame).tolist() == [False, True, True, True, False]
    assert segment_lengths(sequence, frame).tolist() == [2, 1, 1, 2]


def test_next_frame_number_of_another_sequence_is_a_join():
    assert sl_avg(np.array([0, 1]), np.array([4, 5])) == 1


def test_one_frame_is_one_segment():
    assert sl_avg(np.array([2]), np.array([7])) == 1
    assert vc_avg(np.ones((1, 3)), np.array([2]), np.array([7])) == 0


def test_average_target_cost():
    assert tc_avg(np.array([1.0, 2.0, 6.0])) == 3


def test_average_visual_cost_counts_joins_only():
    sequence, frame = segments(2, 2, 1)
    pca = np.array([[0.0, 0], [9, 9], [9, 6], [1, 1], [4, 5]])
    # Joins: (9, 9) to (9, 6) is 3, (1, 1) to (4, 5) is 5; five frames.
    assert vc_avg(pca, sequence, frame) == pytest.approx((3 + 5) / 4)


def test_correlation_by_hand():
    # Deviations (-1, 0, 1) and (-1, 1, 0): r = 1 / 2.
    assert correlation(np.array([1.0, 2, 3]), np.array([1.0, 3, 2])) == pytest.approx(0.5)
    x = np.array([1.0, 2, 4, 3])
    assert correlation(x, 3 * x + 2) == pytest.approx(1)
    assert correlation(x, -x) == pytest.approx(-1)


@pytest.mark.parametrize("value", [0.0, 17.3])
def test_constant_trajectory_counts_zero(value):
    x = np.array([1.0, 2, 4, 3])
    still = np.full(4, value)
    assert correlation(still, x) == 0
    assert correlation(x, still) == 0
    assert sd_ratio(still, x) == 0
    assert sd_ratio(x, still) == 0


def test_constant_in_single_precision_counts_zero():
    still = np.full(75, 0.1, dtype=np.float32)
    assert correlation(still, np.arange(75)) == 0


def test_inside_speech_only():
    inside = np.array([False, True, True, True, False])
    a = np.array([100.0, 1, 2, 3, -50])
    b = np.array([-7.0, 1, 3, 2, 9])
    assert correlation(a, b, inside) == pytest.approx(0.5)
    assert sd_ratio(2 * b, b, inside) == pytest.approx(2)
    assert sd_ratio(a, b, inside) == pytest.approx(1)
    assert correlation(a, b, np.array([True, False, False, False, False])) == 0


def test_frames_inside_speech():
    track = PhonemeTrack.from_intervals(
        [Interval(0.1, 0.2, "p"), Interval(0.2, 0.22, "sil"), Interval(0.22, 0.3, "iy"),
         Interval(0.3, 0.4, "sil")]
    )  # fmt: skip
    # Middles at 25 fps: 0.02, 0.06, 0.10, ... of which 0.10 to 0.26 lie in 0.1 to 0.3.
    assert np.flatnonzero(speech_frames(track, 25, 10)).tolist() == [2, 3, 4, 5, 6]


def test_silence_is_measured_as_a_whole():
    track = PhonemeTrack(np.array([PHONEME_INDEX["sil"]]), np.array([0.0, 0.4]))
    assert speech_frames(track, 25, 10).all()


def test_arrays_that_do_not_fit():
    with pytest.raises(SelectionError, match="same number"):
        correlation(np.ones(3), np.ones(4))
    with pytest.raises(SelectionError, match="at least 1"):
        tc_avg(np.zeros(0))
    with pytest.raises(SelectionError, match="not finite"):
        correlation(np.array([1.0, math.nan]), np.ones(2))
    with pytest.raises(SelectionError, match="frame rate"):
        speech_frames(PhonemeTrack(np.array([0]), np.array([0.0, 1.0])), 0, 3)
