"""Corpus folders: which clips are found, and which script beside a clip is believed."""

import numpy as np
import pytest

from analysis.align import Aligner
from analysis.corpus import align_clip, find_clips, fitted
from database.errors import AlignmentError, CorpusError, TimingError
from database.sound import SPEECH_RATE, Sound
from database.timing import Timing, WordTrack, write_timing
from database.track import Interval, PhonemeTrack

WORDS = "place blue by four now"


def fill(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return folder


def test_clips_are_found_with_their_scripts(tmp_path):
    fill(
        tmp_path, "b.mp4", "b.txt", "a.MPG", "a.TextGrid", "a.align", "a.txt", "c.mov", "notes.txt"
    )
    fill(tmp_path, "sub/d.webm", "sub/d.lab", "b.wav", "picture.png")
    clips = find_clips(tmp_path)
    assert [c.name for c in clips] == ["a", "b", "c", "d"]
    assert [sorted(s.name for s in c.scripts) for c in clips] == [
        ["a.TextGrid", "a.align", "a.txt"],
        ["b.txt"],
        [],
        ["d.lab"],
    ]


def test_a_name_in_two_folders_is_told_apart(tmp_path):
    fill(tmp_path, "day1/x.mp4", "day1/x.txt", "day2/x.mp4", "day2/x.TextGrid", "y.mp4")
    clips = {c.name: c for c in find_clips(tmp_path)}
    assert sorted(clips) == ["day1/x.mp4", "day2/x.mp4", "y"]
    assert [s.name for s in clips["day1/x.mp4"].scripts] == ["x.txt"]
    assert [s.name for s in clips["day2/x.mp4"].scripts] == ["x.TextGrid"]
    left = find_clips(tmp_path, exclude=["day1/x.mp4"])
    assert [c.name for c in left] == ["day2/x.mp4", "y"]


def test_a_limit_is_spread_over_the_names(tmp_path):
    fill(tmp_path, *(f"{i:02}.mp4" for i in range(11)))
    assert [c.name for c in find_clips(tmp_path, limit=3)] == ["00", "05", "10"]
    assert len(find_clips(tmp_path, limit=7)) == 7
    assert len(find_clips(tmp_path, limit=99)) == 11
    # What is left out does not count.
    assert [c.name for c in find_clips(tmp_path, limit=2, exclude=["10"])] == ["00", "09"]
    with pytest.raises(CorpusError, match="at least 1, not 0"):
        find_clips(tmp_path, limit=0)


def test_an_unknown_name_to_exclude_gets_a_hint(tmp_path):
    fill(tmp_path, "bbaf2n.mp4", "lrae3s.mp4")
    with pytest.raises(CorpusError, match="no clip 'bbaf2m' to exclude; near it: bbaf2n"):
        find_clips(tmp_path, exclude=["bbaf2m"])
    with pytest.raises(CorpusError, match=r"no clip '\?\?' to exclude$"):
        find_clips(tmp_path, exclude=["??"])
    with pytest.raises(CorpusError, match="nothing is left"):
        find_clips(tmp_path, exclude=["bbaf2n", "lrae3s"])


def test_folders_that_are_no_corpus(tmp_path):
    with pytest.raises(CorpusError, match="nowhere: is not a folder"):
        find_clips(tmp_path / "nowhere")
    fill(tmp_path, "a.txt", "b.wav")
    with pytest.raises(CorpusError, match=r"holds no media file \(\.avi, "):
        find_clips(tmp_path)
    with pytest.raises(CorpusError, match=r"a\.txt: is not a folder"):
        find_clips(tmp_path / "a.txt")


@pytest.fixture(scope="module")
def aligner():
    return Aligner()


@pytest.fixture(scope="module")
def spoken(puppet):
    if not puppet.can_speak():
        pytest.skip("needs speech: the optional extra `espeak`")
    return puppet.speak(WORDS)


@pytest.fixture
def clip(tmp_path):
    """Give a function that tells the one clip of the folder, with what lies beside it by then."""
    fill(tmp_path, "talk.mp4")
    return lambda: find_clips(tmp_path)[0]


PHONES = PhonemeTrack.from_intervals(
    [Interval(0.5, 0.7, "m"), Interval(0.7, 1.0, "aa")], name="phones"
)


def test_a_phone_level_file_replaces_alignment(tmp_path, clip, aligner):
    words = WordTrack(("ma",), (0.5,), (1.0,))
    write_timing(tmp_path / "talk.TextGrid", Timing(PHONES, words))
    write_timing(tmp_path / "talk.align", WordTrack(tuple(WORDS.split()), *_even(5)))
    (tmp_path / "talk.txt").write_text(WORDS)
    found = align_clip(clip(), None, 1.5, aligner)
    assert found.track.labels == ("sil", "m", "aa", "sil")
    assert found.words.words == ("ma",)
    assert (found.attempts, found.notes) == (0, ())
    assert found.track.end == 1.5


def _even(n, start=0.3, end=1.6):
    edges = np.linspace(start, end, n + 1).tolist()
    return tuple(edges[:-1]), tuple(edges[1:])


def test_word_times_come_before_a_text(tmp_path, clip, aligner, spoken):
    sound, truth = spoken
    free = aligner.align(sound, WORDS.split()).words
    write_timing(tmp_path / "talk.align", free)
    (tmp_path / "talk.txt").write_text("something else altogether")
    found = align_clip(clip(), sound, sound.duration, aligner)
    assert found.words.words == tuple(WORDS.split())
    np.testing.assert_allclose(found.words.starts, free.starts, atol=0.021)
    np.testing.assert_allclose(found.track.speech_span(), truth.speech_span(), atol=0.06)


@pytest.mark.parametrize("name", ["talk.txt", "talk.lab"])
def test_words_alone_are_aligned(tmp_path, clip, aligner, spoken, name):
    sound, truth = spoken
    (tmp_path / name).write_text("Place blue by four, now.\n")
    found = align_clip(clip(), sound, sound.duration, aligner)
    assert found.words.words == ("Place", "blue", "by", "four", "now")
    np.testing.assert_allclose(found.track.speech_span(), truth.speech_span(), atol=0.06)


def test_the_track_lasts_as_long_as_the_picture(tmp_path, clip, aligner, spoken):
    sound, _ = spoken
    (tmp_path / "talk.txt").write_text(WORDS)
    assert align_clip(clip(), sound, 3.0, aligner).track.end == 3.0
    assert align_clip(clip(), sound, 1.2, aligner).track.end == 1.2


def test_a_broken_timing_file_beside_good_words(tmp_path, clip, aligner, spoken):
    sound, _ = spoken
    write_timing(tmp_path / "talk.TextGrid", PHONES)
    whole = (tmp_path / "talk.TextGrid").read_bytes()
    (tmp_path / "talk.TextGrid").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "talk.txt").write_text(WORDS)
    found = align_clip(clip(), sound, sound.duration, aligner)
    assert found.words.words == tuple(WORDS.split())
    assert len(found.notes) == 1
    assert found.notes[0].startswith("not used: ") and "talk.TextGrid" in found.notes[0]


