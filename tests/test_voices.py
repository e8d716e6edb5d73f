"""espeak's voices: nothing that they say is lost on its way to Table 1, and its times are true.

`data/espeak_inventory.json` holds each symbol that four voices were heard to say, with a text in
which it occurs. For English every seventh or ninth word of the CMU dictionary was spoken, for Greek
10 000 syllables, for Mandarin all Chinese characters of Unicode's first block.
"""

from __future__ import annotations

import json
import re
import threading
from pathlib import Path

import numpy as np
import pytest

import unitsel
from analysis.espeak import voices
from analysis.utterance import say
from database.alphabets import VOWELS
from database.phonemes import PHONEMES
from database.sound import Sound, read_sound, resampled
from database.voice_symbols import ENGLISH, render_intervals, render_symbol

HERE = Path(__file__).parent
INVENTORY = json.loads((HERE / "data" / "espeak_inventory.json").read_text(encoding="utf-8"))
VOICES = ("en-us", "en-gb", "el", "cmn")
STRESS = re.compile("[ˈˌ]")

FOREIGN = {
    "en-us": "r x ɑ̃ ɬ",
    "en-gb": "r x ɬ",
    "el": "c o r ts x ç ɣ ɲ ʎ ʲ",
    "cmn": "i. io iou iɑ iɛ i̪ o o- onɡ r s. ts ts. ts.h tsh tɕ tɕh ua uai uei uo uə y yi yæ yə yɛ "
    "ŋ- ɕ ər ʐ χ",
}
"""What English lacks."""


@pytest.fixture
def espeak() -> None:
    pytest.importorskip("espeakng_loader", reason="needs the optional extra `espeak`")


def test_the_inventories_are_whole() -> None:
    assert {v: len(s) for v, s in INVENTORY.items()} == {
        **{"en-us": 61, "en-gb": 53, "el": 33, "cmn": 75},
    }


@pytest.mark.parametrize("voice", VOICES)
def test_no_symbol_of_a_voice_is_lost(voice: str) -> None:
    for symbol in INVENTORY[voice]:
        said = render_symbol(symbol)
        assert said.known, symbol
        assert said.phonemes and set(said.phonemes) <= set(PHONEMES) - {"sil"}, symbol
        assert sum(said.shares) == pytest.approx(1) and min(said.shares) > 0.1, symbol
        # A vowel becomes a vowel, and a consonant none.
        vowel = bool(set(symbol) & set("aæɐɑɒeɛəɚɜiɪᵻoɔuʊʌy")) or symbol == "n̩"
        assert bool(set(said.phonemes) & VOWELS) == vowel, symbol
        assert render_symbol(f"ˈ{symbol}").phonemes == said.phonemes
    foreign = {render_symbol(s).symbol for s in INVENTORY[voice] if not render_symbol(s).exact}
    assert foreign <= set(FOREIGN[voice].split())


@pytest.mark.usefixtures("espeak")
@pytest.mark.parametrize("voice", VOICES)
def test_a_voice_says_its_inventory_and_nothing_else(voice: str) -> None:
    heard: set[str] = set()
    for text in dict.fromkeys(INVENTORY[voice].values()):
        said = say(text, voice, lambda piece: None)
        heard |= {STRESS.sub("", p.label) for p in said.phones}
        assert all(p.end - p.start > 0.005 for p in said.phones if p.label), text
    assert heard - {""} == set(INVENTORY[voice])


@pytest.mark.usefixtures("espeak")
@pytest.mark.parametrize(
    ("voice", "text", "phonemes", "words"),
    [
        ("en-us", "It's 25, Dr. Map.", "ih t s t w eh n t iy f ay v sil d aa k t er m ae p",
         "It's 25, Dr. Map."),
        ("en-gb", "The cat, at home.", "dh ax k ae t sil ae t hh ow m", "The cat, at home."),
        ("el", "Γειά σου. Μπορώ;", "y ae s uw sil b ow r ow", "Γειά σου. Μπορώ;"),
        ("cmn", "你好。中国", "n iy k aw sil ch ow ng k w ow", None),
    ],
)  # fmt: skip
def test_sentences_keep_their_order_and_pauses(
    voice: str, text: str, phonemes: str, words: str | None
) -> None:
    speech = unitsel.speak(text, voice=voice)
    assert " ".join(speech.track.labels) == f"sil {phonemes} sil"
    assert speech.words is not None
    if words is not None:
        assert list(speech.words.words) == words.split()
    assert isinstance(speech.sound, Sound)
    assert speech.track.end == pytest.approx(speech.sound.duration, abs=1e-3)
    assert {r.symbol for r in speech.approximated} <= set(FOREIGN[voice].split())


@pytest.mark.parametrize(
    ("symbol", "phonemes"),
    [
        ("kh", "k"), ("ts.h", "ch"), ("tɕ", "ch"), ("iou", "y ow"),
        ("ˈuai", "w ay"), ("yɛ", "w eh"), ("onɡ", "ow ng"), ("ŋ-", "ng"), ("o-", "ah"), ("ʲ", "y"),
        ("rʲ", "r"), ("ˈɑu5", "aw"),
        ("aː", "aa"), ("a", "ae"), ("ɔ̃", "ao"), ("ts", "t s"), ("tsʰ", "t s"), ("ʘ", "p"),
        ("", "sil"), ("ˈ", "sil"), ("d͡ʒ", "jh"), ("œ̃ː", "er"),
        ("tS", "ch"), ("?ɑ", "t aa"), ("ε", "eh"),
    ],
)  # fmt: skip
def test_symbols_of_any_voice(symbol: str, phonemes: str) -> None:
    said = render_symbol(symbol)
    assert said.known and " ".join(said.phonemes) == phonemes


