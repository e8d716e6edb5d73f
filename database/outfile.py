"""A file that is there when it is complete, and not before.

It grows under a hidden name beside its place and is renamed when it is on the disk, so that
nobody ever meets half of it.
"""

from __future__ import annotations

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from database.errors import DatabaseError, UnitselError


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the system's and HDF5's errors while writing into one `DatabaseError`."""
    try:
        yield
    except UnitselError:
        raise
    except (OSError, RuntimeError, ValueError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise DatabaseError(
            f"{path}: cannot be written: {reason}; free some space there or choose another place"
        ) from error


class Sink:
    """What HDF5 writes into: a file whose failures wait until HDF5 is done.

    HDF5 cannot close a file that it cannot write to, and brings the interpreter down when it
    tries later (a full disk is enough). So a write that fails seems to succeed, the error is
    kept, and `check` raises it.
    """

    def __init__(self, path: Path) -> None:
        self._raw = path.open("x+b", buffering=0)
        self._error: BaseException | None = None

    def check(self) -> None:
        """Raise the first error there was."""
        if self._error is not None:
            raise self._error

    def write(self, data: bytes | memoryview) -> int:
        """Write all of the data at the current place, or keep the error."""
        left = memoryview(data)
        try:
            while self._error is None and len(left):
                left = left[self._raw.write(left) :]
        # An interrupt, too: HDF5 would not survive it here.
        except BaseException as error:
            self._error = error
        return len(data)

    def truncate(self, size: int) -> int:
        """Set the file's length, or keep the error."""
        try:
            if self._error is None:
                self._raw.truncate(size)
        except BaseException as error:
            self._error = error
        return size

    def read(self, size: int = -1) -> bytes:
        """Read from the current place."""
        return self._raw.read(size) or b""

    def readinto(self, buffer: memoryview) -> int:
        """Read from the current place into a buffer."""
        return self._raw.readinto(buffer) or 0

    def seek(self, place: int, whence: int = os.SEEK_SET) -> int:
        """Go to a place."""
        return self._raw.seek(place, whence)

    def tell(self) -> int:
        """Return the current place."""
        return self._raw.tell()

    def flush(self) -> None:
        """Do nothing: no write waits here."""

    def sync(self) -> None:
        """Wait until everything is on the disk."""
        os.fsync(self._raw.fileno())

    def close(self) -> None:
        """Close the file."""
        self._raw.close()


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Sink]:
    """Give a file to write; once the block has ended without an error, it stands at `path`.

    After an error there is no new file, and what was at `path` is still there.

    Raises
    ------
    DatabaseError
        If the folder does not exist, `path` is a folder, or the file cannot be written.
    """
    with writing(path):
        if not path.parent.is_dir():
            raise DatabaseError(f"{path}: there is no folder {path.parent}; create it first")
        if path.is_dir():
            raise DatabaseError(f"{path}: is a folder; give the name of a file in it")
        _remove_leftovers(path)
        partial = path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(3)}.partial")
        sink = Sink(partial)
    try:
        with contextlib.closing(sink):
            yield sink
            with writing(path):
                sink.check()
                sink.sync()
        with writing(path):
            partial.replace(path)
            _sync_folder(path.parent)
    finally:
        partial.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    """Wait until a folder's names are on the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _remove_leftovers(path: Path) -> None:
    """Delete the partial files of writers that were killed."""
    mark = f".{path.name}."
    with contextlib.suppress(OSError):
        for other in list(path.parent.iterdir()):
            if not (other.name.startswith(mark) and other.name.endswith(".partial")):
                continue
            pid = other.name[len(mark) :].partition("-")[0]
            if pid.isdecimal() and not is_running(int(pid)):
                other.unlink(missing_ok=True)


def is_running(pid: int) -> bool:
    """Whether a process of this machine is alive, whoever it belongs to."""
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True
