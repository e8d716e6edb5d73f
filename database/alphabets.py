"""Tables of the phoneme alphabets that `database.symbols` maps into Table 1.

Each is written as phonemes of Table 1 and the symbols that stand for them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from database.phonemes import PHONEMES

SILENCE_MARKS: Final = frozenset({
    "", "sil", "sp", "spn", "ssil", "pau", "pause", "epi", "h#", "#", "_", "_:", "_!", "_|",
    "(.)", "<sil>", "<s>", "</s>", "<eps>", "<p:>", "<p>", "<usb>", "<noise>", "[sil]", "[noise]",
    "+spn+", "+noise+", "++noise++",
})  # fmt: skip
"""Labels that mean silence in every alphabet, lower case."""

VOWELS: Final = frozenset({
    "ae", "ax", "ah", "aa", "ao", "ey", "eh", "uh", "er", "iy", "ih", "ix", "uw", "ow", "aw",
    "oy", "ay",
})  # fmt: skip
"""Names of the vowels of Table 1."""


def _inverted(table: Mapping[str, str]) -> dict[str, tuple[str, ...]]:
    return {s: tuple(p.split()) for p, symbols in table.items() for s in symbols.split()}


TABLE: Final = {p: (p,) for p in PHONEMES}

# CMU's and TIMIT's symbols; TIMIT's closures belong to the stop that follows.
ARPABET: Final = {p.upper(): (p,) for p in PHONEMES} | _inverted(
    {
        "ax": "AH0 AX-H", "ix": "IH0", "er": "AXR", "uw": "UX", "aa": "OH", "w": "WH",
        "hh": "HV", "d": "DX DCL", "n": "NX", "t": "Q TCL", "b": "BCL", "g": "GCL", "p": "PCL",
        "k": "KCL", "ax l": "EL", "ax m": "EM", "ax n": "EN", "ax ng": "ENG",
    }
)  # fmt: skip

IPA: Final = _inverted(
    {
        "ae": "æ a aa", "ax": "ə ɐ ɘ", "ah": "ʌ ɤ", "aa": "ɑ ɒ", "ao": "ɔ ɶ",
        "ey": "eɪ ei ej ɛɪ ɛi ɛj æɪ", "eh": "ɛ e", "uh": "ʊ ɵ ᵿ",
        "er": "ɜ ɝ ɚ ɞ œ əɪ əɹ ər ɜɹ ɜr", "iy": "i", "y": "j ʝ", "ih": "ɪ", "ix": "ɨ ᵻ ɯ",
        "w": "w ʍ ɥ", "uw": "u ʉ y ʏ", "ow": "oʊ əʊ ou ow əw əʉ oʉ ɔʊ ʌʊ o ø",
        "aw": "aʊ au aw æʊ æɔ ɑʊ ɑu ʌʉ", "oy": "ɔɪ ɔi ɔj oɪ oi oj ɒɪ ɔʏ ɔø ɔy œʏ œy",
        "ay": "aɪ ai aj ɑɪ ɑi ɑj ʌɪ", "hh": "h ɦ ç ħ ʕ", "r": "ɹ r ɻ",
        "l": "l ɫ ɬ ɮ ʎ ɭ ɺ ʟ", "s": "s", "z": "z", "sh": "ʃ ɕ ʂ ɧ",
        "ch": "tʃ ʧ tɕ ʨ ʈʂ", "jh": "dʒ ʤ dʑ ʥ ɖʐ", "zh": "ʒ ʑ ʐ", "th": "θ", "dh": "ð",
        "f": "f ɸ", "v": "v ʋ β ɱ", "d": "d ɾ ɖ ɗ ɽ", "t": "t ʈ ʔ", "n": "n ɲ ɳ",
        "k": "k c q x χ", "g": "ɡ g ɟ ɢ ɣ ʁ ʀ ɠ ɰ", "ng": "ŋ ɴ",
        "p": "p", "b": "b ɓ ʙ", "m": "m",
        "t s": "ts ʦ", "d z": "dz ʣ", "p f": "pf", "k p": "kp", "g b": "ɡb gb", "y uw": "ju",
        "ao r": "oɹ or", "ao ax": "oə",
    }
)  # fmt: skip

ESPEAK: Final = _inverted(
    {
        "ae": "a aa", "ax": "@ a# @2 @5 @-", "ah": "V", "aa": "A: A 0 A~", "ao": "O: O O~",
        "ey": "eI e:", "eh": "E e E~", "uh": "U", "er": "3: 3 IR VR @r", "iy": "i: i",
        "y": "j ;", "ih": "I I2", "ix": "I# i#", "w": "w w# W", "uw": "u: u y y: Y",
        "ow": "oU o: o Y:", "aw": "aU", "oy": "OI OY", "ay": "aI", "hh": "h C", "r": "r r-",
        "l": "l l^", "s": "s", "z": "z", "sh": "S S;", "ch": "tS tS; ts;", "jh": "dZ dZ;",
        "zh": "Z Z;", "th": "T t[", "dh": "D", "f": "f", "v": "v B", "d": "d t# * d.",
        "t": "t t2 ? t.", "n": "n n^", "k": "k x c q X", "g": "g Q R J", "ng": "N",
        "p": "p", "b": "b", "m": "m",
        "t s": "ts", "d z": "dz", "p f": "pF pf", "ax l": "@L l-", "ax n": "n-", "ax m": "m-",
        "aa r": "A@", "ao r": "O@ o@", "eh r": "e@", "uh r": "U@", "ih r": "i@3 I@",
        "iy ax": "i@", "ay er": "aI3", "ay ax": "aI@", "aw er": "aU@",
    }
)  # fmt: skip

SAMPA_TO_IPA: Final[dict[str, str]] = {
    "{": "æ", "}": "ʉ", "@\\": "ɘ", "3\\": "ɞ", "I\\": "ᵻ", "U\\": "ᵿ", "1": "ɨ", "2": "ø",
    "9": "œ", "&": "ɶ", "Q": "ɒ", "7": "ɤ", "M": "ɯ", "8": "ɵ", "V": "ʌ", "A": "ɑ", "O": "ɔ",
    "E": "ɛ", "I": "ɪ", "U": "ʊ", "Y": "ʏ", "@": "ə", "3": "ɜ", "6": "ɐ", "D": "ð", "T": "θ",
    "S": "ʃ", "Z": "ʒ", "N": "ŋ", "J": "ɲ", "L": "ʎ", "R": "ʁ", "C": "ç", "B": "β", "G": "ɣ",
    "X": "χ", "H": "ɥ", "P": "ʋ", "W": "ʍ", "F": "ɱ", "K": "ɬ", "4": "ɾ", "5": "ɫ", "?": "ʔ",
    "h\\": "ɦ", "s\\": "ɕ", "z\\": "ʑ", "x\\": "ɧ", "R\\": "ʀ", "B\\": "ʙ", "p\\": "ɸ",
    "j\\": "ʝ", "J\\": "ɟ", "X\\": "ħ", "?\\": "ʕ", "N\\": "ɴ", "M\\": "ɰ", "l\\": "ɺ",
    "L\\": "ʟ", "G\\": "ɢ", "r\\": "ɹ", "v\\": "ʋ", "H\\": "h", "t`": "ʈ", "d`": "ɖ", "n`": "ɳ",
    "s`": "ʂ", "z`": "ʐ", "l`": "ɭ", "r`": "ɽ", "r\\`": "ɻ", "b_<": "ɓ", "d_<": "ɗ", "g_<": "ɠ",
    "K\\": "ɮ", "@`": "ɚ", "3`": "ɝ", "=": "\u0329", "_=": "\u0329", "`": "\u02de",
}  # fmt: skip
"""X-SAMPA to IPA, but for the letters that both write alike."""

ARPABET_NAMES: Final[dict[str, str]] = {"ax": "AH", "ix": "IH", "h": "HH"}
"""ARPAbet of the phonemes that pocketsphinx's 39 phones lack by their own name."""

SAMPA_NAMES: Final[dict[str, str]] = {
    "sil": "_", "ae": "{", "ax": "@", "ah": "V", "aa": "A", "ao": "O", "ey": "eI", "eh": "E",
    "uh": "U", "er": "r=", "iy": "i", "y": "j", "ih": "I", "ix": "I\\", "uw": "u", "ow": "@U",
    "aw": "aU", "oy": "OI", "ay": "aI", "hh": "h", "sh": "S", "ch": "tS", "jh": "dZ", "zh": "Z",
    "th": "T", "dh": "D", "ng": "N",
}  # fmt: skip
"""SAMPA of the phonemes of Table 1 that it writes otherwise, as MBROLA's American voices do."""
