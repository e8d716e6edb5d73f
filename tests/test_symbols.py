"""Phoneme alphabets into Table 1."""

from pathlib import Path

import pocketsphinx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from database.alphabets import ARPABET, ESPEAK, IPA, VOWELS
from database.errors import PhonemeError, UnitselError
from database.phonemes import PHONEMES
from database.symbols import (
    ALPHABETS,
    best_alphabet,
    detect_alphabet,
    expand_intervals,
    to_arpabet,
    to_phonemes,
    to_sampa,
    unknown_symbols,
)
from database.track import Interval, PhonemeTrack

# What espeak-ng 1.52 prints for English words, en-us and en-gb (stress marks kept).
ESPEAK_SAID = """
0 3 3: ; ? @ @- @L A: A@ A~ D E I I# I2 N O2 O: O@ OI O~ S T U U@ V Z a a# aI aI3 aI@ aU aa b d dZ
e@ eI f g h i i: i@ i@3 j k l l# m n n- o@ oU p r r- s t t# t2 tS u: v w x z
'0 '3: 'A: 'aI 'eI ,I ,n- ,i@3 'O 'aI2 w# IR VR t[
"""
ESPEAK_IPA_SAID = """
aɪ aɪə aɪɚ aʊ b d dʒ eɪ f h i iə iː j k l m n n̩ oʊ p r s t tʃ uː v w x z æ ð ŋ ɐ ɑː ɑːɹ ɑ̃ ɔ ɔɪ ɔː
ɔːɹ ɔ̃ ə əl ɚ ɛ ɛɹ ɜː ɡ ɪ ɪɹ ɬ ɹ ɾ ʃ ʊ ʊɹ ʌ ʒ ʔ θ ᵻ ˈaɪ ˈɑːɹ ˌn̩ ˈɜː əʊ eə ʊə ɒ ˈəʊ a aː eː oː ʍ
ʌʉ əɹ ʉ ʉː o e t̪
"""
# Phones of MFA's English IPA models.
MFA_IPA = """
a aj aw aː b bʲ c cʰ cʷ d dʒ dʲ d̪ e ej eː f fʲ h i iː j k kʰ kʷ l m mʲ m̩ n n̩ o ow oː p pʰ pʲ pʷ s
t tʃ tʰ tʲ tʷ t̪ u uː v vʲ w z æ ç ð ŋ ɐ ɑ ɑː ɒ ɒː ɔ ɔj ɔː ə əw ɚ ɛ ɛː ɜ ɜː ɝ ɟ ɟʷ ɡ ɡʷ ɪ ɫ ɫ̩ ɱ ɲ
ɹ ɾ ɾʲ ʃ ʉ ʉː ʊ ʋ ʎ ʒ ʔ θ kp ɡb ʈ ɖ
"""
SAMPA_ENGLISH = """
p b t d k g f v T D s z S Z h m n N l r w j tS dZ I E { Q V U @ i: eI aI OI u: @U aU I@ e@ U@ 3:
A: O: 3` @` r= l= n= m= i u A O EI AI AU 4 ? p_h t_h k_h " "i: %aI
"""


@pytest.mark.parametrize(
    ("symbol", "phonemes"),
    [
        ("AH0", "ax"), ("AH1", "ah"), ("AH", "ah"), ("IH0", "ix"), ("IH2", "ih"), ("ER0", "er"),
        ("AXR", "er"), ("OY1", "oy"), ("HH", "hh"), ("NG", "ng"), ("SIL", "sil"), ("ah0", "ax"),
        ("DX", "d"), ("EN", "ax n"), ("tcl", "t"), ("h#", "sil"), ("sp", "sil"), ("spn", "sil"),
    ],
)  # fmt: skip
def test_arpabet(symbol: str, phonemes: str) -> None:
    assert to_phonemes(symbol, "arpabet") == tuple(phonemes.split())


