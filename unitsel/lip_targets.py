"""What lips cost as targets beside their likeness: rest in silences, closure in p, b and m.

Phonemes around a frame, and a prediction from them, are averages: a pause between two words that
nobody recorded looks half open to both, and a short m hardly closes. A viewer sees each such
frame. So a silence of `LONG_SILENCE` or more asks for lips at the person's own rest, and the frames
in which a p, b or m is closed ask for lips together. Both are added to the target cost of every
candidate; the search chooses, and stays exact.

Lips are counted in parts of the way from the person's rest to wide open, so that the same settings
do for every person and camera. Where the database has marks of rests and closures
(analysis/phone_marks.py) they say which of its units rest; where it has none, silence around a unit
does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from database.errors import SelectionError
from database.phonemes import CLOSURES, PHONEME_INDEX, SILENCE
from database.schema import PhoneMarks, Phones, Units
from database.track import PhonemeTrack, frame_count, frame_times

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

LONG_SILENCE: Final = 0.2
"""Seconds from which on lips come to rest in a silence."""

AROUND: Final = 0.12
"""Seconds of silence on both sides that make a unit one of rest, where nothing is marked."""

ENOUGH: Final = 20
"""Units that a person's rest is estimated from, at least."""

USUAL: Final = 80.0
"""Percentile of the units at rest whose difference from the median costs nothing."""

WIDE: Final = 95.0
"""Percentile of the openings and heights in speech that counts as wide open."""

RAMPS: Final = 0.6
"""Part of a silence that coming to rest and opening again may take, at most."""

CLOSED_PART: Final = {PHONEME_INDEX["p"]: 0.75, PHONEME_INDEX["b"]: 0.75, PHONEME_INDEX["m"]: 1.0}
"""Part of each phone, from its start, in which lips are together: p and b end in a burst."""

BESIDE: Final = 0.5
"""Weight of the frame beside a closure that has only one frame of its own: to the eye a flicker
of one frame is no closure."""


@dataclass(frozen=True)
class RestSettings:
    """How lips are held to rest and closure.

    Parameters
    ----------
    rest : float
        Weight of the cost of lips that are not at rest in a long silence, beside a target cost
        of 1 for two random frames; 0 switches it off.
    closure : float
        Weight of the cost of open lips in p, b and m; 0 switches it off.
    after, before : float
        Seconds after speech in which lips come to rest, and before speech in which they open
        already: the cost rises and falls there. In a short silence both shrink.
    closed : float
        Up to this part of the way from rest to wide open, lips are together.

    Raises
    ------
    SelectionError
        If a number cannot be used.
    """

    rest: float = 1.5
    closure: float = 4.0
    after: float = 0.1
    before: float = 0.4
    closed: float = 0.12

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or not (math.isfinite(value) and value >= 0):
                raise SelectionError(
                    f"lips: {f.name} must be a finite number, 0 or more, got {value!r}"
                )
        if self.closed > 1:
            raise SelectionError(f"lips: closed must lie in 0..1, got {self.closed!r}")

    @property
    def used(self) -> bool:
        """Whether any of it costs anything."""
        return self.rest > 0 or self.closure > 0


OFF: Final = RestSettings(rest=0.0, closure=0.0)
"""Neither rest nor closure costs anything."""


class LipSource(Protocol):
    """What is needed of a database."""

    @property
    def fps(self) -> float:
        """Frame rate, 1/s."""

    @property
    def units(self) -> Units:
        """Parameters of the N units."""

    @property
    def phones(self) -> Phones:
        """The phones of all sequences."""

    @property
    def marks(self) -> PhoneMarks:
        """Closures and rests that were found."""


@dataclass(frozen=True)
class Lips:
    """How open the lips of each unit are, and how far from rest.

    Parameters
    ----------
    opening : (N,) float64
        0 at the person's rest, 1 wide open.
    unrest : (N,) float64
        How far opening, height and visible teeth are from what is usual at rest; 0 where they
        are not.
    """

    opening: FloatArray
    unrest: FloatArray

    @classmethod
    def of(cls, source: LipSource) -> Lips:
        """Measure the units of a database."""
        units = source.units
        speech = units.phoneme != SILENCE
        if not speech.any():
            speech = np.ones(len(units), dtype=np.bool_)
        rest = resting(source)
        measures = []
        for values in (units.inner_opening, units.mouth_height):
            v = values.astype(np.float64)
            wide = float(np.percentile(v[speech], WIDE))
            # Who was never recorded at rest is taken to rest as narrow as speech ever gets.
            still = v[rest] if rest.any() else v[v <= np.percentile(v, 100 - WIDE)]
            middle = float(np.median(still))
            away = np.abs(v - middle)
            usual = float(np.percentile(np.abs(still - middle), USUAL))
            span = max(wide - middle, 1e-6)
            measures.append(((v - middle) / span, np.maximum(away - usual, 0.0) / span))
        teeth = units.teeth.astype(np.float64)
        usual = float(np.percentile(teeth[rest], USUAL)) if rest.any() else float(teeth.min())
        shown = np.maximum(teeth - usual, 0.0)
        (opening, opened), (_, raised) = measures
        return cls(opening, np.sqrt(opened**2 + raised**2 + shown**2))


