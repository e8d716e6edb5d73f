"""The corpus doctor's parts: English, coverage, advice, and measures of pictures and sound."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from database.lexicon import Lexicon
from database.mask import OUTER_LIPS
from database.phonemes import N_PHONEMES, PHONEME_INDEX, SILENCE
from database.sound import Sound
from unitsel.doctor import measures
from unitsel.doctor.charts import dots, histogram
from unitsel.doctor.coverage import ENOUGH, Coverage, diphone_name, what_to_record
from unitsel.doctor.english import (
    count_diphones,
    english,
    phonemes_of,
    read_sentences,
    words_of,
)
from unitsel.doctor.facts import ClipFacts, Limits, SoundFacts, clip_faults, poses_outside

NEVER = {"ax", "ix", "h"}
"""Phonemes of Table 1 that the CMU dictionary writes as others."""


def _coverage(*sentences: str) -> Coverage:
    lexicon = Lexicon.default()
    said = [phonemes_of(words_of(s), lexicon) for s in sentences]
    return Coverage(count_diphones(said), None, english())


def test_sentences_are_many_distinct_and_pronounceable() -> None:
    sentences = read_sentences()
    assert len(sentences) >= 300
    assert len({s.lower() for s in sentences}) == len(sentences)
    assert all(re.fullmatch(r"[A-Z][A-Za-z' ,;?-]+[.?]", s) for s in sentences)
    words = {w for s in sentences for w in words_of(s)}
    assert Lexicon.default().missing(words) == []


def test_a_lexicon_lists_its_words() -> None:
    own = Lexicon({"Zwick": [("z", "w", "ih", "k")], "ab": [("ae", "b")]})
    assert own.words() == ["ab", "zwick"]
    words = Lexicon.default().words()
    assert words == sorted(words) and len(words) > 100_000
    assert own.missing(own.words()) == [] == Lexicon.default().missing(words[::5000])


def test_english_has_every_phoneme_in_a_sensible_order() -> None:
    found = english()
    assert found.diphones.sum() == pytest.approx(1)
    assert found.diphones[SILENCE, SILENCE] == 0
    share = {p: found.phonemes[i] for p, i in PHONEME_INDEX.items()}
    assert {p for p, s in share.items() if s == 0} == {"sil", *NEVER}
    assert share["ah"] > share["t"] > share["f"] > share["oy"] > share["zh"] > 0
    assert found.visemes.sum() == pytest.approx(1)


def test_each_rare_phoneme_is_said_often_enough_to_choose() -> None:
    said = np.bincount(np.concatenate(english().spoken), minlength=N_PHONEMES)
    for p in ("zh", "oy", "th", "dh", "ng", "uh", "ch", "jh", "aw", "y"):
        assert said[PHONEME_INDEX[p]] >= 40, p


def test_diphones_are_counted_by_hand_too() -> None:
    counts = count_diphones([phonemes_of(["boy", "boy"], Lexicon.default())])
    expected = {("sil", "b"): 1, ("b", "oy"): 2, ("oy", "b"): 1, ("oy", "sil"): 1}
    assert counts.sum() == 5
    for (a, b), n in expected.items():
        assert counts[PHONEME_INDEX[a], PHONEME_INDEX[b]] == n
    assert count_diphones([np.array([SILENCE, SILENCE])]).sum() == 0


def test_coverage_of_nothing_and_of_everything() -> None:
    nothing = _coverage()
    assert nothing.share() == nothing.viseme_share() == 0
    assert len(nothing.missing_phonemes()) == N_PHONEMES - 1 - len(NEVER)
    everything = Coverage(np.full((N_PHONEMES, N_PHONEMES), ENOUGH), None, english())
    assert everything.share() == pytest.approx(1)
    assert everything.share(ENOUGH) == pytest.approx(1)
    assert everything.missing_phonemes() == everything.gaps() == []
    assert what_to_record(everything, 10) == []


def test_coverage_knows_what_is_missing_and_thin() -> None:
    found = _coverage(*["Bin blue at f two now."] * 30)
    assert "zh" in found.missing_phonemes() and "b" not in found.missing_phonemes()
    assert found.missing_phonemes()[0] == "ah"  # the commonest of those that are lacking
    assert 10 in found.thin_visemes() and 21 not in found.thin_visemes()
    assert found.gaps()[0] not in found.gaps()[1:]
    assert all(found.diphones[d] == 0 for d in found.gaps())
    assert found.viseme_share() > found.share() > 0
    document = found.as_json()
    assert document["missing_phonemes"] == found.missing_phonemes()
    assert document["missing_diphones"][0] == diphone_name(found.gaps()[0])


def test_advice_adds_what_it_says_and_stops_at_the_number() -> None:
    start = _coverage("Set white with p two please.")
    advice = what_to_record(start, 6)
    assert len(advice) == 6 and len({a.sentence for a in advice}) == 6
    have = start.diphones.copy()
    shares = [start.share()]
    for a in advice:
        counts = count_diphones([phonemes_of(words_of(a.sentence), Lexicon.default())])
        new = {
            (int(i), int(j)) for i, j in zip(*np.nonzero((counts > 0) & (have == 0)), strict=True)
        }
        assert set(a.new) == new
        have = have + counts
        assert a.share == pytest.approx(Coverage(have, None, english()).share())
        shares.append(a.share)
    assert shares == sorted(shares)
    # More than sentences taken at random would add.
    rng = np.random.default_rng(0)
    drawn = [
        _coverage("Set white with p two please.", *rng.choice(english().sentences, 6)).share()
        for _ in range(10)
    ]
    assert shares[-1] > max(drawn)


def _mouth(seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(60, 190, (48, 64, 3)).astype(np.uint8)
    return cv2.GaussianBlur(noise, (0, 0), 0.7)


def test_sharpness_falls_with_blur_and_not_with_light() -> None:
    mouth = _mouth()
    values = [measures.sharpness(cv2.GaussianBlur(mouth, (0, 0), s)) for s in (0.5, 1.0, 2.0)]
    assert measures.sharpness(mouth) > values[0] > values[1] > values[2] > 0
    dim = (mouth.astype(float) * 0.6 + 10).round().astype(np.uint8)
    assert measures.sharpness(dim) == pytest.approx(measures.sharpness(mouth), rel=0.03)
    assert measures.sharpness(np.full((20, 20, 3), 7, np.uint8)) == 0


def test_clipping_and_drift() -> None:
    mouth = np.full((10, 10, 3), 128, np.uint8)
    mouth[:2], mouth[2] = 255, 0
    assert measures.clipped_share(mouth) == pytest.approx(0.3)
    assert measures.drift([100, 100, 100, 100, 120, 120]) == pytest.approx(20 / (320 / 3))
    assert measures.drift([1, 200]) == 0


def test_the_mouth_is_cut_out_even_at_the_edge() -> None:
    frame = np.zeros((100, 120, 3), np.uint8)
    mesh = np.zeros((468, 2))
    angles = np.linspace(0, 2 * np.pi, len(OUTER_LIPS), endpoint=False)
    mesh[list(OUTER_LIPS)] = np.column_stack([60 + 20 * np.cos(angles), 50 + 8 * np.sin(angles)])
    assert measures.mouth_box(frame, mesh).shape == (45, 69, 3)
    assert measures.mouth_box(frame, mesh + [60, 0]).shape[1] < 69
    assert 0 in measures.mouth_box(frame, mesh + [300, 0]).shape


def test_sound_level_noise_and_clipping() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(32000) / 16000
    speech = 0.1 * np.sqrt(2) * np.sin(2 * np.pi * 200 * t) * (t > 1)
    noise = 0.001 * rng.standard_normal(len(t))
    found = measures.sound_facts(Sound((speech + noise).astype(np.float32), 16000))
    assert found is not None
    assert found.level == pytest.approx(-20, abs=0.3)
    assert found.snr == pytest.approx(40, abs=1)
    assert found.clipped == 0
    loud = measures.sound_facts(Sound(np.clip(20 * speech, -1, 1).astype(np.float32), 16000))
    assert loud is not None and loud.clipped > 0.3
    assert measures.sound_facts(Sound(np.zeros(100, np.float32), 16000)) is None


def test_lips_that_follow_their_phones_agree_and_others_do_not() -> None:
    rng = np.random.default_rng(0)
    shapes = rng.standard_normal((N_PHONEMES, 2))
    phoneme = np.repeat(rng.integers(1, 12, (8, 25)), 4, axis=1)
    seen = shapes[phoneme] + 0.2 * rng.standard_normal((8, 100, 2))
    seen[3] = seen[3][::-1]
    phoneme[6] = SILENCE
    clip = np.repeat(np.arange(8), 100)
    found = measures.lip_agreements(seen.reshape(-1, 2), phoneme.ravel(), clip, 8, 25.0)
    assert found[6] is None
    assert all(r is not None and r > 0.8 for i, r in enumerate(found) if i not in (3, 6))
    assert found[3] is not None and found[3] < 0.4


def test_poses_count_from_the_camera_and_the_median_place() -> None:
    rotations = np.array([[0, 0, 0], [0, 20, 0], [-13, 0, 0]], float)
    translations = np.array([[500, 0, 900], [500, 0, 905], [500, 0, 1000]], float)
    found = poses_outside(rotations, translations, Limits())
    assert found.tolist() == [
        [False] * 6,
        [False, True, False, False, False, False],
        [True, False, False, False, False, True],
    ]
    assert poses_outside(np.zeros((0, 3)), np.zeros((0, 3)), Limits()).shape == (0, 6)


def test_faults_of_clips_are_told_against_the_others() -> None:
    good = ClipFacts(
        "a", Path("a.mp4"), looked=6, faces=6, sharpness=0.2, brightness=120.0,
        sound=SoundFacts(-20, 30, 0),
    )  # fmt: skip
    clips = [replace(good, name=n) for n in "abcde"]
    clips[1] = replace(clips[1], sharpness=0.05)
    clips[2] = replace(clips[2], brightness=160.0, drift=0.3, clipped=0.2)
    clips[3] = replace(clips[3], sound=SoundFacts(-50, 5, 0.1))
    clips.append(replace(good, name="f", error="broken", sharpness=0.0))
    found = clip_faults(clips, Limits())
    assert set(found) == {"b", "c", "d"}
    assert found["b"] == ["blurred: 25% of the usual sharpness"]
    assert len(found["c"]) == len(found["d"]) == 3


def test_charts_mark_what_is_outside() -> None:
    drawn = histogram(np.array([0.0, 5.0, 30.0]), -12, 12, "nod", "degrees")
    assert drawn.count('class="out"') == 1 and drawn.count('class="bar"') == 2
    drawn = dots(["a<", "b"], [0.2, 0.9], 0.4, math.inf, "r")
    assert drawn.count('class="out"') == 1 and "a&lt;: 0.20" in drawn
    assert "nan" not in dots(["a"], [0.5], 0.5, math.inf, "r")
