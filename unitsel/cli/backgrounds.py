"""``unitsel backgrounds``: what the mouth can be laid on, the best first."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from database.reader import open_database
from unitsel.background_keeping import add_backgrounds, remove_backgrounds, shape_note
from unitsel.background_ranking import RankedBackground, rank_backgrounds
from unitsel.cli.arguments import Commands, positive_int
from unitsel.cli.output import Output


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "backgrounds",
        help="list, rank, add and remove videos that the mouth is laid on",
        description="List what the mouth can be laid on, the best first: a mouth at rest, steady "
        "light, a head that moves as is typical. Videos that are added come before the clips that "
        "the database was built from, photos last; the first that is there is the default.",
    )
    parser.add_argument("database", metavar="DB.h5")
    parser.add_argument(
        "--add",
        metavar="VIDEO",
        nargs="+",
        default=[],
        help="track videos or photos of the person and keep where they are and how the head moves",
    )
    parser.add_argument(
        "--remove",
        metavar="NAME",
        nargs="+",
        default=[],
        help="take out backgrounds that were added, by name or file; the files stay",
    )
    parser.add_argument(
        "--limit", type=positive_int, default=10, metavar="N", help="list so many (default: 10)"
    )
    parser.add_argument(
        "--models", metavar="DIR", help="folder with the face models (default: fetched once)"
    )
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Remove, add, rank and report."""
    if options.remove:
        remove_backgrounds(options.database, options.remove)
    names: tuple[str, ...] = ()
    if options.add:
        names = add_backgrounds(
            options.database, options.add, models=options.models, progress=output.progress
        )
    with open_database(options.database) as database:
        ranked = rank_backgrounds(database)
        notes = [shape_note(database, Path(video)) for video in options.add]
    told = [note for note in notes if note is not None]
    shown = [one for k, one in enumerate(ranked) if one.added or k < options.limit]
    document = {
        "database": str(options.database),
        "added": list(names),
        "removed": options.remove,
        "notes": told,
        "backgrounds": [_as_json(one) for one in shown],
        "of": len(ranked),
    }
    output.result(document, "\n".join([*told, *_table(shown, len(ranked))]))


def _as_json(one: RankedBackground) -> dict[str, Any]:
    return {
        "name": one.name,
        "media": str(one.media),
        "state": one.state,
        "added": one.added,
        "photo": one.still,
        "seconds": round(one.seconds, 3),
        "rest": round(one.rest, 4),
        "chin_mm": None if one.chin is None else round(one.chin, 3),
        "light": None if one.light is None else round(one.light, 5),
        "shut_eyes": None if one.shut is None else round(one.shut, 4),
        "motion_mm_s": round(one.motion, 2),
        "cost": round(one.cost, 4),
    }


def _table(shown: list[RankedBackground], total: int) -> list[str]:
    wide = max(len(one.name) for one in shown)
    lines = [
        f"{'':<{wide}}  {'seconds':>7} {'rest %':>6} {'chin mm':>7} {'light %':>7} "
        f"{'shut %':>6} {'motion mm/s':>11} {'cost':>6}"
    ]
    for one in shown:
        seconds = "photo" if one.still else f"{one.seconds:.1f}"
        chin = "" if one.chin is None else f"{one.chin:.2f}"
        light = "" if one.light is None else f"{100 * one.light:.2f}"
        shut = "" if one.shut is None else f"{100 * one.shut:.0f}"
        state = one.state
        kind = ", ".join(word for word in ("added" * one.added, state * (state != "there")) if word)
        lines.append(
            f"{one.name:<{wide}}  {seconds:>7} {100 * one.rest:>6.0f} {chin:>7} {light:>7} "
            f"{shut:>6} {one.motion:>11.1f} {one.cost:>6.2f}  {kind}".rstrip()
        )
    if len(shown) < total:
        lines.append(f"and {total - len(shown)} more (--limit)")
    return lines
