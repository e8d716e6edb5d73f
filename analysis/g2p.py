"""Pronunciations that no dictionary has: guessed by espeak-ng, where it is installed.

espeak-ng is GPL-3, so it is the optional extra ``espeak`` and nothing here needs it: without it
nothing is guessed, and whoever needs the word asks the user for its pronunciation.
"""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterable
from typing import Final

from analysis.espeak import phonemes_in_ipa
from database.errors import PhonemeError
from database.lexicon import Lexicon, Pronunciation
from database.symbols import to_phonemes
from database.timing.words import clean_word

VOICE: Final = "en-us"

_LANGUAGE: Final = re.compile(r"\([a-z-]+\)")
"""espeak's mark of a word that it says in another language: ``(fr)``."""


def speaking_lexicon(dictionary: str | os.PathLike[str] | None = None) -> Lexicon:
    """The CMU dictionary with the user's own on top.

    Parameters
    ----------
    dictionary : path, optional
        Lines of ``WORD PHONES``; see `database.lexicon`.

    Raises
    ------
    PronunciationError
        If the user's dictionary cannot be read; names the file and the line.
    """
    lexicon = Lexicon.default()
    return lexicon if dictionary is None else lexicon.extended(dictionary)


def with_guesses(lexicon: Lexicon, words: Iterable[str]) -> tuple[Lexicon, dict[str, str]]:
    """Add pronunciations of the words that a lexicon lacks, as far as they can be guessed.

    Parameters
    ----------
    lexicon : Lexicon
    words : iterable of str

    Returns
    -------
    lexicon : Lexicon
        The same one where nothing was added. What is still missing, `Lexicon.missing` tells.
    notes : dict of str to str
        A sentence on each word that was guessed, for the user to check.
    """
    guesses = {w: g for w in lexicon.missing(words) if (g := guess_pronunciation(w))}
    if not guesses:
        return lexicon, {}
    said = "pronunciation of {!r} guessed by espeak: {}"
    notes = {w: said.format(w, " ".join(g)) for w, g in guesses.items()}
    return lexicon.with_entries({clean_word(w): [g] for w, g in guesses.items()}), notes


def guess_pronunciation(word: str) -> Pronunciation | None:
    """How espeak-ng's American voice would say a word.

    Parameters
    ----------
    word : str
        Numbers may be in digits.

    Returns
    -------
    tuple of str or None
        Names of Table 1. None without espeak, and for what its voice cannot read: other
        alphabets than the Latin one, of which it only says that they are others.
    """
    bare = clean_word(word)
    if not bare or not all(map(_is_readable, bare)) or not any(c.isalnum() for c in bare):
        return None
    said = phonemes_in_ipa(bare, VOICE)
    if said is None:
        return None
    symbols = [s for s in re.split(r"[_\s]+", _LANGUAGE.sub(" ", said)) if s]
    try:
        found = tuple(p for s in symbols for p in to_phonemes(s, "ipa"))
    except PhonemeError:
        return None
    return found if found and "sil" not in found else None


def _is_readable(c: str) -> bool:
    return not c.isalpha() or unicodedata.name(c, "").startswith("LATIN")
