"""One build at a time: a lock beside the output, and what a killed build left behind.

The lock is the system's (flock), so that it ends with the process however that ends; the file
that carries it names the process, so that the next build knows whose leavings to clear away.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import platform
import shutil
import tempfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from database.errors import DatabaseError
from database.outfile import is_running

SHARED_MEMORY: Final = Path("/dev/shm")


@contextlib.contextmanager
def only_build(lock: Path, what: Path, *, lasting: bool = False) -> Iterator[None]:
    """Hold a lock for a block; first clear away what a killed holder left in shared memory.

    Parameters
    ----------
    lock : Path
        File of the lock.
    what : Path
        What is locked, for the message.
    lasting : bool
        Whether the file stays: a process can be killed when its build is done, before it has
        given its shared memory back, and then, too, the next build should know of it.

    Raises
    ------
    DatabaseError
        If another process holds it, or the file cannot be made.
    """
    try:
        handle = _locked(lock)
    except BlockingIOError:
        raise DatabaseError(f"{what}: {_holder(lock)}; wait until it is done, or stop it") from None
    except OSError as error:
        raise DatabaseError(f"{lock}: cannot be locked ({error.strerror})") from error
    try:
        before = _read(lock).get("pid")
        if isinstance(before, int) and not is_running(before):
            _clear_shared_memory(before)
        now = datetime.now(UTC).isoformat(timespec="seconds")
        document = {"pid": os.getpid(), "host": platform.node(), "started": now}
        os.ftruncate(handle, 0)
        os.pwrite(handle, json.dumps(document).encode(), 0)
        yield
    finally:
        if not lasting:
            # While it is still locked: who opens the file now sees that it has lost its name.
            lock.unlink(missing_ok=True)
        os.close(handle)


def clear_partials(folder: Path, pattern: str) -> None:
    """Delete what writers that were killed left half-written; nobody else may be writing."""
    for path in folder.glob(pattern):
        path.unlink(missing_ok=True)


def _locked(lock: Path) -> int:
    """Open and lock a file that still has its name once it is locked."""
    while True:
        handle = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), lock.stat()):
                    return handle
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _holder(lock: Path) -> str:
    about = _read(lock)
    if "pid" not in about:
        return "another build is at work on it"
    return (
        f"another build is at work on it (process {about['pid']} on {about.get('host')}, since "
        f"{about.get('started')})"
    )


def _read(lock: Path) -> dict[str, Any]:
    with contextlib.suppress(OSError, ValueError):
        about = json.loads(lock.read_text(encoding="utf-8"))
        if isinstance(about, dict):
            return about
    return {}


def _clear_shared_memory(pid: int) -> None:
    """Remove the semaphores and folders of a process that was killed with all its children.

    joblib's own tracker does it when it survives; it dies with the group of its process.
    """
    for path in SHARED_MEMORY.glob(f"sem.loky-{pid}-*"):
        with contextlib.suppress(OSError):
            path.unlink()
    places = {SHARED_MEMORY, Path(tempfile.gettempdir())}
    if named := os.environ.get("JOBLIB_TEMP_FOLDER"):
        places.add(Path(named))
    for place in places:
        for folder in place.glob(f"joblib_memmapping_folder_{pid}_*"):
            shutil.rmtree(folder, ignore_errors=True)