@pytest.mark.parametrize(
    ("symbol", "phonemes"),
    [
        ("ɑː", "aa"), ("ɒ", "aa"), ("æ", "ae"), ("a", "ae"), ("aː", "aa"), ("ə", "ax"),
        ("ɐ", "ax"), ("ᵻ", "ix"), ("ɜː", "er"), ("ɚ", "er"), ("ɝ", "er"), ("ə˞", "er"),
        ("ɑ˞", "aa r"), ("aɪ", "ay"), ("a͡ɪ", "ay"), ("ˈeɪ", "ey"), ("əʊ", "ow"), ("oʊ", "ow"),
        ("ɔɪ", "oy"), ("aʊ", "aw"), ("ɪə", "ih ax"), ("eə", "eh ax"), ("ʊə", "uh ax"),
        ("aɪɚ", "ay er"), ("ɔːɹ", "ao r"), ("əl", "ax l"), ("n̩", "ax n"), ("ɫ̩", "ax l"),
        ("ɹ̩", "er"), ("ɾ", "d"), ("ʔ", "t"), ("ɹ", "r"), ("ɫ", "l"), ("ɡ", "g"), ("g", "g"),
        ("t͡ʃ", "ch"), ("tʃʰ", "ch"), ("dʒ", "jh"), ("x", "k"), ("ç", "hh"), ("c\u0327", "hh"),
        ("ʁ", "g"), ("y", "uw"), ("ø", "ow"), ("ɲ", "n"), ("β", "v"), ("pf", "p f"),
        ("ts", "t s"), ("ɔ̃", "ao"), ("tʲ", "t"), ("j", "y"), ("", "sil"),
    ],
)  # fmt: skip
def test_ipa(symbol: str, phonemes: str) -> None:
    assert to_phonemes(symbol, "ipa") == tuple(phonemes.split())


@pytest.mark.parametrize(
    ("symbol", "phonemes"),
    [
        ("0", "aa"), ("a", "ae"), ("a#", "ax"), ("I#", "ix"), ("3:", "er"), ("3", "er"),
        ("A@", "aa r"), ("o@", "ao r"), ("i@3", "ih r"), ("aI3", "ay er"), ("@L", "ax l"),
        ("n-", "ax n"), ("t#", "d"), ("?", "t"), ("'eI", "ey"), (",oU", "ow"), ("l#", "l"),
        ("_:", "sil"), ("tS", "ch"), ("V", "ah"),
    ],
)  # fmt: skip
def test_espeak(symbol: str, phonemes: str) -> None:
    assert to_phonemes(symbol, "espeak") == tuple(phonemes.split())


@pytest.mark.parametrize(
    ("symbol", "phonemes"),
    [
        ("{", "ae"), ("a", "aa"), ("aI", "ay"), ("@U", "ow"), ("3:", "er"), ("r=", "er"),
        ("n=", "ax n"), ("I@", "ih ax"), ("A:", "aa"), ("Q", "aa"), ("D", "dh"), ("tS", "ch"),
        ("t_S", "ch"), ("p_h", "p"), ('"i:', "iy"), ("r\\", "r"), ("@`", "er"), ("s`", "sh"),
        ("2:", "ow"), ("R", "g"), ("pf", "p f"), ("_", "sil"), ("4", "d"),
    ],
)  # fmt: skip
def test_sampa(symbol: str, phonemes: str) -> None:
    assert to_phonemes(symbol, "sampa") == tuple(phonemes.split())


@pytest.mark.parametrize(
    ("inventory", "alphabet"),
    [
        (ESPEAK_SAID, "espeak"), (ESPEAK_IPA_SAID, "ipa"), (MFA_IPA, "ipa"),
        (SAMPA_ENGLISH.replace(' " ', " "), "sampa"),
    ],
)  # fmt: skip
def test_whole_inventories_are_known_and_told_apart(inventory: str, alphabet: str) -> None:
    symbols = inventory.split()
    assert unknown_symbols(symbols, alphabet) == []
    assert detect_alphabet(symbols) == alphabet


def test_every_symbol_of_the_cmu_dictionary_with_every_stress() -> None:
    path = pocketsphinx.get_model_path("en-us/cmudict-en-us.dict")
    lines = Path(path).read_text(encoding="utf-8").splitlines()
    symbols = {s for line in lines for s in line.split()[1:]}
    assert len(symbols) == 39
    for s in symbols:
        (bare,) = to_phonemes(s, "arpabet")
        assert bare == s.lower()
        for stress in "012":
            if bare in VOWELS:
                (stressed,) = to_phonemes(s + stress, "arpabet")
                reduced = {"AH0": "ax", "IH0": "ix"}
                assert stressed == reduced.get(s + stress, bare)
            else:
                with pytest.raises(PhonemeError):
                    to_phonemes(s + stress, "arpabet")


