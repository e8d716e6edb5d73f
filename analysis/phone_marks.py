"""When lips are closed for p, b and m, and when mouth and voice rest: from sound and lips together.

An aligner's phone boundaries are those of its acoustic model, some 20 ms from where the lips
close or the voice stops, and lips are filmed every 40 ms. The sound has neither fault: while
the lips are closed, little above two kilohertz comes out, in p, b and m alike, in steps
of 10 ms. But it does not tell a closure from the silence before it; lips do. So each is asked for
what it knows, and what neither confirms is not marked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from database.phonemes import CLOSURES, SILENCE
from database.schema import PhoneMarks, Phones
from database.sound_features import FEATURE_RATE, band_centres

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Span = tuple[int, int]

BRIGHT: Final = 2000.0
"""Hertz above which closed lips let little through, in m as in p and b."""

STEP: Final = 1.0 / FEATURE_RATE
"""Seconds: the time resolution of the marks."""


@dataclass(frozen=True)
class MarkSettings:
    """What counts as a closure and as a rest.

    Parameters
    ----------
    reach : float
        Seconds by which a closure may begin or end outside its phone's boundaries, though never
        beyond the middle of the phone beside it.
    contrast : float
        A closure is heard if the brightness falls by so much, in spreads of the clip's, against
        what is around it.
    closed_share : float
        Lips are together up to this share of the way from their rest to wide open.
    still_share : float
        Lips rest while they move slower than this share of their mean speed in speech.
    shortest_closure, shortest_rest : float
        Seconds below which nothing is marked.
    """

    reach: float = 0.06
    contrast: float = 0.6
    closed_share: float = 0.25
    still_share: float = 0.5
    shortest_closure: float = 0.02
    shortest_rest: float = 0.08


@dataclass(frozen=True)
class SpokenClip:
    """What of a clip the marks are taken from.

    Parameters
    ----------
    times : (n,) float
        Seconds of the frames with a face.
    opening : (n,) float
        Inner opening of the lips there, mm.
    sound : (steps, 26) float
        `database.sound_features`, in the time of the phones; no steps without sound.
    """

    times: npt.NDArray[np.floating]
    opening: npt.NDArray[np.floating]
    sound: npt.NDArray[np.floating]


def mark_phones(
    phones: Phones, clips: Sequence[SpokenClip], settings: MarkSettings | None = None
) -> PhoneMarks:
    """Mark closures and rests in all clips of a person.

    Parameters
    ----------
    phones : Phones
        Of all clips.
    clips : sequence of SpokenClip
        Number s is that of sequence s.
    settings : MarkSettings, optional

    Returns
    -------
    PhoneMarks
        In order of the phones; at most one mark a phone.
    """
    chosen = settings or MarkSettings()
    first = np.searchsorted(phones.sequence, np.arange(len(clips) + 1))
    curves = [
        _Curves.of(clip, float(phones.end[last - 1]))
        for clip, last in zip(clips, first[1:], strict=True)
    ]
    levels = _Levels.of(phones, first, curves, chosen)
    found: list[tuple[int, Span, bool, bool]] = []
    for curve, a, b in zip(curves, first[:-1], first[1:], strict=True):
        for k in range(int(a), int(b)):
            if phones.phoneme[k] == SILENCE:
                mark = _rest(_span(phones, k), curve, levels, chosen)
            elif int(phones.phoneme[k]) in CLOSURES:
                mark = _closure(phones, k, (int(a), int(b)), curve, levels, chosen)
            else:
                continue
            if mark is not None:
                found.append((k, *mark))
    spans = np.array([span for _, span, _, _ in found], dtype=np.float64).reshape(-1, 2)
    return PhoneMarks(
        np.array([k for k, _, _, _ in found], np.int32),
        spans[:, 0] / FEATURE_RATE,
        spans[:, 1] / FEATURE_RATE,
        np.array([heard for _, _, heard, _ in found], np.uint8),
        np.array([seen for _, _, _, seen in found], np.uint8),
    )


@dataclass(frozen=True)
class _Curves:
    """A clip in steps of `STEP`, step k centred at (k + 1/2) `STEP`; NaN where nothing is known."""

    bright: FloatArray
    loud: FloatArray
    opening: FloatArray
    speed: FloatArray

    @classmethod
    def of(cls, clip: SpokenClip, end: float) -> _Curves:
        n = int(np.ceil(end * FEATURE_RATE))
        at = (np.arange(n) + 0.5) * STEP
        bright, loud, opening = (np.full(n, np.nan) for _ in range(3))
        if len(clip.sound):
            heard = np.asarray(clip.sound, dtype=np.float64)
            times = np.arange(len(heard)) * STEP
            bright = np.interp(at, times, heard[:, band_centres() > BRIGHT].mean(axis=1))
            loud = np.interp(at, times, heard.mean(axis=1))
        if len(clip.times) > 1:
            opening = np.interp(at, clip.times, np.asarray(clip.opening, np.float64))
            # A gap of frames without a face says nothing of the lips.
            place = np.clip(np.searchsorted(clip.times, at), 1, len(clip.times) - 1)
            usual = float(np.median(np.diff(clip.times)))
            gap = np.diff(clip.times)[place - 1] > 1.5 * usual
            outside = (at < clip.times[0] - usual) | (at > clip.times[-1] + usual)
            opening[gap | outside] = np.nan
        speed = np.abs(np.gradient(opening, STEP)) if n > 1 else np.full(n, np.nan)
        return cls(bright, loud, opening, speed)


@dataclass(frozen=True)
class _Levels:
    """What is low for this person: halfway between what speech and what closures and rests have."""

    loud: float
    opening: float
    speed: float

    @classmethod
    def of(
        cls,
        phones: Phones,
        first: npt.NDArray[np.integer],
        curves: Sequence[_Curves],
        settings: MarkSettings,
    ) -> _Levels:
        kinds = []
        for curve, a, b in zip(curves, first[:-1], first[1:], strict=True):
            at = (np.arange(len(curve.loud)) + 0.5) * STEP
            which = np.searchsorted(phones.end[a:b], at, side="right")
            kinds.append(phones.phoneme[a:b][np.clip(which, 0, b - a - 1)])
        kind = np.concatenate(kinds)
        silent = kind == SILENCE
        speech = ~silent & ~np.isin(kind, list(CLOSURES))

        def joined(name: str) -> FloatArray:
            return np.concatenate([getattr(c, name) for c in curves])

        def halfway(values: FloatArray) -> float:
            return (_median(values[silent]) + _median(values[speech])) / 2

        opening = joined("opening")
        at_rest, wide = _median(opening[silent]), _percentile(opening[speech], 95.0)
        if np.isnan(at_rest):
            # Never recorded in silence: as narrow as speech ever gets.
            at_rest = _percentile(opening[speech], 5.0)
        return cls(
            halfway(joined("loud")),
            at_rest + settings.closed_share * (wide - at_rest),
            settings.still_share * _mean(joined("speed")[speech]),
        )


def _closure(
    phones: Phones,
    k: int,
    clip: Span,
    curve: _Curves,
    levels: _Levels,
    settings: MarkSettings,
) -> tuple[Span, bool, bool] | None:
    """Time of a closure and whether it is heard and seen; None if it is neither."""
    earliest, latest = phones.start[k] - settings.reach, phones.end[k] + settings.reach
    after_silence, before_silence = True, True
    if k > clip[0]:
        earliest = max(earliest, (phones.start[k - 1] + phones.end[k - 1]) / 2)
        after_silence = bool(phones.phoneme[k - 1] == SILENCE)
    if k + 1 < clip[1]:
        latest = min(latest, (phones.start[k + 1] + phones.end[k + 1]) / 2)
        before_silence = bool(phones.phoneme[k + 1] == SILENCE)
    window = _steps(max(earliest, float(phones.start[clip[0]])), latest, len(curve.loud))
    own = _span(phones, k)
    shortest = round(settings.shortest_closure / STEP)
    heard = _run(curve.bright < _dark(curve, window, settings), window, own, shortest)
    seen = _run(curve.opening <= levels.opening, window, own, shortest)
    if heard is not None and (after_silence or before_silence):
        # Where silence is beside it, the sound knows only the closure's other end.
        start = (own if seen is None else seen)[0] if after_silence else heard[0]
        end = (own if seen is None else seen)[1] if before_silence else heard[1]
        heard = (start, end) if end - start >= shortest else heard
    if heard is None:
        return None if seen is None else (seen, False, True)
    together = seen is not None and min(seen[1], heard[1]) > max(seen[0], heard[0])
    return heard, True, together


def _dark(curve: _Curves, window: Span, settings: MarkSettings) -> float:
    """Brightness below which lips are closed: halfway between the least and what is around it.

    Of this place and not of the person: a nasal's closure is brighter than a vowel of a dull voice.
    """
    around = curve.bright[window[0] : window[1]]
    least, usual = _percentile(around, 0.0), _percentile(around, 80.0)
    return (least + usual) / 2 if usual - least >= settings.contrast else float("-inf")


def _rest(
    span: Span, curve: _Curves, levels: _Levels, settings: MarkSettings
) -> tuple[Span, bool, bool] | None:
    """Time in a silence in which mouth and voice rest, and whether that is heard and seen."""
    shortest = round(settings.shortest_rest / STEP)
    quiet = curve.loud < levels.loud
    still = (curve.opening <= levels.opening) & (curve.speed <= levels.speed)
    both = _run(quiet & still, span, span, shortest)
    if both is not None:
        return both, True, True
    for flags, heard in ((quiet, True), (still, False)):
        alone = _run(flags, span, span, shortest)
        if alone is not None:
            return alone, heard, not heard
    return None


def _run(flags: BoolArray, window: Span, own: Span, shortest: int) -> Span | None:
    """Of the runs of True inside a window, the one that shares most with the phone's own time."""
    inside = np.concatenate([[False], flags[window[0] : window[1]], [False]])
    edges = np.flatnonzero(np.diff(inside.astype(np.int8))) + window[0]
    runs = [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= shortest]
    best = max(runs, key=lambda r: (min(r[1], own[1]) - max(r[0], own[0]), -r[0]), default=None)
    # Beside the phone and not in it, it is another sound's.
    return best if best and min(best[1], own[1]) > max(best[0], own[0]) else None


def _span(phones: Phones, k: int) -> Span:
    return _steps(float(phones.start[k]), float(phones.end[k]), None)


def _steps(start: float, end: float, n: int | None) -> Span:
    a, b = round(start / STEP), max(round(start / STEP) + 1, round(end / STEP))
    return (max(0, a), b if n is None else min(b, n))


def _median(values: npt.NDArray[Any]) -> float:
    return _percentile(values, 50.0)


def _mean(values: npt.NDArray[Any]) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else float("nan")


def _percentile(values: npt.NDArray[Any], q: float) -> float:
    known = values[~np.isnan(values)]
    # Comparisons with NaN are False: what is not known is never low.
    return float(np.percentile(known, q)) if len(known) else float("nan")
