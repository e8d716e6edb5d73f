"""Other phoneme alphabets, mapped into Table 1: ARPAbet, IPA, espeak's mnemonics, SAMPA.

One symbol may stand for several phonemes (a syllabic n is ax n). Vowels are mapped by the words
they occur in rather than by their exact quality: the British vowel of "lot" becomes aa, because
that is what the CMU dictionary, and so a database aligned with it, calls it. Sounds that English
lacks become the phoneme that looks most alike. Espeak's mnemonics are read as its American voice
means them, with r after the vowels of "start" and "north"; its IPA says itself where an r is.

Every alphabet but Table 1's own gives hh, never h, so that one sound has one name.
"""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Final

from database.alphabets import (
    ARPABET,
    ARPABET_NAMES,
    ESPEAK,
    IPA,
    SAMPA_NAMES,
    SAMPA_TO_IPA,
    SILENCE_MARKS,
    TABLE,
    VOWELS,
)
from database.errors import PhonemeError
from database.track import Interval

ALPHABETS: Final = ("table", "arpabet", "ipa", "espeak", "sampa")
"""Alphabets that `to_phonemes` knows, besides "auto"."""

_SAMPA_TOKEN: Final = re.compile(
    "|".join(re.escape(s) for s in sorted(SAMPA_TO_IPA, key=len, reverse=True))
    + r"|(?P<mark>:\\|[:\"%~';.]|_(?![sSzZ])[^\s_])|_|(?P<same>[a-z])"
)

_SYLLABIC: Final = "\u0329\u030d"
_RHOTIC: Final = "\u02de"


def _from_ipa(symbol: str) -> tuple[str, ...]:
    """Phonemes of one IPA symbol; empty where it is none."""
    # An unmarked a is the vowel of "trap", a long one that of "palm".
    decomposed = unicodedata.normalize("NFD", re.sub("a[ː:]", "ɑ", symbol))
    kept = "".join(c for c in decomposed if c in _SYLLABIC + _RHOTIC + "\u0327" or _is_letter(c))
    text = unicodedata.normalize("NFC", kept)  # puts c and its cedilla together again
    out: list[str] = []
    tokens: list[tuple[str, ...]] = []
    at = 0
    while at < len(text):
        size = next((n for n in (2, 1) if text[at : at + n] in IPA), 0)
        if not size:
            return ()
        token = IPA[text[at : at + size]]
        at += size
        if text[at : at + 1] in tuple(_SYLLABIC):
            if token[0] not in VOWELS:
                token = ("er",) if token == ("r",) else ("ax", *token)
            at += 1
        elif text[at : at + 1] == _RHOTIC:
            token = ("er",) if token in (("ax",), ("er",)) else (*token, "r")
            at += 1
        tokens.append(token)
        out += token
    # A phone is one sound, or a vowel that ends in schwa, r or l; whole words are not phones.
    tail = tokens[1:]
    if tail and tail[0] in (("ax",), ("er",)):
        tail = tail[1:]
    if tail and tail[0] in (("r",), ("l",)):
        tail = tail[1:]
    return tuple(out) if not tail and out and (len(tokens) == 1 or out[0] in VOWELS) else ()


def _is_letter(c: str) -> bool:
    """Whether an IPA character is a sound, not stress, length, a tie or a shade of one."""
    return unicodedata.category(c) not in ("Lm", "Mn", "Sk", "Pc") and c not in "':."


def _from_sampa(symbol: str) -> tuple[str, ...]:
    ipa, at = "", 0
    while at < len(symbol):
        token = _SAMPA_TOKEN.match(symbol, at)
        if token is None:
            return ()
        if token["same"]:
            ipa += token["same"]
        elif not token["mark"]:
            ipa += SAMPA_TO_IPA.get(token[0], "")
        at = token.end()
    # English SAMPA writes the vowel of "trap" as {, so an a of its own is the open one.
    return _from_ipa("ɑ" if ipa == "a" else ipa)


def _from_arpabet(symbol: str) -> tuple[str, ...]:
    if not (symbol.isupper() or symbol.islower()):
        return ()
    upper = symbol.upper()
    if upper in ARPABET:
        return ARPABET[upper]
    known = ARPABET.get(upper[:-1], ()) if upper[-1:] in ("0", "1", "2") else ()
    return known if known and known[0] in VOWELS else ()


def _from_espeak(symbol: str) -> tuple[str, ...]:
    bare = symbol.lstrip("',%=")
    for form in (bare, bare.rstrip('#2-^"!;'), bare.rstrip('#2-^"!;:~')):
        if form in ESPEAK:
            return ESPEAK[form]
    return ()


_READERS: Final = {
    "table": lambda symbol: TABLE.get(symbol, ()),
    "arpabet": _from_arpabet,
    "ipa": _from_ipa,
    "espeak": _from_espeak,
    "sampa": _from_sampa,
}
_KNOWN: Final[dict[str, tuple[str, ...]]] = {
    "table": tuple(TABLE),
    "arpabet": tuple(ARPABET),
    "ipa": tuple(IPA),
    "espeak": tuple(ESPEAK),
    "sampa": (*SAMPA_TO_IPA, *"pbtdkgfvszhmnlrwjiueoax"),
}


_LONGEST: Final = 40
"""Characters; longer labels are no symbols, and looking into each of them would take long."""


def _lookup(symbol: str, alphabet: str) -> tuple[str, ...]:
    if len(symbol) > _LONGEST:
        return () if symbol.strip() else ("sil",)
    return _known(symbol, alphabet)


@lru_cache(maxsize=4096)
def _known(symbol: str, alphabet: str) -> tuple[str, ...]:
    if symbol.strip().lower() in SILENCE_MARKS:
        return ("sil",)
    if alphabet != "auto":
        found: tuple[str, ...] = _READERS[alphabet](symbol)
        return found
    order = ("table", "arpabet", "ipa", "sampa", "espeak")
    return next((found for a in order if (found := _lookup(symbol, a))), ())


