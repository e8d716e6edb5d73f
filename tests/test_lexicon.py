"""Pronunciations of words."""

import pickle
from pathlib import Path

import pytest

from database.errors import PronunciationError, TrackError
from database.lexicon import DURATIONS, Lexicon, spread_words
from database.phonemes import PHONEMES
from database.symbols import VOWELS
from database.timing import WordTrack


@pytest.fixture(scope="module")
def cmu() -> Lexicon:
    return Lexicon.default()


def test_all_variants_the_first_first(cmu: Lexicon) -> None:
    assert cmu.pronunciations("hello") == [("hh", "ah", "l", "ow"), ("hh", "eh", "l", "ow")]
    assert cmu.arpabet("hello") == [("HH", "AH", "L", "OW"), ("HH", "EH", "L", "OW")]


def test_a_lone_a_is_the_letter_first_and_the_article_second(cmu: Lexicon) -> None:
    assert cmu.pronunciations("a") == [("ey",), ("ah",)]
    assert cmu.pronunciations("A") == cmu.pronunciations("a")


def test_every_letter_has_a_name(cmu: Lexicon) -> None:
    assert cmu.missing("abcdefghijklmnopqrstuvwxyz") == []
    assert cmu.pronunciations("w")[0] == ("d", "ah", "b", "ah", "l", "y", "uw")


@pytest.mark.parametrize(
    ("written", "word"),
    [
        ("Hello,", "hello"),
        ("“don’t!”", "don't"),
        ("'hello'", "hello"),
        ("'cause", "'cause"),
        ("a.m.", "a.m."),
        ("boys'", "boys"),
        ("now.", "now"),
    ],
)
def test_case_and_punctuation_do_not_matter(cmu: Lexicon, written: str, word: str) -> None:
    assert cmu.pronunciations(written) == cmu.pronunciations(word)


def test_compounds_are_made_of_their_parts(cmu: Lexicon) -> None:
    (only,) = cmu.pronunciations("well-known")
    assert only == cmu.pronunciations("well")[0] + cmu.pronunciations("known")[0]
    assert len(cmu.pronunciations("the-the-the-the")) == 8
    assert "well-zzyx" not in cmu


@pytest.mark.parametrize("word", ["zzyx", "3", "", "--", "!", "x" * 500, "\x00"])
def test_an_unknown_word_is_named_with_the_remedy(cmu: Lexicon, word: str) -> None:
    assert word not in cmu
    with pytest.raises(PronunciationError) as caught:
        cmu.pronunciations(word)
    message = str(caught.value)
    assert repr(word[:40]) in message
    assert "--dictionary" in message
    assert "espeak" in message
    assert "\n" not in message


def test_missing_words_are_listed_once_in_order(cmu: Lexicon) -> None:
    assert cmu.missing(["bin", "zzyx", "blue", "qwertz", "zzyx"]) == ["zzyx", "qwertz"]


def test_a_users_dictionary_adds_and_replaces(cmu: Lexicon, tmp_path: Path) -> None:
    file = tmp_path / "mine.dict"
    file.write_text(
        ";;; mine\nZzyx Z IH1 K S\nzzyx(2) Z AY1 K S\n\nhello HH AH0 L OW1\n# end\n<unk> SPN\n"
    )
    both = cmu.extended(file)
    assert both.pronunciations("zzyx") == [("z", "ih", "k", "s"), ("z", "ay", "k", "s")]
    assert both.pronunciations("hello") == [("hh", "ax", "l", "ow")]
    assert both.arpabet("hello") == [("HH", "AH", "L", "OW")]
    assert both.pronunciations("bin") == cmu.pronunciations("bin")
    assert "zzyx" not in cmu
    alone = Lexicon.read(file)
    assert "bin" not in alone
    assert "<unk>" not in alone
    assert alone.pronunciations("zzyx") == both.pronunciations("zzyx")


def test_a_dictionary_in_ipa_with_mfas_probabilities(tmp_path: Path) -> None:
    file = tmp_path / "mfa.dict"
    file.write_text("red\t0.99\t0.15\t1.0\t1.0\tɹ ɛ d\nray\tɹ ej\n", encoding="utf-8")
    assert Lexicon.read(file).pronunciations("red") == [("r", "eh", "d")]
    assert Lexicon.read(file).pronunciations("ray") == [("r", "ey")]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"bin B IH N\nblue\n", "line 2: expected 'word phone phone ...', got 'blue'"),
        (b"bin B IH N\nblue B LL UW\n", "line 2: unknown phoneme 'LL'.*nearest known"),
        (b"\x89PNG\r\n\x1a\n\x00", "line 1: expected text in UTF-8"),
        (b"bin B IH N\x00\n", "control character"),
        (b";;; nothing\n", "holds no word"),
    ],
)
def test_a_dictionary_that_cannot_be_read(tmp_path: Path, content: bytes, said: str) -> None:
    file = tmp_path / "bad.dict"
    file.write_bytes(content)
    with pytest.raises(PronunciationError, match=said) as caught:
        Lexicon.read(file)
    assert str(caught.value).startswith(str(file))


def test_a_dictionary_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(PronunciationError, match=r"none\.dict: cannot be read"):
        Lexicon.default().extended(tmp_path / "none.dict")


def test_entries_of_a_g2p_are_checked(cmu: Lexicon) -> None:
    assert cmu.with_entries({"Zzyx": [("z", "ih")]}).pronunciations("zzyx") == [("z", "ih")]
    with pytest.raises(PronunciationError, match=r"'zzyx'.*unknown phoneme 'QQ'"):
        cmu.with_entries({"zzyx": [("QQ",)]})
    with pytest.raises(PronunciationError, match="'zzyx': holds no phoneme"):
        cmu.with_entries({"zzyx": [()]})


def test_a_lexicon_is_small_to_send_to_another_process(cmu: Lexicon) -> None:
    cmu.pronunciations("bin")
    data = pickle.dumps(cmu)
    assert len(data) < 1000
    assert pickle.loads(data).pronunciations("bin") == [("b", "ih", "n")]


def test_the_table_of_lengths_is_whole() -> None:
    assert set(DURATIONS) == set(PHONEMES)
    consonants = set(PHONEMES) - VOWELS - {"sil"}
    assert min(DURATIONS[v] for v in VOWELS) > max(DURATIONS[c] for c in consonants)


def test_words_are_spread_over_their_time(cmu: Lexicon) -> None:
    words = WordTrack(("bin", "a"), (0.2, 0.5), (0.5, 0.7), duration=1.0)
    t = spread_words(words, cmu)
    assert t.labels == ("sil", "b", "ih", "n", "ey", "sil")
    total = DURATIONS["b"] + DURATIONS["ih"] + DURATIONS["n"]
    ih_start = 0.2 + 0.3 * DURATIONS["b"] / total
    n_start = ih_start + 0.3 * DURATIONS["ih"] / total
    assert t.boundaries.tolist() == pytest.approx([0, 0.2, ih_start, n_start, 0.5, 0.7, 1.0])


def test_words_that_cannot_be_spread(cmu: Lexicon) -> None:
    with pytest.raises(PronunciationError, match="'zzyx'"):
        spread_words(WordTrack(("zzyx",), (0,), (1,)), cmu)
    with pytest.raises(TrackError, match="has no length"):
        spread_words(WordTrack(("hello",), (0,), (2e-6,)), cmu)
