"""A database's fingerprint: when two databases count as identical."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Final

import h5py
import numpy as np

from database.reader import UnitDatabase
from database.schema import UNHASHED_ATTRIBUTES
from database.storage import open_file, reading

BLOCK_BYTES: Final = 16 << 20


def content_hash(path: str | Path) -> str:
    """Checksum of a database's content: equal for databases that count as identical.

    It covers every dataset and attribute, with names, types and shapes, but for
    `UNHASHED_ATTRIBUTES` (time, host and jobs of the build).

    Returns
    -------
    str
        SHA-256, 64 hexadecimal digits.

    Raises
    ------
    DatabaseError
        If the file cannot be opened or read as a database.
    """
    path = Path(path)
    digest = hashlib.sha256()

    def add(*parts: object) -> None:
        # Each part with its length, so that no two contents run together into the same bytes.
        for part in parts:
            data = part if isinstance(part, bytes) else str(part).encode()
            digest.update(len(data).to_bytes(8, "little") + data)

    def add_attributes(item: h5py.Group | h5py.Dataset) -> None:
        for name in sorted(item.attrs):
            if item.name != "/" or name not in UNHASHED_ATTRIBUTES:
                value = np.asarray(item.attrs[name])
                add("attribute", name, value.dtype.str, value.shape, value.tobytes())

    with open_file(path)[0] as file, reading(path):
        names: list[str] = []
        file.visit(names.append)
        add_attributes(file)
        for name in sorted(names):
            item = file[name]
            if isinstance(item, h5py.Dataset):
                add("dataset", name, item.dtype.str, item.shape)
                rows = max(1, BLOCK_BYTES // max(1, item.nbytes // len(item)))
                for first in range(0, len(item), rows):
                    digest.update(item[first : first + rows].tobytes())
            else:
                add("group", name)
            add_attributes(item)
    return digest.hexdigest()


def identity(database: UnitDatabase) -> str:
    """What tells a database's costs from another's, in milliseconds.

    Weights hold for the units, the phoneme distances and the scales that they were trained
    with. Two databases with the same of these have the same identity, whatever else (pictures,
    media paths, default settings) is different.

    Parameters
    ----------
    database : UnitDatabase

    Returns
    -------
    str
        32 hexadecimal digits.
    """
    units, costs = database.units, database.costs
    digest = hashlib.sha256()
    for array in (
        units.sequence,
        units.frame,
        units.phoneme,
        units.pca,
        units.mouth_width,
        units.mouth_height,
        units.inner_opening,
        units.teeth,
        units.tongue,
        costs.phoneme_distance,
        costs.feature_scales,
        np.array([database.fps, costs.target_scale, costs.visual_scale]),
    ):
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]
