"""Mandarin syllables in Pinyin: their initials, medials and finals.

A syllable is an initial (b, zh, none), then a final, which may begin with a medial (i, u, ü): the
ü of ``xue`` is written u, the u of ``bo`` not at all, and a syllable without initial writes its
medial y or w. `split` undoes these rules of spelling, so that what is left are sounds.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Final

from database.errors import PronunciationError

INITIALS: Final = (
    "zh", "ch", "sh", "b", "p", "m", "f", "d", "t", "n", "l", "g", "k", "h", "j", "q", "x", "r",
    "z", "c", "s",
)  # fmt: skip
"""Longer ones first."""

RIMES: Final = (
    "a", "o", "e", "ê", "ai", "ei", "ao", "ou", "an", "en", "ang", "eng", "ong", "er", "-i", "i",
    "u", "ü", "n", "ng",
)  # fmt: skip
"""Finals without their medials; ``-i`` is the vowel of zi and zhi, ``i``, ``u`` and ``ü`` are
vowels where no other follows, with or without a nasal."""

_APICAL: Final = ("zh", "ch", "sh", "r", "z", "c", "s")
_SHORT: Final = {"iu": "iou", "ui": "uei", "un": "uen"}
_YEH: Final = {"ie": "iê", "üe": "üê", "ue": "üê"}
_NASAL: Final = {"iong": ("ü", "ong"), "in": ("i", "n"), "ing": ("i", "ng"), "ün": ("ü", "n"),
                 "uen": ("u", "en"), "ian": ("i", "an"), "üan": ("ü", "an")}  # fmt: skip


@dataclass(frozen=True)
class Syllable:
    """The parts of a syllable.

    Parameters
    ----------
    initial : str
        One of `INITIALS`, or none.
    medial : str
        i, u, ü or none.
    rime : str
        One of `RIMES`.
    """

    initial: str
    medial: str
    rime: str

    @property
    def nasal(self) -> bool:
        """Whether it ends with n or ng."""
        return self.rime.endswith(("n", "ng"))


def split(pinyin: str) -> Syllable:
    """The parts of a syllable as it is written.

    Parameters
    ----------
    pinyin : str
        Without tone; ü as ü or v.

    Raises
    ------
    PronunciationError
        If it is no syllable of Mandarin.
    """
    written = pinyin.strip().lower().replace("v", "ü").replace("u:", "ü")
    if written in ("n", "ng", "m", "hm", "hng"):
        # Interjections: a nasal is all there is.
        return Syllable("m" if "m" in written else "", "", "ng" if "g" in written else "n")
    initial = next((i for i in INITIALS if written.startswith(i)), "")
    final = written[len(initial) :]
    if not initial:
        final = _unspelled(final)
    elif initial in ("j", "q", "x") and final.startswith("u"):
        final = "ü" + final[1:]
    if initial in _APICAL and final == "i":
        final = "-i"
    final = _YEH.get(_SHORT.get(final, final), _SHORT.get(final, final))
    if final in _NASAL:
        return Syllable(initial, *_NASAL[final])
    match = re.fullmatch("([iuü]?)(.*)", final)
    assert match is not None
    medial, rime = match.groups()
    if medial and not rime:
        medial, rime = "", medial
    if rime not in RIMES or (medial and rime in ("-i", "i", "u", "ü", "er")):
        raise PronunciationError(f"{pinyin!r} is no syllable of Mandarin in Pinyin")
    return Syllable(initial, medial, rime)


def _unspelled(written: str) -> str:
    """A final that stands alone, without the y and w that it is written with."""
    if written.startswith("yu"):
        return "ü" + written[2:]
    if written in ("yi", "yin", "ying"):
        return written[1:]
    if written.startswith("y"):
        rest = written[1:]
        return "iou" if rest == "ou" else "i" + rest
    if written == "wu":
        return "u"
    if written.startswith("w"):
        return "u" + written[1:]
    return written


@dataclass(frozen=True)
class TimedSyllable:
    """A syllable that was said.

    Parameters
    ----------
    start, end : float
        Seconds.
    pinyin : str
        Without tone.
    tone : int
        1 to 4; 5 is the neutral tone.
    onset : float
        Seconds at which its initial ends; `start` where it has none.
    """

    start: float
    end: float
    pinyin: str
    tone: int
    onset: float

    def later(self, seconds: float) -> TimedSyllable:
        """The same syllable, so much later."""
        return replace(
            self,
            start=self.start + seconds,
            end=self.end + seconds,
            onset=self.onset + seconds,
        )
