"""``unitsel build``: a corpus of one person into a database."""

from __future__ import annotations

import argparse
import sys

from analysis.build import BuildReport, BuildSettings, ShardSettings, build_database
from analysis.calibration import read_camera
from analysis.consent import read_consent
from analysis.corpus_lips import SOURCES, LipSettings
from analysis.estimate import Estimate, size_text
from analysis.face import FaceSettings
from analysis.faces import check_choice
from analysis.hand_points import read_hand_points
from analysis.sound_offset import OffsetSettings, read_offset
from database.errors import DatabaseError, UnitselError
from database.pictures import AUTO_CODEC, CODECS, find_codec
from unitsel.cli.arguments import Commands, add_jobs, add_models, positive_int, positive_number
from unitsel.cli.output import Output


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "build",
        help="build a database from a folder of clips, a manifest, or one long video",
        description="Build a database from a folder of clips (media files, each with its words "
        "in NAME.txt or a timing file NAME.TextGrid, .lab, .align, ... beside it), from a manifest "
        "(a .csv with the header media,words,timing,start,end), or from one long video with its "
        "timing file, which is cut at pauses. Analysed clips are kept in DB.h5.shards: a build "
        "that was ended goes on where it was, and one of more clips analyses only those.",
    )
    parser.add_argument("corpus", metavar="CORPUS", help="folder, manifest.csv or video")
    parser.add_argument("-o", "--output", metavar="DB.h5", required=True)
    add_jobs(parser, "clips analysed at a time")
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
        "--timing",
        metavar="FILE",
        help="timing file of one long video (default: the one beside it)",
    )
    parser.add_argument(
        "--face",
        type=_face,
        default="main",
        metavar="WHICH",
        help="which of several faces: left, right, largest, or a number counted from the left "
        "(default: the largest and most central)",
    )
    parser.add_argument(
        "--sound-offset",
        type=_offset,
        metavar="MS",
        help="milliseconds by which the sound comes after the lips, to be taken out; auto: as "
        "estimated (default: estimated and reported only)",
    )
    lens = parser.add_mutually_exclusive_group()
    lens.add_argument(
        "--focal",
        type=positive_number,
        metavar="PIXELS",
        help="focal length of the camera (default: twice the longer side of the picture)",
    )
    lens.add_argument(
        "--camera",
        metavar="FILE",
        help="the camera as OpenCV's calibration writes it: YAML, XML or JSON",
    )
    lens.add_argument(
        "--estimate-focal",
        action="store_true",
        help="estimate the focal length over the first clips; a head that turns tells it best",
    )
    parser.add_argument(
        "--points",
        metavar="FILE",
        help="eye corners and nostrils marked in a frame of one clip, which rule where the mask "
        "sits on the face",
    )
    parser.add_argument(
        "--codec",
        type=_codec,
        default=AUTO_CODEC,
        metavar="NAME[:QUALITY]",
        help=f"codec of the stored mouths: {', '.join(sorted(CODECS))}; png loses nothing, the "
        "others take a quality of 1 to 100 (default: png for mouths so small that it takes some "
        "15 kB at most, else avif:85)",
    )
    parser.add_argument(
        "--consent",
        metavar="TEXT|@FILE",
        help="what the person filmed has agreed to, or a text file that says it; the database "
        "carries the note, and unitsel inspect shows it",
    )
    parser.add_argument(
        "--person",
        default="",
        metavar="NAMES",
        help="clips to make the face's mask of, separated by commas, best first (default: the "
        "first by name that show a good face); another mask means that all clips are analysed anew",
    )
    kept = parser.add_mutually_exclusive_group()
    kept.add_argument(
        "--shards",
        metavar="DIR",
        help="keep analysed clips there (default: DB.h5.shards, beside the database)",
    )
    kept.add_argument(
        "--discard-shards",
        action="store_true",
        help="delete the analysed clips when the database is complete",
    )
    parser.add_argument(
        "--restart", action="store_true", help="analyse all clips anew, whatever is kept"
    )
    parser.add_argument(
        "--estimate",
        action="store_true",
        help="say how long the build will take and how much space it needs, and stop",
    )
    parser.add_argument(
        "--lips",
        choices=SOURCES,
        default=LipSettings.source,
        help="measure mouths on the face mesh's smoothed contours, or by the lip model (aam); "
        f"mesh-only makes no lip model (default: {LipSettings.source})",
    )
    parser.add_argument(
        "--lip-points",
        metavar="FILE.csv",
        help="frames whose 20 lip points were marked by hand (clip,frame,point,x,y), to train the "
        "lip model on",
    )
    add_models(parser)
    return parser


def _codec(name: str) -> str:
    try:
        if name != AUTO_CODEC:
            find_codec(name)
    except DatabaseError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return name


class _OnlyEstimateError(Exception):
    """Ends a build that was to be estimated only."""


def run(options: argparse.Namespace, output: Output) -> None:
    """Build and report, or estimate and report that."""
    told: list[Estimate] = []

    def announce(estimate: Estimate) -> None:
        told.append(estimate)
        if options.estimate:
            raise _OnlyEstimateError
        if sys.stderr.isatty():
            print(estimate.text(), file=sys.stderr)

    try:
        report = build_database(
            options.corpus,
            options.output,
            settings=BuildSettings(
                focal=options.focal,
                camera=None if options.camera is None else read_camera(options.camera),
                estimate_focal=options.estimate_focal,
                hand=None if options.points is None else read_hand_points(options.points),
                codec=options.codec,
                consent="" if options.consent is None else read_consent(options.consent),
                lips=LipSettings(source=options.lips, marks=options.lip_points),
                face=FaceSettings(face=options.face),
                offset=OffsetSettings(correct=options.sound_offset),
            ),
            timing=options.timing,
            jobs=options.jobs,
            limit=options.limit,
            exclude=_names(options.exclude),
            person=_names(options.person),
            models=options.models,
            dictionary=options.dictionary,
            shards=ShardSettings(options.shards, not options.discard_shards, options.restart),
            announce=announce,
            progress=output.progress,
        )
    except _OnlyEstimateError:
        output.result({"estimate": told[0].as_json()}, told[0].text())
    else:
        output.result(report.as_json(), report_text(report))


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _face(text: str) -> str:
    try:
        return check_choice(text)
    except UnitselError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _offset(text: str) -> float | str:
    try:
        return read_offset(text)
    except UnitselError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def report_text(report: BuildReport) -> str:
    """What a build made, for people."""
    reused = f" ({report.reused} of them analysed before)" if report.reused else ""
    lines = [
        f"{report.path}: {report.units} units from {report.sequences} clips{reused} in "
        f"{report.seconds:.1f} s"
    ]
    if report.changed:
        lines.append(f"all clips were analysed anew: other {', '.join(report.changed)} than before")
    if report.damaged:
        lines.append(f"kept clips that were damaged and analysed anew: {', '.join(report.damaged)}")
    for title, entries in (("skipped", report.skipped), ("repaired", report.repaired)):
        if entries:
            lines.append(f"{title} ({len(entries)}):")
            lines += [f"  {clip}: {what}" for clip, what in entries]
    if report.shards is not None:
        lines.append(
            f"analysed clips are kept for a build of more in {report.shards} "
            f"({size_text(report.shard_bytes)}; they may be deleted)"
        )
    return "\n".join(lines)
