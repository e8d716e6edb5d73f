"""``unitsel train``: weights from recordings that the database does not hold."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from database.reader import open_database
from database.writer import store_selection
from unitsel.cli.arguments import Commands, add_jobs, add_models, check_output, positive_int
from unitsel.cli.output import Output
from unitsel.plots import plots_folder
from unitsel.settings import TARGETS, default_settings
from unitsel.training.pareto import ParetoSettings
from unitsel.training.plots import plot_training
from unitsel.training.result import SENTENCES, Training, TrainingSettings, Trial
from unitsel.training.train import train

SHOWN = 5
"""Sets of the front that the text shows."""


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "train",
        help="train the weights on recorded sentences",
        description="Train the weights of the path cost by Pareto optimisation on clips that "
        "the database does not hold. Every set of weights that was tried is kept in "
        "WEIGHTS.json.partial until the training is done; --resume goes on from there.",
    )
    parser.add_argument("database", metavar="DB.h5")
    parser.add_argument("folder", metavar="TRAIN_DIR")
    parser.add_argument("-o", "--output", metavar="WEIGHTS.json", required=True)
    parser.add_argument("--plots", metavar="DIR", help="draw front and likeness into this folder")
    parser.add_argument(
        "--resume", action="store_true", help="go on where the same training was stopped"
    )
    add_jobs(parser, "sets tried at a time")
    parser.add_argument(
        "--sentences",
        type=positive_int,
        default=SENTENCES,
        metavar="N",
        help=f"take at most N clips, spread evenly over the sorted names (default: {SENTENCES})",
    )
    parser.add_argument(
        "--seed", type=_whole, default=0, metavar="S", help="of all that is random (default: 0)"
    )
    parser.add_argument(
        "--generations",
        type=positive_int,
        default=ParetoSettings.generations,
        metavar="N",
        help="stop after N generations, stable or not (default: %(default)s)",
    )
    parser.add_argument(
        "--target",
        choices=TARGETS,
        help="target cost that the weights are for (default: the database's own)",
    )
    parser.add_argument(
        "--features",
        action="store_true",
        help="train the weights of the features, beta1 and the context's length too",
    )
    parser.add_argument(
        "--store",
        action="store_true",
        help="make the trained settings the database's own, which all commands then use",
    )
    add_models(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Train, write, draw and report."""
    check_output(options.output, (".json",))
    if options.plots is not None:
        plots_folder(options.plots)
    state = Path(f"{options.output}.partial")
    with open_database(options.database) as database:
        target = default_settings(database).target
        if options.target is not None:
            target = replace(target, name=options.target)
        found = train(
            database,
            options.folder,
            TrainingSettings(
                target=target,
                sentences=options.sentences,
                features=options.features,
                pareto=ParetoSettings(seed=options.seed, generations=options.generations),
            ),
            state=state,
            resume=options.resume,
            jobs=options.jobs,
            models=options.models,
            dictionary=options.dictionary,
            progress=output.progress,
        )
    found.write(options.output)
    if options.store:
        store_selection(options.database, found.chosen.settings.as_json())
    drawn = [] if options.plots is None else plot_training(found, options.plots)
    # Only now is nothing of the work lost any more.
    state.unlink(missing_ok=True)
    document = {
        "weights_file": options.output,
        "stored": options.store,
        **found.as_json(),
        "plots": [str(p) for p in drawn],
    }
    text = _text(found, options.output)
    if options.store:
        text += f"\n{options.database}: has these settings as its own now"
    output.result(document, "\n".join([text, *(f"drawn: {p}" for p in drawn)]))


def _text(found: Training, name: str) -> str:
    evolution = found.evolution
    ended = "stable" if evolution.stable else "not stable yet"
    lines = [
        f"{name}: {found.tried} sets of weights tried on {len(found.sentences)} sentences in "
        f"{found.seconds:.1f} s; front of {len(found.front)}, {ended} after "
        f"{evolution.generations} generations",
        f"{'':<12}{'visual':>11}{'skip':>11}"
        + "".join(f"{name:>8}" for name in ("TC", "SL", "VC", "pca_sp", "h_sp", "sd")),
    ]
    lines += [_row("front", trial) for trial in found.along(SHOWN)]
    lines += [_row("most alike", found.most_alike), _row("default", found.default)]
    lines.append(_row("chosen", found.chosen))
    lines.append(
        "chosen: the least VC of those as good as the most alike; visual, skip: wcc*wccf/wtc, "
        "wcc*wccg/wtc; _sp: correlations from the first to the last "
        "sound; sd: standard deviation of the mouth height there, over the real one's"
    )
    if found.settings.features:
        costs = found.chosen.settings.costs
        k = ", ".join(f"{n} {v:g}" for n, v in vars(costs.features).items())
        lines.append(f"features: {k}; beta1 {costs.beta1:g}; context {costs.context:g} s")
    if found.skipped:
        lines.append(f"skipped ({len(found.skipped)}):")
        lines += [f"  {clip}: {reason}" for clip, reason in found.skipped]
    return "\n".join(lines)


def _row(name: str, trial: Trial) -> str:
    w, m = trial.settings.weights, trial.measures
    ratios = (w.concatenation * w.visual / w.target, w.concatenation * w.skip / w.target)
    measured = (m.tc_avg, m.sl_avg, m.vc_avg, m.r_pca_speech, m.r_h_speech, m.sd_ratio)
    return (
        f"{name:<12}"
        + "".join(f"{r:>11.4g}" for r in ratios)
        + "".join(f"{v:>8.3f}" for v in measured)
    )


def _whole(text: str) -> int:
    """A whole number, 0 or more."""
    try:
        value = int(text)
    except ValueError:
        value = -1
    if not 0 <= value < 2**32:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to 2^32 - 1")
    return value
