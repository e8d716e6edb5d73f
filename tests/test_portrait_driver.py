"""A face that is driven: lips that meet, skin that follows, eyes that shut, all else still."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from database.errors import SelectionError
from database.phonemes import CLOSURES, PHONEME_INDEX, PHONEMES, VISEMES
from database.pinyin import TimedSyllable
from database.portrait_mesh import (
    CHIN,
    EYE_TRIANGLES,
    FRAME,
    GENERIC,
    HEAD,
    INNER_CORNERS,
    LEFT_BROW,
    LEFT_LOWER_LID,
    LEFT_UPPER_LID,
    LOWER_INNER,
    MOUTH_CORNERS,
    NOSE,
    RIGHT_LOWER_LID,
    RIGHT_UPPER_LID,
    SKIN_TRIANGLES,
    STILL_WHEN_SPEAKING,
    TEMPLES,
    UPPER_INNER,
    FaceMotion,
)
from database.reader import open_database
from database.talk_mask import TalkMask
from database.track import Interval, PhonemeTrack, frame_times
from unitsel.cli.driving import add_driving, driving_settings, refuse_driving
from unitsel.portrait.driver import DriveSettings, LipMotion, drive
from unitsel.portrait.emotions import EMOTIONS, parse_emotion
from unitsel.portrait.keyframes import MOUTH_FRAMES, MOUTH_REGION, N_KEYS, NAMES, VISEME_SHAPES
from unitsel.portrait.life import LifeSettings, blinks, head_motion, unrest
from unitsel.portrait.retarget import lips_like

UNIT = 100.0
MASK = TalkMask(GENERIC * UNIT + [200.0, 190.0], 400, 420)
STILL = DriveSettings(still=True)
OUTSIDE = np.setdiff1d(np.arange(len(GENERIC)), MOUTH_REGION)


def said(text: str, length: float = 0.1, lead: float = 0.3) -> PhonemeTrack:
    """A track of phonemes of one length, silence before and after."""
    names = text.split()
    spans = [Interval(lead + i * length, lead + (i + 1) * length, p) for i, p in enumerate(names)]
    end = lead + len(names) * length
    return PhonemeTrack.from_intervals([*spans, Interval(end, end + 0.4, "sil")])


def babble(seconds: float, seed: int = 0) -> PhonemeTrack:
    """Random phonemes of lengths as in speech."""
    random = np.random.default_rng(seed)
    spans, t = [], 0.2
    while t < seconds - 0.6:
        length = random.uniform(0.04, 0.16)
        spans.append(Interval(t, t + length, str(random.choice(PHONEMES))))
        t += length
    return PhonemeTrack.from_intervals([*spans, Interval(t, seconds, "sil")])


def gaps(motion: FaceMotion, mask: TalkMask = MASK) -> np.ndarray:
    """Distance of the inner lips down the face, (n, 7)."""
    at = mask.normalised + motion.displacements
    return np.asarray(at[:, LOWER_INNER, 1] - at[:, UPPER_INNER, 1])


def turned_over(motion: FaceMotion) -> int:
    """Triangles of all frames that lie the other way round than at rest."""
    triangles = SKIN_TRIANGLES
    areas = []
    for at in (MASK.normalised[None], MASK.normalised + motion.displacements):
        a, b, c = (at[:, triangles[:, k]] for k in range(3))
        u, v = b - a, c - a
        areas.append(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
    return int(((areas[1] * np.sign(areas[0])) < 0).sum())


def test_nine_mouths_show_all_visemes() -> None:
    assert N_KEYS == 9 and NAMES[0] == "rest" and not MOUTH_FRAMES[0].any()
    assert len(VISEME_SHAPES) == len(VISEMES)
    for shapes in VISEME_SHAPES:
        np.testing.assert_allclose(shapes.sum(axis=1), 1)
    used = np.concatenate(VISEME_SHAPES).sum(axis=0)
    assert (used > 0).all(), "none is there for nothing"
    # No two of them alike, and none that moves what speech leaves still.
    apart = np.abs(MOUTH_FRAMES[:, None] - MOUTH_FRAMES[None]).max(axis=(2, 3))
    assert (apart[~np.eye(9, dtype=bool)] > 0.005).all()
    assert not MOUTH_FRAMES[:, STILL_WHEN_SPEAKING].any()


@pytest.mark.parametrize("fps", [25.0, 30.0, 50.0])
def test_lips_meet_on_p_b_and_m_and_never_cross(fps: float) -> None:
    track = babble(20.0)
    for settings in (STILL, DriveSettings(emotion="surprise"), DriveSettings(amplitude=1.6)):
        motion = drive(MASK, track, fps, settings)
        opening = gaps(motion)
        assert opening.min() > -1e-5
        times = frame_times(len(motion), fps)
        for phone, a, b in zip(
            track.phonemes, track.boundaries, track.boundaries[1:], strict=False
        ):
            inside = (times > a + 1e-3) & (times < b - 0.25 / fps)
            if int(phone) in CLOSURES and inside.any():
                assert opening[inside].max() < 0.004, (a, settings)
    assert np.median(gaps(drive(MASK, track, fps, STILL)).max(axis=1)) > 0.03, "else it moves"


def test_vowels_open_and_round() -> None:
    def middle(phoneme: str) -> tuple[FaceMotion, int]:
        motion = drive(MASK, said(phoneme, 0.2), 50.0, STILL)
        return motion, 17

    opened = {p: gaps(middle(p)[0])[17].max() for p in ("aa", "eh", "iy", "uw", "s", "m")}
    assert opened["aa"] > opened["eh"] > opened["iy"] > opened["m"] == pytest.approx(0, abs=1e-6)
    wide = {}
    for p in ("iy", "aa", "ow", "uw"):
        motion, i = middle(p)
        wide[p] = float(np.diff(motion.displacements[i, MOUTH_CORNERS, 0])[0])
    assert wide["iy"] > 0 > wide["aa"] > wide["ow"] > wide["uw"]
    motion, i = middle("aa")
    chin = motion.displacements[i, CHIN[5], 1]
    assert motion.jaw[i] == pytest.approx(chin, rel=0.02) and motion.jaw[0] == 0
    assert middle("th")[0].tongue[17] > 0.9 > 0.1 > middle("aa")[0].tongue[17]


def test_consonants_of_the_tongue_take_their_neighbour_s_mouth() -> None:
    apart = {}
    for vowel in ("uw", "iy"):
        motion = drive(MASK, said(f"k {vowel}"), 50.0, STILL)
        apart[vowel] = motion.displacements[17, MOUTH_CORNERS[1], 0]  # in the k
    assert apart["iy"] - apart["uw"] > 0.03


def test_nothing_outside_the_mouth_moves_in_a_still_face() -> None:
    track = babble(20.0)
    still = drive(MASK, track, 25.0, STILL)
    assert len(still) == 500 and not still.displacements[:, OUTSIDE].any()
    assert set(STILL_WHEN_SPEAKING) <= set(OUTSIDE)
    sad = drive(MASK, track, 25.0, replace(STILL, emotion="sadness"))
    assert not np.ptp(sad.displacements[:, OUTSIDE], axis=0).any(), "an expression, but no motion"
    alive = drive(MASK, track, 25.0)
    moved = np.ptp(alive.displacements, axis=0).max(axis=1)
    assert not moved[FRAME].any()
    assert (np.delete(moved, FRAME) > 0.005).all()
    # Life is added to the speech, and leaves it what it is.
    np.testing.assert_allclose(gaps(alive), gaps(still), atol=0.012)


def test_no_triangle_is_turned_over() -> None:
    every = said(" ".join(PHONEMES[1:]), 0.15)
    for emotion in (None, *EMOTIONS):
        settings = DriveSettings(emotion=emotion, life=LifeSettings(turn=3, perturbation=3))
        assert turned_over(drive(MASK, every, 25.0, settings)) == 0, emotion
    assert turned_over(drive(MASK, every, 25.0, DriveSettings(amplitude=1.4))) == 0


@pytest.mark.parametrize("fps", [12.5, 25.0, 29.97, 60.0])
def test_blinks_are_short_and_quite_shut(fps: float) -> None:
    n = round(120 * fps)
    shut = blinks(n, fps, 3.5, np.random.default_rng(1))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], shut > 0, [0]]).astype(int)))
    lengths = (edges[1::2] - edges[::2]) / fps
    assert 22 <= len(lengths) <= 50, "one in 3.5 s, some of them double"
    assert lengths.max() <= 0.2 + 1.01 / fps
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        assert shut[a:b].max() == 1, "shut in one frame at least"
    pauses = np.diff(edges[::2]) / fps
    usual = pauses[pauses > 1]
    assert 2.5 < usual.mean() < 4.5 and usual.std() > 0.3, "semi-periodic"
    assert not blinks(n, fps, 0, np.random.default_rng(1)).any()


def test_a_shut_eye_is_shut_whatever_the_face_feels() -> None:
    for emotion in (None, "surprise", "sadness"):
        motion = drive(MASK, babble(20.0), 25.0, DriveSettings(emotion=emotion))
        at = MASK.normalised + motion.displacements
        open_ = 0.0
        for upper, lower in (
            (LEFT_UPPER_LID, LEFT_LOWER_LID),
            (RIGHT_UPPER_LID, RIGHT_LOWER_LID),
        ):
            corner = MASK.normalised[[upper[2], lower[2]], 1]
            rest = corner[1] - corner[0]
            height = at[:, lower[2], 1] - at[:, upper[2], 1]
            # The two vertices do not quite face each other.
            assert height.min() < 0.12 * rest, emotion
            open_ = np.median(height) / rest
        assert open_ > 0.6


def test_the_head_turns_in_depth() -> None:
    settings = LifeSettings(turn=2.0, shift=0.0)
    moved = head_motion(1500, 25.0, settings, np.random.default_rng(0))
    size = moved.std(axis=0)
    tip, temple = NOSE[2], TEMPLES[0]
    assert size[tip, 0] > 1.5 * size[temple, 0] > 0
    assert not moved[:, FRAME].any()
    neck = HEAD[GENERIC[HEAD, 1] > 1]
    assert size[neck].max() < 0.01
    steps = np.abs(np.diff(moved, axis=0)).max() * UNIT
    assert steps < 1.0, "pixels a frame: no jerks"
    # Two degrees at two thirds of the eyes' distance before the axis.
    assert 0.01 < size[tip, 0] < 0.05


def test_unrest_is_small_and_stirs_neighbours_alike() -> None:
    moved = unrest(1500, 25.0, LifeSettings(perturbation=2.0), np.random.default_rng(0))
    reach = np.abs(moved).max() * UNIT
    assert 1.0 < reach < 6.0 and 0.3 < moved.std() * UNIT < 2.0
    closed = moved[:, LOWER_INNER] - moved[:, UPPER_INNER]
    assert np.abs(closed).max() * UNIT < 0.05, "closed lips stay closed"
    assert np.abs(np.diff(moved, axis=0)).max() * UNIT < 1.0


def test_the_same_seed_makes_the_same_video() -> None:
    track = babble(5.0)
    one, again = (drive(MASK, track, 25.0, DriveSettings(seed=3)) for _ in range(2))
    np.testing.assert_array_equal(one.displacements, again.displacements)
    other = drive(MASK, track, 25.0, DriveSettings(seed=4))
    assert np.abs(other.displacements - one.displacements).max() > 0.01


def test_emotions_show() -> None:
    quiet = PhonemeTrack.from_intervals([Interval(0, 2.0, "sil")])

    def face(emotion: str, strength: float = 1.0) -> np.ndarray:
        settings = replace(STILL, emotion=emotion, strength=strength)
        return drive(MASK, quiet, 25.0, settings).displacements[10]

    faces = {e: face(e) for e in EMOTIONS}
    corners = {e: f[MOUTH_CORNERS, 1].mean() for e, f in faces.items()}
    brows = {e: f[LEFT_BROW[:5], 1].mean() for e, f in faces.items()}
    assert corners["joy"] < -0.02 and corners["sadness"] > 0.02
    assert brows["surprise"] < brows["fear"] < -0.02 and brows["anger"] > 0.01
    assert faces["sadness"][LEFT_BROW[4], 1] < faces["sadness"][LEFT_BROW[0], 1]
    assert faces["disgust"][NOSE[6], 1] < -0.01
    lids = {e: f[LEFT_UPPER_LID, 1].mean() for e, f in faces.items()}
    assert lids["surprise"] < 0 < lids["sadness"]
    half = face("joy", 0.5)
    np.testing.assert_allclose(half, 0.5 * faces["joy"], atol=2e-3)
    for one in EMOTIONS:
        for other in EMOTIONS:
            if one < other:
                assert np.abs(faces[one] - faces[other]).max() > 0.02, (one, other)


def test_names_of_emotions() -> None:
    assert parse_emotion("joy") == ("joy", 1.0) and parse_emotion("Fear:0.25") == ("fear", 0.25)
    for wrong, says in (("love", "joy, sadness"), ("joy:2", "0 to 1"), ("joy:much", "joy:0.6")):
        with pytest.raises(SelectionError, match=says):
            parse_emotion(wrong)
    for settings in ({"emotion": "love"}, {"strength": 2}, {"amplitude": -1}, {"seed": -1}):
        with pytest.raises(ValueError):
            DriveSettings(**settings)
    with pytest.raises(ValueError):
        LifeSettings(turn=-1)


def test_syllables_rule_where_they_are() -> None:
    track = said("p aa ng s iy t", 0.1)
    syllables = [TimedSyllable(0.3, 0.6, "pang", 2, 0.4)]
    motion = drive(MASK, track, 50.0, STILL, syllables=syllables)
    opening = gaps(motion).max(axis=1)
    assert opening[15:19].max() < 0.004, "p closes until it is released"
    assert opening[20:30].max() > 0.08, "a"
    spread = np.diff(motion.displacements[:, MOUTH_CORNERS, 0], axis=1)[:, 0]
    assert spread[35:38].max() > 0.015, "what is not Chinese is said by its phonemes"


def test_another_s_lips_replace_key_frames() -> None:
    track = said("aa m aa")
    n = len(drive(MASK, track, 25.0, STILL))
    lips = np.zeros((n, len(GENERIC), 2))
    lips[:, LOWER_INNER, 1] = 0.05
    motion = drive(MASK, track, 25.0, STILL, lips=LipMotion(lips, np.full(n, 0.04)))
    opening = gaps(motion).max(axis=1)
    assert opening[8] == pytest.approx(0.05, abs=1e-6), "theirs"
    assert opening[10:12].max() < 0.004, "but an m is closed"
    assert motion.jaw[8] == pytest.approx(0.04)


def test_lips_of_a_recorded_person(puppet_db: Path) -> None:
    with open_database(puppet_db) as database:
        spoken = database.sequence_track(0)
        motion = lips_like(database, spoken, MASK, 30.0)
        assert len(motion.displacements) == len(motion.jaw) == round(spoken.end * 30)
        opening = (motion.displacements[:, LOWER_INNER] - motion.displacements[:, UPPER_INNER])[
            ..., 1
        ].max(axis=1)
        assert opening.max() > 0.02, "it opens as theirs did"
        assert not motion.displacements[:, STILL_WHEN_SPEAKING].any()
        # Twice as wide a mouth moves twice as far.
        wide = TalkMask(MASK.vertices.copy(), MASK.width, MASK.height)
        middle = wide.vertices[INNER_CORNERS].mean(axis=0)
        wide.vertices[MOUTH_CORNERS] = middle + 2 * (MASK.vertices[MOUTH_CORNERS] - middle)
        twice = lips_like(database, spoken, wide, 30.0)
    np.testing.assert_allclose(twice.jaw, 2 * motion.jaw, rtol=1e-6)


def options(*given: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_driving(parser)
    found = parser.parse_args(given)
    found.database = "me.h5"
    return found


def test_options_become_settings() -> None:
    assert driving_settings(options()) == DriveSettings()
    given = options(
        "--emotion", "joy:0.6", "--seed", "5", "--amplitude", "1.2", "--blink-every", "0"
    )
    found = driving_settings(given)
    assert (found.emotion, found.strength, found.seed, found.amplitude) == ("joy", 0.6, 5, 1.2)
    assert found.life == LifeSettings(blink_every=0)
    assert driving_settings(options("--still")).still
    assert driving_settings(options("--head-motion", "0")).life.turn == 0
    with pytest.raises(SelectionError, match="--still"):
        driving_settings(options("--still", "--head-motion", "2"))
    refuse_driving(options())
    for given in (["--still"], ["--emotion", "joy"], ["--seed", "0"], ["--like", "you.h5"]):
        with pytest.raises(SelectionError, match=f"{given[0]}: is for portraits"):
            refuse_driving(options(*given))
    behind = options("--head-motion", "1", "--seed", "2")
    behind.background = "me.mp4"
    with pytest.raises(SelectionError, match="photos as backgrounds only"):
        refuse_driving(behind)
    behind.background = "me.JPG"
    refuse_driving(behind)


def test_constants_fit_one_another() -> None:
    assert int(PHONEME_INDEX["p"]) in CLOSURES
    assert set(np.unique(EYE_TRIANGLES)) <= set(OUTSIDE)
