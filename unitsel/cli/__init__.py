"""The command ``unitsel``: one module a sub-command, each with `add` and `run`."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

import unitsel
from database.errors import UnitselError
from unitsel.cli import (
    align,
    build,
    doctor,
    dub,
    evaluate,
    inspect,
    merge,
    portrait,
    say,
    synth,
    train,
)
from unitsel.cli.output import Output

COMMANDS = (build, merge, portrait, say, dub, synth, align, inspect, doctor, evaluate, train)

USAGE_ERROR = 2
"""Exit status of bad input."""

DEBUG_ENV = "UNITSEL_DEBUG"
"""Environment variable that asks for tracebacks."""


class UsageError(UnitselError):
    """Arguments that no command takes."""


class Parser(argparse.ArgumentParser):
    """A parser whose errors are told as all others are: in one line, or as JSON."""

    def error(self, message: str) -> NoReturn:
        """Raise, where argparse would print the usage and exit."""
        raise UsageError(f"{message}; see {self.prog} --help")


def parser() -> argparse.ArgumentParser:
    """The command line, for `main` and for its tests."""
    top = Parser(
        prog="unitsel",
        description="Image-based talking heads by unit selection: a real person's mouth.",
    )
    top.add_argument("--version", action="version", version=f"unitsel {unitsel.__version__}")
    commands = top.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in COMMANDS:
        sub = command.add(commands)
        sub.add_argument(
            "--json", action="store_true", help="print one JSON object on standard output"
        )
        sub.set_defaults(run=command.run)
    return top


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit status is 0, or 2 for input that cannot be used."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    output = Output(json="--json" in given)
    try:
        options = parser().parse_args(given)
        output.json = options.json
        options.run(options, output)
    except UnitselError as error:
        if os.environ.get(DEBUG_ENV):
            raise
        return output.failed(str(error), USAGE_ERROR)
    except KeyboardInterrupt as error:
        return output.failed(str(error) or "interrupted; nothing half-written was left", 130)
    except BrokenPipeError:
        # The reader of our output went away: no more to say, and nothing wrong with it.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if os.environ.get(DEBUG_ENV):
            raise
        return output.failed(
            f"unexpected {type(error).__name__}: {error} (a fault of ours; {DEBUG_ENV}=1 shows "
            "where)",
            1,
        )
    finally:
        output.close()
    return 0
