"""What espeak-ng says of a text: the sound, and when each phoneme and word of it begins.

What bit: a phoneme's event stands behind the silence of its own closure, so the start of a p is
moved back over the digital silence before it, to where the lips meet. Marks of tone and pauses
have no name both; a pause is told by its silence. Some phones are one sound with the one before,
and have no time of their own. Names are cut off after eight bytes.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from analysis.espeak import UTF8, find_voice, lock, needed
from database.errors import SpeechError
from database.track import Interval

RATES: Final = (80, 450)
"""Words a minute that espeak can speak at."""

DEFAULT_RATE: Final = 175

LONGEST_CLOSURE: Final = 0.06
"""Seconds of silence before a phone that are its own; more is a pause."""

CLOSURE: Final = 0.05
"""Seconds that a stop is closed for when it comes out of a pause."""

NO_TIME: Final = 0.005
"""Seconds; shorter phones are sounded together with the one before: the l of "aisle"."""

LONGEST_SHARE: Final = 0.06
"""Seconds that such a phone gets of the other's time."""

_RATE: Final = 1
_LIST_END, _WORD, _PHONEME = 0, 1, 7

_STOPS: Final = tuple("pbtdkɡgcɟqɢʈɖ")
_SHORTEST_RUN: Final = 40
"""Samples of digital silence that are noted at all."""

Samples = npt.NDArray[np.int16]


class _Event(ctypes.Structure):
    """espeak_EVENT of espeak-ng's speak_lib.h; its union is read as the phoneme's name."""

    _fields_ = (
        ("type", ctypes.c_int),
        ("identifier", ctypes.c_uint),
        ("text_position", ctypes.c_int),
        ("length", ctypes.c_int),
        ("milliseconds", ctypes.c_int),
        ("sample", ctypes.c_int),
        ("user_data", ctypes.c_void_p),
        ("name", ctypes.c_ubyte * 8),
    )


_Listener = ctypes.CFUNCTYPE(
    ctypes.c_int, ctypes.POINTER(ctypes.c_short), ctypes.c_int, ctypes.POINTER(_Event)
)


@dataclass(frozen=True)
class Utterance:
    """What espeak said, beside the sound.

    Parameters
    ----------
    duration : float
        Seconds of sound.
    phones : tuple of Interval
        espeak's IPA with its marks of stress; blank in pauses. Without gaps, from 0 on.
    words : tuple of Interval
        Words as they stand in the text.
    """

    duration: float
    phones: tuple[Interval, ...]
    words: tuple[Interval, ...]


def say(
    text: str, voice: str, sink: Callable[[Samples], None], rate: float | None = None
) -> Utterance:
    """Say a text; the sound is handed over piece by piece.

    Parameters
    ----------
    text : str
        Of any length. Numbers, abbreviations and punctuation are read as the voice reads them.
    voice : str
        See `find_voice`.
    sink : callable
        Gets (n,) int16 at `sample_rate`, in order.
    rate : float, optional
        Words a minute, about; espeak's own, 175, by default.

    Raises
    ------
    SpeechError
        Without espeak; for a voice that it lacks, a rate out of range, and text in which there is
        nothing to say.
    """
    espeak = needed()
    wanted = DEFAULT_RATE if rate is None else rate
    if not RATES[0] <= wanted <= RATES[1]:
        raise SpeechError(f"rate {wanted:g}: espeak speaks {RATES[0]} to {RATES[1]} words a minute")
    identifier = find_voice(voice)
    heard = _Heard(sink)
    listener = _Listener(heard.listen)
    data = text.replace("\0", " ").encode("utf-8", "replace")
    with lock:
        if espeak.espeak_SetVoiceByName(identifier.encode()) != 0:
            raise SpeechError(f"voice {voice!r}: espeak cannot load it; choose another")
        espeak.espeak_SetParameter(_RATE, round(wanted), 0)
        espeak.espeak_SetSynthCallback(listener)
        try:
            size = ctypes.c_size_t(len(data) + 1)
            failed = espeak.espeak_Synth(ctypes.c_char_p(data), size, 0, 0, 0, UTF8, None, None)
        finally:
            espeak.espeak_SetSynthCallback(_Listener())
            espeak.espeak_SetParameter(_RATE, DEFAULT_RATE, 0)
    if heard.error is not None:
        raise heard.error
    if failed:
        raise SpeechError(f"voice {voice!r}: espeak failed to speak (error {failed})")
    phones = heard.intervals(espeak.sample_rate)
    if not any(p.label for p in phones):
        raise SpeechError(f"the text {text[:40]!r} holds nothing that voice {voice!r} can say")
    return Utterance(
        heard.samples / espeak.sample_rate,
        tuple(phones),
        tuple(_words(heard, text, espeak.sample_rate)),
    )


