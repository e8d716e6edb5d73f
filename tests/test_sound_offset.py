"""A constant offset between sound and lips: drawn, and put into real clips."""

import json

import numpy as np
import pytest

from analysis.corpus import find_clips
from analysis.face import FaceFinder, FaceSettings
from analysis.sound_offset import (
    NATURAL,
    OffsetSettings,
    correction,
    find_sound_offset,
    offset_note,
    read_offset,
)
from database.errors import CorpusError
from database.mask import INNER_LIPS, OUTER_EYE_CORNERS
from database.media import read_video
from database.reader import open_database
from database.sound import read_sound
from database.sound_features import moved_features, sound_features

FPS = 25.0


def mouths(n_clips, late, noise=0.5, seed=0):
    """Lips that open as the voice grows louder, `late` seconds before it."""
    rng = np.random.default_rng(seed)
    frames, heights, sounds = [], [], []
    for _ in range(n_clips):
        t = np.arange(300) / 100
        opening = np.zeros_like(t)
        for at in rng.uniform(0.3, 2.7, 8):
            opening += np.exp(-(((t - at) / 0.08) ** 2))
        numbers = np.arange(75, dtype=np.int32)
        seen = np.interp((numbers + 0.5) / FPS, t, opening)
        heard = np.interp(t - late - NATURAL, t, opening)
        frames.append(numbers)
        heights.append(12 + 5 * seen + noise * rng.standard_normal(75))
        sounds.append(heard[:, None] + noise * rng.standard_normal((300, 26)))
    return frames, heights, sounds


@pytest.mark.parametrize("late", [-0.3, -0.12, 0.0, 0.05, 0.2, 0.4])
def test_an_offset_is_found(late):
    found = find_sound_offset(*mouths(20, late), FPS)
    assert found.sure
    assert found.seconds == pytest.approx(late, abs=0.015)
    assert abs(found.seconds - late) < 4 * found.error + 0.005
    assert found.clips == 20


def test_what_does_not_belong_together_is_not_believed():
    frames, heights, _ = mouths(20, 0.0, seed=1)
    sounds = mouths(20, 0.0, seed=2)[2]
    found = find_sound_offset(frames, heights, sounds, FPS)
    assert not found.sure
    assert correction(found, OffsetSettings(correct="auto")) == 0.0
    assert offset_note(found, OffsetSettings()) is None
    assert "cannot be told" in offset_note(found, OffsetSettings(correct="auto"))


def test_too_little_to_tell():
    frames, heights, sounds = mouths(8, 0.2)
    none = np.zeros((0, 26))
    assert find_sound_offset(frames, heights, [*sounds[:4], *[none] * 4], FPS) is None
    flat = [np.full(75, 12.0)] * 8
    assert find_sound_offset(frames, flat, sounds, FPS) is None
    assert find_sound_offset([], [], [], FPS) is None
    gaps = [np.arange(0, 150, 2, dtype=np.int32)] * 8
    assert find_sound_offset(gaps, heights, sounds, FPS) is None, "no two frames in a row"


def test_what_is_done_about_it():
    found = find_sound_offset(*mouths(20, 0.12), FPS)
    assert correction(found, OffsetSettings()) == 0.0
    assert correction(found, OffsetSettings(correct="auto")) == found.seconds
    assert correction(found, OffsetSettings(correct=-0.05)) == -0.05
    assert "--sound-offset auto takes it out" in offset_note(found, OffsetSettings())
    assert "phones moved" in offset_note(found, OffsetSettings(correct="auto"))
    assert "-50 ms" in offset_note(found, OffsetSettings(correct=-0.05))
    small = find_sound_offset(*mouths(20, 0.02), FPS)
    assert correction(small, OffsetSettings(correct="auto")) == 0.0
    assert offset_note(small, OffsetSettings()) is None
    assert set(json.loads(json.dumps(found.as_json()))) >= {"milliseconds", "error", "sure"}


def test_what_a_user_asks_for():
    assert read_offset("auto") == "auto"
    assert read_offset("-120") == -0.12
    for text in ("late", "nan", "2001", "", "inf"):
        with pytest.raises(CorpusError, match="expected auto, or milliseconds from -2000 to 2000"):
            read_offset(text)


@pytest.fixture(scope="module")
def clips(corpus, face_models):
    """Give frames, lip openings in eye widths, and sound of eight real clips."""
    finder = FaceFinder(face_models, FaceSettings(looks=()))
    frames, heights, sounds = [], [], []
    for clip in find_clips(corpus, limit=8):
        finder.reset()
        numbers, opening = [], []
        for frame in read_video(clip.media):
            mesh = finder.find(frame.rgb)
            if mesh is not None:
                lips = mesh.points[list(INNER_LIPS), 1]
                eyes = np.linalg.norm(np.diff(mesh.points[list(OUTER_EYE_CORNERS), :2], axis=0))
                numbers.append(frame.index)
                opening.append(np.ptp(lips) / eyes)
        frames.append(np.array(numbers, np.int32))
        heights.append(np.array(opening))
        sounds.append(sound_features(read_sound(clip.media)))
    return frames, heights, sounds


@pytest.mark.parametrize("late", [-0.2, -0.08, 0.0, 0.04, 0.2])
def test_real_clips(clips, late):
    frames, heights, sounds = clips
    moved = [moved_features(s, late) for s in sounds]
    found = find_sound_offset(frames, heights, moved, FPS)
    assert found.sure
    assert found.seconds == pytest.approx(late, abs=0.02)


def test_a_build_takes_it_out(puppet_corpus, puppet_db, tmp_path, run):
    """By hand, since the puppet's voice is not made with its lips."""
    output = tmp_path / "moved.h5"
    options = ("--jobs", 1, "--limit", 1, "--sound-offset", 80)
    status, out, err = run("build", puppet_corpus, "-o", output, *options)
    assert status == 0, err
    assert "all clips: sound taken to come +80 ms after the lips" in out
    with open_database(puppet_db) as plain, open_database(output) as moved:
        before, after = plain.sequence_track(0), moved.sequence_track(0)
        starts = [i.start - 0.08 for i in before.intervals() if i.label != "sil"]
        assert min(starts) > 0
        assert [i.start for i in after.intervals() if i.label != "sil"] == pytest.approx(starts)
        heard, moved_heard = plain.sound(0), moved.sound(0)
        np.testing.assert_array_equal(moved_heard[:-8], heard[8:])
