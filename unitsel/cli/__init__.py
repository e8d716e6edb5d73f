"""The command ``unitsel``: one module a sub-command, each with `add` and `run`."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import Any, NoReturn

import unitsel
from database.errors import UnitselError
from unitsel.cli.output import Output

NAMES = (
    *("build", "merge", "portrait", "say", "dub", "synth", "align", "inspect", "doctor"),
    *("evaluate", "train"),
)
"""The commands, each a module of this name."""

USAGE_ERROR = 2
"""Exit status of bad input."""

DEBUG_ENV = "UNITSEL_DEBUG"
"""Environment variable that asks for tracebacks."""


def command_modules(names: Sequence[str] = NAMES) -> tuple[ModuleType, ...]:
    """Load the modules of some commands."""
    return tuple(importlib.import_module(f"unitsel.cli.{name}") for name in names)


def __getattr__(name: str) -> Any:
    if name != "COMMANDS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return command_modules()


class UsageError(UnitselError):
    """Arguments that no command takes."""


class Parser(argparse.ArgumentParser):
    """A parser whose errors are told as all others are: in one line, or as JSON."""

    def error(self, message: str) -> NoReturn:
        """Raise, where argparse would print the usage and exit."""
        raise UsageError(f"{message}; see {self.prog} --help")


def parser(names: Sequence[str] = NAMES) -> argparse.ArgumentParser:
    """The command line, with all commands or some of them.

    A command that is not asked for is not loaded: a build needs libraries that take seconds.
    """
    top = Parser(
        prog="unitsel",
        description="Image-based talking heads by unit selection: a real person's mouth.",
    )
    top.add_argument("--version", action="version", version=f"unitsel {unitsel.__version__}")
    commands = top.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in command_modules(names):
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
        options = parser(given[:1] if given[:1] and given[0] in NAMES else NAMES).parse_args(given)
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
