"""Parts of the page: tables, pictures, and drawings as SVG (histograms, dots, diphones)."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from typing import Final

import numpy as np
import numpy.typing as npt

from database.phonemes import PHONEMES
from unitsel.doctor.coverage import ENOUGH, Coverage

BINS: Final = 32
CELL: Final = 16
"""Side of a diphone's square in the map."""

PALEST: Final = 0.18
"""Opacity of the rarest missing diphone."""


def counted(n: int, noun: str) -> str:
    """A number and its noun: ``1 clip``, ``2 clips``."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def picture(data: bytes, alt: str) -> str:
    """A JPEG inside the page; nothing where there is none."""
    if not data:
        return ""
    code = base64.b64encode(data).decode("ascii")
    return f'<img alt="{escape(alt)}" src="data:image/jpeg;base64,{code}">'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], text: Sequence[int] = ()) -> str:
    """A table; the cells are HTML, the columns in `text` are set left and may wrap."""

    def cell(tag: str, i: int, content: str) -> str:
        if content.startswith("<td"):
            return content
        kind = ' class="text"' if i in text else ""
        return f"<{tag}{kind}>{content}</{tag}>"

    top = "".join(cell("th", i, h) for i, h in enumerate(head))
    body = "".join(
        f"<tr>{''.join(cell('td', i, c) for i, c in enumerate(row))}</tr>\n" for row in rows
    )
    return (
        f'<div class="scroll"><table class="numbers"><thead><tr>{top}</tr></thead>\n'
        f"<tbody>\n{body}</tbody></table></div>\n"
    )


def histogram(
    values: npt.NDArray[np.float64], low: float, high: float, title: str, unit: str
) -> str:
    """Counts of values, the good range behind them and what is outside of it in red.

    Parameters
    ----------
    values : (n,) float64
        At least one.
    low, high : float
        Ends of the good range.
    title, unit : str
    """
    first, last = min(float(values.min()), low), max(float(values.max()), high)
    counts, edges = np.histogram(values, bins=BINS, range=(first, last))
    width, height, top = 340.0, 96.0, 22.0

    def x(value: float) -> float:
        return 8 + (value - first) / max(last - first, 1e-9) * (width - 16)

    tall = max(int(counts.max()), 1)
    bars = []
    for n, a, b in zip(counts, edges[:-1], edges[1:], strict=True):
        if n:
            size = max(1.0, n / tall * height)
            middle = (a + b) / 2
            kind = "bar" if low <= middle <= high else "out"
            bars.append(
                f'<rect class="{kind}" x="{x(a):.1f}" y="{top + height - size:.1f}" '
                f'width="{max(0.5, x(b) - x(a) - 1):.1f}" height="{size:.1f}">'
                f"<title>{n} frames from {a:.1f} to {b:.1f} {unit}</title></rect>"
            )
    base = top + height
    return (
        f'<svg class="histogram" viewBox="0 0 {width:g} {base + 18:g}">'
        f'<text class="left" x="8" y="14">{escape(title)}, {unit}</text>'
        f'<rect class="range" x="{x(low):.1f}" y="{top:g}" width="{x(high) - x(low):.1f}" '
        f'height="{height:g}"/>{"".join(bars)}'
        f'<path class="axis" d="M8 {base:g}H{width - 8:g}"/>'
        f'<text class="left soft" x="8" y="{base + 14:g}">{first:.0f}</text>'
        f'<text class="right soft" x="{width - 8:g}" y="{base + 14:g}">{last:.0f}</text>'
        f'<text class="soft" x="{(x(low) + x(high)) / 2:.1f}" y="{base + 14:g}">'
        f"good: {low:.0f} to {high:.0f}</text></svg>"
    )


def dots(
    names: Sequence[str],
    values: Sequence[float],
    low: float,
    high: float,
    title: str,
    form: str = ".2f",
) -> str:
    """One dot a clip in the order of their names, the good range behind them.

    Parameters
    ----------
    names : sequence of str
    values : sequence of float
        As many, at least one.
    low, high : float
        Ends of the good range; infinite where it has none.
    title : str
    form : str
        How values are written.
    """
    seen = np.array(values, dtype=np.float64)
    ends = [v for v in (low, high) if np.isfinite(v)]
    bottom, top = min(seen.min(), *ends, *ends[:1]), max(seen.max(), *ends, *ends[:1])
    margin = 0.06 * max(top - bottom, 1e-6)
    bottom, top = bottom - margin, top + margin
    width, height, head = 1100.0, 110.0, 20.0

    def y(value: float) -> float:
        return head + float(np.clip((top - value) / (top - bottom), 0, 1)) * height

    step = (width - 80) / max(len(names), 1)
    marks = []
    for i, (name, value) in enumerate(zip(names, values, strict=True)):
        kind = "" if low <= value <= high else ' class="out"'
        marks.append(
            f'<circle{kind} cx="{64 + (i + 0.5) * step:.1f}" cy="{y(value):.1f}" r="3">'
            f"<title>{escape(name)}: {value:{form}}</title></circle>"
        )
    good_top, good_bottom = y(min(high, top)), y(max(low, bottom))
    most, least = f"{seen.max():{form}}", f"{seen.min():{form}}"
    scale = f'<text class="right soft" x="54" y="{y(seen.max()) + 4:.1f}">{most}</text>'
    if least != most:
        under = max(y(seen.min()), y(seen.max()) + 12) + 4
        scale += f'<text class="right soft" x="54" y="{under:.1f}">{least}</text>'
    return (
        f'<svg class="dots" viewBox="0 0 {width:g} {head + height + 8:g}">'
        f'<text class="left" x="0" y="13">{escape(title)}</text>'
        f'<rect class="range" x="60" y="{good_top:.1f}" width="{width - 60:g}" '
        f'height="{max(good_bottom - good_top, 0):.1f}"/>{scale}{"".join(marks)}</svg>'
    )


def diphone_map(coverage: Coverage) -> str:
    """Every diphone of English as a square: first phoneme down, second across."""
    wanted = coverage.english.diphones
    known = [p for p in range(len(PHONEMES)) if wanted[p].any() or wanted[:, p].any()]
    left, top = 34, 26
    rarest, commonest = wanted[wanted > 0].min(), wanted.max()
    span = float(np.log(commonest / rarest)) or 1.0
    parts = []
    for i, a in enumerate(known):
        middle = i * CELL + CELL / 2 + 3
        parts.append(f'<text class="row" x="{left - 4}" y="{top + middle:g}">{PHONEMES[a]}</text>')
        parts.append(f'<text x="{left + middle - 3:g}" y="{top - 6}">{PHONEMES[a]}</text>')
        for j, b in enumerate(known):
            share, n = float(wanted[a, b]), int(coverage.diphones[a, b])
            if share == 0 and n == 0:
                continue
            kind = "have" if n >= ENOUGH else "few" if n else "none"
            fade = ""
            if n == 0:
                opacity = PALEST + (1 - PALEST) * float(np.log(share / rarest)) / span
                fade = f' style="opacity:{opacity:.2f}"'
            parts.append(
                f'<rect class="{kind}"{fade} x="{left + j * CELL}" y="{top + i * CELL}" '
                f'width="{CELL - 1}" height="{CELL - 1}"><title>{PHONEMES[a]}-{PHONEMES[b]}: '
                f"{n} recorded, {1000 * share:.2g} in 1000 of English</title></rect>"
            )
    side = len(known) * CELL
    return f'<svg class="map" viewBox="0 0 {left + side} {top + side}">{"".join(parts)}</svg>'
