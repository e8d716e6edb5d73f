"""Sections of the page: coverage, pose, pictures, rejected frames, alignment, all clips."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from typing import Final

import numpy as np
import numpy.typing as npt

from database.phonemes import SILENCE, VISEME_OF, VISEMES
from unitsel.doctor.charts import counted, diphone_map, dots, histogram, picture, table
from unitsel.doctor.coverage import COMMON, ENOUGH, diphone_name
from unitsel.doctor.facts import AXES, ClipFacts
from unitsel.doctor.report import DoctorReport

NAMED: Final = 60
"""Missing diphones that are listed."""

SHOWN: Final = 24
"""Pictures of rejected or faulty clips; the others are listed."""


def coverage_section(report: DoctorReport) -> str:
    """What of English is recorded: visemes, the map of diphones, the commonest gaps."""
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
                "" if quiet else str(counts[v]),
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
        + table(
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


def pose_section(report: DoctorReport) -> str:
    """Histograms of the head's pose, with the good range."""
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


def _split(report: DoctorReport) -> list[npt.NDArray[np.bool_]]:
    ends = np.cumsum([len(c.rotations) for c in report.usable])
    return np.split(report.outside, ends[:-1])


def pictures_section(report: DoctorReport) -> str:
    """Blur, light and sound of each clip, and pictures of those with a fault."""
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
        table(("clip", "fault"), rest, (0, 1)) if rest else ""
    )


def rejected_section(report: DoctorReport) -> str:
    """Clips and frames that cannot be used, with pictures and reasons."""
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
                    f"<figure>{picture(r.picture, c.name)}<b>{escape(c.name)}</b>, "
                    f"frame{'s' * (len(r.frames) > 1)} {frames}<br>{escape(r.reason)}</figure>"
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
        f"{head}<p>Not usable: {counted(len(report.skipped), 'clip')}, and "
        f"{counted(report.rejected_frames, 'frame')} of others. {note} Frames count from 0.</p>\n"
        + (f'<div class="thumbs">{"".join(figures)}</div>\n' if figures else "")
        + (table(("clip", "frames", "reason"), rest, (0, 1, 2)) if rest else "")
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


def alignment_section(report: DoctorReport) -> str:
    """How sure the phones are, and the clips where they are doubted."""
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
        else "How well the lips follow the phones is known only of databases of 30 clips and more."
    )
    return (
        f"{head}<p>{first} of {len(known)} clips were aligned at the first attempt or had their "
        f"phones given; {short:.0%} of the phones are as short as the aligner makes them (30 ms). "
        f"{counted(len(rows), 'clip')} in doubt.</p>\n{drawn}"
        + (table(("clip", "words", "doubt"), rows, (0, 1, 2)) if rows else "")
        + f'<p class="soft">{how}</p>\n'
    )


def lags_section(report: DoctorReport) -> str:
    """Clips whose lips and sound the build found apart."""
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
        + table(("clip", "lips move"), rows, (0, 1))
    )


def clips_section(report: DoctorReport) -> str:
    """All clips in numbers."""
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
        f"{len(rows)} clips</summary>\n{table(head, rows, (0, 10))}</details>\n"
    )
