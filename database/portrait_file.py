"""A portrait's head as a file: written whole or not at all, and opened for reading."""

from __future__ import annotations

import contextlib
import hashlib
import platform
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Final

import h5py
import numpy as np
import numpy.typing as npt

from database.checks import match_shape
from database.database_file import DatabaseFile
from database.errors import DatabaseError
from database.mouth_look import MouthLook
from database.outfile import whole_file, writing
from database.pictures import decode, encode
from database.portrait_schema import (
    PORTRAIT_FIELDS,
    PORTRAIT_SCHEMA_NAME,
    PORTRAIT_SCHEMA_VERSION,
    PortraitContent,
    check_portrait,
)
from database.storage import PORTRAIT, FileKind, reading
from database.talk_mask import TalkMask
from database.writer import FORMAT, as_json, as_stored, library_versions, write_dataset

CODEC: Final = "png"

FRAME_RATE: Final = 25.0
"""Frames a second of a portrait's videos, where nothing else is asked for."""


class PortraitHead(DatabaseFile):
    """A portrait's head, open for reading; a context manager.

    Parameters
    ----------
    path : str or Path

    Raises
    ------
    DatabaseError
        On opening and from every member: if the file is not what it should be, or was closed.
    """

    KIND: ClassVar[FileKind] = PORTRAIT

    def __reduce__(self) -> tuple[type[PortraitHead], tuple[Path]]:
        return PortraitHead, (self.path.absolute(),)

    def __repr__(self) -> str:
        if self._handle is None:
            return f"<PortraitHead {self.path}: closed>"
        return f"<PortraitHead {self.path}: {self.mask.width} x {self.mask.height}>"

    @property
    def fps(self) -> float:
        """Frame rate of its videos where none is asked for, 1/s."""
        return FRAME_RATE

    @cached_property
    def identity(self) -> str:
        """What tells this head from others: a checksum of photo, mask and mouth."""
        digest = hashlib.sha256()
        with reading(self.path):
            for name in ("size", "photo", "vertices", "mouth"):
                digest.update(self._read(f"portrait/{name}").tobytes())
        return digest.hexdigest()[:16]

    @cached_property
    def photo(self) -> npt.NDArray[np.uint8]:
        """The photo, (h, w, 3) uint8 RGB."""
        with reading(self.path):
            data = self._read("portrait/photo").tobytes()
            try:
                photo = decode(data, CODEC)
            except DatabaseError as error:
                raise ValueError(f"portrait/photo: {error}") from error
            if photo.shape[:2] != (self.mask.height, self.mask.width):
                raise ValueError("portrait/photo is not of the size portrait/size")
            photo.setflags(write=False)
            return photo

    @cached_property
    def mask(self) -> TalkMask:
        """The Talk Mask over the photo."""
        with reading(self.path):
            width, height = self._read("portrait/size").tolist()
            mask = TalkMask(self._read("portrait/vertices"), width, height)
            check_portrait(mask, self.mouth)
            return mask

    @cached_property
    def mouth(self) -> MouthLook:
        """Colours of the mouth's inside."""
        with reading(self.path):
            return MouthLook.from_array(self._read("portrait/mouth"))

    @cached_property
    def landmarks(self) -> npt.NDArray[np.float32]:
        """The face mesh in the photo, (468, 2) float32 pixels, nothing put right."""
        with reading(self.path):
            landmarks: npt.NDArray[np.float32] = self._read("portrait/landmarks")
            return landmarks

    @cached_property
    def settings(self) -> dict[str, Any]:
        """What it was made with."""
        return self._document("settings")

    @cached_property
    def versions(self) -> dict[str, Any]:
        """Versions of unitsel and its libraries then."""
        return self._document("versions")

    @cached_property
    def report(self) -> dict[str, Any]:
        """What was done to the photo."""
        return self._document("report")


def write_portrait(path: str | Path, content: PortraitContent) -> None:
    """Write a portrait's head.

    Parameters
    ----------
    path : str or Path
        The file; one that is there is replaced once the new one is complete.
    content : PortraitContent

    Raises
    ------
    DatabaseError
        If a field does not have the shape, type or values that the schema asks for, or the
        file cannot be written. There is no new file then, and what was at `path` is still there.
    """
    path = Path(path)
    try:
        arrays = _prepare(content)
    except (ValueError, TypeError, OverflowError) as error:
        raise DatabaseError(f"{path}: not written: {error}") from error
    with whole_file(path) as sink, writing(path):
        file = h5py.File(sink, "w", libver=FORMAT)
        with contextlib.closing(file):
            texts = {
                "schema": PORTRAIT_SCHEMA_NAME,
                "codec": CODEC,
                "created": datetime.now(UTC).isoformat(timespec="seconds"),
                "host": platform.node(),
            }
            for name, text in texts.items():
                file.attrs[name] = np.bytes_(text.encode())
            file.attrs["schema_version"] = np.int64(PORTRAIT_SCHEMA_VERSION)
            for field in PORTRAIT_FIELDS:
                write_dataset(file, field, arrays[field.path])
                sink.check()


def _prepare(content: PortraitContent) -> dict[str, npt.NDArray[Any]]:
    """All datasets in the types of the schema, checked."""
    mask, mouth = content.mask, content.mouth
    check_portrait(mask, mouth)
    if content.photo.shape != (mask.height, mask.width, 3) or content.photo.dtype != np.uint8:
        raise ValueError(
            f"the photo is {content.photo.dtype} of shape {content.photo.shape}, its mask is for "
            f"{mask.width} x {mask.height} pixels"
        )
    values: dict[str, Any] = {
        "portrait/photo": np.frombuffer(encode(content.photo, CODEC), dtype=np.uint8),
        "portrait/size": [mask.width, mask.height],
        "portrait/vertices": mask.vertices,
        "portrait/landmarks": content.landmarks,
        "portrait/mouth": mouth.as_array(),
        "build/settings": [as_json("build/settings", content.settings)],
        "build/report": [as_json("build/report", content.report)],
        "build/versions": [as_json("build/versions", library_versions())],
    }
    sizes: dict[str, int] = {}
    arrays = {}
    for field in PORTRAIT_FIELDS:
        arrays[field.path] = as_stored(field, values[field.path])
        match_shape(field, arrays[field.path].shape, sizes)
    return arrays
