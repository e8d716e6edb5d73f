"""Pronunciations that no dictionary has: guessed by espeak-ng, where it is installed.

espeak-ng is GPL-3, so it is the optional extra ``espeak`` and nothing here needs it: without it
nothing is guessed, and whoever needs the word asks the user for its pronunciation. The library
is one instance a process, with one voice at a time; the lock keeps threads apart, and the voice
is set for each question, since whoever else speaks with it may have changed it.
"""

from __future__ import annotations

import ctypes
import os
import re
import threading
import unicodedata
from collections.abc import Iterable
from functools import cache
from typing import Final

from database.errors import PhonemeError
from database.lexicon import Lexicon, Pronunciation
from database.symbols import to_phonemes
from database.timing.words import clean_word

VOICE: Final = b"en-us"

_SYNCHRONOUS: Final = 2
_DONT_EXIT: Final = 0x8000
_UTF8: Final = 1
_IPA: Final = 0x02
_SEPARATED: Final = ord("_") << 8

_LANGUAGE: Final = re.compile(r"\([a-z-]+\)")
"""espeak's mark of a word that it says in another language: ``(fr)``."""

_lock = threading.Lock()


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
    library = _espeak()
    if library is None:
        return None
    with _lock:
        if library.espeak_SetVoiceByName(VOICE) != 0:
            return None
        place = ctypes.c_char_p(bare.encode())
        clauses = []
        while place.value:  # espeak moves it behind each clause, and to NULL behind the last
            said = library.espeak_TextToPhonemes(ctypes.byref(place), _UTF8, _IPA | _SEPARATED)
            clauses.append((said or b"").decode())
    symbols = [s for s in re.split(r"[_\s]+", _LANGUAGE.sub(" ", " ".join(clauses))) if s]
    try:
        found = tuple(p for s in symbols for p in to_phonemes(s, "ipa"))
    except PhonemeError:
        return None
    return found if found and "sil" not in found else None


def _is_readable(c: str) -> bool:
    return not c.isalpha() or unicodedata.name(c, "").startswith("LATIN")


@cache
def _espeak() -> ctypes.CDLL | None:
    """The library, ready to be asked; None where the extra is not installed or cannot start."""
    try:
        import espeakng_loader

        library = ctypes.CDLL(espeakng_loader.get_library_path())
        data = str(espeakng_loader.get_data_path()).encode()
    except (ImportError, OSError):
        return None
    library.espeak_Initialize.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_char_p, ctypes.c_int]
    library.espeak_SetVoiceByName.argtypes = [ctypes.c_char_p]
    library.espeak_TextToPhonemes.argtypes = [
        ctypes.POINTER(ctypes.c_char_p),
        ctypes.c_int,
        ctypes.c_int,
    ]
    library.espeak_TextToPhonemes.restype = ctypes.c_char_p
    with _lock:
        rate = library.espeak_Initialize(_SYNCHRONOUS, 0, data, _DONT_EXIT)
    return library if rate > 0 else None
