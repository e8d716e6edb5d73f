"""What the eye punishes, on cases whose answers are known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from analysis.align import Aligner
from analysis.corpus import align_clip, find_clips
from analysis.face import FaceFinder
from analysis.g2p import speaking_lexicon
from database.errors import SelectionError
from database.mask import INNER_LIPS, OUTER_EYE_CORNERS
from database.media import probe, read_video
from database.phonemes import CLOSURES, SILENCE
from database.sound import read_sound
from database.track import Interval, PhonemeTrack
from unitsel.likeness.eye_measures import (
    closed_frames,
    closure_hit_rate,
    closure_threshold,
    greatest_join_jump,
    lip_opening,
    natural_step,
    silence_motion,
)

BY = PhonemeTrack.from_intervals(
    [
        Interval(0.0, 0.4, "sil"),
        Interval(0.4, 0.48, "b"),
        Interval(0.48, 0.8, "ay"),
        Interval(0.8, 0.88, "m"),
        Interval(0.88, 1.0, "iy"),
        Interval(1.0, 1.3, "sil"),
    ]
)
"""At 25 fps b is frames 10 and 11, m is 20 and 21 (their middles 0.42, 0.46, 0.82, 0.86)."""

FRAMES = np.arange(32)


def closed_in(*frames: int) -> np.ndarray:
    return np.isin(FRAMES, frames)


def mesh(gaps: dict[int, float], angle: float = 0.0, size: float = 1.0) -> np.ndarray:
    """A face of 100 pixels between the eyes, closed but for the given pairs of inner points."""
    points = np.zeros((468, 2))
    left, right = OUTER_EYE_CORNERS
    points[left], points[right] = (-50, 0), (50, 0)
    points[list(INNER_LIPS)] = [(2.0 * i, 60.0) for i in range(20)]
    for i, gap in gaps.items():
        points[INNER_LIPS[-i], 1] = 60 + gap
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return (size * points @ turn.T + [180, 140]).astype(np.float32)


def test_opening_is_the_greatest_gap_in_parts_of_the_eyes() -> None:
    faces = [
        mesh({3: 4.0, 5: 12.0, 7: 6.0}),
        mesh({3: 4.0, 5: 12.0, 7: 6.0}, angle=0.3),
        mesh({3: 4.0, 5: 12.0, 7: 6.0}, size=2.5),
        mesh({}),
    ]
    assert lip_opening(np.stack(faces)) == pytest.approx([0.12, 0.12, 0.12, 0], abs=1e-4)


def test_lips_that_overlap_in_every_pair_open_less_than_nothing() -> None:
    face = mesh(dict.fromkeys(range(1, 10), -3.0))
    assert lip_opening(face[None])[0] == pytest.approx(-0.03, abs=1e-4)


def test_threshold_is_a_quarter_of_the_way_from_rest_to_wide() -> None:
    rest = np.array([0.01, 0.012, 0.05])
    speech = np.linspace(0, 1, 101) * 0.1
    assert closure_threshold(rest, speech) == pytest.approx(0.012 + 0.25 * (0.095 - 0.012))
    # Never seen at rest: the narrowest 5 % of speech stand in.
    assert closure_threshold(np.zeros(0), speech) == pytest.approx(0.005 + 0.25 * 0.09)


@pytest.mark.parametrize(
    ("rest", "speech"), [([0.01], []), ([math.nan], [0.1]), ([0.01], [0.1, math.inf])]
)
def test_threshold_needs_finite_openings(rest: list[float], speech: list[float]) -> None:
    with pytest.raises(SelectionError, match="finite lip openings"):
        closure_threshold(np.array(rest), np.array(speech))


def test_a_flicker_of_one_frame_is_no_closure() -> None:
    opening = np.array([5, 1, 5, 1, 2, 5, 2, 2, 2], dtype=float)
    closed = closed_frames(opening, np.arange(9), 2.0, 25)
    assert np.flatnonzero(closed).tolist() == [3, 4, 6, 7, 8]
    # 0.08 s are four frames at 50 a second, and no more than one at 12.
    assert not closed_frames(opening, np.arange(9), 2.0, 50).any()
    assert np.flatnonzero(closed_frames(opening, np.arange(9), 2.0, 12)).tolist() == [
        *(1, 3, 4, 6, 7, 8)
    ]


def test_a_closure_does_not_reach_over_missing_frames() -> None:
    opening = np.array([9.0, 1, 1, 9])
    assert closed_frames(opening, np.array([0, 1, 2, 3]), 2.0, 25).tolist() == [
        *(False, True, True, False)
    ]
    assert not closed_frames(opening, np.array([0, 1, 5, 6]), 2.0, 25).any()


@pytest.mark.parametrize(
    ("frames", "rate"),
    [
        ((10, 11, 20, 21), 1.0),
        ((9,), 0.5),  # One frame before b.
        ((12,), 0.5),  # One frame after it.
        ((8,), 0.0),
        ((13,), 0.0),
        ((19, 22), 0.5),
        ((18, 23), 0.0),
        ((), 0.0),
    ],
)
def test_closures_at_the_right_time(frames: tuple[int, ...], rate: float) -> None:
    assert closure_hit_rate(closed_in(*frames), FRAMES, BY, 25) == rate


def test_a_phone_shorter_than_a_frame_is_looked_for_on_both_sides() -> None:
    # p lies between the middles of frames 10 and 11.
    track = PhonemeTrack.from_intervals(
        [Interval(0, 0.425, "iy"), Interval(0.425, 0.455, "p"), Interval(0.455, 1, "iy")]
    )
    rates = [closure_hit_rate(closed_in(f), FRAMES, track, 25) for f in range(8, 14)]
    assert rates == [0, 0, 1, 1, 0, 0]


def test_phones_without_a_face_do_not_count() -> None:
    seen = np.array([f for f in FRAMES if not 17 <= f <= 24])
    closed = np.isin(seen, (10, 11))
    assert closure_hit_rate(closed, seen, BY, 25) == 1
    nothing = PhonemeTrack.from_intervals([Interval(0, 1, "iy")])
    assert closure_hit_rate(closed_in(4), FRAMES, nothing, 25) is None


def test_motion_in_silence_by_hand() -> None:
    # Silence is frames 0 to 9 and 25 to 31; what happens in speech does not count.
    height = np.zeros(32)
    height[:10] = [1, 3] * 5
    height[10:25] = np.arange(15) * 7.0
    height[25:] = 50.0
    motion = silence_motion(height, FRAMES, BY, 25)
    assert motion is not None
    # Ten deviations of 1 and seven of 0; nine steps of 2 and six of 0.
    assert motion.sd == pytest.approx(math.sqrt(10 / 17))
    assert motion.step == pytest.approx(9 * 2 / 15)


def test_a_step_over_missing_frames_is_none() -> None:
    frames = np.array([0, 1, 2, 6, 7])
    motion = silence_motion(np.array([0.0, 1, 2, 100, 101]), frames, BY, 25)
    assert motion is not None and motion.step == 1


def test_short_silences_are_pauses_of_speech() -> None:
    track = PhonemeTrack.from_intervals([Interval(0, 0.16, "sil"), Interval(0.16, 1, "iy")])
    assert silence_motion(np.arange(25.0), np.arange(25), track, 25) is None
    # Two phones of silence in a row are one silence, here of 0.2 s.
    both = PhonemeTrack.from_intervals(
        [Interval(0, 0.1, "sil"), Interval(0.1, 0.2, "sil"), Interval(0.2, 1, "iy")]
    )
    motion = silence_motion(np.arange(25.0), np.arange(25), both, 25)
    assert motion is not None and motion.step == 1


def test_natural_step_is_of_recorded_neighbours() -> None:
    sequence = np.array([0, 0, 0, 1, 1, 1])
    frame = np.array([0, 1, 2, 0, 1, 7])
    pca = np.array([[0.0, 0], [3, 4], [3, 4], [90, 90], [90, 91], [0, 0]])
    # Steps of 5, 0 and 1; the change of sequence and the missing frames do not count.
    assert natural_step(pca, sequence, frame) == pytest.approx(np.percentile([5, 0, 1], 95))
    assert natural_step(pca, np.arange(6), frame) == 0


def test_greatest_jump_is_at_a_join() -> None:
    sequence = np.array([0, 0, 1, 1, 1])
    frame = np.array([3, 4, 9, 10, 12])
    pca = np.array([[0.0, 0], [100, 0], [103, 4], [0, 0], [0, 8]])
    # Joins: a step of 5 between the sequences, one of 8 over a frame left out.
    assert greatest_join_jump(pca, sequence, frame, 2.0) == pytest.approx(4)
    assert greatest_join_jump(pca[:3], sequence[:3], frame[:3], 2.0) == pytest.approx(2.5)
    assert greatest_join_jump(pca[:2], sequence[:2], frame[:2], 2.0) == 0


def test_what_does_not_fit() -> None:
    with pytest.raises(SelectionError, match="3 values do not fit 4 frames"):
        closed_frames(np.zeros(3), np.arange(4), 0.1, 25)
    with pytest.raises(SelectionError, match="0 values"):
        closure_hit_rate(np.zeros(0, bool), np.arange(0), BY, 25)
    with pytest.raises(SelectionError, match="frame rate"):
        silence_motion(np.zeros(4), np.arange(4), BY, 0)
    with pytest.raises(SelectionError, match="natural step"):
        greatest_join_jump(np.zeros((2, 3)), np.array([0, 1]), np.array([0, 0]), 0.0)


def test_recorded_closures_are_found(corpus: Path, finder: FaceFinder) -> None:
    """On clips of the corpus: the raw mesh sees p, b and m close the lips, others less."""
    aligner = Aligner(speaking_lexicon())
    hits, shares = [], []
    for clip in find_clips(corpus, limit=4):
        info = probe(clip.media)
        track = align_clip(clip, read_sound(clip.media), info.duration, aligner).track
        finder.reset()
        meshes = {f.index: finder.find(f.rgb) for f in read_video(clip.media)}
        seen = {i: found.points[:, :2] for i, found in meshes.items() if found is not None}
        frames, opening = np.array(list(seen)), lip_opening(np.stack(list(seen.values())))
        said = track.sample(info.fps, int(frames[-1]) + 1)[frames]
        speech = said != SILENCE
        closure = np.isin(said, list(CLOSURES))
        threshold = closure_threshold(opening[~speech], opening[speech])
        closed = closed_frames(opening, frames, threshold, info.fps)
        rate = closure_hit_rate(closed, frames, track, info.fps)
        if rate is not None:
            hits.append(rate)
            shares.append((closed[closure].mean(), closed[speech & ~closure].mean()))
    assert np.mean(hits) > 0.8
    in_closures, elsewhere = np.mean(shares, axis=0)
    assert in_closures > elsewhere + 0.25
