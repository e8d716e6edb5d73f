"""``unitsel build``: a corpus of one person into a database."""

from __future__ import annotations

import argparse
import os

from analysis.build import BuildReport, BuildSettings, build_database
from analysis.corpus_lips import SOURCES, LipSettings
from database.pictures import CODECS
from unitsel.cli.arguments import Commands, add_models, positive_int, positive_number
from unitsel.cli.output import Output


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "build",
        help="build a database from a folder of clips",
        description="Build a database from a folder of clips: media files, each with its words "
        "in NAME.txt or a timing file NAME.TextGrid, .lab, .align, ... beside it.",
    )
    parser.add_argument("corpus", metavar="CORPUS_DIR")
    parser.add_argument("-o", "--output", metavar="DB.h5", required=True)
    parser.add_argument(
        "--jobs",
        type=positive_int,
        default=max(1, os.cpu_count() or 1),
        metavar="N",
        help="clips analysed at a time (default: the number of cores)",
    )
    parser.add_argument(
        "--limit",
        type=positive_int,
        metavar="N",
        help="take N clips only, spread evenly over the sorted names",
    )
    parser.add_argument(
        "--exclude",
        default="",
        metavar="NAMES",
        help="clips to leave out, separated by commas",
    )
    parser.add_argument(
        "--focal",
        type=positive_number,
        metavar="PIXELS",
        help="focal length of the camera (default: twice the longer side of the picture)",
    )
    parser.add_argument(
        "--codec",
        choices=sorted(CODECS),
        default="png",
        help="codec of the stored mouths: png is lossless, webp visually so (default: png)",
    )
    parser.add_argument(
        "--lips",
        choices=SOURCES,
        default=LipSettings.source,
        help="measure lips by a lip model (aam) or on the face mesh's smoothed contours "
        f"(default: {LipSettings.source})",
    )
    parser.add_argument(
        "--lip-points",
        metavar="FILE.csv",
        help="frames whose 20 lip points were marked by hand (clip,frame,point,x,y), to train the "
        "lip model on",
    )
    add_models(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Build and report."""
    report = build_database(
        options.corpus,
        options.output,
        settings=BuildSettings(
            focal=options.focal,
            codec=options.codec,
            lips=LipSettings(source=options.lips, marks=options.lip_points),
        ),
        jobs=options.jobs,
        limit=options.limit,
        exclude=[name.strip() for name in options.exclude.split(",") if name.strip()],
        models=options.models,
        dictionary=options.dictionary,
        progress=output.progress,
    )
    output.result(report.as_json(), _text(report))


def _text(report: BuildReport) -> str:
    lines = [
        f"{report.path}: {report.units} units from {report.sequences} clips in "
        f"{report.seconds:.1f} s"
    ]
    for title, entries in (("skipped", report.skipped), ("repaired", report.repaired)):
        if entries:
            lines.append(f"{title} ({len(entries)}):")
            lines += [f"  {clip}: {what}" for clip, what in entries]
    return "\n".join(lines)