@dataclass
class _Heard:
    """What comes out of the library while it speaks."""

    sink: Callable[[Samples], None]
    samples: int = 0
    phones: list[tuple[int, str]] = field(default_factory=list)
    words: list[tuple[int, int, int]] = field(default_factory=list)
    """The phone that it begins with; place in the text from 0; length."""
    quiet: list[tuple[int, int]] = field(default_factory=list)
    """Runs of digital silence: first sample, and the one behind."""
    error: BaseException | None = None
    starts: list[int] = field(default_factory=list)
    """First sample of each phone, once `intervals` has run."""

    def listen(self, wave: Any, n: int, events: Any) -> int:
        """The library's callback; 1 ends it. Nothing may be raised through C."""
        try:
            i = 0
            while events[i].type != _LIST_END:
                event = events[i]
                if event.type == _PHONEME:
                    name = bytes(event.name).split(b"\0")[0].decode("utf-8", "ignore")
                    if not name.startswith("("):  # the mark of another language: (en)
                        self.phones.append((event.sample, name))
                elif event.type == _WORD:
                    mark = (len(self.phones), event.text_position - 1, event.length)
                    self.words.append(mark)
                i += 1
            if wave and n:
                # numpy's as_array would leave a type behind for every length there is.
                piece = np.frombuffer(ctypes.string_at(wave, 2 * n), dtype=np.int16)
                self._note_quiet(piece)
                self.samples += n
                self.sink(piece)
        except BaseException as error:
            self.error = error
            return 1
        return 0

    def _note_quiet(self, piece: Samples) -> None:
        edges = np.flatnonzero(np.diff(np.concatenate([[0], piece == 0, [0]]).astype(np.int8)))
        for a, b in zip(edges[::2] + self.samples, edges[1::2] + self.samples, strict=True):
            if self.quiet and self.quiet[-1][1] == a:
                self.quiet[-1] = (self.quiet[-1][0], int(b))
            elif b - a >= _SHORTEST_RUN or b == self.samples + len(piece):
                self.quiet.append((int(a), int(b)))

    def intervals(self, rate: int) -> list[Interval]:
        """Phones without gaps: their starts with their closures, and pauses apart."""
        runs = [r for r in self.quiet if r[1] - r[0] >= _SHORTEST_RUN]
        begins = np.array([r[0] for r in runs] + [0], dtype=np.int64)
        ends = np.array([r[1] for r in runs], dtype=np.int64)
        starts = self.starts
        for sample, name in self.phones:
            k = int(np.searchsorted(ends, sample))  # the first run that ends here or later
            begin = int(begins[k]) if k < len(ends) else sample
            if name and begin < sample:
                own = sample - begin
                if own > LONGEST_CLOSURE * rate:
                    own = round(CLOSURE * rate) if name.lstrip("ˈˌ").startswith(_STOPS) else 0
                sample -= own
            starts.append(max(sample, starts[-1]) if starts else sample)
        self._make_room(rate)
        out: list[Interval] = []
        bounds = [*starts, self.samples]
        if bounds[0] > 0:
            out.append(Interval(0.0, bounds[0] / rate, ""))
        for (_, name), a, b in zip(self.phones, bounds, bounds[1:], strict=False):
            if b <= a:
                continue
            silent = not name and _silent_share(runs, ends, a, b) > 0.8
            if not name and out and (not silent or out[-1].label == ""):
                out[-1] = Interval(out[-1].start, b / rate, out[-1].label)
            else:
                out.append(Interval(a / rate, b / rate, name))
        return out

    def _make_room(self, rate: int) -> None:
        """Give phones that have no time of their own the end of the phone before them."""
        bounds = [*self.starts, self.samples]
        i, n = 0, len(self.phones)
        while i < n:
            j = i + 1
            while j < n and self.phones[j][1] and bounds[j + 1] - bounds[j] < NO_TIME * rate:
                j += 1
            short = j - i - 1
            if short and self.phones[i][1]:
                part = min(round(LONGEST_SHARE * rate), (bounds[j] - bounds[i]) // (short + 2))
                for k in range(1, short + 1):
                    self.starts[i + k] = bounds[j] - part * (short + 1 - k)
            i = j


def _silent_share(
    runs: list[tuple[int, int]], ends: npt.NDArray[np.int64], first: int, last: int
) -> float:
    """How much of a span is digital silence."""
    k = int(np.searchsorted(ends, first, side="right"))
    total = 0
    while k < len(runs) and runs[k][0] < last:
        total += min(runs[k][1], last) - max(runs[k][0], first)
        k += 1
    return total / (last - first)


def _words(heard: _Heard, text: str, rate: int) -> list[Interval]:
    """Words in time: the phones from one word's mark to the next one's, without pauses."""
    kept: list[tuple[int, int, int]] = []
    for mark in heard.words:
        # A number is one word of the text, said in several.
        if not kept or mark[1] >= kept[-1][1] + max(1, kept[-1][2]):
            kept.append(mark)
    bounds = [*heard.starts, heard.samples]
    out: list[Interval] = []
    for i, (first, place, _) in enumerate(kept):
        after, behind = kept[i + 1][:2] if i + 1 < len(kept) else (len(heard.phones), len(text))
        named = [k for k in range(first, after) if heard.phones[k][1]]
        tokens = text[place:behind].split()
        if not tokens or not named:
            continue
        start, end = bounds[named[0]] / rate, bounds[named[-1] + 1] / rate
        left = sum(map(len, tokens))
        for token in tokens:  # "of the" may be one word to espeak
            share = (end - start) * len(token) / left
            left -= len(token)
            if share > 1e-6:
                out.append(Interval(start, start + share, token))
            start += share
    return out
