"""Pronunciations guessed by espeak-ng, with it and without."""

import pickle
import sys
import threading

import numpy as np
import pytest

import analysis.espeak
from analysis.align import Aligner
from analysis.g2p import guess_pronunciation, speaking_lexicon, with_guesses
from database.errors import PronunciationError
from database.phonemes import PHONEME_INDEX
from database.sound import Sound

UNKNOWN = "blorptastic"


@pytest.fixture
def espeak():
    pytest.importorskip("espeakng_loader", reason="needs the optional extra `espeak`")


@pytest.fixture
def no_espeak(monkeypatch):
    """Hide the extra, as on a machine that lacks it."""
    monkeypatch.setitem(sys.modules, "espeakng_loader", None)
    analysis.espeak.library.cache_clear()
    yield
    analysis.espeak.library.cache_clear()


@pytest.mark.usefixtures("espeak")
@pytest.mark.parametrize(
    ("word", "phones"),
    [
        ("hello", "hh ax l ow"),
        ("42", "f ao r d iy t uw"),
        ("blorptastic", "b l ao r p t ey s t ih k"),
        ("Café,", "k ae f ey"),
        ("button", "b ah t ax n"),
        ("(fire)", "f ay er"),
    ],
)
def test_words_and_numbers_are_guessed(word, phones):
    assert guess_pronunciation(word) == tuple(phones.split())


@pytest.mark.usefixtures("espeak")
@pytest.mark.parametrize("word", ["日本", "слово", "!!", "—", "", "١٢"])
def test_what_an_american_voice_cannot_read_is_not_guessed(word):
    assert guess_pronunciation(word) is None


@pytest.mark.usefixtures("espeak")
def test_guesses_agree_with_the_dictionary_on_common_words():
    lexicon = speaking_lexicon()
    closed = {"p", "b", "m"}
    for word in ("people", "water", "little", "number", "mother", "picture", "study", "family"):
        known, guessed = lexicon.pronunciations(word)[0], guess_pronunciation(word)
        assert abs(len(known) - len(guessed)) <= 1, word
        # What closes the lips matters most, and no accent changes it.
        assert [p for p in known if p in closed] == [p for p in guessed if p in closed], word


@pytest.mark.usefixtures("espeak")
def test_only_missing_words_are_guessed_and_noted():
    plain = speaking_lexicon()
    lexicon, notes = with_guesses(plain, ["blue", UNKNOWN, "日本"])
    assert notes == {
        UNKNOWN: "pronunciation of 'blorptastic' guessed by espeak: b l ao r p t ey s t ih k"
    }
    assert lexicon.missing(["blue", UNKNOWN, UNKNOWN.upper(), "日本"]) == ["日本"]
    assert plain.missing([UNKNOWN]) == [UNKNOWN]
    assert with_guesses(plain, ["blue", "now"]) == (plain, {})


@pytest.mark.usefixtures("espeak")
def test_a_lexicon_with_guesses_goes_to_another_process():
    lexicon, _ = with_guesses(speaking_lexicon(), [UNKNOWN])
    data = pickle.dumps(lexicon)
    assert len(data) < 2000
    assert pickle.loads(data).pronunciations(UNKNOWN) == lexicon.pronunciations(UNKNOWN)


@pytest.mark.usefixtures("espeak")
def test_threads_do_not_disturb_each_other():
    words = ["blorptastic", "quizzlewump", "42", "frabjous", "zorch"] * 8
    alone = [guess_pronunciation(w) for w in words]
    together = [None] * len(words)

    def ask(first):
        for i in range(first, len(words), 4):
            together[i] = guess_pronunciation(words[i])

    threads = [threading.Thread(target=ask, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert together == alone


@pytest.mark.usefixtures("espeak")
def test_another_voice_in_the_same_process_changes_nothing(puppet):
    before = guess_pronunciation(UNKNOWN)
    puppet.speak("set red now")
    analysis.espeak.library().espeak_SetVoiceByName(b"de")
    assert guess_pronunciation(UNKNOWN) == before


@pytest.mark.usefixtures("espeak")
def test_a_guess_is_good_enough_to_align_by(puppet):
    sound, _ = puppet.speak(f"set {UNKNOWN} now")
    aligner = Aligner()
    found = aligner.align(sound, ["set", UNKNOWN, "now"])
    assert found.words.words == ("set", UNKNOWN, "now")
    assert found.notes[0].startswith(f"pronunciation of {UNKNOWN!r} guessed by espeak")
    # The note belongs to the clip, not to the first that needed the word.
    assert aligner.align(sound, ["set", UNKNOWN, "now"]).notes == found.notes


@pytest.mark.usefixtures("no_espeak")
def test_without_espeak_nothing_is_guessed():
    assert guess_pronunciation(UNKNOWN) is None
    plain = speaking_lexicon()
    assert with_guesses(plain, [UNKNOWN]) == (plain, {})


@pytest.mark.usefixtures("no_espeak")
def test_without_espeak_the_word_is_asked_for():
    sound = Sound(np.zeros(16000, np.float32), 16000)
    with pytest.raises(PronunciationError, match=f"clip7: .*{UNKNOWN}.*--dictionary.*espeak"):
        Aligner().align(sound, ["blue", UNKNOWN], name="clip7")


def test_the_users_dictionary_comes_first(tmp_path):
    path = tmp_path / "mine.dict"
    path.write_text("blorptastic B L AO1 R P\nblue B OW1\n")
    lexicon = speaking_lexicon(path)
    assert lexicon.pronunciations("blorptastic") == [("b", "l", "ao", "r", "p")]
    assert lexicon.pronunciations("blue") == [("b", "ow")]
    assert lexicon.pronunciations("red")[0] == ("r", "eh", "d")
    assert with_guesses(lexicon, ["blorptastic"]) == (lexicon, {})


def test_a_dictionary_that_cannot_be_read(tmp_path):
    with pytest.raises(PronunciationError, match=r"none\.dict"):
        speaking_lexicon(tmp_path / "none.dict")


@pytest.mark.usefixtures("espeak")
def test_guesses_are_phonemes_of_the_table():
    for word in ("yacht", "rhythm", "loch", "naïve", "zhuzh", "llama", "psst", "1984", "fjord"):
        guessed = guess_pronunciation(word)
        assert guessed is not None and all(p in PHONEME_INDEX for p in guessed), word