@pytest.mark.usefixtures("espeak")
def test_every_voice_is_understood() -> None:
    unknown, spoken = set(), 0
    for voice in voices():
        try:
            speech = unitsel.speak("1 2 3 8 10 100 radio taxi", voice=voice.languages[0])
        except unitsel.SpeechError:
            continue  # Three voices come without their dictionaries.
        spoken += 1
        unknown |= {r.symbol for r in speech.approximated if not r.known}
    assert spoken > 100
    assert unknown <= {"\u0303"}, "a nasal mark on its own, in Bishnupriya Manipuri"


def test_a_symbol_that_nobody_knows_is_told() -> None:
    said = render_symbol("ß☃")
    assert not said.known and not said.exact
    assert str(said).endswith("(unknown)")


def test_a_glide_is_shorter_than_its_vowel_and_affricates_are_halved() -> None:
    spans, foreign = render_intervals(
        [unitsel.Interval(0, 0.3, "ˈuo"), unitsel.Interval(0.3, 0.5, "ts")]
    )
    assert [s.label for s in spans] == ["w", "ow", "t", "s"]
    assert [s.end for s in spans] == pytest.approx([0.075, 0.3, 0.4, 0.5])
    assert list(foreign) == ["uo", "ts"]


def test_english_s_own_sounds_are_known_to_be_so() -> None:
    assert all(render_symbol(s).known for s in ENGLISH)


@pytest.mark.usefixtures("espeak")
def test_the_lips_meet_where_the_sound_stops() -> None:
    speech = unitsel.speak("happy papa")
    sound = resampled(speech.sound, 16000)
    stops = [i for i in speech.track.intervals() if i.label == "p"]
    assert len(stops) == 3
    for p in stops:
        first, last = round(p.start * 16000), round(p.end * 16000)
        closed = np.abs(sound.samples[first + 80 : first + 480])
        assert closed.max() < 0.01, "a p begins with its closure, 30 ms of silence"
        assert np.abs(sound.samples[first + 480 : last]).max() > 0.01, "and ends with its burst"
        before = np.abs(sound.samples[first - 480 : first - 80])
        assert before.max() > 0.01


@pytest.mark.usefixtures("espeak")
def test_speech_is_the_same_in_memory_and_in_a_file_and_from_threads(tmp_path: Path) -> None:
    text = "One two three. Four, five!"
    held = unitsel.speak(text)
    kept = unitsel.speak(text, wav=tmp_path / "a.wav")
    assert kept.track.labels == held.track.labels
    # A period or two more or less: the voice's pitch goes on from what was said before.
    np.testing.assert_allclose(kept.track.boundaries, held.track.boundaries, atol=0.03)
    assert isinstance(held.sound, Sound) and kept.sound == tmp_path / "a.wav"
    assert read_sound(tmp_path / "a.wav").duration == pytest.approx(kept.track.end, abs=1e-3)
    for speech in (held, kept):
        heard = speech.heard()
        assert heard.rate == 16000 and heard.duration == pytest.approx(speech.track.end, abs=2e-3)
        start, end = speech.track.speech_span()
        loud = np.flatnonzero(np.abs(heard.samples) > 0.02) / 16000
        assert loud[0] == pytest.approx(start, abs=0.03)
        assert loud[-1] == pytest.approx(end, abs=0.1)
    voices = ["el", "en-us", "cmn", "en-gb"] * 2
    found: dict[int, tuple[str, ...]] = {}

    def task(k: int) -> None:
        found[k] = unitsel.speak("42", voice=voices[k]).track.labels

    threads = [threading.Thread(target=task, args=(k,)) for k in range(len(voices))]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert found == {k: unitsel.speak("42", voice=v).track.labels for k, v in enumerate(voices)}


@pytest.mark.usefixtures("espeak")
def test_an_error_while_it_speaks_comes_through() -> None:
    def full(piece: object) -> None:
        raise OSError("the disk is full")

    with pytest.raises(OSError, match="the disk is full"):
        say("hello", "en-us", full)
    assert say("hello", "en-us", lambda piece: None).duration > 0.2


@pytest.mark.usefixtures("espeak")
def test_a_long_text_is_handed_over_in_small_pieces() -> None:
    pieces: list[int] = []
    text = "The quick brown fox, number 7, jumps over Dr. Lee's lazy dog. " * 80
    said = say(text, "en-us", lambda piece: pieces.append(len(piece)), 450)
    assert max(pieces) < 22050 and sum(pieces) / 22050 == pytest.approx(said.duration)
    assert len(said.words) == len(text.split())
    assert [w.label for w in said.words[-12:]] == text.split()[-12:]
    gaps = [b.start - a.end for a, b in zip(said.phones, said.phones[1:], strict=False)]
    assert max(map(abs, gaps)) < 1e-9
