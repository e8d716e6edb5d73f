"""``unitsel portrait``: one photo into a head that talks."""

from __future__ import annotations

import argparse
from dataclasses import replace

from analysis.faces import check_choice
from analysis.portrait import PortraitReport, PortraitSettings, make_portrait
from analysis.portrait_adjust import read_adjustment
from database.errors import FaceError
from database.heads import open_portrait
from unitsel.cli.arguments import Commands, add_face_models, check_output, positive_int
from unitsel.cli.output import Output
from unitsel.portrait.plots import plot_portrait


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "portrait",
        help="make a head of one photo",
        description="Lay a mask over the face of a photo. The head that is written is used as a "
        "database is: by synth, say, dub and inspect. The face should look at the camera with its "
        "mouth closed.",
    )
    parser.add_argument("photo", metavar="PHOTO")
    parser.add_argument("-o", "--output", metavar="HEAD.h5", required=True)
    parser.add_argument(
        "--adjust",
        metavar="FILE.json",
        help='put the mask right: {"box": [left, top, right, bottom], "vertices": {"12": [x, y]}, '
        '"drags": [{"from": [x, y], "to": [x, y], "reach": 0.25}]}, pixels as in --plots',
    )
    parser.add_argument(
        "--face",
        type=_choice,
        default="largest",
        metavar="WHICH",
        help="where there are several: largest, main, left, right, or a number from the left "
        "(default: largest)",
    )
    parser.add_argument(
        "--longest",
        type=positive_int,
        metavar="PIXELS",
        help="scale larger photos down to this (default: 1280)",
    )
    parser.add_argument(
        "--plots", metavar="DIR", help="draw the mask and some mouths into this folder"
    )
    add_face_models(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Fit, write, draw and report."""
    check_output(options.output, (".h5", ".hdf5"))
    adjustment = None if options.adjust is None else read_adjustment(options.adjust)
    settings = PortraitSettings(face=options.face)
    if options.longest is not None:
        settings = replace(settings, longest=options.longest)
    report = make_portrait(
        options.photo,
        options.output,
        adjustment=adjustment,
        settings=settings,
        models=options.models,
        progress=output.progress,
    )
    drawn = []
    if options.plots is not None:
        with open_portrait(options.output) as head:
            drawn = plot_portrait(head, options.plots)
    document = {
        "head": str(report.path),
        "width": report.width,
        "height": report.height,
        "eye_distance": round(report.eye_distance, 2),
        "mouth_width": round(report.mouth_width, 2),
        "notes": list(report.notes),
        "plots": [str(p) for p in drawn],
    }
    output.result(document, "\n".join([_text(report), *(f"drawn: {p}" for p in drawn)]))


def _text(report: PortraitReport) -> str:
    lines = [
        f"{report.path}: a head of {report.width} x {report.height} pixels, eyes "
        f"{report.eye_distance:.0f} and mouth {report.mouth_width:.0f} pixels wide",
        *report.notes,
    ]
    return "\n".join(lines)


def _choice(text: str) -> str:
    try:
        return check_choice(text)
    except FaceError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
