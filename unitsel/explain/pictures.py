"""Mouth pictures inside a page: each distinct unit once, small, shown wherever it is used."""

from __future__ import annotations

import base64
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.errors import RenderError
from database.pictures import Picture
from database.reader import UnitDatabase

CELL: Final = 60
"""Width of a picture, and of a frame in a row, in the SVGs' units."""

PICTURE_BYTES: Final = 6000
"""Most bytes of an encoded picture: three seconds at 50 frames make 1.2 MB of text."""

ENCODINGS: Final = ((112, 85), (112, 70), (88, 70), (88, 50), (64, 50), (64, 30), (40, 30))
"""Widths in pixels and JPEG qualities to try, the best first."""


def picture_height(database: UnitDatabase) -> float:
    """Height of a picture in a strip, `CELL` wide."""
    patch = database.mask.patch
    return round(CELL * patch.crop_height / patch.crop_width, 2)


def picture_definitions(database: UnitDatabase, units: npt.NDArray[np.int64]) -> str:
    """All pictures of a page, each once, to be drawn by `<use>`."""
    height = picture_height(database)
    images = "".join(
        f'<image id="u{unit}" width="{CELL}" height="{height:g}" preserveAspectRatio="none" '
        f'href="data:image/jpeg;base64,{_jpeg(database.picture(int(unit)))}"/>'
        for unit in np.unique(units)
    )
    return (
        f'<svg class="defs" width="0" height="0" aria-hidden="true"><defs>{images}</defs></svg>\n'
    )


def pair(database: UnitDatabase, first: int, second: int) -> str:
    """The pictures of two units side by side, as a small SVG."""
    height = picture_height(database)
    return (
        f'<svg class="pair" viewBox="0 0 {2 * CELL + 4} {height:g}">'
        f'<use href="#u{first}"/><use href="#u{second}" x="{CELL + 4}"/></svg>'
    )


def single(database: UnitDatabase, unit: int) -> str:
    """The picture of a unit, as a small SVG."""
    height = picture_height(database)
    return f'<svg class="single" viewBox="0 0 {CELL} {height:g}"><use href="#u{unit}"/></svg>'


def _jpeg(picture: Picture) -> str:
    """A picture as base64 of a JPEG of at most `PICTURE_BYTES`, or the smallest that we make."""
    data = b""
    for width, quality in ENCODINGS:
        height = max(1, round(picture.shape[0] * width / picture.shape[1]))
        # Nothing is gained by blowing a picture up; the browser does that.
        small = (
            cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
            if width < picture.shape[1]
            else picture
        )
        done, encoded = cv2.imencode(
            ".jpg",
            cv2.cvtColor(small, cv2.COLOR_RGB2BGR),
            (cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1),
        )
        if not done:
            raise RenderError(f"a picture of {small.shape} cannot be made a JPEG")
        data = encoded.tobytes()
        if len(data) <= PICTURE_BYTES:
            break
    return base64.b64encode(data).decode("ascii")
