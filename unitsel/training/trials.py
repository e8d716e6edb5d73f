"""Many settings tried on the same sentences: in parallel, each once, and never lost.

Worker processes open the database themselves and keep what they prepared. The measures of a set
follow from the set alone, whoever tries it and when, so a run that was killed and is resumed
from its file ends as if nothing had happened.
"""

from __future__ import annotations

import fcntl
import json
import os
import pickle
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
import numpy.typing as npt
from joblib import Parallel, delayed
from joblib.externals.loky.process_executor import TerminatedWorkerError

from database.errors import SelectionError
from database.reader import open_database
from unitsel.settings import SelectionSettings
from unitsel.training.rehearsal import MEANS, Player, Rehearsal, TrialMeasures

FloatArray = npt.NDArray[np.float64]
Numbers = tuple[float, ...]

FORMAT: Final = "unitsel-training"
VERSION: Final = 1


class Trials:
    """Tries sets of numbers.

    Parameters
    ----------
    player : Player
        For what is tried in this process; workers make their own.
    settings : callable
        From a set of numbers to the settings that it stands for.
    jobs : int
        Processes. The measures do not depend on it.
    file : TrialFile, optional
        What was tried before, and where to note what is tried now.
    progress : callable, optional
        Called with the sets done and those asked for so far.
    """

    def __init__(
        self,
        player: Player,
        settings: Callable[[Sequence[float]], SelectionSettings],
        *,
        jobs: int = 1,
        file: TrialFile | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        self.player = player
        self.jobs = jobs
        self.asked: dict[Numbers, TrialMeasures] = {}
        self.tried = 0
        self._settings = settings
        self._file = file
        self._known = {} if file is None else dict(file.known)
        self._progress = progress
        self._token = player.rehearsal.token

    def objectives(self, sets: FloatArray) -> FloatArray:
        """Try sets (n, D) and give their objectives (n, 3), to be small."""
        numbers = [tuple(float(v) for v in row) for row in sets]
        self.measure(numbers)
        return np.array([self.asked[n].objectives for n in numbers], dtype=np.float64)

    def measure(self, sets: Sequence[Numbers]) -> None:
        """Try sets; what they measure is then in `asked`, in the order of asking.

        Raises
        ------
        SelectionError
            If a set cannot be tried, a worker was ended, or the file cannot be written.
        """
        wanted = list(dict.fromkeys(n for n in sets if n not in self.asked))
        missing = [n for n in wanted if n not in self._known]
        total = len(self.asked) + len(wanted)
        done = total - len(missing)
        self._tell(done, total)
        for numbers, found in self._run(missing):
            self._known[numbers] = found
            self.tried += 1
            if self._file is not None:
                self._file.add(numbers, found)
            done += 1
            self._tell(done, total)
        self.asked.update((n, self._known[n]) for n in wanted)

    def _run(self, sets: list[Numbers]) -> Iterator[tuple[Numbers, TrialMeasures]]:
        if self.jobs == 1 or len(sets) < 2:
            for n in sets:
                yield n, self.player.measure(self._settings(n))
            return
        try:
            with tempfile.TemporaryDirectory(prefix="unitsel-") as folder:
                # Sound makes a rehearsal too large to be sent with every set.
                path = Path(folder) / "rehearsal"
                path.write_bytes(pickle.dumps(self.player.rehearsal))
                tasks = (delayed(_try)(path, self._token, self._settings(n), n) for n in sets)
                run = Parallel(n_jobs=self.jobs, return_as="generator_unordered", batch_size=1)
                yield from run(tasks)
        except TerminatedWorkerError as error:
            raise SelectionError(
                "a worker of the training was ended from outside (out of memory?); go on with "
                "--resume and fewer --jobs"
            ) from error

    def _tell(self, done: int, total: int) -> None:
        if self._progress is not None:
            self._progress(done, total)


_players: dict[str, Player] = {}


def _try(
    path: Path, token: str, settings: SelectionSettings, numbers: Numbers
) -> tuple[Numbers, TrialMeasures]:
    """Try a set in a worker, which keeps the player of the last rehearsal."""
    if token not in _players:
        for player in _players.values():
            player.database.close()
        _players.clear()
        rehearsal: Rehearsal = pickle.loads(path.read_bytes())
        _players[token] = Player(open_database(rehearsal.database), rehearsal)
    return numbers, _players[token].measure(settings)


class TrialFile:
    """The sets that a run has tried, one a line, written as they come.

    The first line says which run it is. What a kill left half-written at the end is dropped.

    Parameters
    ----------
    path : path
    run : mapping
        What makes this run another than others, as JSON values.
    resume : bool
        Whether to go on where a run of the same kind stopped; else an earlier file is replaced.

    Raises
    ------
    SelectionError
        If the file cannot be read or written, another process is writing it, or it belongs to
        another run.
    """

    def __init__(self, path: str | Path, run: Mapping[str, Any], *, resume: bool = False) -> None:
        self.path = Path(path)
        self.known: dict[Numbers, TrialMeasures] = {}
        header = {"format": FORMAT, "version": VERSION, **run}
        self._file = self._open()
        try:
            kept = self._read(json.loads(json.dumps(header))) if resume else 0
            self._file.truncate(kept)
            self._file.seek(kept)
            if kept == 0:
                self._line(header)
        except OSError as error:
            self._file.close()
            raise SelectionError(f"{self.path}: {error.strerror or error}") from error
        except BaseException:
            self._file.close()
            raise

    def _open(self) -> IO[bytes]:
        try:
            file = os.fdopen(os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644), "r+b")
        except OSError as error:
            raise SelectionError(
                f"{self.path}: cannot be written ({error.strerror or error})"
            ) from error
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.close()
            raise SelectionError(
                f"{self.path}: another training is writing it; wait for that, or name another "
                "output"
            ) from error
        return file

    def __enter__(self) -> TrialFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; it stays where it is."""
        self._file.close()

    def add(self, numbers: Numbers, measures: TrialMeasures) -> None:
        """Note a set; it is in the file when this returns.

        Raises
        ------
        SelectionError
            If it cannot be written.
        """
        try:
            self._line({"set": numbers, "measures": asdict(measures)})
        except OSError as error:
            raise SelectionError(
                f"{self.path}: cannot be written ({error.strerror or error}); free some space "
                "and go on with --resume"
            ) from error

    def _line(self, content: Mapping[str, Any]) -> None:
        self._file.write(json.dumps(content).encode() + b"\n")
        self._file.flush()

    def _read(self, header: dict[str, Any]) -> int:
        """Take over the sets of the same run; gives the bytes that are of use."""
        content = self._file.read()
        whole = content[: content.rfind(b"\n") + 1]
        for i, line in enumerate(whole.splitlines(), 1):
            try:
                values = json.loads(line)
                if i == 1:
                    self._compare(values, header)
                    continue
                measured = values["measures"]
                means = {name: float(measured[name]) for name in MEANS}
                likeness = tuple(float(v) for v in measured["sentences"])
                numbers = tuple(float(v) for v in values["set"])
            except (ValueError, TypeError, KeyError, RecursionError) as error:
                raise SelectionError(
                    f"{self.path}, line {i}: is damaged; leave out --resume to start over"
                ) from error
            self.known[numbers] = TrialMeasures(**means, sentences=likeness)
        return len(whole)

    def _compare(self, found: Any, header: dict[str, Any]) -> None:
        if not isinstance(found, dict) or found.get("format") != FORMAT:
            raise ValueError("no header")
        other = [k for k in header | found if found.get(k) != header.get(k)]
        if other:
            raise SelectionError(
                f"{self.path}: belongs to a training with another {', another '.join(other)}; "
                "give the options of that one, or leave out --resume to start over"
            )
