"""What a command says: progress and words for people, one JSON object for machines."""

from __future__ import annotations

import json
import sys
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)


class Output:
    """Progress on standard error (on a terminal only), results on standard output.

    Parameters
    ----------
    json : bool
        Whether standard output is to hold one JSON object and nothing else.
    """

    def __init__(self, *, json: bool) -> None:
        self.json = json
        self._errors = Console(stderr=True, highlight=False)
        self._progress: Progress | None = None
        self._stages: dict[str, TaskID] = {}

    def progress(self, stage: str, done: int, total: int) -> None:
        """Show how far a stage has come; the callback that the API's functions take."""
        if not self._errors.is_terminal:
            return
        if self._progress is None:
            self._progress = Progress(
                TextColumn("{task.description:>24}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeRemainingColumn(),
                console=self._errors,
            )
            self._progress.start()
        if stage not in self._stages:
            self._stages[stage] = self._progress.add_task(stage, total=total)
        self._progress.update(self._stages[stage], completed=done, total=total)

    def result(self, document: dict[str, Any], text: str) -> None:
        """Print the result: the document for machines, else the text for people."""
        self.close()
        if self.json:
            print(json.dumps(document, ensure_ascii=False, allow_nan=False))
        else:
            print(text)

    def failed(self, message: str, status: int) -> int:
        """Print why a command failed, in one line; gives the exit status."""
        self.close()
        line = " ".join(message.split())
        if self.json:
            print(json.dumps({"error": line}, ensure_ascii=False))
        print(f"unitsel: {line}", file=sys.stderr)
        return status

    def close(self) -> None:
        """Leave the terminal as it was."""
        if self._progress is not None:
            self._progress.stop()
            self._progress = None
            self._stages = {}
