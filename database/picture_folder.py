"""A folder of numbered PNG pictures: video for programs that lay pictures over one another."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import numpy as np
import numpy.typing as npt
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from database.errors import MediaError
from database.planes import Colour, Planes, planes_to_rgb

NAME: Final = "{:06d}.png"

COMPRESSION: Final = 3
"""Of zlib: a tenth larger than the usual 6, in a third of the time."""


class PictureFolder:
    """Writes frames as ``000000.png`` and on into a new folder; a context manager.

    The folder is there when it is complete; leaving the block through an exception removes what
    was written.

    Parameters
    ----------
    path : path
        Does not exist yet, or is an empty folder.
    width, height : int
        Of every picture.
    colour : Colour
        Meaning of planes.
    metadata : mapping of str to str, optional
        Text chunks of every picture.

    Raises
    ------
    MediaError
        Here and in every method: if the place cannot be used or writing fails.
    """

    def __init__(
        self,
        path: str | Path,
        width: int,
        height: int,
        *,
        colour: Colour | None = None,
        metadata: Mapping[str, str] | None = None,
    ) -> None:
        self.path = Path(path)
        self.width, self.height = width, height
        self.frames = 0
        """Pictures written so far."""
        self._colour = Colour() if colour is None else colour
        self._text = PngInfo()
        for key, value in (metadata or {}).items():
            self._text.add_itxt(key.capitalize(), value)
        check_folder(self.path)
        self._partial = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")

    def __enter__(self) -> Self:
        try:
            self._partial.mkdir()
        except OSError as error:
            raise self._failed(error) from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                if self.frames == 0:
                    raise MediaError(f"{self.path}: no frame was written")
                if self.path.exists():
                    self.path.rmdir()
                self._partial.replace(self.path)
        except OSError as error:
            raise self._failed(error) from error
        finally:
            shutil.rmtree(self._partial, ignore_errors=True)

    def write_planes(self, planes: Planes) -> None:
        """Write the next frame from its planes, as RGB."""
        self._write(planes_to_rgb(planes, self._colour), 3)

    def write_rgba(self, rgba: npt.NDArray[np.uint8]) -> None:
        """Write the next frame from (height, width, 4) uint8 RGB and alpha, not premultiplied."""
        self._write(rgba, 4)

    def _write(self, picture: npt.NDArray[np.uint8], channels: int) -> None:
        if picture.shape != (self.height, self.width, channels):
            raise MediaError(
                f"{self.path}: frame {self.frames} has shape {picture.shape}, "
                f"not {(self.height, self.width, channels)}"
            )
        place = self._partial / NAME.format(self.frames)
        try:
            Image.fromarray(np.ascontiguousarray(picture)).save(
                place, "PNG", compress_level=COMPRESSION, pnginfo=self._text
            )
        except OSError as error:
            raise self._failed(error) from error
        self.frames += 1

    def _failed(self, error: OSError) -> MediaError:
        return MediaError(f"{self.path}: cannot be written ({error.strerror or error})")


def check_folder(path: Path) -> None:
    """Refuse a place where no new folder can be made.

    Raises
    ------
    MediaError
        If it is a file, is not empty, or its parent does not exist or may not be written to.
    """
    if not path.parent.is_dir():
        raise MediaError(f"{path}: the folder {path.parent} does not exist; create it first")
    if not os.access(path.parent, os.W_OK):
        raise MediaError(f"{path}: the folder {path.parent} cannot be written to")
    if path.is_dir():
        if next(path.iterdir(), None) is not None:
            raise MediaError(f"{path}: is a folder with files in it; name a new or empty one")
    elif path.exists():
        raise MediaError(f"{path}: is a file; pictures go to a folder")
