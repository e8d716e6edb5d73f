"""When a face has which shape: the rules of Image Talk (section 4) for shapes in time.

A syllable (or a phoneme) that lasts from ``a`` to ``d`` has one or more shapes. With times counted
in parts of its length, the first is reached at ``begin`` (the paper's b = 0.2) and the last at
``end`` (c = 0.6); those between divide the time evenly. Then either

* ``contract``, the paper's method (a): the face is drawn back to the neutral one,
  ``F = rA Fn + rB Fneutral`` with ``rB = (t - c) / contraction``, until the next ``a``; or
* ``onward``, method (b): straight on from the last shape to the next one's first, but back to the
  neutral face where a pause follows.

The shape has to be there before the sound (rule 1 of section 4.1): the paper's ``b`` is where the
sound begins. Times that are measured in sound are therefore moved forward by ``lead``, 0.2 of the
length, which lays ``b`` on the sound's first moment; with ``lead = 0`` they are taken as they are,
and so are those of a span that does not lead (`Span.leads`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from database.errors import TrackError
from database.track import frame_times

FloatArray = npt.NDArray[np.float64]

NEUTRAL: Final = 0
"""Column of the neutral face, which all others are measured from."""

_APART: Final = 1e-4
"""Seconds that two points of a curve lie apart at least."""


@dataclass(frozen=True)
class TimingSettings:
    """The constants of section 4.

    Parameters
    ----------
    begin, end : float
        Parts of a span at which its first and its last shape are reached: b and c.
    lead : float
        Part of a span by which its shapes come before its sound.
    method : {"contract", "onward"}
        What follows the last shape: methods (a) and (b).
    interpolation : {"linear", "hermite"}
        Straight between two shapes, or along cubic Hermite curves that do not overshoot.
    contraction : float
        Time in which a face is back at the neutral one, in lengths of its span
        (the paper's timeContractionConst, 1).
    prepare : float
        Seconds that the way from rest to a first shape, and from the last one back, takes at
        least; spans of phonemes are too short to divide.
    pause : float
        Seconds without sound that count as rest.

    Raises
    ------
    ValueError
        If a constant lies outside its range.
    """

    begin: float = 0.2
    end: float = 0.6
    lead: float = 0.2
    method: Literal["contract", "onward"] = "contract"
    interpolation: Literal["linear", "hermite"] = "hermite"
    contraction: float = 1.0
    prepare: float = 0.12
    pause: float = 0.1

    def __post_init__(self) -> None:
        if not 0 <= self.begin <= self.end <= 1:
            raise ValueError(f"begin {self.begin:g} and end {self.end:g} must rise within 0 to 1")
        if not 0 <= self.lead <= 1:
            raise ValueError(f"lead must lie within 0 to 1, not {self.lead:g}")
        if self.method not in ("contract", "onward"):
            raise ValueError(f"method must be contract or onward, not {self.method!r}")
        if self.interpolation not in ("linear", "hermite"):
            raise ValueError(f"interpolation must be linear or hermite, not {self.interpolation!r}")
        if self.contraction <= 0 or self.prepare < 0 or self.pause < 0:
            raise ValueError("contraction must be positive, prepare and pause not negative")


@dataclass(frozen=True)
class Span:
    """A syllable or phoneme and the shapes that show it.

    Parameters
    ----------
    start, end : float
        Of its sound, seconds.
    shapes : (m, K) float
        What the face is at its shapes, in turn: weights of K key frames, the neutral first.
    held : float
        Seconds of sound through which the first shape is kept: lips stay closed until a p is
        released.
    leads : bool
        Whether its first sound is made with the first shape. Where the tongue makes it (the d of
        "da"), the sound that has to find the shape ready comes later, and nothing is moved forward.
    """

    start: float
    end: float
    shapes: FloatArray
    held: float = 0.0
    leads: bool = True

    def part(self, share: float, settings: TimingSettings) -> float:
        """Time of a part of the span, moved forward, seconds."""
        lead = settings.lead if self.leads else 0.0
        return self.start + (share - lead) * (self.end - self.start)


def shape_weights(
    spans: Sequence[Span], fps: float, n: int, n_shapes: int, settings: TimingSettings
) -> FloatArray:
    """Weights of the key frames in each frame.

    Parameters
    ----------
    spans : sequence of Span
        In order, none overlapping; what lies between is silence.
    fps : float
        Frames a second.
    n : int
        Frames.
    n_shapes : int
        Key frames, K, the neutral one among them.
    settings : TimingSettings

    Returns
    -------
    (n, K) float64
        At the frames' middles; not negative, each row adds up to 1.

    Raises
    ------
    TrackError
        If spans overlap or have no length.
    """
    times, rows = curve_points(spans, n_shapes, settings)
    at = frame_times(n, fps)
    if len(times) < 2:
        out = np.repeat(rows[:1], n, axis=0)
    elif settings.interpolation == "linear":
        columns = [np.interp(at, times, rows[:, k]) for k in range(n_shapes)]
        out = np.stack(columns, axis=1)
    else:
        inside = np.clip(at, times[0], times[-1])
        out = PchipInterpolator(times, rows, axis=0)(inside)
    out = np.clip(out, 0.0, None)
    # The neutral face is what the others leave of 1.
    others = np.delete(out, NEUTRAL, axis=1).sum(axis=1)
    out /= np.maximum(1.0, others)[:, None]
    out[:, NEUTRAL] = np.maximum(0.0, 1.0 - others)
    return np.asarray(out, dtype=np.float64)


def curve_points(
    spans: Sequence[Span], n_shapes: int, settings: TimingSettings
) -> tuple[FloatArray, FloatArray]:
    """The points that the curves go through.

    Returns
    -------
    times : (p,) float64
        Seconds, rising.
    rows : (p, K) float64
        The face there.

    Raises
    ------
    TrackError
        If spans overlap or have no length.
    """
    neutral = np.zeros(n_shapes)
    neutral[NEUTRAL] = 1.0
    curve = _Curve([], [])
    before: Span | None = None
    for i, span in enumerate(spans):
        length = span.end - span.start
        if length <= 0 or (before is not None and span.start < before.end - 1e-6):
            raise TrackError(
                f"span {i + 1} ({span.start:g} to {span.end:g} s) has no length or overlaps"
            )
        begin = span.part(settings.begin, settings)
        a = min(span.part(0.0, settings), begin - settings.prepare)
        if before is None:
            curve.put(a, neutral)
        elif settings.method == "contract" or span.start - before.end >= settings.pause:
            curve.draw_back(a, begin, _contraction(before, settings), neutral)
        curve.put_shapes(span, begin, settings)
        before = span
    if before is None:
        curve.put(0.0, neutral)
    else:
        curve.put(curve.times[-1] + _contraction(before, settings), neutral)
    # Rest before and after, so that curves are level where they begin and end.
    times = [curve.times[0] - 1.0, *curve.times, curve.times[-1] + 1.0]
    return np.array(times), np.array([curve.rows[0], *curve.rows, curve.rows[-1]])


def _contraction(span: Span, settings: TimingSettings) -> float:
    """Seconds in which the face after a span is neutral again."""
    return max(settings.contraction * (span.end - span.start), settings.prepare)


@dataclass
class _Curve:
    """The points of a curve, as they are found."""

    times: list[float]
    rows: list[FloatArray]

    def put(self, time: float, row: FloatArray) -> None:
        """Add a point, behind the last one."""
        self.times.append(max(time, self.times[-1] + _APART) if self.times else time)
        self.rows.append(row)

    def put_shapes(self, span: Span, begin: float, settings: TimingSettings) -> None:
        """Add a span's own shapes: the first at `begin`, the last at the paper's c."""
        end = span.part(settings.end, settings)
        shapes = np.asarray(span.shapes, dtype=np.float64)
        self.put(begin, shapes[0])
        if span.held > 0:
            begin = max(begin, min(span.start + span.held, span.end) - _APART)
            self.put(begin, shapes[0])
            # What follows a closure still has its share of the time.
            end = max(end, begin + (settings.end - settings.begin) * (span.end - begin))
        for k in range(1, len(shapes)):
            self.put(begin + (end - begin) * k / (len(shapes) - 1), shapes[k])
        if len(shapes) == 1 and end > begin:
            self.put(end, shapes[0])

    def draw_back(self, a: float, begin: float, whole: float, neutral: FloatArray) -> None:
        """Method (a): towards the neutral face from the last shape until `a`, Ftransition."""
        c, last = self.times[-1], self.rows[-1]
        a = min(max(a, c), begin)
        if a - c <= _APART:
            return
        if a - c > whole:
            self.put(c + whole, neutral)
        back = min(1.0, (a - c) / whole)
        self.put(a, (1 - back) * last + back * neutral)