def test_an_empty_text_beside_good_phones(tmp_path, clip, aligner):
    write_timing(tmp_path / "talk.TextGrid", PHONES)
    (tmp_path / "talk.txt").touch()
    assert align_clip(clip(), None, 1.0, aligner).track.labels == ("sil", "m", "aa")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("talk.TextGrid", b""),
        ("talk.TextGrid", b"File type = \"ooTextFile\"\nObject class = \"TextGrid\"\n\n0\n1.5\n"),
        ("talk.lab", b"0 5000000 m\n5000000 4000000 aa\n"),
        ("talk.txt", b"  \n"),
        ("talk.txt", bytes(range(256))),
    ],
)  # fmt: skip
def test_a_broken_file_alone_is_one_clear_error(tmp_path, clip, aligner, name, content):
    (tmp_path / name).write_bytes(content)
    sound = Sound(np.zeros(SPEECH_RATE, np.float32), SPEECH_RATE)
    with pytest.raises(TimingError, match=name.replace(".", r"\.")) as caught:
        align_clip(clip(), sound, 1.0, aligner)
    assert "\n" not in str(caught.value)


def test_no_script(clip, aligner):
    with pytest.raises(CorpusError, match=r"talk\.mp4: has no words; put talk\.txt"):
        align_clip(clip(), None, 1.0, aligner)


def test_words_without_sound(tmp_path, clip, aligner):
    (tmp_path / "talk.txt").write_text(WORDS)
    with pytest.raises(CorpusError, match=r"talk\.mp4: has no sound.*phone-level timing file"):
        align_clip(clip(), None, 1.0, aligner)


def test_words_that_are_not_spoken(tmp_path, clip, aligner, spoken):
    (tmp_path / "talk.txt").write_text("internationalization notwithstanding")
    with pytest.raises(AlignmentError, match=r"talk\.mp4: the words"):
        align_clip(clip(), spoken[0], spoken[0].duration, aligner)


def test_times_beyond_the_clip(tmp_path, clip, aligner):
    write_timing(tmp_path / "talk.TextGrid", PHONES)
    assert align_clip(clip(), None, 0.8, aligner).track.labels == ("sil", "m", "aa")
    with pytest.raises(CorpusError, match="beyond the clip's end at 0"):
        fitted(PhonemeTrack(PHONES.phonemes[1:], PHONES.boundaries[1:]), 0.2)


def test_words_beside_given_phones_are_kept(tmp_path, clip, aligner, spoken):
    """A timing of phones alone leaves the words to the text."""
    write_timing(tmp_path / "talk.lab", spoken[1])
    (tmp_path / "talk.txt").write_text("place blue now")
    found = align_clip(clip(), spoken[0], spoken[0].duration, aligner)
    assert found.given
    assert found.words is None
    assert found.text == "place blue now"
    (tmp_path / "talk.txt").unlink()
    assert align_clip(clip(), spoken[0], spoken[0].duration, aligner).text == ""