def test_every_phoneme_can_be_reached_from_every_alphabet() -> None:
    assert {to_phonemes(p, "table") for p in PHONEMES} == {(p,) for p in PHONEMES}
    sources = {
        "arpabet": {p for s in ARPABET for p in to_phonemes(s, "arpabet")},
        "ipa": {"sil"} | {p for s in IPA for p in to_phonemes(s, "ipa")},
        "espeak": {"sil"} | {p for s in ESPEAK for p in to_phonemes(s, "espeak")},
        "sampa": {p for q in PHONEMES for p in to_phonemes(to_sampa(q), "sampa")},
    }
    assert sources.pop("arpabet") == set(PHONEMES)
    for alphabet, reached in sources.items():
        assert set(PHONEMES) - reached == {"h"}, alphabet  # written hh


def test_writing_and_reading_back() -> None:
    for p in PHONEMES:
        hh = "hh" if p == "h" else p
        assert to_phonemes(to_sampa(p), "sampa") == (hh,)
        merged = {"ax": "ah", "ix": "ih"}.get(hh, hh)
        assert to_phonemes(to_arpabet(p), "arpabet") == (merged,)


@pytest.mark.parametrize("alphabet", [*ALPHABETS, "auto"])
def test_an_unknown_symbol_is_named_with_its_neighbours(alphabet: str) -> None:
    with pytest.raises(PhonemeError) as caught:
        to_phonemes("IYY", alphabet)
    message = str(caught.value)
    assert "'IYY'" in message
    assert ("any alphabet" if alphabet == "auto" else repr(alphabet)) in message
    assert "nearest known: " in message
    assert "\n" not in message
    if alphabet == "arpabet":
        assert "IY" in message.split("nearest known: ")[1].split(", ")


def test_an_unknown_alphabet_is_named() -> None:
    with pytest.raises(PhonemeError, match="'klingon' is unknown; choose one of auto, table"):
        to_phonemes("aa", "klingon")


@pytest.mark.parametrize("word", ["hello", "red", "bin", "speech", "plese", "two"])
def test_words_are_no_phonemes(word: str) -> None:
    with pytest.raises(PhonemeError):
        to_phonemes(word)


@pytest.mark.parametrize(
    ("symbols", "alphabet"),
    [
        (["aa", "s", "sil", "hh"], "table"),
        (["AA1", "S", "sp", ""], "arpabet"),
        (["AA", "S", "SIL"], "arpabet"),
        (["aa", "dcl", "d", "h#", "axr"], "arpabet"),
        (["s", "V", "n", "D"], "sampa"),
        (["s", "{", "t", "_"], "sampa"),
        (["s", "a#", "t", "0"], "espeak"),
        (["s", "ɪ", "t"], "ipa"),
        ([], "table"),
    ],
)
def test_detection(symbols: list[str], alphabet: str) -> None:
    assert detect_alphabet(symbols) == alphabet


def test_detection_names_what_fits_nowhere() -> None:
    with pytest.raises(PhonemeError) as caught:
        detect_alphabet(["AA1", "S", "QX", "T", "WOW"])
    assert "'QX', 'WOW'" in str(caught.value)
    assert "'arpabet'" in str(caught.value)
    assert best_alphabet(["AA1", "S", "QX", "T"]) == ("arpabet", ["QX"])


def test_a_phone_of_several_phonemes_is_split_evenly() -> None:
    spans = [Interval(0, 0.2, "b"), Interval(0.2, 0.5, "ɑːɹ"), Interval(0.5, 0.6, "")]
    out = expand_intervals(spans)
    assert [i.label for i in out] == ["b", "aa", "r", "sil"]
    assert [i.end for i in out] == pytest.approx([0.2, 0.35, 0.5, 0.6])
    assert PhonemeTrack.from_intervals(out).end == 0.6


def test_expanding_names_its_source() -> None:
    with pytest.raises(PhonemeError, match=r"^a\.pho: .*'qqq'"):
        expand_intervals([Interval(0, 1, "qqq")], "sampa", "a.pho")


@given(st.text(max_size=6), st.sampled_from([*ALPHABETS, "auto"]))
def test_any_text_is_phonemes_of_table_1_or_an_error(symbol: str, alphabet: str) -> None:
    try:
        found = to_phonemes(symbol, alphabet)
    except UnitselError:
        return
    assert found
    assert set(found) <= set(PHONEMES)
