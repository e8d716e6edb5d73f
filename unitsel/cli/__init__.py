"""The command ``unitsel``: one module a sub-command, each with `add` and `run`."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Collection, Sequence
from typing import Final, NoReturn

import unitsel
from database.errors import UnitselError
from unitsel.cli.output import Output

COMMANDS: Final = {
    "build": "build a database from a folder of clips, a manifest, or one long video",
    "merge": "databases of one person into one",
    "portrait": "make a talking head of one photo",
    "say": "make the person of a database say a text",
    "dub": "make the person of a database say what a recording says",
    "synth": "make the person of a database say a timing file",
    "backgrounds": "list, rank, add and remove videos that the mouth is laid on",
    "align": "align the sound of a media file to its words",
    "inspect": "counts, visemes covered, sequences, pictures of mouths",
    "doctor": "examine footage or a database, and say what to record next",
    "evaluate": "compare selections with held-out recordings",
    "train": "train the weights on recorded sentences",
}
"""Names of the commands, each its module's, and what `unitsel --help` says of them."""

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


def parser(loaded: Collection[str] = tuple(COMMANDS)) -> argparse.ArgumentParser:
    """The command line, for `main` and for its tests.

    Parameters
    ----------
    loaded : collection of str
        Commands that can be parsed. Of the others there is only the name: each loads what it
        works with, which takes seconds, and no call of `unitsel` needs two.
    """
    top = Parser(
        prog="unitsel",
        description="Image-based talking heads by unit selection: a real person's mouth.",
    )
    top.add_argument("--version", action="version", version=f"unitsel {unitsel.__version__}")
    commands = top.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, what in COMMANDS.items():
        if name not in loaded:
            commands.add_parser(name, help=what)
            continue
        command = importlib.import_module(f"unitsel.cli.{name}")
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
        command = next((word for word in given if word in COMMANDS), None)
        options = parser(() if command is None else (command,)).parse_args(given)
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
