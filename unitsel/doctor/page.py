"""The doctor's report as one page that holds all it shows and fetches nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Final

import numpy as np

from database.outfile import whole_file
from database.phonemes import SILENCE, VISEME_OF, VISEMES
from unitsel.doctor.charts import diphone_map, dots, histogram, picture
from unitsel.doctor.coverage import COMMON, ENOUGH, diphone_name
from unitsel.doctor.facts import AXES, ClipFacts
from unitsel.doctor.quality import METHODS, Quality
from unitsel.doctor.report import DoctorReport
from unitsel.doctor.style import STYLE

NAMED: Final = 60
"""Missing diphones that are listed."""

SHOWN: Final = 24
"""Pictures of rejected or faulty clips; the others are listed."""

TONES: Final = {"good": "Good", "note": "Note", "bad": "Problem"}

ROWS: Final = {
    "random": "random pictures of the right viseme",
    "phoneme_mean": "mean mouth of each phoneme",
    "selected": "selected, as synthesis would",
    "nearest": "nearest picture for each frame (ceiling)",
}

Row = Sequence[str]


def doctor_page(report: DoctorReport) -> str:
    """Describe a report as an HTML page, for light and dark screens."""
    name = escape(report.source.resolve().name)
    seconds = sum(c.seconds for c in report.usable)
    kind = "database" if report.built else "folder of clips, not built yet"
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n',
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "img-src data:; style-src 'unsafe-inline'\">\n",
        '<meta name="viewport" content="width=device-width">\n',
        f"<title>{name}: corpus doctor</title>\n<style>{STYLE}</style>\n</head>\n<body>\n",
        f"<h1>Corpus doctor: {name}</h1>\n",
        f'<p class="soft">A {kind}; {len(report.usable)} of {len(report.clips)} clips usable, '
        f"{seconds / 60:.1f} minutes. Point at a mark in a drawing to read what it stands for."
        "</p>\n",
        _findings(report),
        _record(report),
        _quality(report),
        _coverage(report),
        _pose(report),
        _pictures(report),
        _rejected(report),
        _alignment(report),
        _lags(report),
        _clips(report),
    ]
    return "".join([*parts, "</body>\n</html>\n"])


def write_doctor_page(path: str | Path, report: DoctorReport) -> None:
    """Write the page to a file, as a whole or not at all.

    Raises
    ------
    DatabaseError
        If it cannot be written.
    """
    with whole_file(Path(path)) as file:
        # A clip may be named with bytes that are no text.
        file.write(doctor_page(report).encode("utf-8", errors="replace"))


def _table(head: Row, rows: Sequence[Row], text: Sequence[int] = ()) -> str:
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


def _findings(report: DoctorReport) -> str:
    items = "".join(
        f'<li class="{f.tone}"><b>{TONES[f.tone]}</b> <a href="#{f.part}">{escape(f.text)}</a></li>'
        for f in report.findings
    )
    return f'<ul class="findings">{items}</ul>\n'


def _record(report: DoctorReport) -> str:
    if not report.advice:
        return '<h2 id="record">What to record next</h2>\n<p>Nothing is missing.</p>\n'
    rows = [
        (
            str(i),
            escape(a.sentence),
            f"{len(a.new)}",
            escape(", ".join(diphone_name(d) for d in a.new)),
            str(len(a.more)),
            f"{a.share:.0%}",
        )
        for i, a in enumerate(report.advice, 1)
    ]
    last = report.advice[-1].share
    return (
        '<h2 id="record">What to record next</h2>\n'
        f"<p>These {len(rows)} sentences, recorded in the light and place of the rest, raise the "
        f"share of English's diphones that are recorded from {report.coverage.share():.0%} to "
        f"{last:.0%}. They are in the order in which each adds most for its length, given those "
        "before it. Lists of words are to be read as such.</p>\n"
        + _table(
            ("", "sentence", "new", "diphones it adds, the commonest first", "second takes",
             "share then"),
            rows,
            (1, 3),
        )
    )  # fmt: skip


def _quality(report: DoctorReport) -> str:
    head = '<h2 id="quality">Expected quality of synthesis</h2>\n'
    q = report.quality
    if not isinstance(q, Quality):
        return f"{head}<p>{escape(q[:1].upper() + q[1:])}.</p>\n"
    rows = [(ROWS[m], str(q.heights[m]), str(q.textures[m])) for m in METHODS]
    worst = "; ".join(f"{escape(w)} ({escape(c)}, r {r:.2f})" for c, w, r in q.worst)
    return (
        f"{head}<p>{escape(q.verdict)}</p>\n"
        + _table(("", "mouth height, r", "first PCA weight, r"), rows, (0,))
        + f'<p class="soft">{q.sentences} of the database\'s own sentences, each selected by the '
        f"target cost “{escape(q.target)}” without its own pictures"
        + (
            f", by a guide fitted again on the {q.learnt:.0%} of the clips that these are not of "
            "(the whole database does a little better)"
            if q.learnt < 1
            else ""
        )
        + "; r is the correlation with the recording, in brackets "
        "where its mean lies in 95 of 100 draws of the sentences. It holds for sentences like "
        f"those recorded; they cover {report.coverage.share():.0%} of English's diphones, and "
        "what they lack is not tested here. Good is from 0.85, fair from 0.70: rules of thumb."
        f"</p>\n<p>Worst by mouth height: {worst}.</p>\n"
    )


def _coverage(report: DoctorReport) -> str:
    c = report.coverage
    wanted, ratios, counts = c.english.visemes, c.viseme_ratios(), c.visemes
    thin = set(c.thin_visemes())
    rows = []
    for v, group in enumerate(VISEMES):
        quiet = v == VISEME_OF[SILENCE]
        size = 100 * min(ratios[v], 2.0) / 2
        mark = "thin" if v in thin else ""
        rows.append(
            (
                str(v),
                " ".join(group),
                f"{counts[v]}",
                "" if c.frames is None else str(c.frames[v]),
                "" if quiet else f"{100 * wanted[v]:.1f} %",
                "" if quiet else f"{ratios[v]:.2f}",
                '<td class="bar"></td>'
                if quiet
                else f'<td class="bar" style="text-align:left"><i class="{mark}" '
                f'style="width:{size:.0f}%"></i></td>',
            )
        )
    gaps = c.gaps()
    common = sum(c.english.diphones[d] >= COMMON for d in gaps)
    listed = ", ".join(
        f"{diphone_name(d)} ({1000 * c.english.diphones[d]:.1f})" for d in gaps[:NAMED]
    )
    few = int(((c.diphones > 0) & (c.diphones < ENOUGH)).sum())
    return (
        '<h2 id="coverage">Visemes and diphones</h2>\n'
        f"<p>{int((c.diphones > 0).sum())} different diphones are recorded, {few} of them less "
        f"than {ENOUGH} times. Weighted by how often they come in English, {c.share():.1%} have a "
        f"recording, {c.share(ENOUGH):.1%} have {ENOUGH} or more; {c.viseme_share():.1%} of the "
        "steps from viseme to viseme have one.</p>\n"
        + _table(
            ("", "viseme", "recordings", "" if c.frames is None else "frames", "in English",
             "against English", ""),
            rows,
            (1,),
        )
        + '<p class="soft">“Against English”: share here over share there; red where it is below '
        "a quarter, or there are fewer than 20 recordings. The bar ends at twice the share.</p>\n"
        f"<h3>Diphones</h3>\n{diphone_map(c)}"
        '<p class="legend"><i class="have"></i>3 or more recordings<i class="few"></i>1 or 2'
        '<i class="none"></i>none, the stronger the commoner in English. First phoneme down, '
        "second across.</p>\n"
        + (
            f"<p>{common} diphones that make up at least 1 in 5000 of English are missing; the "
            f"commonest missing (in 1000): {listed}.</p>\n"
            if gaps
            else "<p>No diphone of English is missing.</p>\n"
        )
        + '<p class="soft">English is the mean of this package\'s sentences and of the CMU '
        "dictionary's words; rare diphones are known only roughly.</p>\n"
    )  # fmt: skip


def _pose(report: DoctorReport) -> str:
    head = '<h2 id="pose">Pose of the head</h2>\n'
    if not len(report.rotations):
        return f"{head}<p>No pose is known.</p>\n"
    middle = np.median(report.translations, axis=0)
    limits = report.limits
    drawn = []
    for k, (name, unit) in enumerate(AXES):
        values = report.rotations[:, k] if k < 3 else report.translations[:, k - 3] - middle[k - 3]
        reach = (*limits.rotation, *limits.translation)[k]
        drawn.append(f'<div class="card">{histogram(values, -reach, reach, name, unit)}</div>')
    shares = ", ".join(
        f"{name} {s:.1%}" for (name, _), s in zip(AXES, report.outside.mean(axis=0), strict=True)
    )
    worst = sorted(
        (
            (float(o.any(axis=1).mean()), c.name)
            for c, o in zip(report.usable, _split(report), strict=True)
            if len(o)
        ),
        reverse=True,
    )
    named = ", ".join(f"{escape(n)} ({s:.0%})" for s, n in worst[:8] if s > 0)
    return (
        f"{head}<p>{report.outside.any(axis=1).mean():.1%} of {len(report.outside)} frames have "
        f"the head outside the good range ({shares}).</p>\n"
        f'<div class="cards">{"".join(drawn)}</div>\n'
        + (f"<p>Clips with most such frames: {named}.</p>\n" if named else "")
        + '<p class="soft">Turns count from a face that looks into the camera, places from their '
        f"median ({middle[2]:.0f} mm from the camera, if its focal length was guessed right). "
        "Beyond the range mouths are seen too much from the side or at another size, and are "
        "hard to join to others.</p>\n"
    )


def _split(report: DoctorReport) -> list[np.ndarray[tuple[int, ...], np.dtype[np.bool_]]]:
    ends = np.cumsum([len(c.rotations) for c in report.usable])
    return np.split(report.outside, ends[:-1])


def _pictures(report: DoctorReport) -> str:
    head = '<h2 id="picture">Blur, light and sound</h2>\n'
    seen = [c for c in report.usable if c.faces]
    if not seen:
        return f"{head}<p>No clip shows a face.</p>\n"
    limits, names = report.limits, [c.name for c in seen]
    sharp = [c.sharpness for c in seen]
    bright = [c.brightness for c in seen]
    usual, light = float(np.median(sharp)), float(np.median(bright))
    width = float(np.median([c.mouth_pixels for c in seen]))
    drawn = [
        dots(names, [s / usual if usual else 1.0 for s in sharp], limits.blur, math.inf,
             "Sharpness of each clip's mouths, over the median clip's"),
        dots(names, bright, (1 - limits.exposure) * light, (1 + limits.exposure) * light,
             "Brightness of each clip's mouths, 0 to 255", ".0f"),
        dots(names, [100 * c.drift for c in seen], 0.0, 100 * limits.drift,
             "Change of brightness inside each clip, %", ".1f"),
        dots(names, [100 * c.clipped for c in seen], 0.0, 100 * limits.clipped,
             "Pixels at the end of the scale, %", ".2f"),
    ]  # fmt: skip
    heard = [c for c in seen if c.sound is not None]
    if heard:
        over = [c.sound.snr for c in heard if c.sound is not None]
        drawn.append(
            dots(
                [c.name for c in heard], over, limits.snr, math.inf, "Speech over noise, dB", ".0f"
            )
        )
    sizes = sorted({c.size for c in seen})
    rates = sorted({round(c.fps, 3) for c in seen})
    faulty = [c for c in seen if c.name in report.faults]
    return (
        f"{head}<p>Pictures of {', '.join(f'{w} x {h}' for w, h in sizes[:5])} at "
        f"{', '.join(f'{r:g}' for r in rates[:5])} frames a second; the mouth is {width:.0f} "
        f"pixels wide. {len(faulty)} of {len(seen)} clips have a fault; "
        f"{len(heard)} have sound that can be heard here.</p>\n"
        + "".join(drawn)
        + _thumbs(faulty, report.faults)
        + '<p class="soft">Sharpness: variance of the Laplacian over that of the grey levels, '
        "around the lips, median over the frames looked at; it depends on the size of the mouth, "
        "so only clips of one corpus compare.</p>\n"
    )


def _thumbs(clips: Sequence[ClipFacts], why: dict[str, list[str]]) -> str:
    """Mouths of some clips with what is wrong; beyond `SHOWN` without pictures."""
    if not clips:
        return ""
    figures = "".join(
        f"<figure>{picture(c.mouth, c.name)}<b>{escape(c.name)}</b><br>"
        f"{escape('; '.join(why[c.name]))}</figure>"
        for c in clips[:SHOWN]
    )
    rest = [(escape(c.name), escape("; ".join(why[c.name]))) for c in clips[SHOWN:]]
    return f'<div class="thumbs">{figures}</div>\n' + (
        _table(("clip", "fault"), rest, (0, 1)) if rest else ""
    )


def _rejected(report: DoctorReport) -> str:
    figures: list[str] = []
    rest: list[tuple[str, str, str]] = []
    for c in report.skipped:
        if len(figures) < SHOWN and c.picture:
            figures.append(
                f"<figure>{picture(c.picture, c.name)}<b>{escape(c.name)}</b>, all of it<br>"
                f"{escape(c.error)}</figure>"
            )
        else:
            rest.append((escape(c.name), "all", escape(c.error)))
    for c in report.usable:
        for r in c.rejected:
            frames = _spans(r.frames)
            if len(figures) < SHOWN and r.picture:
                figures.append(
                    f"<figure>{picture(r.picture, c.name)}<b>{escape(c.name)}</b>, frames "
                    f"{frames}<br>{escape(r.reason)}</figure>"
                )
            else:
                rest.append((escape(c.name), frames, escape(r.reason)))
    head = '<h2 id="rejected">Rejected clips and frames</h2>\n'
    if not figures and not rest:
        return f"{head}<p>None.</p>\n"
    note = (
        "The build left these out."
        if report.built
        else "A build would leave these out. Only a few frames a clip were looked at, so more "
        "may follow."
    )
    return (
        f"{head}<p>{len(report.skipped)} clips cannot be used, and {report.rejected_frames} frames "
        f"of others. {note} Frames count from 0.</p>\n"
        + (f'<div class="thumbs">{"".join(figures)}</div>\n' if figures else "")
        + (_table(("clip", "frames", "reason"), rest, (0, 1, 2)) if rest else "")
    )


def _spans(frames: Sequence[int]) -> str:
    """Numbers as text, runs drawn together: ``0 to 11, 40``."""
    spans: list[list[int]] = []
    for i in frames:
        if spans and i == spans[-1][1] + 1:
            spans[-1][1] = i
        else:
            spans.append([i, i])
    return ", ".join(str(a) if a == b else f"{a} to {b}" for a, b in spans)


def _alignment(report: DoctorReport) -> str:
    head = '<h2 id="alignment">Alignment of phones</h2>\n'
    known = [c for c in report.usable if c.alignment is not None]
    if not known:
        return f"{head}<p>No clip was aligned.</p>\n"
    pairs = [
        (c.name, c.alignment.agreement)
        for c in known
        if c.alignment is not None and c.alignment.agreement is not None
    ]
    drawn = ""
    if pairs:
        drawn = dots(
            [n for n, _ in pairs], [r for _, r in pairs], report.limits.agreement, math.inf,
            "How well each clip's lips follow its phones, r",
        )  # fmt: skip
    short = float(np.mean([c.alignment.short for c in known if c.alignment is not None]))
    first = sum(c.alignment is not None and c.alignment.attempts <= 1 for c in known)
    rows = [
        (escape(c.name), escape(c.words), escape("; ".join(report.doubts[c.name])))
        for c in known
        if c.name in report.doubts
    ]
    how = (
        "The correlation compares mouth height and first PCA weight with the mean of the same "
        "phonemes in all other clips; a low one means wrong words, wrong times, or footage out of "
        "step."
        if pairs
        else "How well the lips follow the phones is known only once a database is built."
    )
    return (
        f"{head}<p>{first} of {len(known)} clips were aligned at the first attempt or had their "
        f"phones given; {short:.0%} of the phones are as short as the aligner makes them (30 ms). "
        f"{len(rows)} clips are doubtful.</p>\n{drawn}"
        + (_table(("clip", "words", "doubt"), rows, (0, 1, 2)) if rows else "")
        + f'<p class="soft">{how}</p>\n'
    )


def _lags(report: DoctorReport) -> str:
    head = '<h2 id="lags">Sound against lips</h2>\n'
    rows = [
        (escape(c.name), f"{1000 * abs(c.lag):.0f} ms {'later' if c.lag > 0 else 'earlier'}")
        for c in sorted(report.usable, key=lambda c: (-abs(c.lag), c.name))
        if c.lag
    ]
    if not report.built:
        return (
            f"{head}<p>Known only once a database is built: the build measures and mends it.</p>\n"
        )
    if not rows:
        return f"{head}<p>The build found no clip whose lips and sound are apart.</p>\n"
    return (
        f"{head}<p>In {len(rows)} of {len(report.usable)} clips the build found the lips before or "
        "after the sound, against what other clips' lips do at the same phonemes. Phones that "
        "were found in the sound were moved to the lips; phones of a timing file are left.</p>\n"
        + _table(("clip", "lips move"), rows, (0, 1))
    )


def _clips(report: DoctorReport) -> str:
    rows = []
    for c in report.clips:
        agreement = c.alignment.agreement if c.alignment is not None else None
        rows.append(
            (
                escape(c.name),
                f"{c.seconds:.1f}",
                f"{c.faces} of {c.looked}",
                f"{c.mouth_pixels:.0f}",
                f"{c.sharpness:.3f}",
                f"{c.brightness:.0f}",
                f"{c.drift:.1%}",
                "" if c.sound is None else f"{c.sound.level:.0f}",
                "" if c.sound is None else f"{c.sound.snr:.0f}",
                "" if agreement is None else f"{agreement:.2f}",
                escape(c.error or c.words),
            )
        )
    head = (
        *("clip", "s", "faces", "mouth, px", "sharpness", "brightness", "drift", "level, dB"),
        *("over noise, dB", "lips r", "words, or why it cannot be used"),
    )
    return (
        '<h2 id="clips">All clips</h2>\n<details><summary>Numbers of '
        f"{len(rows)} clips</summary>\n{_table(head, rows, (0, 10))}</details>\n"
    )