def resting(source: LipSource) -> BoolArray:
    """Units recorded at rest in a silence of `LONG_SILENCE` or more, (N,).

    Those in marked rests; where these are too few, those amid silence.
    """
    units, phones, marks = source.units, source.phones, source.marks
    times = (units.frame + 0.5) / source.fps
    silent = phones.phoneme[marks.phone] == SILENCE
    long = phones.end[marks.phone] - phones.start[marks.phone] >= LONG_SILENCE - 1e-9
    for sure in ((marks.sound > 0) & (marks.lips > 0), np.ones(len(marks), dtype=np.bool_)):
        found = np.zeros(len(units), dtype=np.bool_)
        for m in np.flatnonzero(silent & long & sure):
            s = int(phones.sequence[marks.phone[m]])
            first, last = (int(i) for i in np.searchsorted(units.sequence, [s, s + 1]))
            inside = (times[first:last] >= marks.start[m]) & (times[first:last] < marks.end[m])
            found[first:last] |= inside
        if found.sum() >= ENOUGH:
            return found
    quiet = units.phoneme == SILENCE
    for sequence in np.unique(units.sequence[quiet]):
        own = np.flatnonzero(units.sequence == sequence)
        spoken = times[own][~quiet[own]]
        if len(spoken):
            after = np.searchsorted(spoken, times[own])
            bounds = np.concatenate([[-np.inf], spoken, [np.inf]])
            near = np.minimum(times[own] - bounds[after], bounds[after + 1] - times[own])
            quiet[own] &= near > AROUND
    return np.asarray(quiet, dtype=np.bool_)


def rest_weights(track: PhonemeTrack, fps: float, settings: RestSettings) -> FloatArray:
    """How much each frame asks for lips at rest, (T,), 0..1."""
    n = frame_count(track.end, fps)
    times = frame_times(n, fps)
    weights = np.zeros(n)
    for start, end in track.silences(LONG_SILENCE):
        # In a short silence the lips have less time for all of it, but come to rest once.
        ramps = np.array([settings.after, settings.before])
        ramps *= min(1.0, RAMPS * (end - start) / max(ramps.sum(), 1e-9))
        if start <= track.start:
            ramps[0] = 0.0
        if end >= track.end:
            ramps[1] = 0.0
        inside = (times >= start - 1e-9) & (times < end - 1e-9)
        since, until = times[inside] - start, end - times[inside]
        up = since / ramps[0] if ramps[0] > 0 else np.ones_like(since)
        down = until / ramps[1] if ramps[1] > 0 else np.ones_like(until)
        weights[inside] = np.clip(np.minimum(up, down), 0.0, 1.0)
    return weights


def closure_frames(track: PhonemeTrack, fps: float) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Which frames show the closure of a p, b or m.

    Parameters
    ----------
    track : PhonemeTrack
    fps : float
        Frames a second.

    Returns
    -------
    phone : (T,) int64
        Number of the p, b or m that is closed in a frame, -1 in others. Each has one frame at
        least, however short it is, unless another closure takes that frame.
    weights : (T,) float64
        How much each frame asks for closed lips, 0..1: 1 where `phone` is set, and `BESIDE` in the
        frame beside a closure of one frame.
    """
    n = frame_count(track.end, fps)
    times = frame_times(n, fps)
    phone = np.full(n, -1, dtype=np.int64)
    weights = np.zeros(n)
    for i in np.flatnonzero(np.isin(track.phonemes, list(CLOSURES))):
        start, end = track.boundaries[i : i + 2]
        end = start + CLOSED_PART[int(track.phonemes[i])] * (end - start)
        # Middles of frames may fall on a boundary: rounding must not decide.
        shown = np.flatnonzero((times >= start - 1e-9) & (times < end - 1e-9))
        middle = (start + end) / 2
        if len(shown) == 0:
            shown = np.array([min(n - 1, int(middle * fps))])
        phone[shown[phone[shown] < 0]] = i
        weights[shown] = 1.0
        if len(shown) == 1:
            beside = int(shown[0]) + (1 if middle > times[shown[0]] else -1)
            if 0 <= beside < n:
                weights[beside] = max(weights[beside], BESIDE)
    return phone, weights


def wanted_phonemes(
    track: PhonemeTrack, fps: float, settings: RestSettings
) -> npt.NDArray[np.uint8]:
    """Phoneme that each frame asks for, (T,): as the track is sampled, but no closure is left out.

    A p, b or m that is so short that no frame's middle falls into it takes the frame in which it
    is; what is said there else is heard, but nobody misses it on the lips.
    """
    phonemes = track.sample(fps)
    if settings.closure > 0:
        phone, _ = closure_frames(track, fps)
        taken = (phone >= 0) & ~np.isin(phonemes, list(CLOSURES))
        phonemes[taken] = track.phonemes[phone[taken]]
    return phonemes


def lip_costs(
    lips: Lips,
    track: PhonemeTrack,
    fps: float,
    candidates: Sequence[npt.NDArray[np.integer]],
    settings: RestSettings,
) -> tuple[FloatArray | None, ...] | None:
    """What rest and closure add to the target costs of a sentence's candidates.

    Parameters
    ----------
    lips : Lips
        Of all units.
    track : PhonemeTrack
    fps : float
        Frames a second.
    candidates : T arrays of int
        Units to look at; frames may share an array.
    settings : RestSettings

    Returns
    -------
    T of (m,) float64 or None, or None
        None where a frame asks for nothing, and None in all where nothing costs anything.
    """
    if not settings.used:
        return None
    rest = settings.rest * rest_weights(track, fps, settings)
    closure = settings.closure * closure_frames(track, fps)[1]
    apart = np.maximum(lips.opening - settings.closed, 0.0)
    out: list[FloatArray | None] = []
    for units, still, together in zip(candidates, rest, closure, strict=True):
        cost: FloatArray | None = None
        if still > 0:
            cost = still * lips.unrest[units]
        if together > 0:
            closing = together * apart[units]
            cost = closing if cost is None else cost + closing
        out.append(cost)
    return tuple(out)
