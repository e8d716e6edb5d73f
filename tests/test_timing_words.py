"""Words and their times."""

import math
from pathlib import Path

import pytest

from database.errors import TimingError, TrackError
from database.timing import Timing, WordTrack, clean_word, read_timing, read_words

DATA = Path(__file__).parent / "data" / "timing"


def test_words_of_a_text_file() -> None:
    words = read_words(DATA / "words-with-punctuation.txt")
    assert words == ["Bin", "blue", "at", "F", "two", "now"]


def test_words_of_a_lab_file_without_times(tmp_path: Path) -> None:
    file = tmp_path / "a.lab"
    file.write_text("bin blue at\nf 2 now\n")
    assert read_words(file) == ["bin", "blue", "at", "f", "2", "now"]
    with pytest.raises(TimingError, match=r"a\.lab: line 1: .*words without times; .*words file"):
        read_timing(file)


@pytest.mark.parametrize("file", ["htk-words.lab", "grid-words.align", "words-only.TextGrid"])
def test_a_timing_file_is_no_words_file(file: str) -> None:
    with pytest.raises(TimingError, match="expected words only, this is a timing file"):
        read_words(DATA / file)


def test_a_words_file_is_no_timing_file() -> None:
    with pytest.raises(TimingError, match=r"\.txt: holds words without times; expected .*\.pho"):
        read_timing(DATA / "words-with-punctuation.txt")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b" \r\n\t", "is empty"),
        (b"\xef\xbb\xbf", "is empty"),
        (b"... --- !", "only punctuation"),
        (b"bin\nbl\xfce\n", "line 2: expected text in UTF-8, got byte 0xfc at offset 6"),
        (b"bin\n\x00\x01\x02", "line 2: expected text, got the control character"),
        (b"\xff\xfeb\x00i", "UTF-8"),
    ],
)
def test_words_that_cannot_be_read(tmp_path: Path, content: bytes, said: str) -> None:
    file = tmp_path / "a.txt"
    file.write_bytes(content)
    with pytest.raises(TimingError, match=said) as caught:
        read_words(file)
    assert str(caught.value).startswith(f"{file}: ")


@pytest.mark.parametrize(
    ("token", "word"),
    [
        ("Hello,", "Hello"), ("“now”", "now"), ("don’t", "don't"), ("'cause", "'cause"),
        ("'quoted'", "quoted"), ("a.m.", "a.m."), ("(a.m.)", "a.m"), ("now.", "now"),
        ("...", ""), ("—", ""), ("''", ""), ("well-known;", "well-known"), ("3", "3"), ("é", "é"),
        ("e\u0301", "é"),
    ],
)  # fmt: skip
def test_cleaning(token: str, word: str) -> None:
    assert clean_word(token) == word


def test_a_word_track_lasts_at_least_as_long_as_its_words() -> None:
    assert WordTrack(("a",), (0.0,), (1.0,)).duration == 1.0
    assert WordTrack(("a",), (0.0,), (1.0,), 0.5).duration == 1.0
    assert WordTrack(("a",), (0.0,), (1.0,), 2.5).duration == 2.5


@pytest.mark.parametrize(
    ("words", "starts", "ends", "said"),
    [
        ((), (), (), "holds no word"),
        (("a",), (0.0, 1.0), (1.0,), "1 words have 2 starts and 1 ends"),
        (("a b",), (0.0,), (1.0,), "one word, without spaces"),
        (("",), (0.0,), (1.0,), "one word, without spaces"),
        (("a",), (-1.0,), (1.0,), "not negative"),
        (("a",), (0.0,), (math.nan,), "finite"),
        (("a",), (1.0,), (1.0,), "has no length"),
        (("a", "b"), (0.0, 0.5), (1.0, 2.0), r"word 2 \('b', 0.5 to 2 s\): starts before"),
    ],
)
def test_words_that_cannot_be_a_track(
    words: tuple[str, ...], starts: tuple[float, ...], ends: tuple[float, ...], said: str
) -> None:
    with pytest.raises(TrackError, match=said):
        WordTrack(words, starts, ends, name="w")


def test_a_timing_holds_something() -> None:
    with pytest.raises(TrackError, match="neither phones nor words"):
        Timing(None, None)
