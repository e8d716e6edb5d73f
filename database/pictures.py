"""Pictures to bytes and back: the codecs that a database may store its crops in.

Each picture is encoded by itself, so that one can be read without its neighbours. Pictures in
memory are RGB uint8; OpenCV's encoders want BGR, and that is dealt with here and nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from database.errors import DatabaseError

Picture = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class Codec:
    """One way to encode a picture.

    Parameters
    ----------
    name : str
        As databases and the command line know it; also the extension for OpenCV.
    signature : tuple of (int, bytes)
        Places and bytes by which encoded data is told from other data.
    options : tuple of int
        Flags for `cv2.imencode`.
    lossless : bool
        Whether decoding gives back the very picture.
    """

    name: str
    signature: tuple[tuple[int, bytes], ...]
    options: tuple[int, ...]
    lossless: bool

    def signs(self, data: bytes) -> bool:
        """Whether data begins as this codec's pictures do."""
        return all(data[at : at + len(mark)] == mark for at, mark in self.signature)


CODECS: Final[dict[str, Codec]] = {
    codec.name: codec
    for codec in (
        Codec(
            "png",
            ((0, b"\x89PNG\r\n\x1a\n"),),
            # Level 3 with the filter strategy: a tenth larger than level 6, a third of its time.
            (
                *(cv2.IMWRITE_PNG_COMPRESSION, 3),
                *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_FILTERED),
            ),
            lossless=True,
        ),
        Codec(
            "webp",
            ((0, b"RIFF"), (8, b"WEBP")),
            (cv2.IMWRITE_WEBP_QUALITY, 95),
            lossless=False,
        ),
    )
}
"""Codecs by name; ``png`` is the default of databases."""


def find_codec(name: str) -> Codec:
    """Look up a codec by its name.

    Raises
    ------
    DatabaseError
        If there is none, naming those that there are.
    """
    try:
        return CODECS[name]
    except KeyError:
        known = ", ".join(sorted(CODECS))
        raise DatabaseError(f"no codec is named {name!r}; choose one of: {known}") from None


def encode(picture: Picture, codec: str = "png") -> bytes:
    """Encode one picture.

    Parameters
    ----------
    picture : (height, width, 3) uint8
        RGB.
    codec : str
        Name of a codec of `CODECS`.

    Returns
    -------
    bytes
        The same bytes for the same picture and library version.

    Raises
    ------
    DatabaseError
        If the codec is unknown, or the array is no such picture.
    """
    how = find_codec(codec)
    picture = np.asarray(picture)
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3 or not picture.size:
        raise DatabaseError(
            f"a picture must be (height, width, 3) uint8, got {picture.shape} {picture.dtype}"
        )
    try:
        done, data = cv2.imencode(
            f".{how.name}", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), how.options
        )
    except cv2.error as error:
        raise DatabaseError(
            f"a {picture.shape} picture cannot be {how.name}: {error.err}"
        ) from error
    if not done:
        raise DatabaseError(f"a {picture.shape} picture cannot be encoded as {how.name}")
    return bytes(data.tobytes())


def decode(data: bytes | npt.NDArray[np.uint8], codec: str = "png") -> Picture:
    """Decode one picture.

    Parameters
    ----------
    data : bytes or (n,) uint8
        What `encode` gave.
    codec : str
        The codec that it was encoded with.

    Returns
    -------
    (height, width, 3) uint8
        RGB.

    Raises
    ------
    DatabaseError
        If the codec is unknown, or the data is not a whole picture of it.
    """
    how = find_codec(codec)
    buffer = np.frombuffer(data, dtype=np.uint8)
    if not how.signs(buffer[:16].tobytes()):
        raise DatabaseError(f"{len(buffer)} bytes do not begin as a {how.name} picture does")
    try:
        picture = cv2.imdecode(buffer, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise DatabaseError(
            f"{len(buffer)} bytes are no {how.name} picture: {error.err}"
        ) from error
    if picture is None:
        raise DatabaseError(f"{len(buffer)} bytes are not a whole {how.name} picture")
    return np.asarray(picture, dtype=np.uint8)
