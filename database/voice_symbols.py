"""What a synthesizer's voice says, in any language: IPA into Table 1, and whether that is exact.

Timing files are read strictly (`database.symbols`): a label that no alphabet knows is a mistake
there. A voice is not mistaken, it speaks another language; so here every symbol gets the phonemes
that look most like it, and the caller is told which ones English does not have. Tones and stress
do not show on the lips and are dropped, length is in the times; diphthongs and affricates become
their parts, with a glide before a vowel shorter than the vowel.

Symbols are espeak's IPA, which where it lacks a letter writes its own mnemonic (``s.`` is ʂ).
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

from database.alphabets import IPA, VOWELS
from database.errors import PhonemeError
from database.symbols import to_phonemes
from database.track import Interval

_ENGLISH: Final = (
    "p b t d k g ɡ f v θ ð s z ʃ ʒ tʃ dʒ h m n ŋ l ɫ ɹ j w ʍ ɾ ʔ "
    "a æ ɑ ɒ ɔ ə ɐ ʌ ɛ e ɜ ɝ ɚ i ɪ ᵻ u ʊ "
    "aɪ aʊ eɪ oʊ əʊ ɔɪ oɪ ai au ɑu ei ou ɔi iə eə ɪə ʊə aɪə aɪɚ aʊə əl n̩ m̩ l̩ ɑɹ ɔɹ ɛɹ ɪɹ ʊɹ"
)
ENGLISH: Final = frozenset(_ENGLISH.split())
"""What English has, so that Table 1 names the very sound; without marks of length."""

GLIDE_SHARE: Final = 1 / 3
"""Of a sound that goes from a glide into a vowel."""

_GLIDES: Final = {"i": "y", "u": "w", "y": "w", "ɨ": "y", "ʉ": "w"}
"""High vowels before another vowel; rounded ones as w, which the lips show."""

_MNEMONICS: Final = {"ts.": "ʈʂ", "nɡ": "ŋ", "s.": "ʂ", "z.": "ʐ", "t.": "ʈ",
                     "d.": "ɖ", "n.": "ɳ", "l.": "ɭ", "r.": "ɽ", "i.": "ɨ", "i\u032a": "ɨ",
                     "o-": "ɤ", "u-": "ɯ", "i-": "ɨ",
                     "?": "ʔ", "ε": "ɛ"}  # fmt: skip
_REST: Final = {"ʲ": "y", "ʷ": "w", "ʘ": "p", "ǀ": "t", "ǃ": "t", "ǂ": "t", "ǁ": "l", "ɥ": "w",
                "ʄ": "jh", "ʛ": "g", "ʜ": "hh", "ʢ": "hh", "ʡ": "k", "ⱱ": "v", "ɧ": "sh",
                "ɿ": "ix", "ʅ": "ix", "ʮ": "uw", "ʯ": "uw"}  # fmt: skip
_NEUTRAL: Final = "ax"

_STRESS: Final = re.compile("[ˈˌ'ˑː:]")
_TONE: Final = re.compile("[\u02e5-\u02e9\u2191\u2193↗↘0-9]")
_TIES: Final = re.compile("[\u0361\u035c\u200d]")


@dataclass(frozen=True)
class Rendering:
    """A voice's symbol as phonemes of Table 1.

    Parameters
    ----------
    symbol : str
        Without marks of stress, tone and length.
    phonemes : tuple of str
        At least one.
    shares : tuple of float
        Part of the sound's time of each.
    exact : bool
        Whether English has the sound.
    known : bool
        Whether any part of the symbol is unknown, and a neutral vowel stands for it.
    """

    symbol: str
    phonemes: tuple[str, ...]
    shares: tuple[float, ...]
    exact: bool
    known: bool = True

    def __str__(self) -> str:
        return f"{self.symbol} as {' '.join(self.phonemes)}" + ("" if self.known else " (unknown)")


@lru_cache(maxsize=4096)
def render_symbol(symbol: str) -> Rendering:
    """Phonemes that look most like a symbol of IPA.

    Parameters
    ----------
    symbol : str
        One phone of a voice, with or without stress, length and tone; blank is silence.
    """
    long = "ː" in symbol
    bare = _TONE.sub("", _STRESS.sub("", _TIES.sub("", unicodedata.normalize("NFD", symbol))))
    bare = unicodedata.normalize("NFC", bare).strip("-_ ") if bare not in _MNEMONICS else bare
    if not bare:
        return Rendering("", ("sil",), (1.0,), True)
    letters = bare
    for mnemonic, letter in _MNEMONICS.items():
        letters = letters.replace(mnemonic, letter)
    # Aspiration is breath behind the sound: the lips have left it by then.
    letters = re.sub("(?<=[ptksɕʂʈcqʃ])[hʰ]", "", letters)
    exact = letters in ENGLISH
    if not exact and letters[0] in _GLIDES and _is_vowel(letters[1:2]):
        return _in_parts(bare, letters)
    try:
        # A long a is another vowel to `to_phonemes` than a short one.
        phonemes = to_phonemes(letters.replace("a", "aː") if long else letters, "ipa")
        return Rendering(bare, phonemes, _even(phonemes), exact)
    except PhonemeError:
        return _in_parts(bare, letters)


def _by_mnemonic(bare: str) -> tuple[str, ...]:
    """Phonemes of espeak's own name for a sound, which some voices have no IPA for."""
    try:
        return to_phonemes(bare, "espeak")
    except PhonemeError:
        return ()


