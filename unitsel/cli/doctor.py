"""``unitsel doctor``: what footage or a database is worth, and what to record next."""

from __future__ import annotations

import argparse

from unitsel.cli.arguments import Commands, add_jobs, add_models, check_output, positive_int
from unitsel.cli.output import Output
from unitsel.doctor.page import TONES, write_doctor_page
from unitsel.doctor.quality import SENTENCES
from unitsel.doctor.report import ADVICE, DoctorReport, doctor_report

SHOWN = 8
"""Sentences to record that the text shows."""


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "doctor",
        help="examine footage or a database, and say what to record next",
        description="Examine a folder of clips before it is built (a few frames a clip, sound, "
        "words) or a database: coverage of English, pose, blur, light, rejected frames, "
        "alignment, expected quality, and the sentences that would fill the gaps.",
    )
    parser.add_argument("source", metavar="CORPUS_DIR|DB.h5")
    parser.add_argument("--html", metavar="REPORT.html", help="write all of it as one page")
    parser.add_argument(
        "--limit",
        type=positive_int,
        metavar="N",
        help="of a folder: take N clips only, spread evenly over the sorted names",
    )
    parser.add_argument(
        "--sentences",
        type=_count,
        default=SENTENCES,
        metavar="N",
        help="of a database: sentences to test its quality with, 0 for no test "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--record",
        type=_count,
        default=ADVICE,
        metavar="N",
        help="recommend at most N sentences (default: %(default)s)",
    )
    add_jobs(parser, "processes")
    add_models(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Examine, write the page and report."""
    if options.html is not None:
        check_output(options.html, (".html", ".htm"))
    report = doctor_report(
        options.source,
        limit=options.limit,
        sentences=options.sentences,
        advice=options.record,
        jobs=options.jobs,
        models=options.models,
        dictionary=options.dictionary,
        progress=output.progress,
    )
    if options.html is not None:
        write_doctor_page(options.html, report)
    output.result({"html": options.html, **report.as_json()}, _text(report, options.html))


def _text(report: DoctorReport, html: str | None) -> str:
    lines = [f"{report.source}: {len(report.usable)} of {len(report.clips)} clips usable"]
    lines += [f"  {TONES[f.tone] + ':':<9}{f.text}" for f in report.findings]
    if report.advice:
        lines.append("record next (with the share of English's diphones then recorded):")
        lines += [f"  {a.share:>4.0%}  {a.sentence}" for a in report.advice[:SHOWN]]
        if (more := len(report.advice) - SHOWN) > 0:
            lines.append(f"  and {more} more (--html, --json)")
    if report.skipped:
        lines.append(f"cannot be used ({len(report.skipped)}):")
        lines += [f"  {c.name}: {c.error}" for c in report.skipped]
    if html is not None:
        lines.append(f"written: {html}")
    return "\n".join(lines)


def _count(text: str) -> int:
    """A whole number, 0 or more."""
    if not text.isascii() or not text.isdigit():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number, 0 or more")
    return int(text)
