"""A long track in pieces, cut where nobody speaks, so that each is an utterance of its own."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np

from database.phonemes import SILENCE
from database.sound import Sound
from database.track import PhonemeTrack

LONG: Final = 30.0
"""Seconds: tracks up to here are searched as one."""

PIECE: Final = 10.0
"""Seconds that a piece lasts at least."""

PAUSE: Final = 0.2
"""Seconds of silence in which a track may be cut."""

LONGEST: Final = 60.0
"""Seconds after which it is cut at the end of a phoneme, if nobody pauses."""


def pieces(track: PhonemeTrack) -> list[PhonemeTrack]:
    """Cut a track that is long into utterances.

    Parameters
    ----------
    track : PhonemeTrack

    Returns
    -------
    list of PhonemeTrack
        Each in its own time, from 0; one after another they are the track. The track itself where
        it is no longer than `LONG`.
    """
    if track.end <= LONG:
        return [track]
    cuts = [0.0, *_cuts(track), track.end]
    return [part(track, a, b) for a, b in pairwise(cuts)]


def _cuts(track: PhonemeTrack) -> Iterator[float]:
    last = 0.0
    bounds = track.boundaries
    for i, phoneme in enumerate(track.phonemes):
        start, end = float(bounds[i]), float(bounds[i + 1])
        middle = (start + end) / 2
        pause = phoneme == SILENCE and end - start >= PAUSE
        while end - last > LONGEST and start - last < PIECE:
            last += LONGEST / 2  # One phoneme without an end.
            yield last
        if pause and middle - last >= PIECE and track.end - middle >= PIECE / 2:
            last = middle
            yield last
        elif end - last > LONGEST:
            last = start
            yield last


def part(track: PhonemeTrack, start: float, end: float) -> PhonemeTrack:
    """A part of a track, in its own time.

    Parameters
    ----------
    track : PhonemeTrack
    start, end : float
        Seconds.
    """
    bounds = track.boundaries
    inside = np.flatnonzero((bounds[1:] > start + 1e-9) & (bounds[:-1] < end - 1e-9))
    cut = np.concatenate([bounds[inside], [end]])
    cut[0] = max(cut[0], start)
    return PhonemeTrack(track.phonemes[inside], cut - start, track.name)


def sound_part(sound: Sound, start: float, end: float) -> Sound:
    """The sound of a part."""
    return Sound(sound.samples[round(start * sound.rate) : round(end * sound.rate)], sound.rate)
