"""A chosen path as strips of mouths: one SVG a row of frames, everything under its frame.

From the top: frame numbers, words, wanted phones, pictures, recorded phonemes, source clips,
weighted costs, trajectories.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from html import escape
from typing import Final

import numpy as np
import numpy.typing as npt

from database.phonemes import PHONEMES
from database.reader import UnitDatabase
from database.timing.words import WordTrack
from database.track import PhonemeTrack
from unitsel.explain.facts import PathFacts, Trajectory
from unitsel.explain.pictures import CELL, picture_height

FloatArray = npt.NDArray[np.float64]

FRAMES_A_ROW: Final = 25
MARGIN: Final = 68
"""Width of what stands left of the first frame: names of the lanes, ends of the axes."""

COSTS_HEIGHT: Final = 56.0
TRAJECTORY_HEIGHT: Final = 84.0

CHARACTER: Final = 6.4
"""Width of a small character, about: how much of a name fits."""


@dataclass(frozen=True)
class Lanes:
    """Where each lane starts from the top of a row, in SVG units.

    Parameters
    ----------
    picture_height : float
        Of the pictures in a strip.
    numbers, words, phones, pictures : float
        Base line of the frame numbers; tops of the lanes above the pictures, and theirs.
    """

    picture_height: float
    numbers: float = 13.0
    words: float = 18.0
    phones: float = 36.0
    pictures: float = 54.0

    @property
    def recorded(self) -> float:
        """Recorded phonemes."""
        return self.pictures + self.picture_height

    @property
    def clips(self) -> float:
        """Source clips and their frames."""
        return self.recorded + 16

    @property
    def costs(self) -> float:
        """Weighted costs, `COSTS_HEIGHT` high."""
        return self.clips + 34

    def trajectory(self, i: int) -> float:
        """The i-th trajectory, `TRAJECTORY_HEIGHT` high."""
        return self.costs + COSTS_HEIGHT + 8 + i * (TRAJECTORY_HEIGHT + 8)


class Strip:
    """Draws the rows of one path, all to the same scales.

    Parameters
    ----------
    database : UnitDatabase
    facts : PathFacts
    track : PhonemeTrack
    words : WordTrack, optional
        Shown over the phones.
    """

    def __init__(
        self,
        database: UnitDatabase,
        facts: PathFacts,
        track: PhonemeTrack,
        words: WordTrack | None,
    ) -> None:
        self._facts, self._track, self._words = facts, track, words
        self._fps = database.fps
        self._names = database.sequences.name
        self._said = database.sequences.words
        tall = picture_height(database)
        self._lanes = Lanes(tall) if words else Lanes(tall, phones=18.0, pictures=36.0)
        self._greatest = float(facts.weighted.max()) or 1.0
        order = list(dict.fromkeys(facts.sequence.tolist()))
        # Steps of the golden angle: hues of clips that follow one another are far apart.
        self._hue = {s: round(i * 137.508 + 210) % 360 for i, s in enumerate(order)}

    def rows(self) -> list[tuple[int, int, str]]:
        """The rows as (first frame, frame after the last, SVG)."""
        ends = range(0, len(self._facts), FRAMES_A_ROW)
        return [
            (a, b, self._row(a, b)) for a in ends for b in [min(a + FRAMES_A_ROW, len(self._facts))]
        ]

    def _row(self, start: int, end: int) -> str:
        lanes, facts = self._lanes, self._facts
        height = lanes.trajectory(len(facts.trajectories)) - 4
        parts = [self._segments(start, end, height)]
        if self._words is not None:
            spans = zip(self._words.words, self._words.starts, self._words.ends, strict=True)
            parts += [
                self._span("word", lanes.words, word, a, b, start, end) for word, a, b in spans
            ]
        for it in self._track.intervals():
            parts.append(self._span("phone", lanes.phones, it.label, it.start, it.end, start, end))
        parts.append(self._costs(start, end))
        for i, trajectory in enumerate(facts.trajectories):
            parts.append(_trajectory(trajectory, start, end, lanes.trajectory(i)))
        parts += [self._cell(t, start, height) for t in range(start, end)]
        parts.append(self._boundaries(start, end, height))
        parts += [self._join(t, start, height) for t in range(start, end) if facts.join[t]]
        parts.append(self._labels())
        label = f"frames {start} to {end - 1}"
        return (
            f'<svg class="row" role="group" aria-label="{label}" '
            f'viewBox="0 0 {MARGIN + FRAMES_A_ROW * CELL + 4} {height:g}">'
            f"{''.join(p for p in parts if p)}</svg>"
        )

    def _segments(self, start: int, end: int, height: float) -> str:
        """Tinted spans of one recorded segment each, with clip and frames."""
        facts, lanes = self._facts, self._lanes
        starts = [*facts.segment_starts.tolist(), len(facts)]
        out = []
        for a, b in itertools.pairwise(starts):
            a, b = max(a, start), min(b, end)
            if a >= b:
                continue
            s = int(facts.sequence[a])
            x, width = _x(a, start), (b - a) * CELL
            frames = f"{facts.recorded_frame[a]}"
            if b - a > 1:
                frames += f"–{facts.recorded_frame[b - 1]}"
            out.append(
                f'<g style="--hue:{self._hue[s]}">'
                f'<rect class="tint" x="{x}" y="{lanes.pictures:g}" width="{width}" '
                f'height="{height - lanes.pictures:g}"/>'
                f'<rect class="clip" x="{x + 1}" y="{lanes.clips:g}" width="{width - 2}" '
                f'height="30" rx="3"/>'
                + _text("clipname", x + width / 2, lanes.clips + 13, _fit(self._names[s], width))
                + _text("clipname", x + width / 2, lanes.clips + 26, _fit(frames, width))
                + "</g>"
            )
        return "".join(out)

    def _span(
        self, kind: str, y: float, label: str, a: float, b: float, start: int, end: int
    ) -> str:
        """A word or phone that lasts from second a to b, as far as it lies in the row."""
        left = max(_x(a * self._fps, start), MARGIN)
        right = min(_x(b * self._fps, start), _x(end, start))
        if right - left < 0.5:
            return ""
        what = escape(f"{kind} {label}: {a:.3f} to {b:.3f} s")
        shown = _fit(label, right - left)
        return (
            f'<g class="{kind}"><title>{what}</title><rect x="{left:.1f}" y="{y:g}" '
            f'width="{right - left:.1f}" height="17"/>'
            f"{_text('', (left + right) / 2, y + 13, shown)}</g>"
        )

    def _costs(self, start: int, end: int) -> str:
        """Bars of the weighted costs, on top of one another."""
        facts, out = self._facts, []
        scale = COSTS_HEIGHT / self._greatest
        bottom = self._lanes.costs + COSTS_HEIGHT
        terms = (
            ("target", facts.weighted_target),
            ("visual", facts.weighted_visual),
            ("skip", facts.weighted_skip),
        )
        for t in range(start, end):
            y = bottom
            for name, values in terms:
                bar = float(values[t]) * scale
                if bar >= 0.05:
                    y -= bar
                    out.append(
                        f'<rect class="{name}" x="{_x(t, start) + 12}" y="{y:.1f}" '
                        f'width="{CELL - 24}" height="{bar:.1f}"/>'
                    )
        x, right = MARGIN, _x(end, start)
        out.append(f'<path class="axis" d="M{x} {bottom:g}H{right}"/>')
        out.append(_text("tick", MARGIN - 4, self._lanes.costs + 9, f"{self._greatest:.3g}"))
        return "".join(out)

    def _cell(self, t: int, start: int, height: float) -> str:
        """A frame: number, picture, recorded phoneme, and all of it in words when pointed at."""
        facts, lanes = self._facts, self._lanes
        x, unit = _x(t, start), int(facts.units[t])
        recorded = PHONEMES[facts.recorded[t]]
        same = facts.recorded[t] == facts.wanted[t]
        kind = "other" if facts.other_viseme[t] else "same" if same else "near"
        return (
            f'<g class="cell" id="f{t}"><title>{escape(self._told(t))}</title>'
            + _text("number", x + CELL / 2, lanes.numbers, str(t))
            + f'<use href="#u{unit}" x="{x}" y="{lanes.pictures:g}"/>'
            + _text(f"recorded {kind}", x + CELL / 2, lanes.recorded + 12, recorded)
            + f'<rect class="hit" x="{x}" y="{lanes.pictures:g}" width="{CELL}" '
            f'height="{height - lanes.pictures - 1:g}"/></g>'
        )

    def _told(self, t: int) -> str:
        facts = self._facts
        s = int(facts.sequence[t])
        parts = f"paper {number(facts.paper[t])}"
        if facts.guided is not None:
            parts += f", guided {number(facts.guided[t])}"
        if facts.lips is not None:
            parts += f", lips {number(facts.lips[t])}"
        return (
            f"frame {t} ({t / self._fps:.2f} s), wants {PHONEMES[facts.wanted[t]]}\n"
            f"unit {facts.units[t]}: {self._names[s]} frame {facts.recorded_frame[t]}, "
            f"recorded saying {PHONEMES[facts.recorded[t]]} in “{self._said[s]}”\n"
            f"target {number(facts.target[t])} ({parts}), "
            f"place {facts.rank[t]} of {facts.candidates[t]}, "
            f"the cheapest costs {number(facts.cheapest[t])}\n"
            f"f {number(facts.visual[t])}, g {number(facts.skip[t])}\n"
            f"weighted: target {number(facts.weighted_target[t])} + "
            f"visual {number(facts.weighted_visual[t])} + skip {number(facts.weighted_skip[t])} "
            f"= {number(facts.weighted[t])}"
        )

    def _boundaries(self, start: int, end: int, height: float) -> str:
        """Thin lines where phones begin, over pictures and trajectories."""
        top = self._lanes.phones
        inside = [x for b in self._track.boundaries if (x := _x(b * self._fps, start)) > MARGIN]
        d = "".join(f"M{x:.1f} {top:g}V{height:g}" for x in inside if x < _x(end, start))
        return f'<path class="boundary" d="{d}"/>' if d else ""

    def _join(self, t: int, start: int, height: float) -> str:
        """The mark of a join, at the left of the frame that it leads to."""
        x, y = _x(t, start), self._lanes.pictures
        return (
            f'<g class="join" id="j{t}"><title>{escape(join_told(self._facts, self._names, t))}'
            f'</title><path class="line" d="M{x} {y:g}V{height:g}"/>'
            f'<path class="arrow" d="M{x - 5} {y:g}h10l-5 8z"/></g>'
        )

    def _labels(self) -> str:
        """Names of the lanes, at the left."""
        lanes = self._lanes
        named = [
            (lanes.numbers, "frame"),
            (lanes.phones + 13, "wanted"),
            (lanes.recorded + 12, "recorded"),
            (lanes.clips + 13, "clip"),
            (lanes.clips + 26, "its frames"),
            (lanes.costs + COSTS_HEIGHT / 2 + 5, "costs"),
        ]
        if self._words is not None:
            named.append((lanes.words + 13, "words"))
        return "".join(_text("lane", MARGIN - 4, y, label) for y, label in named)


def join_told(facts: PathFacts, names: tuple[str, ...], t: int) -> str:
    """A join in words: from where to where, and its costs."""
    a, b = int(facts.sequence[t - 1]), int(facts.sequence[t])
    before, after = facts.recorded_frame[t - 1], facts.recorded_frame[t]
    return (
        f"join at frame {t}: {names[a]} frame {before} to {names[b]} frame {after}, "
        f"f {number(facts.visual[t])}, g {number(facts.skip[t])}, weighted "
        f"{number(facts.weighted_visual[t])} + {number(facts.weighted_skip[t])}"
    )


def number(value: float) -> str:
    """A cost as the page shows it: five digits that count."""
    return f"{float(value):.5g}"


def _trajectory(trajectory: Trajectory, start: int, end: int, top: float) -> str:
    """Two lines over the frames of a row, at the scale of the whole sentence."""
    both = np.concatenate([trajectory.selected, trajectory.wanted])
    low, high = float(both.min()), float(both.max())
    if high <= low:
        low, high = low - 1, high + 1
    inner = TRAJECTORY_HEIGHT - 8

    def points(values: FloatArray) -> str:
        # Up to the row's ends a line goes half way to the neighbour in the next row.
        at = [t + 0.5 for t in range(start, end)]
        y = [float(v) for v in values[start:end]]
        if start > 0:
            at, y = [float(start), *at], [float(values[start - 1 : start + 1].mean()), *y]
        if end < len(values):
            at, y = [*at, float(end)], [*y, float(values[end - 1 : end + 1].mean())]
        return " ".join(
            f"{_x(a, start):.1f},{top + 4 + inner * (high - v) / (high - low):.1f}"
            for a, v in zip(at, y, strict=True)
        )

    right = _x(end, start)
    unit = f" {trajectory.unit}" if trajectory.unit else ""
    wanted = "predicted" if trajectory.predicted else "mean"
    first, _, rest = trajectory.name.rpartition(" ")
    return (
        f'<path class="axis" d="M{MARGIN} {top:g}H{right}M{MARGIN} '
        f'{top + TRAJECTORY_HEIGHT:g}H{right}"/>'
        f'<polyline class="{wanted}" points="{points(trajectory.wanted)}"/>'
        f'<polyline class="selected" points="{points(trajectory.selected)}"/>'
        + _text("tick", MARGIN - 4, top + 10, f"{high:.4g}{unit}")
        + _text("tick", MARGIN - 4, top + TRAJECTORY_HEIGHT - 2, f"{low:.4g}{unit}")
        + _text("lane", MARGIN - 4, top + TRAJECTORY_HEIGHT / 2 - 1, first)
        + _text("lane", MARGIN - 4, top + TRAJECTORY_HEIGHT / 2 + 12, rest)
    )


def _x(frame: float, start: int) -> float:
    """Place of a time in frames, in a row that begins with a frame."""
    return MARGIN + (frame - start) * CELL


def _text(kind: str, x: float, y: float, text: str) -> str:
    """A text whose alignment its class gives; nothing for no text."""
    if not text:
        return ""
    classed = f' class="{kind}"' if kind else ""
    return f'<text{classed} x="{x:.6g}" y="{y:.6g}">{escape(text)}</text>'


def _fit(text: str, width: float) -> str:
    """As much of a text as a width holds."""
    room = int((width - 4) / CHARACTER)
    if len(text) <= room:
        return text
    return f"{text[: room - 1]}…" if room >= 3 else text[:room]
