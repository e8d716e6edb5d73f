"""``unitsel evaluate``: selections against recordings that the database does not hold."""

from __future__ import annotations

import argparse

from database.reader import open_database
from unitsel.cli.arguments import Commands, add_models, positive_int
from unitsel.cli.output import Output
from unitsel.costs import Weights
from unitsel.evaluation import METHODS, Evaluation, Scores, evaluate
from unitsel.plots import plot_evaluation, plots_folder

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
)


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "evaluate",
        help="compare selections with held-out recordings",
        description="Select the sentences of held-out clips from a database and compare the "
        "mouths with the recorded ones (equations 12 to 16 of the paper).",
    )
    parser.add_argument("database", metavar="DB.h5")
    parser.add_argument("heldout", metavar="HELDOUT_DIR")
    parser.add_argument("--weights", metavar="FILE", help="weights of the path cost, json")
    parser.add_argument("--limit", type=positive_int, metavar="N", help="take N clips only")
    parser.add_argument("--plots", metavar="DIR", help="draw the trajectories into this folder")
    add_models(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Evaluate, draw and report."""
    weights = Weights() if options.weights is None else Weights.read(options.weights)
    if options.plots is not None:
        plots_folder(options.plots)
    with open_database(options.database) as database:
        found = evaluate(
            database,
            options.heldout,
            weights=weights,
            limit=options.limit,
            models=options.models,
            dictionary=options.dictionary,
            progress=output.progress,
        )
    drawn = [] if options.plots is None else plot_evaluation(found, options.plots)
    text = _text(found)
    if drawn:
        text += f"\ndrawn: {len(drawn)} plots in {drawn[0].parent}"
    output.result(found.as_json(), text)


def _text(found: Evaluation) -> str:
    names = "".join(f"{title:>9}" for _, title in COLUMNS)
    width = max(12, *(len(s.clip) for s in found.sentences))
    lines = [f"{'':<{width}}{names}", "sentences, selected:"]
    lines += [_row(s.clip, s.scores["selected"], width) for s in found.sentences]
    lines.append(f"mean over {len(found.sentences)} sentences:")
    lines += [_row(m.replace("_", " "), found.means[m], width) for m in METHODS]
    lines.append(
        "_sp: the correlations from the first to the last sound; sd: standard deviation "
        "of the mouth height there, over the real one's"
    )
    lines += [f"skipped {clip}: {reason}" for clip, reason in found.skipped]
    fallbacks = sorted({f.partition(":")[0] for s in found.sentences for f in s.fallbacks})
    return "\n".join(lines + fallbacks)


def _row(name: str, scores: Scores, width: int) -> str:
    values = (getattr(scores, field) for field, _ in COLUMNS)
    return f"{name:<{width}}" + "".join(f"{'-':>9}" if v is None else f"{v:>9.3f}" for v in values)