def _in_parts(bare: str, letters: str) -> Rendering:
    """A symbol that is no single phone to the strict table, letter by letter."""
    text = unicodedata.normalize("NFD", letters)
    phonemes: list[str] = []
    shares: list[float] = []
    known, at = True, 0
    while at < len(text):
        if (glide := _GLIDES.get(text[at])) and _is_vowel(text[at + 1 : at + 2]):
            phonemes.append(glide)
            shares.append(GLIDE_SHARE)
            at += 1
            continue
        size = next((n for n in (2, 1) if text[at : at + n] in IPA), 0)
        if size:
            found = IPA[text[at : at + size]]
        elif text[at] in _REST and (text[at] not in "ʲʷ" or not phonemes):
            found = (_REST[text[at]],)
        elif (
            unicodedata.category(text[at]) in ("Lm", "Mn", "Sk", "Pc", "Pd") or text[at] in ".~^;!#"
        ):
            found = ()  # A shade of the letter before it.
        else:
            found, known = (_NEUTRAL,), False
        phonemes += found
        shares += [1.0 / max(1, len(found))] * len(found)
        at += max(1, size)
    if not (phonemes and known) and (named := _by_mnemonic(bare)):
        return Rendering(bare, named, _even(named), False)
    if not phonemes:
        phonemes, shares, known = [_NEUTRAL], [1.0], False
    whole = sum(shares)
    return Rendering(bare, tuple(phonemes), tuple(s / whole for s in shares), False, known)


def _is_vowel(letter: str) -> bool:
    return letter in IPA and IPA[letter][0] in VOWELS


def _even(phonemes: tuple[str, ...]) -> tuple[float, ...]:
    return (1 / len(phonemes),) * len(phonemes)


def render_intervals(phones: Iterable[Interval]) -> tuple[list[Interval], dict[str, Rendering]]:
    """A voice's phones as phonemes of Table 1.

    Parameters
    ----------
    phones : iterable of Interval
        IPA; blank is silence.

    Returns
    -------
    intervals : list of Interval
    approximated : dict of str to Rendering
        The symbols that English lacks, in the order in which they are first said.
    """
    out: list[Interval] = []
    approximated: dict[str, Rendering] = {}
    for phone in phones:
        said = render_symbol(phone.label)
        if not said.exact:
            approximated.setdefault(said.symbol, said)
        start = phone.start
        for i, (phoneme, share) in enumerate(zip(said.phonemes, said.shares, strict=True)):
            last = i == len(said.phonemes) - 1
            end = phone.end if last else start + share * (phone.end - phone.start)
            out.append(Interval(start, end, phoneme))
            start = end
    return out, approximated
