"""``unitsel merge``: databases of one person into one."""

from __future__ import annotations

import argparse

from analysis.build_settings import ShardSettings
from analysis.merge import merge_databases
from unitsel.cli.arguments import Commands, add_jobs, add_models
from unitsel.cli.build import report_text
from unitsel.cli.output import Output


def add(commands: Commands) -> argparse.ArgumentParser:
    """Describe the command."""
    parser = commands.add_parser(
        "merge",
        help="databases of one person into one",
        description="Merge databases of one person: clips that their builds have kept are taken "
        "over where they were analysed with the first one's mask, the others are analysed again, "
        "and what depends on all clips is fitted anew.",
    )
    parser.add_argument(
        "databases", metavar="DB.h5", nargs="+", help="the first one's mask is taken"
    )
    parser.add_argument("-o", "--output", metavar="OUT.h5", required=True)
    add_jobs(parser, "clips analysed at a time")
    parser.add_argument(
        "--discard-shards",
        action="store_true",
        help="delete the merged database's analysed clips when it is complete",
    )
    add_models(parser)
    return parser


def run(options: argparse.Namespace, output: Output) -> None:
    """Merge and report."""
    report = merge_databases(
        options.databases,
        options.output,
        jobs=options.jobs,
        models=options.models,
        dictionary=options.dictionary,
        shards=ShardSettings(keep=not options.discard_shards),
        progress=output.progress,
    )
    output.result(report.as_json(), report_text(report))
