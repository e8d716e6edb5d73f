"""Clips whose lips and phones are apart are found, and moved into step."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from analysis.lag import LagSettings, find_lags, moved
from analysis.smoothing import runs, smoothed, smoothed_runs
from database.track import Interval, PhonemeTrack

FPS = 25.0


@pytest.fixture(scope="module")
def clips(makedb: ModuleType) -> tuple[list[PhonemeTrack], list[np.ndarray], list[np.ndarray]]:
    """Tracks of 40 made-up clips, their frame numbers, and mouths that follow them."""
    content, _, _ = makedb.make_content(seed=3, sequences=40, frames=75, fps=FPS)
    units, sequences, phones = content.units, content.sequences, content.phones
    tracks, frames, mouths = [], [], []
    for s in range(len(sequences)):
        mine = phones.sequence == s
        bounds = np.append(phones.start[mine], phones.end[mine][-1])
        tracks.append(PhonemeTrack(phones.phoneme[mine], bounds, sequences.name[s]))
        rows = slice(sequences.first_unit[s], sequences.first_unit[s] + sequences.units[s])
        frames.append(units.frame[rows])
        mouths.append(np.column_stack([units.mouth_height[rows], units.pca[rows, 0]]))
    return tracks, frames, mouths


def test_clips_in_step_are_left_alone(
    clips: tuple[list[PhonemeTrack], list[np.ndarray], list[np.ndarray]],
) -> None:
    assert find_lags(*clips, FPS) == [0.0] * 40


@pytest.mark.parametrize("late", [-3, -2, 2, 3])
def test_a_clip_out_of_step_is_found_and_moved_back(
    clips: tuple[list[PhonemeTrack], list[np.ndarray], list[np.ndarray]], late: int
) -> None:
    tracks, frames, mouths = clips
    wrong = list(tracks)
    # Phones moved ahead by as much as the lips then come late.
    wrong[7] = moved(tracks[7], -late / FPS, tracks[7].end)
    lags = find_lags(wrong, frames, mouths, FPS)
    assert lags[7] == pytest.approx(late / FPS)
    assert [lag for i, lag in enumerate(lags) if i != 7] == [0.0] * 39
    back = moved(wrong[7], lags[7], tracks[7].end)
    same = back.sample(FPS) == tracks[7].sample(FPS)
    # All but what was moved out of the clip.
    assert same[3:-3].all()


def test_few_clips_say_nothing(
    clips: tuple[list[PhonemeTrack], list[np.ndarray], list[np.ndarray]],
) -> None:
    tracks, frames, mouths = ([*part[:12]] for part in clips)
    tracks[3] = moved(tracks[3], 0.12, tracks[3].end)
    assert find_lags(tracks, frames, mouths, FPS) == [0.0] * 12
    eager = LagSettings(fewest_clips=5)
    assert len(find_lags(tracks, frames, mouths, FPS, eager)) == 12


def test_moving_keeps_the_length_and_fills_with_silence() -> None:
    track = PhonemeTrack.from_intervals(
        [Interval(0.0, 0.2, "b"), Interval(0.2, 0.9, "iy"), Interval(0.9, 1.0, "s")]
    )
    later = moved(track, 0.15, 1.0)
    assert later.labels == ("sil", "b", "iy")
    assert later.boundaries.tolist() == pytest.approx([0, 0.15, 0.35, 1.0])
    earlier = moved(track, -0.25, 1.0)
    assert earlier.labels == ("iy", "s", "sil")
    assert earlier.boundaries.tolist() == pytest.approx([0, 0.65, 0.75, 1.0])


def test_runs_and_smoothing_stop_at_gaps() -> None:
    numbers = [0, 1, 2, 3, 4, 10, 11, 12, 13, 14]
    assert runs(numbers) == [(0, 5), (5, 10)]
    assert runs([]) == []
    steps = np.array([0.0] * 5 + [1.0] * 5)
    assert smoothed_runs(steps, numbers, 5) == pytest.approx(steps)
    assert smoothed(steps, 5) != pytest.approx(steps)


def test_smoothing_keeps_parabolas_and_takes_out_noise() -> None:
    t = np.arange(50) / 10
    assert smoothed(t**2, 7) == pytest.approx(t**2)
    noise = np.random.default_rng(0).normal(size=(500, 2))
    assert smoothed(noise, 7).std() < 0.7 * noise.std()
    assert smoothed(noise, 1) is noise
    assert smoothed(noise[:2], 7).tolist() == noise[:2].tolist()
