"""espeak-ng as a library: loaded where it is installed, its voices, and how they pronounce.

espeak-ng is GPL-3, so it is the optional extra ``espeak``. The library is one instance a process,
with one voice at a time; the lock keeps threads apart, and voice and rate are set each time.
"""

from __future__ import annotations

import ctypes
import difflib
import threading
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from database.errors import SpeechError

MISSING: Final = (
    "espeak-ng is not installed: add the optional extra, pip install 'unitsel[espeak]', or speak "
    "with another program (--tts COMMAND) or a recording (--tts FILE.wav)"
)

_SYNCHRONOUS: Final = 2
_PHONEME_EVENTS_IN_IPA: Final = 0x0003
_DONT_EXIT: Final = 0x8000
UTF8: Final = 1
"""Texts are given in it."""
_IPA_SEPARATED: Final = 0x02 | ord("_") << 8
lock = threading.Lock()
"""Held by whoever sets a voice and speaks with it."""


class _Voice(ctypes.Structure):
    """espeak_VOICE of espeak-ng's speak_lib.h."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("languages", ctypes.POINTER(ctypes.c_char)),
        ("identifier", ctypes.c_char_p),
        ("rest", ctypes.c_ubyte * 24),
    )


@dataclass(frozen=True)
class Voice:
    """One of espeak's voices.

    Parameters
    ----------
    name : str
        For people: ``English (America)``.
    languages : tuple of str
        What it is asked for by: ``en-us``.
    identifier : str
        Its file.
    """

    name: str
    languages: tuple[str, ...]
    identifier: str


class Library(ctypes.CDLL):
    """The library, and the samples a second that it speaks at."""

    sample_rate: int = 0


@cache
def library() -> Library | None:
    """The library, ready to be asked; None where the extra is not installed or cannot start."""
    try:
        import espeakng_loader

        espeak = Library(espeakng_loader.get_library_path())
        data = str(espeakng_loader.get_data_path()).encode()
    except (ImportError, OSError):
        return None
    espeak.espeak_Initialize.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_char_p, ctypes.c_int]
    espeak.espeak_SetVoiceByName.argtypes = [ctypes.c_char_p]
    espeak.espeak_TextToPhonemes.argtypes = [
        ctypes.POINTER(ctypes.c_char_p),
        ctypes.c_int,
        ctypes.c_int,
    ]
    espeak.espeak_TextToPhonemes.restype = ctypes.c_char_p
    espeak.espeak_ListVoices.argtypes = [ctypes.c_void_p]
    espeak.espeak_ListVoices.restype = ctypes.POINTER(ctypes.POINTER(_Voice))
    with lock:
        rate = espeak.espeak_Initialize(_SYNCHRONOUS, 0, data, _PHONEME_EVENTS_IN_IPA | _DONT_EXIT)
    if rate <= 0:
        return None
    espeak.sample_rate = rate
    return espeak


def sample_rate() -> int:
    """Samples a second of what espeak says.

    Raises
    ------
    SpeechError
        Without espeak.
    """
    return needed().sample_rate


def voices() -> tuple[Voice, ...]:
    """List the voices that are there.

    Raises
    ------
    SpeechError
        Without espeak.
    """
    espeak = needed()
    found = []
    with lock:
        listed = espeak.espeak_ListVoices(None)
        i = 0
        while listed[i]:
            voice = listed[i].contents
            found.append(
                Voice(voice.name.decode(), _languages(voice.languages), voice.identifier.decode())
            )
            i += 1
    return tuple(found)


def _languages(listed: Any) -> tuple[str, ...]:
    """Names out of espeak's list: each a byte of priority, then the name and a zero."""
    names, at = [], 0
    while listed[at] != b"\0":
        text = ctypes.string_at(ctypes.addressof(listed.contents) + at + 1)
        names.append(text.decode())
        at += len(text) + 2
    return tuple(names)


def find_voice(name: str) -> str:
    """What the library calls a voice that somebody asks for.

    Parameters
    ----------
    name : str
        A language (``en-us``), a voice's name or its file, in upper or lower case; with a variant
        behind a plus sign (``en-us+f3``).

    Raises
    ------
    SpeechError
        If there is no such voice or variant; names those that are most like it.
    """
    asked, plus, variant = name.strip().partition("+")
    low = asked.lower()
    known = voices()
    for names in (
        lambda v: v.languages[:1],
        lambda v: (v.identifier, v.name, Path(v.identifier).name),
        lambda v: v.languages,
    ):
        found = next((v for v in known if low in [n.lower() for n in names(v)]), None)
        if found is not None:
            break
    if found is None:
        languages = [v.languages[0] for v in known]
        like = difflib.get_close_matches(low, [x.lower() for x in languages], 4, 0.5)
        named = [v for v in known if low and low in v.name.lower()]
        named.sort(key=lambda v: (not v.name.lower().startswith(low), len(v.languages[0])))
        like = [v.languages[0].lower() for v in named] + like
        near = [x for n in dict.fromkeys(like) for x in languages if x.lower() == n][:6]
        raise SpeechError(
            f"voice {name!r}: espeak has none of that name; "
            + (
                f"near it: {', '.join(near)}"
                if near
                else "en-us, en-gb, el and cmn are some it has"
            )
        )
    variants = _variants()
    if plus and variant not in variants:
        near = difflib.get_close_matches(variant, variants, 4, 0.0)
        raise SpeechError(
            f"voice {name!r}: espeak has no variant {variant!r}; near it: {', '.join(near)}"
        )
    return found.identifier + plus + variant


def _variants() -> list[str]:
    import espeakng_loader

    folder = Path(espeakng_loader.get_data_path()) / "voices" / "!v"
    return sorted(p.name for p in folder.iterdir()) if folder.is_dir() else []


def phonemes_in_ipa(text: str, voice: str) -> str | None:
    """How a voice would say a text: IPA, phonemes apart by ``_``; None where it cannot be asked."""
    espeak = library()
    if espeak is None:
        return None
    with lock:
        if espeak.espeak_SetVoiceByName(voice.encode()) != 0:
            return None
        place = ctypes.c_char_p(text.encode())
        clauses = []
        while place.value:  # espeak moves it behind each clause, and to NULL behind the last
            said = espeak.espeak_TextToPhonemes(ctypes.byref(place), UTF8, _IPA_SEPARATED)
            clauses.append((said or b"").decode())
    return " ".join(clauses)


def needed() -> Library:
    """The library.

    Raises
    ------
    SpeechError
        Without the extra; says how to install it.
    """
    espeak = library()
    if espeak is None:
        raise SpeechError(MISSING)
    return espeak
