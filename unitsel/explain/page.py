"""The page: a summary, then the strips, each with its numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Final

import numpy as np

from database.cost_definition import GROUPS
from database.outfile import whole_file
from database.phonemes import PHONEMES
from database.reader import UnitDatabase
from database.timing.words import WordTrack
from database.track import PhonemeTrack
from unitsel.explain.facts import PathFacts, path_facts
from unitsel.explain.pictures import pair, picture_definitions, single
from unitsel.explain.strip import Strip, join_told, number
from unitsel.explain.style import STYLE
from unitsel.likeness.measures import sl_avg, tc_avg, vc_avg
from unitsel.select import Selection
from unitsel.settings import SelectionSettings

WORST: Final = 8
"""Frames and joins that the summary names."""


def explain(
    database: UnitDatabase,
    track: PhonemeTrack,
    selection: Selection,
    settings: SelectionSettings,
    *,
    words: WordTrack | None = None,
) -> str:
    """Describe a selection as an HTML page.

    Parameters
    ----------
    database : UnitDatabase
        Of the units; their pictures are read from it.
    track : PhonemeTrack
        What was to be said; its name heads the page.
    selection : Selection
    settings : SelectionSettings
        What it was selected with.
    words : WordTrack, optional
        Shown over the phones.

    Returns
    -------
    str
        A whole HTML document, for light and dark screens.

    Raises
    ------
    SelectionError
        If the selection is of another database.
    DatabaseError
        If a picture cannot be read.
    """
    facts = path_facts(database, selection, settings)
    strip = Strip(database, facts, track, words)
    title = escape(track.name)
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n',
        # Whatever the page holds, it fetches nothing.
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "img-src data:; style-src 'unsafe-inline'\">\n",
        '<meta name="viewport" content="width=device-width">\n',
        f"<title>{title}: selection</title>\n<style>{STYLE}</style>\n</head>\n<body>\n",
        picture_definitions(database, facts.units),
        f"<h1>{title}</h1>\n",
        f'<p class="soft">{len(facts)} frames at {database.fps:g} a second '
        f"({selection.duration:.2f} s) from {escape(database.path.name)}. Frames are the "
        "database's; a video of another rate shows the nearest in time.</p>\n",
        _said(facts, words, database.fps),
        '<div class="cards">\n',
        _path_cost(facts, selection),
        _averages(database, facts),
        _settings(settings),
        "</div>\n",
        _fallbacks(selection),
        '<div class="cards">\n',
        _worst_frames(database, facts),
        _worst_joins(database, facts),
        "</div>\n",
        _legend(facts),
    ]
    for start, end, drawn in strip.rows():
        seconds = f"{start / database.fps:.2f} to {end / database.fps:.2f} s"
        parts += [
            f'<h2 id="r{start}">{seconds}</h2>\n<div class="scroll">{drawn}</div>\n',
            f"<details><summary>Numbers of frames {start} to {end - 1}</summary>\n",
            _numbers(database, facts, start, end),
            "</details>\n",
        ]
    return "".join([*parts, "</body>\n</html>\n"])


def write_explanation(path: str | Path, page: str) -> None:
    """Write a page of `explain` to a file, as a whole or not at all.

    Raises
    ------
    DatabaseError
        If it cannot be written.
    """
    with whole_file(Path(path)) as file:
        # A clip may be named with bytes that are no text.
        file.write(page.encode("utf-8", errors="replace"))


def _said(facts: PathFacts, words: WordTrack | None, fps: float) -> str:
    """The words, each a link to its first frame, redder the more its frames cost."""
    if words is None:
        return ""
    spans = []
    for word, a, b in zip(words.words, words.starts, words.ends, strict=True):
        # The frames whose middles lie in the word, and one at least.
        first = min(math.ceil(a * fps - 0.5), len(facts) - 1)
        spans.append((word, first, max(first + 1, min(math.ceil(b * fps - 0.5), len(facts)))))
    means = np.array([facts.weighted[a:b].mean() for _, a, b in spans])
    worst = float(means.max()) or 1.0
    out = []
    for (word, a, b), mean in zip(spans, means, strict=True):
        joined = int(facts.join[a:b].sum())
        heat = 0.55 * max(0.0, float(mean) / worst) ** 2
        out.append(
            f'<a href="#f{a}" style="background:rgb(201 42 42 / {heat:.2f})" title="mean path cost '
            f'a frame {number(mean)}, {joined} joins">{escape(word)}<small>{mean:.3g}</small></a>'
        )
    return (
        f'<p class="said">{"".join(out)}</p>\n<p class="soft">Under each word its mean path cost '
        "a frame; a word leads to its frames.</p>\n"
    )


def _card(
    heading: str, rows: Sequence[tuple[str, ...]], head: tuple[str, ...] = (), kind: str = ""
) -> str:
    """A small table; the cells are HTML, the first of a row names it."""
    top = ""
    if head:
        top = f"<thead><tr>{''.join(f'<th>{h}</th>' for h in head)}</tr></thead>"
    body = "".join(
        f'<tr><th scope="row">{name}</th>{"".join(f"<td>{c}</td>" for c in cells)}</tr>\n'
        for name, *cells in rows
    )
    return (
        f'<div class="card {kind}"><h2>{heading}</h2>\n'
        f"<table>{top}<tbody>\n{body}</tbody></table></div>\n"
    )


def _path_cost(facts: PathFacts, selection: Selection) -> str:
    """The path cost as the sum of its parts."""
    w, total = facts.weights, selection.costs.cost
    step = f"{w.concatenation:g} × "
    terms = (
        ("target", f"{w.target:g}", facts.target, facts.weighted_target),
        ("visual f", f"{step}{w.visual:g}", facts.visual, facts.weighted_visual),
        ("skip g", f"{step}{w.skip:g}", facts.skip, facts.weighted_skip),
    )
    rows: list[tuple[str, ...]] = []
    for name, weight, raw, weighted in terms:
        share = weighted.sum() / total if total > 0 else 0.0
        rows.append((name, number(raw.sum()), weight, f"{number(weighted.sum())}", f"{share:.0%}"))
    rows.append(("path cost", "", "", f'<b id="cost">{number(total)}</b>', ""))
    return _card("Path cost, the sum of its parts", rows, ("", "sum", "weight", "weighted", ""))


def _averages(database: UnitDatabase, facts: PathFacts) -> str:
    pca = database.units.pca[facts.units]
    rows = [
        ("SL_avg, frames", number(sl_avg(facts.sequence, facts.recorded_frame))),
        ("TC_avg", number(tc_avg(facts.target))),
        ("TC_avg of the paper's cost", number(tc_avg(facts.paper))),
    ]
    if facts.guided is not None:
        rows.append(("TC_avg of the guided cost", number(tc_avg(facts.guided))))
    if facts.lips is not None:
        rows.append(("TC_avg: rest and closure of lips", number(tc_avg(facts.lips))))
    rows += [
        ("VC_avg", number(vc_avg(pca, facts.sequence, facts.recorded_frame))),
        ("segments", str(len(facts.segment_starts))),
        ("joins", str(int(facts.join.sum()))),
        ("clips", str(len(np.unique(facts.sequence)))),
    ]
    return _card("Averages", rows)


def _settings(settings: SelectionSettings) -> str:
    w, costs, target = settings.weights, settings.costs, settings.target
    name = target.name
    if 0 < target.guided < 1:
        name += f" ({target.guided:g} guided + {1 - target.guided:g} paper)"
    lips = settings.lips
    held = f"rest {lips.rest:g}, closure {lips.closure:g}" if lips.used else "not held"
    features = ", ".join(
        f"{group} {k:.3g}" for group, k in zip(GROUPS, costs.features.normalised, strict=True)
    )
    rows = [
        ("target cost", escape(name)),
        ("lips", held),
        ("weights", f"target {w.target:g}, concatenation {w.concatenation:g}"),
        ("", f"visual {w.visual:g}, skip {w.skip:g}"),
        ("feature weights k_d", escape(features)),
        ("context", f"{costs.context:g} s, beta1 {costs.beta1:g}"),
        ("skip cost", f"beta3 {costs.beta3:g}, p {costs.p}"),
    ]
    return _card("Settings", rows, kind="left")


def _fallbacks(selection: Selection) -> str:
    if not selection.fallbacks:
        return (
            '<p id="fallbacks">No fallbacks: the database has units of every viseme wanted.</p>\n'
        )
    lines = "".join(f"<li>{escape(str(f))}</li>" for f in selection.fallbacks)
    return f'<h2>Fallbacks</h2>\n<ul id="fallbacks">{lines}</ul>\n'


def _worst_frames(database: UnitDatabase, facts: PathFacts) -> str:
    rows = [
        (
            f'<a href="#f{t}">frame {t}</a>',
            single(database, int(facts.units[t])),
            PHONEMES[facts.wanted[t]],
            PHONEMES[facts.recorded[t]],
            number(facts.target[t]),
            number(facts.cheapest[t]),
            f"{facts.rank[t]} of {facts.candidates[t]}",
        )
        for t in facts.worst_frames(WORST)
    ]
    head = ("", "", "wanted", "recorded", "target cost", "cheapest", "place")
    return _card("Worst frames by target cost, one a phone", rows, head)


def _worst_joins(database: UnitDatabase, facts: PathFacts) -> str:
    names = database.sequences.name
    rows = [
        (
            f'<a href="#j{t}" title="{escape(join_told(facts, names, t))}">to frame {t}</a>',
            pair(database, int(facts.units[t - 1]), int(facts.units[t])),
            number(facts.visual[t]),
            number(facts.skip[t]),
            number(facts.weighted_visual[t] + facts.weighted_skip[t]),
        )
        for t in facts.worst_joins(WORST)
    ]
    if not rows:
        return _card("Worst joins", [("none: one recorded segment",)])
    return _card("Worst joins", rows, ("", "", "f", "g", "weighted"))


def _legend(facts: PathFacts) -> str:
    predicted = facts.trajectories[0].predicted
    wanted = (
        "predicted trajectory"
        if predicted
        else "mean of each wanted phoneme (no trajectory was predicted)"
    )
    kind = "predicted" if predicted else "mean"
    line = '<svg viewBox="0 0 34 10"><polyline class="{}" points="0,5 34,5"/></svg>'
    return (
        '<p class="legend">Point at a frame or a mark to read all of it. Weighted costs:'
        '<i class="target"></i>target<i class="visual"></i>visual step<i class="skip"></i>skip. '
        f"Trajectories:{line.format('selected')}selected{line.format(kind)}{wanted}. Red lines "
        "are joins, dotted lines phone boundaries; colours tell source clips apart. A recorded "
        "phoneme is grey where it is the wanted one, red where even its viseme differs.</p>\n"
    )


def _numbers(database: UnitDatabase, facts: PathFacts, start: int, end: int) -> str:
    """All numbers of a row's frames, as a table."""
    guided = facts.guided
    head = [
        *("frame", "wanted", "clip", "its frame", "recorded", "target", "paper"),
        *(() if guided is None else ("guided",)),
        *(() if facts.lips is None else ("lips",)),
        *("cheapest", "place", "of", "f", "g"),
        *("weighted target", "weighted f", "weighted g", "sum"),
    ]
    rows = []
    for t in range(start, end):
        parts = (facts.target, facts.paper, guided, facts.lips)
        costs = [part[t] for part in parts if part is not None]
        rest = (facts.weighted_target, facts.weighted_visual, facts.weighted_skip, facts.weighted)
        cells = [
            f'<a href="#f{t}">{t}</a>',
            PHONEMES[facts.wanted[t]],
            escape(database.sequences.name[int(facts.sequence[t])]),
            str(facts.recorded_frame[t]),
            PHONEMES[facts.recorded[t]],
            *(number(c) for c in (*costs, facts.cheapest[t])),
            str(facts.rank[t]),
            str(facts.candidates[t]),
            *(number(c) for c in (facts.visual[t], facts.skip[t], *(r[t] for r in rest))),
        ]
        kind = ' class="joined"' if facts.join[t] else ""
        rows.append(f"<tr{kind}>{''.join(f'<td>{c}</td>' for c in cells)}</tr>\n")
    return (
        '<div class="scroll"><table class="numbers"><thead><tr>'
        f"{''.join(f'<th>{h}</th>' for h in head)}</tr></thead>\n<tbody>\n{''.join(rows)}"
        "</tbody></table></div>\n"
    )
