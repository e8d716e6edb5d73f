"""Subtitles bound the words of an alignment by their cues, not by guesses inside them."""

from pathlib import Path

import numpy as np
import pytest

from analysis.align import Aligner, AlignSettings
from analysis.corpus import Clip, align_clip
from database.errors import TimingError
from database.sound import Sound
from database.timing import WordTrack, parse_timing, write_timing
from database.track import PhonemeTrack

RATE = 16000
FIRST, SECOND = "set white with nine again", "place blue by four now"


@pytest.fixture(scope="module")
def aligner():
    return Aligner()


@pytest.fixture(scope="module")
def spoken(puppet, aligner):
    """Two sentences with half a second between; where each begins; their words as heard."""
    if not puppet.can_speak():
        pytest.skip("needs speech: the optional extra `espeak`")
    parts = [puppet.speak(s)[0].samples for s in (FIRST, SECOND)]
    gap = np.zeros(RATE // 2, np.float32)
    sound = Sound(np.concatenate([parts[0], gap, parts[1]]), RATE)
    edges = (len(parts[0]) / RATE, (len(parts[0]) + len(gap)) / RATE, sound.duration)
    return sound, edges, aligner.align(sound, f"{FIRST} {SECOND}".split()).words


def clock(seconds):
    return f"00:{int(seconds) // 60:02d}:{seconds % 60:06.3f}"


def subtitles(*cues):
    rows = [f"{i}\n{clock(a)} --> {clock(b)}\n{text}\n" for i, (a, b, text) in enumerate(cues, 1)]
    return "\n".join(rows).replace(".", ",")


def test_cues_leave_the_words_where_they_are_heard(spoken, aligner):
    sound, (end, start, last), free = spoken
    text = subtitles((0, end + 0.2, FIRST + "!"), (start - 0.1, last, SECOND.capitalize()))
    words = parse_timing("a.srt", text.encode()).words
    assert words.words[5] == "Place" and len(set(words.cues)) == 2
    guessed = np.abs(np.array(words.starts) - free.starts)
    assert guessed.max() > 2 * AlignSettings().tolerance, "the guesses happen to be right"
    found = aligner.align_bounded(sound, words)
    assert found.words.words[:5] == free.words[:5]
    np.testing.assert_allclose(found.words.starts, free.starts, atol=0.021)
    np.testing.assert_allclose(found.words.ends, free.ends, atol=0.021)


def test_a_cue_that_contradicts_the_sound_wins(spoken, aligner):
    """Whoever says when a cue is means it; its words are searched there, and a note says so."""
    sound, (end, start, last), free = spoken
    words = parse_timing("a.srt", subtitles((0, end, FIRST), (start, last, SECOND)).encode()).words
    late = WordTrack(
        words.words,
        (*words.starts[:5], *np.linspace(last - 0.5, last - 0.1, 5)),
        (*words.ends[:5], *np.linspace(last - 0.4, last, 5)),
        cues=words.cues,
    )
    found = aligner.align_bounded(sound, late)
    np.testing.assert_allclose(found.words.starts[:5], free.starts[:5], atol=0.021)
    slack = AlignSettings().cue_tolerance
    assert min(found.words.starts[5:]) >= last - 0.5 - slack - 0.011


def test_cues_without_speech_share_their_time(aligner):
    sound = Sound(np.random.default_rng(0).normal(0, 0.05, 3 * RATE).astype(np.float32), RATE)
    words = parse_timing("a.srt", subtitles((0.5, 1.5, "place blue")).encode()).words
    found = aligner.align_bounded(sound, words)
    assert found.words.words == ("place", "blue")
    assert found.words.starts[0] >= 0.5 - AlignSettings().cue_tolerance
    assert any("the cue 'place blue'" in note or "one by one" in note for note in found.notes)


def test_subtitles_beside_a_clip_are_its_words(spoken, aligner, tmp_path):
    sound, (end, start, last), free = spoken
    script = tmp_path / "a.vtt"
    cues = subtitles((0, end, FIRST), (start, last, SECOND)).replace(",", ".")
    script.write_text(f"WEBVTT\n\n{cues}")
    shapes = tmp_path / "a.tsv"
    write_timing(shapes, PhonemeTrack(np.array([1]), np.array([0, 1.0])))
    clip = Clip("a", Path("a.mp4"), (shapes, script))
    found = align_clip(clip, sound, sound.duration, aligner)
    assert found.words.words == free.words
    assert any("holds mouth shapes" in note for note in found.notes)
    with pytest.raises(TimingError, match=r"a\.tsv: holds mouth shapes.* put the words beside"):
        align_clip(Clip("a", Path("a.mp4"), (shapes,)), sound, sound.duration, aligner)
