"""The database file as HDF5: opened, told from other files, and compared with the schema.

Opening looks at the attributes and at every dataset's type and shape, not at the data.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from database.checks import match_shape
from database.errors import DatabaseError, UnitselError
from database.portrait_schema import (
    PORTRAIT_FIELDS,
    PORTRAIT_SCHEMA_NAME,
    PORTRAIT_SCHEMA_VERSION,
)
from database.schema import FIELDS, SCHEMA_NAME, SCHEMA_VERSION, Field

HDF5_SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
CACHE_BYTES: Final = 1 << 20
"""Cache of chunks a dataset: small, as hardly a chunk is read twice in a row."""


@dataclass(frozen=True)
class FileKind:
    """One kind of head in a file.

    Parameters
    ----------
    schema : str
        Its mark, in the attribute of this name.
    version : int
        Of the schema.
    fields : tuple of Field
        Every dataset.
    name, maker : str
        What it is called, and the command that writes it.
    """

    schema: str
    version: int
    fields: tuple[Field, ...]
    name: str
    maker: str


DATABASE: Final = FileKind(
    SCHEMA_NAME, SCHEMA_VERSION, FIELDS, "a database of units", "unitsel build"
)
PORTRAIT: Final = FileKind(
    PORTRAIT_SCHEMA_NAME,
    PORTRAIT_SCHEMA_VERSION,
    PORTRAIT_FIELDS,
    "a portrait's head",
    "unitsel portrait",
)
KINDS: Final = (DATABASE, PORTRAIT)


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn whatever goes wrong while reading a file into one `DatabaseError`.

    What is a `DatabaseError` already comes through as it is.
    """
    try:
        yield
    except DatabaseError:
        raise
    except (OSError, LookupError, RuntimeError, ValueError, TypeError, UnitselError) as error:
        # A KeyError's text is its argument in quotes.
        said = error.args[0] if isinstance(error, KeyError) and error.args else error
        reason = " ".join(str(said).split())
        raise DatabaseError(
            f"{path}: damaged or cut short ({reason}); copy it again or build it again"
        ) from error


def open_file(path: Path, kind: FileKind = DATABASE) -> tuple[h5py.File, dict[str, int]]:
    """Open a head's file and compare it with its schema.

    Returns
    -------
    file : h5py.File
        Open for reading; the caller closes it.
    sizes : dict of str to int
        The sizes that the fields name (``N``, ``S``, ...).

    Raises
    ------
    DatabaseError
        If there is no such file, it is of another kind, its schema version is another, or its
        datasets are not those of the schema.
    """
    _check_signature(path, kind.maker)
    with reading(path):
        file = h5py.File(path, "r", rdcc_nbytes=CACHE_BYTES)
    try:
        _check_version(path, file, kind)
        sizes: dict[str, int] = {}
        with reading(path):
            for field in kind.fields:
                # A group of optional fields is there as a whole or not at all.
                if not field.optional or field.path.partition("/")[0] in file:
                    _check_dataset(file, field, sizes)
    except BaseException:
        file.close()
        raise
    return file, sizes


def kind_of(path: Path) -> FileKind:
    """Which kind of head a file holds; a database where it says nothing.

    Raises
    ------
    DatabaseError
        If there is no such file, or it is no HDF5 file.
    """
    _check_signature(path, " or ".join(kind.maker for kind in KINDS))
    with reading(path), h5py.File(path, "r") as file:
        named = read_text_attribute(file, "schema") if "schema" in file.attrs else ""
    return next((kind for kind in KINDS if kind.schema == named), DATABASE)


def _check_signature(path: Path, maker: str) -> None:
    try:
        with path.open("rb") as stream:
            start = stream.read(len(HDF5_SIGNATURE))
    except FileNotFoundError:
        raise DatabaseError(f"{path}: there is no such file; make one with `{maker}`") from None
    except IsADirectoryError:
        raise DatabaseError(f"{path}: is a folder; give the database file in it") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DatabaseError(
            f"{path}: cannot be read: {reason}; check its name and rights"
        ) from error
    if not start:
        raise DatabaseError(f"{path}: is empty; build it again")
    if start != HDF5_SIGNATURE:
        raise DatabaseError(
            f"{path}: is no HDF5 file, so no database; give a file that `{maker}` wrote"
        )


def read_field(file: h5py.File, path: str) -> Any:
    """Read a whole dataset: a read-only array, or a tuple of str for a field of strings."""
    dataset = file[path]
    values = dataset[()]
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return tuple(text.decode() for text in values.tolist())
    values.setflags(write=False)
    return values


def read_text_attribute(file: h5py.File, name: str) -> str:
    """Read an attribute of the root that is a text."""
    value = file.attrs[name]
    if not isinstance(value, bytes):
        raise ValueError(f"attribute {name} is no text of fixed length")
    return value.decode()


def _check_version(path: Path, file: h5py.File, kind: FileKind) -> None:
    with reading(path):
        attributes = file.attrs
        named = read_text_attribute(file, "schema") if "schema" in attributes else None
        version = attributes["schema_version"] if named == kind.schema else None
        if named == kind.schema and not isinstance(version, np.integer):
            raise ValueError("attribute schema_version is no whole number")
    other = next((k for k in KINDS if k.schema == named and k is not kind), None)
    if other is not None:
        raise DatabaseError(
            f"{path}: is {other.name}, and this needs {kind.name}; give a file that "
            f"`{kind.maker}` wrote"
        )
    if version is None:
        raise DatabaseError(
            f"{path}: is an HDF5 file of something else; give one that `{kind.maker}` wrote"
        )
    if version > kind.version:
        raise DatabaseError(
            f"{path}: has schema version {version}, newer than this unitsel reads "
            f"({kind.version}); install a newer unitsel"
        )
    if version < kind.version:
        again = "build it again" if kind is DATABASE else f"make it again with `{kind.maker}`"
        raise DatabaseError(
            f"{path}: has schema version {version}, older than this unitsel reads "
            f"({kind.version}); {again}"
        )


def _check_dataset(file: h5py.File, field: Field, sizes: dict[str, int]) -> None:
    if field.path not in file:
        raise ValueError(f"{field.path} is missing")
    dataset = file[field.path]
    if not isinstance(dataset, h5py.Dataset):
        raise ValueError(f"{field.path} is no dataset")
    if field.dtype == "string":
        text = h5py.check_string_dtype(dataset.dtype)
        if text is None or text.length is None:
            raise ValueError(f"{field.path} is {dataset.dtype}, not text of fixed length")
    elif dataset.dtype != np.dtype(field.dtype):
        raise ValueError(f"{field.path} is {dataset.dtype}, not {field.dtype}")
    match_shape(field, dataset.shape, sizes)
