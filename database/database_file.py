"""A database's file, open for reading: how its parts are read, whatever they are."""

from __future__ import annotations

import json
import operator
from dataclasses import fields
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, ClassVar, Self

import h5py

from database.errors import DatabaseError
from database.storage import DATABASE, FileKind, open_file, read_field, reading


class DatabaseFile:
    """An open file; a context manager.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    DatabaseError
        If it is not a database, or not one that this version reads.
    """

    KIND: ClassVar[FileKind] = DATABASE

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._handle: h5py.File | None
        self._handle, self._sizes = open_file(self.path, self.KIND)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; closing twice does no harm."""
        handle, self._handle = self._handle, None
        for name in [
            n for n in vars(self) if isinstance(getattr(type(self), n, None), cached_property)
        ]:
            del self.__dict__[name]
        if handle is not None:
            with reading(self.path):
                handle.close()

    @property
    def _file(self) -> h5py.File:
        if self._handle is None:
            raise DatabaseError(f"{self.path}: the database was closed; open it again")
        return self._handle

    def _read(self, path: str) -> Any:
        return read_field(self._file, path)

    def _group(self, group: str, kind: type[Any]) -> dict[str, Any]:
        return {f.name: self._read(f"{group}/{f.name}") for f in fields(kind)}

    def _document(self, name: str, group: str = "build") -> dict[str, Any]:
        with reading(self.path):
            document = json.loads(self._read(f"{group}/{name}")[0])
            if not isinstance(document, dict):
                raise ValueError(f"{group}/{name} is no JSON object")
            return document

    def _index(self, i: int, n: int, what: str) -> int:
        try:
            place = operator.index(i)
        except TypeError:
            raise DatabaseError(f"{self.path}: {i!r} is no number of a {what}") from None
        if not 0 <= place < n:
            raise DatabaseError(f"{self.path}: there is no {what} {place}; it has 0..{n - 1}")
        return place
