"""The doctor's report as one page that holds all it shows and fetches nothing."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Final

from database.outfile import whole_file
from unitsel.doctor.charts import table
from unitsel.doctor.coverage import ENOUGH, diphone_name
from unitsel.doctor.quality import METHODS, Quality
from unitsel.doctor.report import DoctorReport
from unitsel.doctor.sections import (
    alignment_section,
    clips_section,
    coverage_section,
    lags_section,
    pictures_section,
    pose_section,
    rejected_section,
)
from unitsel.doctor.style import STYLE

TONES: Final = {"good": "Good", "note": "Note", "bad": "Problem"}

ROWS: Final = {
    "random": "random pictures of the right viseme",
    "phoneme_mean": "mean mouth of each phoneme",
    "selected": "selected, as synthesis would",
    "nearest": "nearest picture for each frame (ceiling)",
}


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
        coverage_section(report),
        pose_section(report),
        pictures_section(report),
        rejected_section(report),
        alignment_section(report),
        lags_section(report),
        clips_section(report),
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


def _findings(report: DoctorReport) -> str:
    items = "".join(
        f'<li class="{f.tone}"><b>{TONES[f.tone]}</b> <a href="#{f.part}">{escape(f.text)}</a></li>'
        for f in report.findings
    )
    return f'<ul class="findings">{items}</ul>\n'


def _record(report: DoctorReport) -> str:
    if not report.advice:
        full = report.coverage.share(ENOUGH) > 0.999
        what = "Nothing is missing." if full else "No sentence was asked for."
        return f'<h2 id="record">What to record next</h2>\n<p>{what}</p>\n'
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
        + table(
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
        + table(("", "mouth height, r", "first PCA weight, r"), rows, (0,))
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
