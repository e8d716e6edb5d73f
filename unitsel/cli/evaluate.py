"""``unitsel evaluate``: selections against recordings that the database does not hold."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from database.errors import SelectionError
from database.reader import open_database
from unitsel.cli.arguments import (
    Commands,
    add_models,
    add_selection,
    positive_int,
    selection_settings,
)
from unitsel.cli.output import Output
from unitsel.likeness.evaluation import ALL, Evaluation, Scores, evaluate
from unitsel.likeness.folds import evaluate_folds
from unitsel.likeness.side_by_side import video_folder, write_side_by_side
from unitsel.plots import plot_evaluation, plots_folder
from unitsel.settings import TARGETS

COLUMNS = (
    ("r_pca", "r_pca"),
    ("r_h", "r_h"),
    ("r_pca_speech", "pca_sp"),
    ("r_h_speech", "h_sp"),
    ("sd_ratio", "sd"),
    ("r_h_mesh", "r_h_mesh"),
    ("sl_avg", "SL"),
    ("tc_avg", "TC"),
    ("vc_avg", "VC"),
    ("closure_hits", "closed"),
    ("silence_ratio", "silence"),
    ("join_jump", "jump"),
)

LEGEND = """\
_sp: the correlations from the first to the last sound; sd: standard deviation of the mouth
height there, over the real one's; TC: the paper's target cost, whatever was searched; closed:
share of p, b and m in which the lips close (units of the right viseme do so even at random);
silence: movement in silences over the real one's; jump: the greatest at a join, over the step
that 95 % of natural ones do not exceed"""


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "evaluate",
        help="compare selections with held-out recordings",
        description="Select the sentences of held-out clips, or with --folds those of the "
        "database itself, and compare the mouths with the recorded ones (equations 12 to 16 of "
        "the paper, and what the eye punishes).",
    )
    parser.add_argument("database", metavar="DB.h5")
    parser.add_argument("heldout", metavar="HELDOUT_DIR", nargs="?")
    parser.add_argument(
        "--folds",
        type=positive_int,
        metavar="N",
        help="instead of HELDOUT_DIR: the database's own sentences, each without its own units, "
        "by guides that are fitted again without its fold; principal components, phoneme "
        "distances and scales of costs stay those of the whole database, so held-out clips are "
        "the stricter test",
    )
    add_selection(parser)
    parser.add_argument(
        "--methods",
        type=_methods,
        default=(),
        metavar="NAMES",
        help=f"target costs to compare: {','.join(TARGETS)} or {ALL} (all that the database has "
        "the guide for), each with the default weights for it",
    )
    parser.add_argument(
        "--limit", type=positive_int, metavar="N", help="take N sentences only, spread evenly"
    )
    parser.add_argument(
        "--jobs",
        type=positive_int,
        metavar="N",
        help="with --folds: processes (default: the number of cores)",
    )
    parser.add_argument("--plots", metavar="DIR", help="draw the trajectories into this folder")
    parser.add_argument(
        "--video",
        metavar="DIR",
        help="write a video of each sentence into this folder: the recording on the left, on the "
        "right the same with the selected mouths, and the recording's sound",
    )
    add_models(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Evaluate, draw and report."""
    if (options.heldout is None) == (options.folds is None):
        raise SelectionError(
            "evaluate: give either HELDOUT_DIR, a folder of clips that the database does not "
            "hold, or --folds N, to take the database's own sentences"
        )
    if options.folds is None and options.jobs is not None:
        raise SelectionError("evaluate: --jobs goes with --folds; held-out clips go one by one")
    if options.plots is not None:
        plots_folder(options.plots)
    if options.video is not None:
        video_folder(options.video)
    with open_database(options.database) as database:
        settings = selection_settings(options, database)
        if options.folds is None:
            found = evaluate(
                database,
                options.heldout,
                settings=settings,
                methods=options.methods,
                limit=options.limit,
                models=options.models,
                dictionary=options.dictionary,
                keep_selections=options.video is not None,
                progress=output.progress,
            )
        else:
            found = evaluate_folds(
                database,
                options.folds,
                settings=settings,
                methods=options.methods,
                limit=options.limit,
                jobs=options.jobs or max(1, os.cpu_count() or 1),
                keep_selections=options.video is not None,
                progress=output.progress,
            )
        videos: list[Path] = []
        unseen: list[tuple[str, str]] = []
        if options.video is not None:
            videos, unseen = write_side_by_side(
                database, found.sentences, options.video, progress=output.progress
            )
    drawn = [] if options.plots is None else plot_evaluation(found, options.plots)
    text = _text(found)
    if drawn:
        text += f"\ndrawn: {len(drawn)} plots in {drawn[0].parent}"
    document = found.as_json()
    if options.video is not None:
        text += f"\nvideos: {len(videos)} in {options.video}"
        text += "".join(f"\nno video of {clip}: {reason}" for clip, reason in unseen)
        document["videos"] = [str(path) for path in videos]
        document["without_video"] = [{"clip": c, "reason": r} for c, r in unseen]
    output.result(document, text)


def _methods(text: str) -> tuple[str, ...]:
    """Names of target costs, separated by commas."""
    names = tuple(n.strip() for n in text.split(",") if n.strip())
    for name in names:
        if name not in (*TARGETS, ALL):
            raise argparse.ArgumentTypeError(f"{name!r} is none of {', '.join(TARGETS)} and {ALL}")
    if not names:
        raise argparse.ArgumentTypeError(f"{text!r} names no target cost")
    return names


def _text(found: Evaluation) -> str:
    names = "".join(f"{title:>9}" for _, title in COLUMNS)
    rows = {m: _title(m, found) for m in found.means}
    width = max(12, *map(len, rows.values()))
    if found.folds is None:
        width = max(width, *(len(s.clip) for s in found.sentences))
    lines = [f"{'':<{width}}{names}"]
    if found.folds is None:
        lines.append("sentences, selected:")
        lines += [_row(s.clip, s.scores["selected"], width) for s in found.sentences]
        lines.append(f"mean over {len(found.sentences)} sentences:")
    else:
        lines.append(
            f"mean over {len(found.sentences)} sentences of the database, in {found.folds} folds:"
        )
    lines += [_row(rows[m], scores, width) for m, scores in found.means.items()]
    for method in found.means:
        count = sum(method in s.scores for s in found.sentences)
        if count < len(found.sentences):
            lines.append(f"{rows[method]}: over the {count} sentences that have sound")
    lines.append(LEGEND)
    lines += [f"skipped {clip}: {reason}" for clip, reason in found.skipped]
    fallbacks = sorted({f.partition(":")[0] for s in found.sentences for f in s.fallbacks})
    return "\n".join(lines + fallbacks)


def _title(method: str, found: Evaluation) -> str:
    if method == "selected":
        return f"selected ({found.settings.target.name})"
    return method.replace("_", " ")


def _row(name: str, scores: Scores, width: int) -> str:
    values = (getattr(scores, field) for field, _ in COLUMNS)
    return f"{name:<{width}}" + "".join(f"{'-':>9}" if v is None else f"{v:>9.3f}" for v in values)