def _nearest(symbol: str, alphabet: str) -> str:
    alphabets = ALPHABETS if alphabet == "auto" else (alphabet,)
    known = list(dict.fromkeys(s for a in alphabets for s in _KNOWN[a]))
    form = symbol.upper() if alphabet == "arpabet" else symbol
    close = difflib.get_close_matches(form[:40], known, n=3, cutoff=0.0)
    return ", ".join(close)


def _check_alphabet(alphabet: str) -> None:
    if alphabet != "auto" and alphabet not in ALPHABETS:
        raise PhonemeError(
            f"alphabet {alphabet!r} is unknown; choose one of auto, {', '.join(ALPHABETS)}"
        )


def to_phonemes(symbol: str, alphabet: str = "auto") -> tuple[str, ...]:
    """Phonemes of Table 1 that one symbol stands for.

    Parameters
    ----------
    symbol : str
        A phone's label. Marks of silence ("", "SIL", "sp", "_", ...) are known in all alphabets.
    alphabet : str
        One of `ALPHABETS`, or "auto": the first alphabet that knows the symbol. A whole file's
        alphabet is told more surely by `detect_alphabet`.

    Returns
    -------
    tuple of str
        Names of Table 1, at least one.

    Raises
    ------
    PhonemeError
        Naming the symbol, the alphabet and the nearest known symbols.
    """
    _check_alphabet(alphabet)
    found = _lookup(symbol, alphabet)
    if not found:
        where = "any alphabet" if alphabet == "auto" else f"alphabet {alphabet!r}"
        raise PhonemeError(
            f"unknown phoneme {symbol[:40]!r} in {where}; "
            f"nearest known: {_nearest(symbol, alphabet)}"
        )
    return found


def unknown_symbols(symbols: Iterable[str], alphabet: str) -> list[str]:
    """List the distinct symbols that an alphabet does not know, in order."""
    _check_alphabet(alphabet)
    distinct = dict.fromkeys(symbols)
    found = {s: _lookup(s, alphabet) for s in distinct}
    unknown = [s for s in distinct if not found[s]]
    if alphabet == "arpabet":  # SAMPA tells T from t, ARPAbet never mixes them
        cased = [s for s in distinct if found[s] and s.strip().lower() not in SILENCE_MARKS]
        upper = [s for s in cased if s.isupper()]
        is_rare = 2 * len(upper) < len(cased)
        unknown += upper if is_rare else [s for s in cased if not s.isupper()]
    return unknown


def best_alphabet(symbols: Iterable[str]) -> tuple[str, list[str]]:
    """Find the alphabet that knows most of the symbols, and list those it does not know.

    Among equals Table 1 comes first, then ARPAbet. ASCII symbols are taken as SAMPA before
    espeak's mnemonics, with which it shares nearly all; others are IPA.
    """
    distinct = list(dict.fromkeys(symbols))
    order = ["table", "arpabet", "sampa", "espeak", "ipa"]
    if not all(s.isascii() for s in distinct):
        order = ["ipa", "table", "arpabet", "sampa", "espeak"]
    misses = {a: unknown_symbols(distinct, a) for a in order}
    best = min(order, key=lambda a: len(misses[a]))
    return best, misses[best]


def detect_alphabet(symbols: Iterable[str]) -> str:
    """Tell the alphabet that all the symbols of one file belong to.

    Raises
    ------
    PhonemeError
        Where none knows them all; names the symbols that do not fit the alphabet that knows
        most.
    """
    alphabet, unknown = best_alphabet(symbols)
    if unknown:
        named = ", ".join(repr(s[:40]) for s in unknown[:5]) + (", ..." if len(unknown) > 5 else "")
        raise PhonemeError(
            f"no alphabet knows all the phonemes; not in alphabet {alphabet!r}, which knows most: "
            f"{named}; nearest known to {unknown[0][:40]!r}: {_nearest(unknown[0], alphabet)}"
        )
    return alphabet


def expand_intervals(
    intervals: Sequence[Interval], alphabet: str = "auto", name: str = "track"
) -> list[Interval]:
    """Intervals in any alphabet to intervals of Table 1.

    A phone that becomes k phonemes is split into k equal spans.

    Parameters
    ----------
    intervals : sequence of Interval
    alphabet : str
        One of `ALPHABETS`; "auto" detects it from all the labels.
    name : str
        Where the intervals come from, for messages.

    Raises
    ------
    PhonemeError
        For a label that the alphabet does not know.
    """
    out: list[Interval] = []
    try:
        known = detect_alphabet(i.label for i in intervals) if alphabet == "auto" else alphabet
        for it in intervals:
            phonemes = to_phonemes(it.label, known)
            step = (it.end - it.start) / len(phonemes)
            edges = [it.start + k * step for k in range(len(phonemes))] + [it.end]
            out += [Interval(edges[k], edges[k + 1], p) for k, p in enumerate(phonemes)]
    except PhonemeError as error:
        raise PhonemeError(f"{name}: {error}") from error
    return out


def to_arpabet(phoneme: str) -> str:
    """Upper-case ARPAbet of a phoneme of Table 1, one of pocketsphinx's 39 phones or SIL."""
    to_phonemes(phoneme, "table")
    return ARPABET_NAMES.get(phoneme, phoneme.upper())


def to_sampa(phoneme: str) -> str:
    """SAMPA of a phoneme of Table 1, as MBROLA's American voices write it; silence is ``_``."""
    to_phonemes(phoneme, "table")
    return SAMPA_NAMES.get(phoneme, phoneme)
