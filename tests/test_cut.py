"""Long recordings cut at pauses, and their timing files with them."""

import numpy as np
import pytest

from analysis.cut import CutSettings, cut_at_pauses, pauses, timing_of_piece
from database.errors import CorpusError
from database.timing import Timing, WordTrack
from database.track import Interval, PhonemeTrack


def speech(seed=0, n=120, gap=0.3):
    """Words of some length, every third followed by a pause."""
    rng = np.random.default_rng(seed)
    words, at = [], 0.5
    for i in range(n):
        length = rng.uniform(0.15, 0.5)
        words.append(Interval(at, at + length, f"w{i}"))
        at += length + (rng.uniform(gap, 2 * gap) if i % 3 == 2 else rng.uniform(0, 0.1))
    return WordTrack.from_intervals(words, duration=at + 0.5)


@pytest.mark.parametrize("fps", [25.0, 30000 / 1001, 50.0])
@pytest.mark.parametrize("seed", range(5))
def test_pieces_cover_all_and_cut_no_word(fps, seed):
    words = speech(seed)
    pieces = cut_at_pauses(Timing(None, words), words.duration, fps)
    assert pieces[0][0] == 0 and pieces[-1][1] == words.duration
    assert [a for a, _ in pieces[1:]] == [b for _, b in pieces[:-1]]
    lengths = np.array([b - a for a, b in pieces])
    assert lengths.min() >= 2 and lengths.max() <= 12
    assert abs(np.median(lengths) - 6) < 1
    for cut, _ in pieces[1:]:
        assert abs(cut * fps - round(cut * fps)) < 1e-6
        before = max(e for e in words.ends if e <= cut)
        after = min(s for s in words.starts if s >= cut)
        assert not any(s < cut < e for s, e in zip(words.starts, words.ends, strict=True))
        assert abs(cut - (before + after) / 2) <= 0.5 / fps + 1e-9
        assert after - before >= 0.2


def test_speech_without_a_pause_is_not_cut():
    words = [Interval(0.4 * i, 0.4 * i + 0.3, "la") for i in range(100)]
    track = WordTrack.from_intervals(words)
    assert cut_at_pauses(Timing(None, track), 41.0, 25) == [(0.0, 41.0)]
    late = [*words, Interval(41, 42, "la"), Interval(43, 44, "la")]
    pieces = cut_at_pauses(Timing(None, WordTrack.from_intervals(late)), 44.0, 25)
    assert pieces[0][1] == pytest.approx(40.44, abs=0.05)


def test_a_silent_phone_inside_a_word_is_no_pause():
    words = WordTrack.from_intervals([Interval(0, 3, "stop"), Interval(3.5, 4, "go")])
    phones = PhonemeTrack.from_intervals(
        [
            *(Interval(0, 1, "aa"), Interval(1, 1.5, "sil"), Interval(1.5, 3, "p")),
            *(Interval(3, 3.5, "sil"), Interval(3.5, 4, "ow")),
        ]
    )
    assert pauses(Timing(phones, words), 4, 0.2) == [(3, 3.5)]
    assert pauses(Timing(phones), 4, 0.2) == [(1, 1.5), (3, 3.5)]
    assert pauses(Timing(None, words), 4, 0.6) == []


def test_what_a_timing_file_says_of_a_piece():
    words = WordTrack.from_intervals(
        [Interval(1, 1.5, "one"), Interval(2, 2.4, "two"), Interval(3, 3.5, "three")]
    )
    phones = PhonemeTrack.from_intervals(
        [
            *(Interval(1, 1.2, "w"), Interval(1.2, 1.5, "n"), Interval(2, 2.4, "uw")),
            *(Interval(3, 3.5, "r"),),
        ]
    )
    piece = timing_of_piece(Timing(phones, words), 1.8, 2.7, "a.TextGrid")
    assert piece.words.words == ("two",)
    assert piece.words.starts == pytest.approx((0.2,))
    assert piece.words.duration == pytest.approx(0.9)
    assert piece.phones.labels == ("sil", "uw", "sil")
    assert piece.phones.boundaries == pytest.approx([0, 0.2, 0.6, 0.9])
    # A hundredth of a second over the edge is rounding.
    edge = timing_of_piece(Timing(None, words), 2.01, 3.49, "a.TextGrid")
    assert edge.words.words == ("two", "three")
    assert edge.words.starts[0] == 0 and edge.words.ends[-1] == pytest.approx(1.48)


def test_pieces_that_do_not_fit_the_words():
    words = WordTrack.from_intervals([Interval(1, 1.5, "one"), Interval(2, 2.4, "two")])
    with pytest.raises(CorpusError, match=r"a\.lab: the piece's edge at 1\.30 s lies inside the "):
        timing_of_piece(Timing(None, words), 1.3, 3, "a.lab")
    with pytest.raises(CorpusError, match=r"edge at 2\.20 s .* word 'two' \(2\.00 to 2\.40 s\)"):
        timing_of_piece(Timing(None, words), 0.5, 2.2, "a.lab")
    with pytest.raises(CorpusError, match=r"a\.lab: has no word from 5\.00 to 6\.00 s"):
        timing_of_piece(Timing(None, words), 5, 6, "a.lab")


def test_the_wanted_length_is_a_setting():
    words = speech(3)
    settings = CutSettings(wanted=3.0, longest=5.0)
    pieces = cut_at_pauses(Timing(None, words), words.duration, 25, settings)
    assert abs(np.median([b - a for a, b in pieces]) - 3) < 0.7
