"""Pictures to bytes and back: the codecs that a database may store its crops in.

Each picture is encoded by itself, so that one can be read without its neighbours. Pictures in
memory are RGB uint8; OpenCV's encoders want BGR, and that is dealt with here and nowhere else.

A codec is named ``NAME`` or ``NAME:QUALITY``. Which is best is measured by benchmarks/codecs.py;
databases are built in what `codec_for` says.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image, features

from database.errors import DatabaseError

Picture = npt.NDArray[np.uint8]

AUTO_CODEC: Final = "auto"
"""Stands for what `codec_for` says."""

DEFAULT_CODEC: Final = "avif:85"
"""Of mouths that are too large for PNG: the smallest that keeps sharp ones above 42 dB."""

PNG_BYTES: Final = 1.45
"""A pixel of a mouth, losslessly."""

MOST_BYTES: Final = 15000.0
"""A unit: what a database of mouths should not exceed."""


@dataclass(frozen=True)
class Codec:
    """One way to encode a picture.

    Parameters
    ----------
    name : str
        As databases and the command line know it.
    signature : tuple of (int, bytes)
        Places and bytes by which encoded data is told from other data.
    write : callable
        Encodes a picture, contiguous RGB, at a quality; what it raises is an error of OpenCV,
        or an OSError or ValueError.
    whole : callable
        Whether data is as long as it says itself, or ends as it must: decoders may fill what is
        missing with grey.
    quality : int, optional
        1..100; None where nothing is lost.
    """

    name: str
    signature: tuple[tuple[int, bytes], ...]
    write: Callable[[Picture, int], bytes]
    whole: Callable[[bytes], bool]
    quality: int | None

    @property
    def lossless(self) -> bool:
        """Whether decoding gives back the very picture."""
        return self.quality is None

    def signs(self, data: bytes) -> bool:
        """Whether data begins as this codec's pictures do."""
        return all(data[at : at + len(mark)] == mark for at, mark in self.signature)


def codec_for(width: int, height: int) -> str:
    """Codec for crops of a size: lossless where that takes little, else `DEFAULT_CODEC`.

    Small mouths have no pixel to lose, and it is the large ones that fill disks.
    """
    return "png" if PNG_BYTES * width * height <= MOST_BYTES else DEFAULT_CODEC


def _opencv(extension: str, *options: int, quality: int | None = None) -> Callable[..., bytes]:
    """An encoder of OpenCV's; `quality` is the flag that sets it."""

    def write(picture: Picture, value: int) -> bytes:
        chosen = options if quality is None else (*options, quality, value)
        done, data = cv2.imencode(extension, cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), chosen)
        if not done:
            raise OSError("the encoder gave up")
        return bytes(data.tobytes())

    return write


def _avif(picture: Picture, quality: int) -> bytes:
    """Encode with Pillow, which can do what OpenCV cannot: tune for PSNR, keep colours whole.

    Small crops lose most by halved colours (2 dB at 88 x 93); one thread, since clips are
    encoded side by side.
    """
    if not features.check("avif"):
        raise OSError("this Pillow was built without AVIF; choose another codec")
    out = io.BytesIO()
    Image.fromarray(picture).save(
        out,
        "AVIF",
        quality=quality,
        subsampling="4:4:4",
        speed=9,
        codec="aom",
        max_threads=1,
        advanced={"tune": "psnr"},
    )
    return out.getvalue()


def _boxes_fill(data: bytes) -> bool:
    """Whether the boxes of an ISO media file, one after another, end where the data does."""
    at = 0
    while at + 8 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        if size < 8:
            return False
        at += size
    return at == len(data)


CODECS: Final[dict[str, Codec]] = {
    codec.name: codec
    for codec in (
        Codec(
            "png",
            ((0, b"\x89PNG\r\n\x1a\n"),),
            # Level 3 with the filter strategy: a tenth larger than level 6, a third of its time.
            _opencv(
                ".png",
                *(cv2.IMWRITE_PNG_COMPRESSION, 3),
                *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_FILTERED),
            ),
            lambda data: data[-8:-4] == b"IEND",
            quality=None,
        ),
        Codec(
            "webp",
            ((0, b"RIFF"), (8, b"WEBP")),
            _opencv(".webp", quality=cv2.IMWRITE_WEBP_QUALITY),
            lambda data: int.from_bytes(data[4:8], "little") + 8 == len(data),
            quality=95,
        ),
        Codec(
            "jpeg",
            ((0, b"\xff\xd8\xff"),),
            _opencv(
                ".jpg",
                *(cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
                *(cv2.IMWRITE_JPEG_OPTIMIZE, 1),
                quality=cv2.IMWRITE_JPEG_QUALITY,
            ),
            lambda data: data[-2:] == b"\xff\xd9",
            quality=95,
        ),
        Codec("avif", ((4, b"ftypavif"),), _avif, _boxes_fill, quality=85),
    )
}
"""Codecs by name, each with the quality that it has unless one is named."""


@lru_cache
def find_codec(name: str) -> Codec:
    """Look up a codec by its name.

    Parameters
    ----------
    name : str
        ``NAME``, or ``NAME:QUALITY`` with a quality of 1..100.

    Raises
    ------
    DatabaseError
        If there is none, naming those that there are, or it has no such quality.
    """
    base, colon, quality = name.partition(":")
    if base not in CODECS:
        known = ", ".join(sorted(CODECS))
        raise DatabaseError(f"no codec is named {name!r}; choose one of: {known}")
    codec = CODECS[base]
    if not colon:
        return codec
    if codec.lossless:
        raise DatabaseError(f"{name!r}: {base} loses nothing and has no quality; write {base}")
    if not (quality.isascii() and quality.isdecimal() and 1 <= int(quality) <= 100):
        raise DatabaseError(f"{name!r}: the quality must be 1 to 100, as in {base}:{codec.quality}")
    return replace(codec, quality=int(quality))


def encode(picture: Picture, codec: str = "png") -> bytes:
    """Encode one picture.

    Parameters
    ----------
    picture : (height, width, 3) uint8
        RGB.
    codec : str
        A codec as `find_codec` knows it.

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
        return how.write(np.ascontiguousarray(picture), how.quality or 0)
    except (cv2.error, OSError, ValueError) as error:
        why = getattr(error, "err", error)  # Of OpenCV's many lines, the one that says it.
        raise DatabaseError(f"a {picture.shape} picture cannot be {how.name}: {why}") from error


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
    encoded = buffer.tobytes()
    if not how.signs(encoded):
        raise DatabaseError(f"{len(buffer)} bytes do not begin as a {how.name} picture does")
    if not how.whole(encoded):
        raise DatabaseError(f"{len(buffer)} bytes are not a whole {how.name} picture")
    try:
        picture = cv2.imdecode(buffer, cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise DatabaseError(
            f"{len(buffer)} bytes are no {how.name} picture: {error.err}"
        ) from error
    if picture is None:
        raise DatabaseError(f"{len(buffer)} bytes are not a whole {how.name} picture")
    return np.asarray(picture, dtype=np.uint8)
