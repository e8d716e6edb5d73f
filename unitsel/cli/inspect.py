"""``unitsel inspect``: what a database holds."""

from __future__ import annotations

import argparse

from database.heads import is_portrait, open_portrait
from database.reader import open_database
from unitsel.cli.arguments import Commands
from unitsel.cli.output import Output
from unitsel.inspection import Inspection, inspect_database
from unitsel.plots import plot_database
from unitsel.portrait.facts import inspect_portrait
from unitsel.portrait.plots import plot_portrait


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "inspect",
        help="counts, visemes covered, sequences, pictures of mouths",
        description="Tell what a database holds.",
    )
    parser.add_argument("database", metavar="DB.h5")
    parser.add_argument(
        "--plots", metavar="DIR", help="draw typical and extreme mouths into this folder"
    )
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Inspect, draw and report."""
    if is_portrait(options.database):
        _portrait(options, output)
        return
    with open_database(options.database) as database:
        found = inspect_database(database)
        drawn = [] if options.plots is None else plot_database(database, options.plots)
    document = found.as_json() | {"plots": [str(p) for p in drawn]}
    output.result(document, "\n".join([_text(found), *(f"drawn: {p}" for p in drawn)]))


def _portrait(options: argparse.Namespace, output: Output) -> None:
    with open_portrait(options.database) as head:
        found = inspect_portrait(head)
        drawn = [] if options.plots is None else plot_portrait(head, options.plots)
    lines = [
        f"{found.path}: a portrait of {found.width} x {found.height} pixels, from {found.photo}",
        f"eyes {found.eye_distance:.0f} and mouth {found.mouth_width:.0f} pixels wide; a mask of "
        f"{found.vertices} vertices and {found.triangles} triangles",
        "teeth of colour {}, {}, {}".format(*found.teeth),
        *found.notes,
        *(f"drawn: {p}" for p in drawn),
    ]
    output.result(found.as_json() | {"plots": [str(p) for p in drawn]}, "\n".join(lines))


def _text(found: Inspection) -> str:
    lines = [
        f"{found.path}: {found.units} units from {found.sequences} sequences, "
        f"{found.seconds:.0f} s at {found.fps:g} frames a second",
        f"mouths of {found.crop[0]} x {found.crop[1]} pixels, {found.codec}, "
        f"{found.bytes_per_unit / 1000:.1f} kB each",
        "units a viseme:",
        *(f"  {name:<16} {count:>7}" for name, count in found.visemes.items()),
    ]
    if found.missing_phonemes:
        lines.append(f"phonemes without a unit: {' '.join(found.missing_phonemes)}")
    lines.append("parameters (1st, 50th, 99th percentile):")
    lines += [
        f"  {name:<16} {low:>9.2f} {middle:>9.2f} {high:>9.2f}"
        for name, (low, middle, high) in found.ranges.items()
    ]
    if any(of["found"] for of in found.marks.values()):
        lines.append("closures and rests found, of those spoken (in sound and lips both):")
        lines += [
            f"  {name:<16} {of['found']:>7} of {of['phones']} ({of['both']})"
            for name, of in found.marks.items()
        ]
    lines += [
        f"guide from {kind}: r_pca {pca:.2f}, r_h {height:.2f} in speech of clips held back"
        for kind, (pca, height) in found.guides.items()
    ]
    if found.own_settings:
        target = found.own_settings.get("target", {}).get("name")
        lines.append(f"carries settings of its own for the selection (target cost {target})")
    note = " ".join(found.consent.split()) or "no note of it was given when this was built"
    lines.append(f"consent: {note}")
    lines.append(
        f"the build skipped {len(found.skipped)} clips and made {len(found.repaired)} repairs"
    )
    return "\n".join(lines)
